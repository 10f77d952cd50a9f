//! What stand-ins do to coverage: the share of rays that hit over the exact share, and how far the outlines overlap.

use super::axis::{Axis, written};
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick::{self, Sum};
use crate::record::Record;

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let mut traces = pick::traces(records, "speed");
    traces.retain(|(_, t)| t.rays == "primary" && !t.is_peer);
    let scenes: Vec<(&str, Vec<Sum>)> = pick::scenes(traces.iter().map(|(r, _)| *r))
        .into_iter()
        .map(|(scene, title)| {
            let of = traces.iter().filter(|(r, _)| r.scene == scene).map(|(_, t)| *t);
            (title, pick::views_together(of))
        })
        .collect();
    let panel = |title: &str, y: &str, value: fn(&Sum) -> f64| {
        let point = |s: &Sum| Point { x: f64::from(s.poe), y: value(s), label: String::new() };
        let curve = |(name, sums): &(&str, Vec<Sum>)| {
            Curve { name: (*name).into(), look: Look::Line, points: sums.iter().map(point).collect() }
        };
        let curves = scenes.iter().map(curve).collect();
        Panel { title: title.into(), x: Axis::log("pixels of error"), y: Axis::linear(y), curves }
    };
    let panels = vec![
        panel("Mean coverage", "rays that hit over those that hit exactly", |s| s.accuracy.coverage),
        panel("Silhouette", "hit in both over hit in either", |s| s.accuracy.overlap),
    ];
    let off = |s: &&Sum| (s.accuracy.coverage - 1.0).abs();
    let (name, worst) = scenes
        .iter()
        .flat_map(|(name, sums)| sums.iter().filter(|s| s.poe <= 10.0).map(move |s| (name, s)))
        .max_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?;
    let poe = written(f64::from(worst.poe));
    let title = format!("Up to 10 pixels of error coverage is at worst {:.2} times the exact one ({name}, PoE {poe})", worst.accuracy.coverage);
    let foot = pick::foot(traces.iter().map(|(r, _)| *r), "Primary rays, one a pixel.");
    Some(Sheet { title, foot, columns: 2, panels })
}
