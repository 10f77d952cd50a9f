//! `outcrop check`.

use crate::common::{self, Failure, Outcome};
use outcrop::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use outcrop::store::scene_file::is_scene_file;
use outcrop::store::{CheckReport, FileSource, Outline, Source};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Read every byte of a model file, or of a scene file and its models, and check it: checksums, padding, tables, trees
#[derive(clap::Args)]
pub struct Args {
    /// The model file or the scene file
    #[arg(value_name = "FILE.oc")]
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
    if is_scene_file(&FileSource::open(&args.model)?)? {
        return scene(args, &context, &cancel);
    }
    let (report, triangles) = model(&context, &args.model, &cancel)?;
    let value = json!({
        "file": args.model.to_string_lossy(), "ok": true, "bytes": report.bytes, "blocks": report.blocks,
        "bytes_payload": report.payload_bytes, "bytes_trace": report.decoded_bytes, "triangles": triangles,
    });
    let text = format!(
        "{}: valid; {} in {}, {}",
        args.model.display(),
        common::in_bytes(report.bytes),
        common::counted(report.blocks.into(), "block"),
        common::counted(triangles, "triangle"),
    );
    common::print(args.json, &value, &text)
}

/// Checks a model file. Also returns the number of its stored triangles.
fn model(context: &Context, path: &Path, cancel: &Cancel) -> Result<(CheckReport, u64), Failure> {
    let outline = Outline::read(Arc::new(FileSource::open(path)?))?;
    let (need, have) = (outline.memory(), context.memory_budget());
    if need > have {
        let what = format!("the tables of {}", path.display());
        return Err(Error::OverBudget { what, need, have }.into());
    }
    let file = outline.open(cancel)?;
    let (progress, bar) = (Progress::default(), common::progress_bar(1000));
    let report = common::watched(&progress, &bar, || file.check(&progress, cancel));
    bar.finish_and_clear();
    let report = report?;
    // Decodes and validates every block of geometry, and checks the links between blocks.
    drop(file);
    let model = Model::open(context, path)?;
    model.check(cancel)?;
    Ok((report, model.info().triangles_stored))
}

/// Checks a scene file and its models.
fn scene(args: &Args, context: &Context, cancel: &Cancel) -> Outcome {
    let bytes = FileSource::open(&args.model)?.len();
    let scene = Scene::open(context, &args.model)?.state();
    let (summary, models) = (scene.summary(), scene.models());
    let paths: Vec<PathBuf> = models.iter().filter_map(Model::path).map(Path::to_path_buf).collect();
    drop(scene);
    let (mut bytes_models, mut triangles) = (0, 0);
    for path in &paths {
        let (report, of_model) = model(context, path, cancel)?;
        (bytes_models, triangles) = (bytes_models + report.bytes, triangles + of_model);
    }
    let value = json!({
        "file": args.model.to_string_lossy(), "ok": true, "bytes": bytes, "models": paths.len(),
        "bytes_models": bytes_models, "triangles": triangles, "scenes": summary.scenes, "stored": summary.stored,
    });
    let text = format!(
        "{}: valid; {} with {} in {}, and {} of {}, {}",
        args.model.display(),
        common::in_bytes(bytes),
        common::counted(summary.stored, "instance"),
        common::counted(summary.scenes, "scene"),
        common::counted(paths.len() as u64, "model"),
        common::in_bytes(bytes_models),
        common::counted(triangles, "triangle"),
    );
    common::print(args.json, &value, &text)
}
