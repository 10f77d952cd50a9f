//! `outcrop generate forest`: a scene file, and the models of its plants in a folder beside it.
//!
//! The scene has two levels. Each tile is a scene with an array of trees, which are instances of the plants; the ground
//! and an array of tiles make the whole. A level of blocks of tiles between them would not pay: tiles have no period,
//! so that no block would occur twice.

use crate::common::{self, Failure, Outcome};
use crate::output::Destination;
use glam::{DAffine3, DVec2, DVec3};
use indicatif::ProgressBar;
use outcrop::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::{self, Forest, ForestOptions, GenerateOptions, SPECIES};
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink, UpAxis};
use outcrop::scene::{Context, ContextOptions, Instances, Model, Place, Prototypes, Scene, Transforms};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Options of a forest with its plants.
pub struct Options {
    pub trees: ForestOptions,
    /// Target number of triangles of each plant.
    pub triangles: u64,
}

/// Id of the ground in the outer scene.
const GROUND: u64 = 0;
/// Id of the first tile in the outer scene; the others follow by rows.
const TILES: u64 = 1;
/// Id of the first tree in the scene of a tile.
const TREES: u64 = 0;
/// Steps of the progress bar for each model.
const STEPS: u64 = 1000;

/// Runs the command.
pub fn run(options: &Options, output: &Path, json: bool) -> Outcome {
    let to = Destination::new(output, "oc", "a scene file", &[], false)?;
    let cancel = common::cancel_on_ctrl_c();
    let start = Instant::now();
    let forest = Forest::plant(&options.trees, &cancel)?;
    let mut folder = Folder::create(output.with_extension("plants"))?;
    let plants = build(options, &forest, &mut folder, &cancel)?;
    let context = Context::new(ContextOptions::default())?;
    let models = folder.files.iter().map(|path| Model::open(&context, path)).collect::<Result<Vec<_>, _>>()?;
    let bytes_plants: u64 = models.iter().map(|model| model.info().file_bytes).sum();
    cancel.check()?;
    let scene = scene(&context, &forest, models)?;
    let bytes = scene.save(output)?;
    folder.goes = false;
    let seconds = start.elapsed().as_secs_f64();
    let triangles = triangles(&forest, &plants);
    let (across, side) = (forest.across(), forest.side());
    let value = json!({
        "file": output.to_string_lossy(), "name": "forest", "seed": options.trees.seed, "trees": forest.trees(),
        "spacing": options.trees.spacing, "species": plants.len(), "triangles_each": plants, "triangles": triangles,
        "tiles": across, "tile_metres": side, "plants": folder.path.to_string_lossy(), "bytes": bytes,
        "bytes_plants": bytes_plants, "seconds": seconds,
    });
    let text = format!(
        "{}: {} trees, {triangles} triangles, on {across} x {across} tiles of {side:.1} m, of {}\n\
         {} in {}, {} in {}; {seconds:.1} s",
        output.display(),
        forest.trees(),
        common::counted_as(plants.len() as u64, "species", "species"),
        common::in_bytes(bytes),
        output.display(),
        common::in_bytes(bytes_plants),
        folder.path.display(),
    );
    to.report(json, &value, &text)
}

/// The folder of the models. It goes with its files when the run fails.
struct Folder {
    path: PathBuf,
    /// The plants by number, then the ground.
    files: Vec<PathBuf>,
    goes: bool,
}

impl Folder {
    fn create(path: PathBuf) -> Result<Self, Failure> {
        // An older forest would lose its plants one by one, and fit none of the new ones if the run ends early.
        if path.exists() {
            let why = format!("{} is there already: remove it, or name another output", path.display());
            return Err(Error::bad_argument(why).into());
        }
        fs::create_dir_all(&path).map_err(|e| Error::io(&path, "create", e))?;
        Ok(Self { path, files: Vec::new(), goes: true })
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if self.goes {
            // Nothing can be done about files that stay. The folder stays if others are in it.
            self.files.iter().for_each(|file| drop(fs::remove_file(file)));
            drop(fs::remove_dir(&self.path));
        }
    }
}

/// Builds the plants and the ground; returns the number of triangles of each plant.
fn build(options: &Options, forest: &Forest, folder: &mut Folder, cancel: &Cancel) -> Result<Vec<u64>, Failure> {
    let count = u64::from(options.trees.species);
    let bar = common::progress_bar((count + 1) * STEPS);
    let mut triangles = Vec::new();
    for species in 0..options.trees.species {
        let of = GenerateOptions { triangles: options.triangles, seed: options.trees.seed, species };
        let name = SPECIES[species as usize].replace(' ', "-");
        let made = model(folder, &name, (&bar, species.into()), cancel, |sink| {
            generate::generate("plant", &of, cancel, sink).map(|made| made.triangles)
        })?;
        triangles.push(made);
    }
    let half = 0.5 * forest.side() * f64::from(forest.across());
    model(folder, "ground", (&bar, count), cancel, |sink| ground(half, sink))?;
    bar.finish_and_clear();
    Ok(triangles)
}

/// Builds one model of the folder, which has step `at` of the progress bar. Returns what `fill` returns.
fn model(
    folder: &mut Folder,
    name: &str,
    (bar, at): (&ProgressBar, u64),
    cancel: &Cancel,
    fill: impl FnOnce(&mut Builder) -> Result<u64, Error>,
) -> Result<u64, Failure> {
    let progress = Arc::new(Progress::default());
    let mut builder = Builder::new(BuildOptions::default(), Arc::clone(&progress), cancel.clone())?;
    let path = folder.path.join(name).with_extension("oc");
    let filled = common::watched_part(&progress, bar, at * STEPS..(at + 1) * STEPS, || {
        let filled = fill(&mut builder)?;
        builder.finish(&path).map(|_| filled)
    })?;
    folder.files.push(path);
    Ok(filled)
}

/// A square of two triangles. Returns their number.
fn ground(half: f64, sink: &mut dyn Sink) -> Result<u64, Error> {
    sink.units(Some(1.0), UpAxis::Z);
    let material = sink.material(MaterialDesc { colour: [0.09, 0.11, 0.04], roughness: 1.0, ..Default::default() })?;
    let part = PartDesc { id: Some(1), name: "ground".into(), parent: None, material: Some(material) };
    let part = sink.part(part)?;
    let [a, b, c, d] =
        [[-half, -half], [half, -half], [half, half], [-half, half]].map(|corner| DVec2::from(corner).extend(0.0));
    sink.triangles(MeshKey::DIRECT, part, &[[a, b, c], [a, c, d]], Attributes::NONE)?;
    Ok(2)
}

/// Makes the scene. `models`: the plants by number, then the ground.
fn scene(context: &Context, forest: &Forest, mut models: Vec<Model>) -> Result<Scene, Failure> {
    let Some(ground) = models.pop() else { return Err(Error::Internal("no ground".into()).into()) };
    let tiles = forest.tiles().iter().map(|trees| {
        let place = |tree: &generate::Tree| Place {
            position: tree.place.extend(0.0),
            rotation: tree.rotation,
            scale: tree.scale,
        };
        let tile = Scene::new(context);
        tile.add_instances(&Instances {
            prototypes: models.clone().into(),
            prototype_of: trees.iter().map(|tree| tree.species).collect(),
            transforms: Transforms::Places(trees.iter().map(place).collect()),
            first_id: TREES,
            mask: u32::MAX,
            masks: None,
            tints: None,
        })?;
        tile.commit()?;
        Ok::<_, Error>(tile)
    });
    let tiles = tiles.collect::<Result<Vec<_>, _>>()?;
    let cells = || (0..forest.across()).flat_map(|row| (0..forest.across()).map(move |column| (column, row)));
    let place = |(column, row)| {
        let position: DVec3 = forest.middle_of(column, row).extend(0.0);
        Place { position, rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 }
    };
    let all = Scene::new(context);
    all.add_instance(&ground, GROUND, DAffine3::IDENTITY)?;
    all.add_instances(&Instances {
        prototypes: Prototypes::Scenes(tiles),
        prototype_of: cells().map(|(column, row)| forest.tile_at(column, row) as u32).collect(),
        transforms: Transforms::Places(cells().map(place).collect()),
        first_id: TILES,
        mask: u32::MAX,
        masks: None,
        tints: None,
    })?;
    all.commit()?;
    Ok(all)
}

/// Number of triangles of all trees.
fn triangles(forest: &Forest, plants: &[u64]) -> u64 {
    let of_tile = |trees: &Vec<generate::Tree>| trees.iter().map(|tree| plants[tree.species as usize]).sum::<u64>();
    let of_tiles: Vec<u64> = forest.tiles().iter().map(of_tile).collect();
    let cells = (0..forest.across()).flat_map(|row| (0..forest.across()).map(move |column| (column, row)));
    cells.map(|(column, row)| of_tiles[forest.tile_at(column, row)]).sum()
}
