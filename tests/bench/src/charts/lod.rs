//! What level of detail comes to: a picture's time over triangles with and without, and its time and working set over
//! pixels of error (Áfra 2012, figures 7 and 8).

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick::{self, Sum};
use crate::pairs::Spread;
use crate::record::Record;
use std::collections::BTreeSet;

/// Settings that have a curve over triangles.
const SHOWN: [f32; 4] = [0.0, 1.0, 3.0, 10.0];

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    // Models of all sizes, those of the full benchmark too.
    let of = |r: &&Record| r.benchmark.starts_with("pictures") && r.trace().is_some_and(|t| t.rays == "picture");
    let mut all: Vec<&Record> = records.iter().filter(of).collect();
    all.sort_by_key(|r| r.triangles);
    let scenes = pick::scenes(all.iter().copied());
    let mut sizes: Vec<(String, f64, Vec<Sum>)> = Vec::new();
    for (scene, title) in scenes {
        let of_scene = || all.iter().filter(|r| r.scene == scene);
        let traces = of_scene().filter_map(|r| r.trace());
        sizes.push((title.to_owned(), of_scene().next()?.triangles as f64 / 1e6, pick::views_together(traces)));
    }
    let sides: Vec<&str> = sizes
        .iter()
        .flat_map(|(_, _, sums)| sums.iter().map(|s| s.side.as_str()))
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    let suffix = |side: &str| pick::suffix(sides.iter().copied(), side);
    let by_setting = SHOWN.iter().flat_map(|&poe| sides.iter().map(move |side| (poe, *side)));
    let over_triangles = Panel {
        title: "Time of a picture over triangles".into(),
        x: Axis::log("million triangles"),
        y: Axis::linear("milliseconds a picture"),
        curves: by_setting.filter_map(|(poe, side)| curve_at(&sizes, poe, side, &suffix(side))).collect(),
    };
    let over_poe = |title: &str, label: &str, y: &dyn Fn(&Sum) -> Option<Point>| {
        let each = sizes.iter().flat_map(|size| sides.iter().map(move |side| (size, *side)));
        let curve = |((name, _, sums), side): (&(String, f64, Vec<Sum>), &str)| {
            let points = sums.iter().filter(|s| s.side == side).filter_map(y).collect();
            Curve { name: format!("{name}{}", suffix(side)), look: Look::Line, points }
        };
        Panel {
            title: title.into(),
            x: Axis::log("pixels of error"),
            y: Axis::linear(label),
            curves: each.map(curve).collect(),
        }
    };
    let time = over_poe("Time over pixels of error", "milliseconds a picture", &|s| Some(time_at(f64::from(s.poe), s)));
    let megabytes = |s: &Sum| Some(Point::new(f64::from(s.poe), s.counters.bytes_working_set? as f64 / 1e6));
    let set = over_poe("Working set over pixels of error", "MB decoded", &megabytes);
    let (smallest, largest) = (sizes.first()?, sizes.last()?);
    let grown = |poe: f32| Some(at(&largest.2, poe)?.seconds.median / at(&smallest.2, poe)?.seconds.median);
    let title = format!(
        "From {} to {} million triangles an exact picture takes {:.2} times as long, one at 3 pixels of error {:.2} times",
        super::axis::written((smallest.1 * 100.0).round() / 100.0),
        super::axis::written((largest.1 * 100.0).round() / 100.0),
        grown(0.0)?,
        grown(3.0).or_else(|| grown(10.0))?
    );
    let foot = pick::foot(
        all.iter().copied(),
        "Mandelbulb, whole, 1024 x 768, all in memory but for the working set; thin lines: least and most.",
    );
    Some(Sheet { title, foot, columns: 3, panels: vec![over_triangles, time, set] })
}

/// Milliseconds of a picture, from the least to the most.
fn time_at(x: f64, sum: &Sum) -> Point {
    let Spread { median, least, most } = sum.seconds;
    Point { range: Some((least * 1e3, most * 1e3)), ..Point::new(x, median * 1e3) }
}

fn at(sums: &[Sum], poe: f32) -> Option<&Sum> {
    sums.iter().find(|s| s.poe == poe)
}

fn curve_at(sizes: &[(String, f64, Vec<Sum>)], poe: f32, side: &str, suffix: &str) -> Option<Curve> {
    let of = |(_, millions, sums): &(String, f64, Vec<Sum>)| {
        let sum = sums.iter().find(|s| s.poe == poe && s.side == side)?;
        Some(time_at(*millions, sum))
    };
    let points: Vec<Point> = sizes.iter().filter_map(of).collect();
    let name = if poe == 0.0 { format!("exact{suffix}") } else { format!("PoE {poe}{suffix}") };
    (!points.is_empty()).then_some(Curve { name, look: Look::Line, points })
}
