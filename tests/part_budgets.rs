//! Looks of parts within a budget: hidden parts cost no reads and are never shown, and neither hidden nor coloured
//! parts make a picture coarser.
//!
//! For measurements by hand, environment variables set the number of triangles (OUTCROP_AIRLINER) or the file of a
//! model that is built already (OUTCROP_AIRLINER_FILE), the bytes of the small budget (OUTCROP_BUDGET), and the number
//! of rows of the pictures (OUTCROP_ROWS).

use crate::common::changed::{self, Change};
use crate::common::frames::LONG;
use glam::{DAffine3, DVec3};
use outcrop::base::error::Result;
use outcrop::base::ids::BlockId;
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::GenerateOptions;
use outcrop::import::{Attributes, MeshKey, Sink};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs};
use outcrop::scene::{Context, ContextOptions, Look, Model, Scene, Scope};
use outcrop::store::ModelFile;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Width and height of the pictures.
fn size() -> (u32, u32) {
    let rows = from_environment("OUTCROP_ROWS", 240) as u32;
    (rows * 4 / 3, rows)
}

const HIDDEN: Look = Look { visible: false, colour: None, selected: false };

fn from_environment(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Passes on the triangles of some parts only.
struct Only<'a>(&'a dyn Fn(u32) -> bool);

impl Change for Only<'_> {
    fn triangles(
        &mut self,
        to: &mut Builder,
        (mesh, part): (MeshKey, u32),
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        if (self.0)(part) { to.triangles(mesh, part, positions, attributes) } else { Ok(()) }
    }
}

fn build(folder: &Path, name: &str, keeps: &dyn Fn(u32) -> bool) -> PathBuf {
    let size =
        GenerateOptions { triangles: from_environment("OUTCROP_AIRLINER", 200_000), seed: 0, ..Default::default() };
    let (path, options) = (folder.join(name), BuildOptions { threads: 2, ..BuildOptions::default() });
    changed::build(&path, "airliner", &size, options, Only(keeps));
    path
}

pub struct Airliner {
    pub path: PathBuf,
    folder: tempfile::TempDir,
}

pub fn airliner() -> &'static Airliner {
    static BUILT: OnceLock<Airliner> = OnceLock::new();
    BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let given = std::env::var_os("OUTCROP_AIRLINER_FILE").map(PathBuf::from);
        let path = given.unwrap_or_else(|| build(folder.path(), "airliner.oc", &|_| true));
        Airliner { path, folder }
    })
}

/// A scene with one instance of the model, of which no block but the roots is in memory.
pub fn open(path: &Path, memory_budget: u64) -> (Context, Scene, Model) {
    let options = ContextOptions { threads: 2, memory_budget, read_ahead: false, ..Default::default() };
    let context = Context::new(options).expect("a context");
    let model = Model::open_cold(&context, path).expect("a model");
    let scene = Scene::new(&context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    (context, scene, model)
}

/// The ids of the parts with triangles.
fn parts_of(model: &Model) -> Vec<u64> {
    model.parts().iter().filter(|part| part.triangles > 0).map(|part| part.id).collect()
}

fn every(parts: &[u64], step: usize) -> Vec<u64> {
    parts.iter().copied().skip(step / 2).step_by(step).collect()
}

struct Picture {
    status: FrameStatus,
    part: Vec<u64>,
    depth: Vec<f32>,
    colour: Vec<f32>,
}

impl Picture {
    /// Pixels that show one of `parts`.
    fn shows(&self, parts: &HashSet<u64>) -> usize {
        self.part.iter().filter(|part| parts.contains(part)).count()
    }
}

/// The picture that fits the budget at once.
fn picture(context: &Context, scene: &Scene, model: &Model, poe: f32) -> Picture {
    let (width, height) = size();
    let options = FrameOptions { width, height, outputs: Outputs::ALL, ..Default::default() };
    let frame = Frame::new(context, options).expect("a frame");
    let settings = FrameSettings { poe, ambient: 1.0, at_once: true, ..FrameSettings::default() };
    scene.set_lights(vec![]).expect("no lights");
    scene.commit().expect("a commit");
    frame.request(&scene.state(), &model.views()[0], &settings).expect("a request");
    let status = frame.wait(LONG);
    assert!(matches!(status.state, FrameState::Converged | FrameState::CompleteWithinBudget), "{status:?}");
    let map = |buffer| frame.map(buffer).expect("a picture");
    Picture {
        part: map(Buffer::Part).ids().expect("ids").to_vec(),
        depth: map(Buffer::Depth).floats().expect("floats").to_vec(),
        colour: map(Buffer::ColourLinear).floats().expect("floats").to_vec(),
        status,
    }
}

/// Bytes, in memory, of the geometry blocks that hold one of `parts`.
fn bytes_with(file: &ModelFile, parts: &HashSet<u32>) -> u64 {
    let (sets, tree) = (file.part_sets().expect("sets"), &file.trees()[0]);
    let [coarse, fine, ..] = tree.class_blocks;
    let bytes = |block: u32| u64::from(file.decoded_len(BlockId(block)));
    let blocks = (0..coarse + fine).filter(|&block| sets.of(block as usize).any(|part| parts.contains(&part)));
    blocks.map(|block| bytes(block) + if block >= coarse { bytes(block + fine) } else { 0 }).sum()
}

/// Isolating parts reads the blocks that hold them, not the model.
#[test]
fn isolated_parts_cost_their_own_blocks() {
    let path = &airliner().path;
    let (context, scene, model) = open(path, 0);
    let parts = parts_of(&model);
    let ten = every(&parts, parts.len() / 10);
    scene.isolate_parts(7, &ten, Scope::Own).expect("ten parts");
    let file = ModelFile::open_path(path).expect("a file");
    let index = |id: &u64| model.part_index(*id).expect("a part");
    let least = bytes_with(&file, &ten.iter().map(index).collect());
    let others: HashSet<u64> = parts.iter().filter(|id| !ten.contains(id)).copied().collect();
    for poe in [3.0, 0.0] {
        let picture = picture(&context, &scene, &model, poe);
        let read = model.memory().resident;
        println!(
            "PoE {poe}: {read} bytes read; {least} hold ten of {} parts, {} in all",
            parts.len(),
            model.memory().geometry
        );
        assert_eq!(picture.shows(&others), 0);
        assert!(picture.shows(&ten.iter().copied().collect()) > 20, "nothing is seen");
        assert!(read <= 3 * least && 3 * least < model.memory().geometry, "{read} of {least}");
    }
}

/// The sets of parts count once while they stay, and twice only while they are read.
#[test]
fn the_parts_of_blocks_count_once() {
    let path = &airliner().path;
    let (context, scene, model) = open(path, 0);
    let file = ModelFile::open_path(path).expect("a file");
    let (stay, before) = (file.part_sets().expect("sets").memory(), context.memory_used());
    assert!(stay > 16 << 10 && file.part_sets_memory() == 2 * stay, "{stay}");
    let part = parts_of(&model)[0];
    scene.set_parts_look(7, &[part], Scope::Own, HIDDEN).expect("a look");
    assert_eq!(context.memory_used() - before, stay);
}

/// Exact pictures equal those of a model that was built without the hidden parts.
#[test]
fn exact_pictures_are_those_of_a_model_without_the_hidden_parts() {
    let built = airliner();
    let (context, scene, model) = open(&built.path, 0);
    let parts = parts_of(&model);
    let hidden = every(&parts, 10);
    scene.set_parts_look(7, &hidden, Scope::Own, HIDDEN).expect("looks");
    let hidden: HashSet<u64> = hidden.into_iter().collect();
    let are_hidden: Vec<bool> = model.parts().iter().map(|part| hidden.contains(&part.id)).collect();
    let without = build(built.folder.path(), "without.oc", &|part| !are_hidden[part as usize]);
    let (other_context, other_scene, other_model) = open(&without, 0);
    let own = picture(&context, &scene, &model, 0.0);
    let others = picture(&other_context, &other_scene, &other_model, 0.0);
    assert!(own.part == others.part && own.depth == others.depth && own.colour == others.colour);
    assert_eq!(own.status.pixels_exact, own.status.pixels_total);
}

/// In a budget that is too small, what is hidden is never shown, what is coloured has its colour, and the picture is
/// about as fine as with all parts as in the file.
#[test]
fn looks_do_not_make_pictures_coarser() {
    let path = &airliner().path;
    let (_, _, model) = open(path, 0);
    let parts = parts_of(&model);
    let (tenth, fifty) = (every(&parts, 10), every(&parts, parts.len() / 50));
    let green = Look { colour: Some([0.0, 1.0, 0.0, 1.0]), ..Look::default() };
    let whole = model.memory().geometry;
    // Thresholds change in steps: near the edge of one, two pictures that need nearly the same are two steps apart, or
    // none, as it happens. This budget is not near one.
    let budget = from_environment("OUTCROP_BUDGET", (whole * 5 / 8).max(8 << 20));
    for poe in [3.0, 1.0] {
        let seen = |parts: &[u64], look: Look| {
            let (context, scene, model) = open(path, budget);
            scene.set_parts_look(7, parts, Scope::Own, look).expect("looks");
            picture(&context, &scene, &model, poe)
        };
        let (plain, without, coloured) = (seen(&[], HIDDEN), seen(&tenth, HIDDEN), seen(&fifty, green));
        let of = |picture: &Picture| {
            (picture.status.effective_poe, picture.status.mean_error_px, picture.status.worst_error_px)
        };
        println!(
            "PoE {poe} in {budget} of {whole}: none {:?}, a tenth hidden {:?}, fifty coloured {:?}",
            of(&plain),
            of(&without),
            of(&coloured)
        );
        assert_eq!(without.shows(&tenth.iter().copied().collect()), 0);
        // One step of the threshold.
        let most = 1.2501 * plain.status.effective_poe;
        assert!(without.status.effective_poe <= most);
        assert!(coloured.status.effective_poe <= most);
        let fifty: HashSet<u64> = fifty.iter().copied().collect();
        assert!(coloured.shows(&fifty) > 10, "nothing is seen");
        for (part, colour) in coloured.part.iter().zip(coloured.colour.chunks(4)) {
            let is_green = colour[..3] == [0.0, 1.0, 0.0];
            assert_eq!(is_green, fifty.contains(part), "part {part}: {colour:?}");
        }
    }
}
