//! `outcrop generate`.

use crate::common::{self, Failure, Outcome};
use crate::output::Destination;
use outcrop::import::generate::{self, GenerateOptions, SPECIES};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Write a generated model (mandelbulb, airliner, plant) as a binary PLY file
#[derive(clap::Args)]
pub struct Args {
    /// Name of the model
    #[arg(value_parser = generate::NAMES)]
    name: String,
    /// Target number of triangles, reached within 2 %; suffix K, M or G for thousands, millions or billions. Default:
    /// 25K for a plant, 1M for other models
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = common::count)]
    triangles: Option<u64>,
    /// Species of the plant, by number or name: 0 spruce, 1 pine, 2 cypress, 3 oak, 4 birch, 5 poplar, 6 willow,
    /// 7 palm, 8 shrub, 9 fern, 10 grass, 11 dead tree, 12 bamboo. Parts of a plant: 2 bark, 3 twigs, 4 leaves
    #[arg(long, value_name = "0..12 or NAME", allow_negative_numbers = true, value_parser = species)]
    species: Option<u32>,
    /// Seed; different seeds give different models
    #[arg(long, default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,
    /// The file to write: a regular file or a new one. "-": standard output
    #[arg(short, long, value_name = "FILE.ply")]
    output: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Parses the number or the name of a species.
fn species(text: &str) -> Result<u32, String> {
    let named = SPECIES.iter().position(|&name| name == text);
    match named.or_else(|| text.parse().ok()) {
        Some(number) if number < SPECIES.len() => Ok(number as u32),
        _ => Err(format!("expected a number from 0 to 12, or one of {}", SPECIES.join(", "))),
    }
}

/// Returns the options of the generator. A plant needs a species, and no other model has one.
fn options(args: &Args) -> Result<GenerateOptions, Failure> {
    let (is_plant, seed) = (args.name == "plant", args.seed);
    let species = match args.species {
        None if is_plant => {
            return Err(Failure::Usage(format!("plant requires --species: 0 to 12, or one of {}", SPECIES.join(", "))));
        }
        Some(_) if !is_plant => return Err(Failure::Usage(format!("--species: {} has no species", args.name))),
        species => species.unwrap_or(0),
    };
    Ok(GenerateOptions {
        triangles: args.triangles.unwrap_or(if is_plant { 25_000 } else { 1_000_000 }),
        seed,
        species,
    })
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let options = options(args)?;
    let to = Destination::new(&args.output, "ply", "a mesh file", &[], true)?;
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
    let species = args.species.map(|number| SPECIES[number as usize]);
    let value = json!({
        "file": args.output.to_string_lossy(), "name": args.name, "seed": args.seed, "species": species,
        "triangles": made.triangles, "vertices": made.vertices, "parts": made.parts, "seconds": seconds,
    });
    let text = format!(
        "{}: {} triangles, {} vertices, {} parts in {seconds:.1} s",
        args.output.display(),
        made.triangles,
        made.vertices,
        made.parts
    );
    to.report(args.json, &value, &text)
}
