//! What stand-ins do to coverage: the share of rays that hit over the exact share, and how far the outlines overlap.

use super::axis::{Axis, written};
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick::{self, Sum};
use crate::record::Record;

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let mut traces = pick::traces(records, "speed");
    traces.retain(|(_, t)| t.rays == "primary" && !t.is_peer);
    let sides = || traces.iter().map(|(_, t)| t.side.as_str());
    let mut scenes: Vec<(String, Vec<Sum>)> = Vec::new();
    for (scene, title) in pick::scenes(traces.iter().map(|(r, _)| *r)) {
        let of = traces.iter().filter(|(r, _)| r.scene == scene).map(|(_, t)| *t);
        for sums in pick::views_together(of).chunk_by(|a, b| a.side == b.side) {
            scenes.push((format!("{title}{}", pick::suffix(sides(), &sums[0].side)), sums.to_vec()));
        }
    }
    let panel = |title: &str, y: &str, value: fn(&Sum) -> f64| {
        let curve = |(name, sums): &(String, Vec<Sum>)| {
            let points = sums.iter().map(|s| Point::new(f64::from(s.poe), value(s))).collect();
            Curve { name: name.clone(), look: Look::Line, points }
        };
        let curves: Vec<Curve> = scenes.iter().map(curve).collect();
        Panel { title: title.into(), x: Axis::log("pixels of error"), y: Axis::span(y), curves }
    };
    let mut coverage = panel("Mean coverage", "rays that hit over those that hit exactly", |s| s.accuracy.coverage);
    let limit = |y: f64| Curve {
        name: "3 % up to 10 pixels".into(),
        look: Look::Limit,
        points: [0.0, 10.0].map(|x| Point::new(x, y)).into(),
    };
    coverage.curves.extend([limit(1.03), limit(0.97)]);
    let panels = vec![coverage, panel("Silhouette", "hit in both over hit in either", |s| s.accuracy.overlap)];
    let off = |s: &&Sum| (s.accuracy.coverage - 1.0).abs();
    let (name, worst) = scenes
        .iter()
        .flat_map(|(name, sums)| sums.iter().filter(|s| s.poe <= 10.0).map(move |s| (name, s)))
        .max_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?;
    let poe = written(f64::from(worst.poe));
    let title = format!(
        "Up to 10 pixels of error coverage is at worst {:.2} times the exact one ({name}, PoE {poe})",
        worst.accuracy.coverage
    );
    let foot = pick::foot(traces.iter().map(|(r, _)| *r), "Primary rays, one a pixel.");
    Some(Sheet { title, foot, columns: 2, panels })
}
