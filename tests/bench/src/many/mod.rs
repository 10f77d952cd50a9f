//! Measures scenes of many instances of one model, a forest: commits, edits, and rays in three views, beside Embree's
//! scene of two levels in the same run.

mod commits;
mod forest;
mod table;
mod traced;

use crate::data::Residency;
use crate::failure::Failure;
use crate::ours::{ModelAt, Ours};
use crate::record::Record;
use crate::trace::Task;
use commits::Mine;
use forest::Forest;
pub use table::table;
pub use traced::timed;

/// The side that is ours, as records call it.
fn side_of(task: &Task) -> String {
    task.benchmark.structures[0].clone()
}

/// A benchmark on one model.
pub fn measure(task: &mut Task) -> Result<Vec<Record>, Failure> {
    let row = task.data.structure(&task.benchmark.structures[0]);
    let stored = ModelAt { places: Vec::new(), ..task.scene.model(row)? };
    let Ours { context, model, .. } = Ours::open(&stored, Residency::All, 0)?;
    let forest = Forest::new(task.benchmark.instances);
    let mut records = commits::measure(task, &context, &model, &forest)?;
    let state = Mine::new(&context, &model, &forest).scene().state();
    records.extend(traced::measure(task, &Ours { context, model, state }, &stored, &forest)?);
    Ok(records)
}
