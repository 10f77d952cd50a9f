//! `outcrop generate`.

use crate::common::{self, Outcome};
use crate::output::Destination;
use outcrop::import::generate::{self, GenerateOptions};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// Write a generated model (mandelbulb, airliner) as a binary PLY file
#[derive(clap::Args)]
pub struct Args {
    /// Name of the model
    #[arg(value_parser = generate::NAMES)]
    name: String,
    /// Target number of triangles, reached within 2 %; suffix K, M or G for thousands, millions or billions
    #[arg(long, value_name = "N", default_value = "1M", allow_negative_numbers = true, value_parser = common::count)]
    triangles: u64,
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

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let to = Destination::new(&args.output, "ply", "a mesh file", &[], true)?;
    let cancel = common::cancel_on_ctrl_c();
    let options = GenerateOptions { triangles: args.triangles, seed: args.seed };
    let bar = common::progress_bar(args.triangles);
    let start = Instant::now();
    let watch = &mut |n| bar.set_position(n);
    let out = match &to {
        Destination::File(path) => generate::generate_file(&args.name, &options, &cancel, path, watch),
        Destination::Stdout => generate::generate_stream(&args.name, &options, &cancel, std::io::stdout(), watch),
    };
    bar.finish_and_clear();
    let made = out?;
    let seconds = start.elapsed().as_secs_f64();
    let value = json!({
        "file": args.output.to_string_lossy(), "name": args.name, "seed": args.seed,
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
