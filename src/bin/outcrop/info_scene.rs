//! `outcrop info` of a scene file.

use crate::common::{self, Outcome};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use outcrop::store::{FileSource, Source};
use serde_json::{Value, json};
use std::path::Path;

/// Opens a scene file and prints what it holds.
pub fn run(path: &Path, json: bool) -> Outcome {
    let context = Context::new(ContextOptions::default())?;
    let bytes = FileSource::open(path)?.len();
    let scene = Scene::open(&context, path)?.state();
    let (it, bounds) = (scene.summary(), scene.bounds());
    let models: Vec<Value> = scene.models().iter().map(model_as_json).collect();
    let value = json!({
        "file": path.to_string_lossy(), "bytes": bytes, "models": models, "scenes": it.scenes, "levels": it.levels,
        "stored": it.stored, "instances": it.instances, "occurrences": it.occurrences,
        "bytes_each": each(bytes, it.stored), "bytes_memory": it.bytes, "bytes_memory_each": each(it.bytes, it.stored),
        "bounds": if bounds.is_empty() {
            Value::Null
        } else {
            json!({ "min": bounds.min.to_array(), "max": bounds.max.to_array() })
        },
    });
    let of_each = |bytes: u64| each(bytes, it.stored).map_or(String::new(), |each| format!(", {each:.1} bytes each"));
    let mut text = format!(
        "{}: a scene, {}, {} in {}\n\
         {} in {}{}; in memory {}{}\n\
         {} and {} in all places\n",
        path.display(),
        common::counted(models.len() as u64, "model"),
        common::counted(it.scenes, "scene"),
        common::counted(it.levels.into(), "level"),
        common::counted_as(it.stored, "stored instance", "stored instances"),
        common::in_bytes(bytes),
        of_each(bytes),
        common::in_bytes(it.bytes),
        of_each(it.bytes),
        common::counted(it.instances, "instance"),
        common::counted_as(it.occurrences, "mesh", "meshes"),
    );
    text += &match bounds.is_empty() {
        true => "bounds empty\n".into(),
        false => format!("bounds {:?} .. {:?}\n", bounds.min.to_array(), bounds.max.to_array()),
    };
    for model in scene.models() {
        let info = model.info();
        let (triangles, bytes) =
            (common::counted(info.triangles_stored, "triangle"), common::in_bytes(info.file_bytes));
        text += &format!("model {}: {triangles}, {bytes}\n", info.name);
    }
    common::print(json, &value, &text)
}

fn model_as_json(model: &Model) -> Value {
    let info = model.info();
    json!({
        "file": info.name, "bytes": info.file_bytes, "triangles": info.triangles_stored,
        "triangles_placed": info.triangles_placed, "parts": info.parts,
    })
}

/// Bytes of each of some objects, if there are any.
fn each(bytes: u64, count: u64) -> Option<f64> {
    (count > 0).then(|| bytes as f64 / count as f64)
}
