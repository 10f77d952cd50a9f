//! `outcrop check`.

use crate::common::{self, Outcome};
use outcrop::Error;
use outcrop::base::progress::Progress;
use outcrop::scene::{Context, ContextOptions, Model};
use outcrop::store::{FileSource, Outline};
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;

/// Read every byte of a model file and check it: checksums, padding, tables, trees
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "MODEL.oc")]
    model: PathBuf,
    /// Bytes of memory for opening the model, with suffix K, M, G or T; 0 for three quarters of the machine's memory
    #[arg(long, visible_alias = "cache", value_name = "BYTES", default_value = "0", allow_negative_numbers = true, value_parser = common::byte_size)]
    memory: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let cancel = common::cancel_on_ctrl_c();
    let context = Context::new(ContextOptions { memory_budget: args.memory, ..ContextOptions::default() })?;
    let outline = Outline::read(Arc::new(FileSource::open(&args.model)?))?;
    let (need, have) = (outline.memory(), context.memory_budget());
    if need > have {
        let what = format!("the tables of {}", args.model.display());
        return Err(Error::OverBudget { what, need, have }.into());
    }
    let file = outline.open(&cancel)?;
    let (progress, bar) = (Progress::default(), common::progress_bar(1000));
    let report = common::watched(&progress, &bar, || file.check(&progress, &cancel));
    bar.finish_and_clear();
    let report = report?;
    // Decodes and validates every block of geometry, and checks the links between blocks.
    drop(file);
    let model = Model::open(&context, &args.model)?;
    model.check(&cancel)?;
    let value = json!({
        "file": args.model.to_string_lossy(), "ok": true, "bytes": report.bytes, "blocks": report.blocks,
        "bytes_payload": report.payload_bytes, "bytes_trace": report.decoded_bytes,
        "triangles": model.info().triangles_stored,
    });
    let text = format!(
        "{}: valid; {} in {}, {}",
        args.model.display(),
        common::in_bytes(report.bytes),
        common::counted(report.blocks.into(), "block"),
        common::counted(model.info().triangles_stored, "triangle"),
    );
    common::print(args.json, &value, &text)
}
