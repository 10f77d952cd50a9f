//! Bytes a triangle against accuracy, and the working set against accuracy: model no more than a scene needs.

use super::axis::Axis;
use super::draw::{Panel, Sheet};
use super::pick::{self, Sum};
use crate::record::Record;

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let mut traces = pick::traces(records, "speed");
    traces.retain(|(_, t)| t.rays == "primary");
    let scenes = pick::scenes(traces.iter().map(|(r, _)| *r));
    let mut rows = [Vec::new(), Vec::new()];
    let mut shares = Vec::new();
    for (scene, title) in &scenes {
        let of = || traces.iter().filter(|(r, _)| r.scene == *scene);
        let triangles = of().next()?.0.triangles as f64;
        let sums = pick::views_together(of().map(|(_, t)| *t));
        shares.extend(share(&sums, 3.0));
        let x = |s: &Sum| if s.is_peer { 0.0 } else { s.accuracy.mean_px };
        let each = pick::by_side(&sums, x, |s| Some(s.counters.bytes_model? as f64 / triangles));
        // Peers must have all of it in memory.
        let set =
            pick::by_side(&sums, x, |s| Some(s.counters.bytes_working_set.or(s.counters.bytes_model)? as f64 / 1e6));
        let error = || Axis::log("mean depth error, pixels");
        let (bytes, megabytes) = (Axis::linear("bytes a triangle in memory"), Axis::linear("MB decoded for the view"));
        rows[0].push(Panel { title: format!("{title}: all of it"), x: error(), y: bytes, curves: each });
        rows[1].push(Panel { title: format!("{title}: working set"), x: error(), y: megabytes, curves: set });
    }
    let (least, most) = shares.iter().fold((f64::INFINITY, 0.0f64), |(a, b), s| (a.min(*s), b.max(*s)));
    let title =
        format!("At 3 pixels of error a view takes {:.0} to {:.0} % of the model's bytes", 100.0 * least, 100.0 * most);
    let foot = pick::foot(
        traces.iter().map(|(r, _)| *r),
        "Primary rays; peers need all of their bytes; numbers: pixels of error.",
    );
    let panels = rows.into_iter().flatten().collect();
    (!shares.is_empty()).then_some(Sheet { title, foot, columns: scenes.len(), panels })
}

/// Of our model, what a view at a setting decodes.
fn share(sums: &[Sum], poe: f32) -> Option<f64> {
    let ours = sums.iter().filter(|s| !s.is_peer).min_by(|a, b| (a.poe - poe).abs().total_cmp(&(b.poe - poe).abs()))?;
    Some(ours.counters.bytes_working_set? as f64 / ours.counters.bytes_model? as f64)
}
