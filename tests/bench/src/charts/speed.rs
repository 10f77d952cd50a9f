//! Speed against accuracy: a curve a structure over pixels of error, peers at no error, and the front that nobody
//! passes.

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick::{self, Sum};
use crate::record::Record;

const KINDS: [&str; 3] = ["primary", "shadow", "bounce"];

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let traces = pick::traces(records, "speed");
    let scenes = pick::scenes(traces.iter().map(|(r, _)| *r));
    let mut panels = Vec::new();
    let mut gains = Vec::new();
    for kind in KINDS {
        for (scene, title) in &scenes {
            let of = traces.iter().filter(|(r, t)| r.scene == *scene && t.rays == kind).map(|(_, t)| *t);
            let sums = pick::views_together(of);
            if let ("primary", Some(one), Some(three)) = (kind, gain(&sums, 1.0), gain(&sums, 3.0)) {
                let name = title.split(" (").next().unwrap_or(title);
                gains.push(format!("{name} {one:.2} and {three:.2}"));
            }
            panels.push(panel(kind, title, &sums));
        }
    }
    let first = traces.first()?;
    let title =
        format!("Primary rays at 1 and 3 pixels of error, times as fast as Embree's exact ones: {}", gains.join(", "));
    let what = format!(
        "{} threads; numbers at points: pixels of error; thin lines: least and most of the pairs.",
        first.1.threads
    );
    let foot = pick::foot(traces.iter().map(|(r, _)| *r), &what);
    (!gains.is_empty()).then_some(Sheet { title, foot, columns: scenes.len(), panels })
}

/// How many times as fast the first structure is at a setting as Embree.
fn gain(sums: &[Sum], poe: f32) -> Option<f64> {
    let ours = sums.iter().find(|s| !s.is_peer && s.poe == poe && s.opponent.as_deref() == Some("embree"));
    ours.map(|s| s.ratio.median)
}

/// How far off a side is. Any hits know no distance, but whether they are hits; of diffuse rays many hit what exact
/// ones pass by, which a mean distance would not show.
fn error(kind: &str, sum: &Sum) -> f64 {
    // Peers differ from exact answers by their rounding alone.
    match (kind, sum.is_peer) {
        (_, true) => 0.0,
        ("primary", _) => sum.accuracy.mean_px,
        _ => 100.0 * sum.accuracy.otherwise.unwrap_or(0.0),
    }
}

fn panel(kind: &str, title: &str, sums: &[Sum]) -> Panel {
    let mut curves =
        pick::by_side_within(sums, |s| error(kind, s), |s| Some((s.ratio.median, Some((s.ratio.least, s.ratio.most)))));
    curves.push(Curve { name: "Pareto front".into(), look: Look::Front, points: front(kind, sums) });
    let x = match kind {
        "shadow" => "rays answered otherwise, %",
        "bounce" => "rays that end more than a width elsewhere, %",
        _ => "mean depth error, pixels",
    };
    let opponent = sums.iter().find_map(|s| s.opponent.clone()).unwrap_or_default();
    let y = format!("times as fast as {}, exactly", pick::name(&opponent, opponent == "embree"));
    Panel { title: format!("{title}: {kind} rays"), x: Axis::log(x), y: Axis::linear(&y), curves }
}

/// What nothing is both faster and more accurate than, by error.
fn front(kind: &str, sums: &[Sum]) -> Vec<Point> {
    let mut all: Vec<(f64, f64)> = sums.iter().map(|s| (error(kind, s), s.ratio.median)).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
    let mut best = 0.0;
    all.retain(|(_, ratio)| {
        let is_front = *ratio > best;
        best = f64::max(best, *ratio);
        is_front
    });
    all.into_iter().map(|(x, y)| Point::new(x, y)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::trace;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let all = [
            trace("a", "bvh", "primary", 0.0, 10.0, 0.0),
            trace("a", "bvh", "primary", 1.0, 11.0, 1.0),
            trace("a", "bvh", "primary", 3.0, 14.0, 2.0),
            trace("a", "embree", "primary", 0.0, 12.0, 0.0),
        ];
        let traces = pick::traces(&all, "speed");
        let sums = pick::views_together(traces.iter().map(|(_, t)| *t));
        let front: Vec<(f64, f64)> = front("primary", &sums).iter().map(|p| (p.x, p.y)).collect();
        assert_eq!(front, [(0.0, 1.0), (2.0, 14.0 / 12.0)]);
        assert_eq!((gain(&sums, 3.0), gain(&sums, 7.0)), (Some(14.0 / 12.0), None));
    }
}
