//! `outcrop generate`.

use crate::common::{self, Failure, Outcome};
use crate::forest;
use crate::output::Destination;
use outcrop::import::generate::{self, ForestOptions, GenerateOptions, SPECIES};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Names of what can be generated: the models, and the forest.
const NAMES: [&str; 4] = {
    let [bulb, airliner, plant] = generate::NAMES;
    [bulb, airliner, plant, FOREST]
};
const FOREST: &str = "forest";

/// Write a generated model (mandelbulb, airliner, plant) as a binary PLY file, or a forest as a scene file with the
/// models of its plants
#[derive(clap::Args)]
pub struct Args {
    /// Name of the model, or forest
    #[arg(value_parser = NAMES)]
    name: String,
    /// The file to write: OUT.ply, for a forest OUT.oc; -o names it likewise
    #[arg(value_name = "OUT", required_unless_present = "output", conflicts_with = "output")]
    out: Option<PathBuf>,
    /// Target number of triangles, reached within 2 %: of the model, or of each plant of a forest; suffix K, M or G for
    /// thousands, millions or billions. Default: 25K for plants, 1M for other models
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = common::count)]
    triangles: Option<u64>,
    /// Species of the plant, by number or name: 0 spruce, 1 pine, 2 cypress, 3 oak, 4 birch, 5 poplar, 6 willow,
    /// 7 palm, 8 shrub, 9 fern, 10 grass, 11 dead tree, 12 bamboo. Parts of a plant: 2 bark, 3 twigs, 4 leaves. Of
    /// a forest the number of species, from 1 to 13: the first ones. Default: 13
    #[arg(long, value_name = "0..12 or NAME", allow_negative_numbers = true, value_parser = species)]
    species: Option<Species>,
    /// Target number of trees of a forest, reached within 1 %: from 100 to 1T; suffix K, M, G or T. Default: 1M
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = common::count)]
    trees: Option<u64>,
    /// Least distance between the trees of a forest. Default: 5
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, value_parser = common::positive)]
    spacing: Option<f64>,
    /// Seed; different seeds give different models
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,
    /// The file to write: a regular file or a new one. "-": standard output. The plants of a forest go to the folder
    /// OUT.plants beside OUT.oc
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Value of `--species`.
#[derive(Debug, Clone, Copy)]
enum Species {
    /// A number: of a species, or how many.
    Number(u32),
    /// The number of a species that was given by its name.
    Named(u32),
}

/// Parses the number or the name of a species.
fn species(text: &str) -> Result<Species, String> {
    match SPECIES.iter().position(|&name| name == text) {
        Some(number) => Ok(Species::Named(number as u32)),
        None => text.parse().map(Species::Number).map_err(|_| no_species()),
    }
}

fn no_species() -> String {
    format!("expected a number from 0 to 12, or one of {}", SPECIES.join(", "))
}

/// Returns the options of the generator of a model. A plant needs a species, and no other model has one.
fn options(args: &Args) -> Result<GenerateOptions, Failure> {
    let (is_plant, seed) = (args.name == "plant", args.seed);
    for (option, is_given) in [("--trees", args.trees.is_some()), ("--spacing", args.spacing.is_some())] {
        if is_given {
            return Err(Failure::Usage(format!("{option}: only a forest has it, not {}", args.name)));
        }
    }
    let species = match args.species {
        None if is_plant => {
            return Err(Failure::Usage(format!("plant requires --species: 0 to 12, or one of {}", SPECIES.join(", "))));
        }
        Some(_) if !is_plant => return Err(Failure::Usage(format!("--species: {} has no species", args.name))),
        Some(Species::Number(number)) if number as usize >= SPECIES.len() => {
            let why = no_species();
            return Err(Failure::Usage(format!("invalid value '{number}' for '--species <0..12 or NAME>': {why}")));
        }
        Some(Species::Number(number) | Species::Named(number)) => number,
        None => 0,
    };
    Ok(GenerateOptions {
        triangles: args.triangles.unwrap_or(if is_plant { PLANT_TRIANGLES } else { 1_000_000 }),
        seed,
        species,
    })
}

/// Triangles of a plant by default.
const PLANT_TRIANGLES: u64 = 25_000;

/// Returns the options of a forest.
fn forest_options(args: &Args) -> Result<forest::Options, Failure> {
    let defaults = ForestOptions::default();
    let species = match args.species {
        None => defaults.species,
        Some(Species::Number(count)) => count,
        Some(Species::Named(_)) => {
            return Err(Failure::Usage("--species: a forest takes the number of its species, 1 to 13".into()));
        }
    };
    let trees = ForestOptions {
        trees: args.trees.unwrap_or(defaults.trees),
        spacing: args.spacing.unwrap_or(defaults.spacing),
        species,
        seed: args.seed,
    };
    Ok(forest::Options { trees, triangles: args.triangles.unwrap_or(PLANT_TRIANGLES) })
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let Some(output) = args.out.as_ref().or(args.output.as_ref()) else {
        return Err(Failure::Usage("name the file to write".into()));
    };
    if args.name == FOREST {
        return forest::run(&forest_options(args)?, output, args.json);
    }
    let options = options(args)?;
    let to = Destination::new(output, "ply", "a mesh file", &[], true)?;
    let cancel = common::cancel_on_ctrl_c();
    let bar = common::progress_bar(options.triangles);
    let start = Instant::now();
    let watch = &mut |n| bar.set_position(n);
    let out = match &to {
        Destination::File(path) => generate::generate_file(&args.name, &options, &cancel, path, watch),
        Destination::Stdout => generate::generate_stream(&args.name, &options, &cancel, std::io::stdout(), watch),
    };
    bar.finish_and_clear();
    let made = out?;
    let seconds = start.elapsed().as_secs_f64();
    let species = args.species.map(|_| SPECIES[options.species as usize]);
    let value = json!({
        "file": output.to_string_lossy(), "name": args.name, "seed": args.seed, "species": species,
        "triangles": made.triangles, "vertices": made.vertices, "parts": made.parts, "seconds": seconds,
    });
    let text = format!(
        "{}: {} triangles, {} vertices, {} parts in {seconds:.1} s",
        output.display(),
        made.triangles,
        made.vertices,
        made.parts
    );
    to.report(args.json, &value, &text)
}
