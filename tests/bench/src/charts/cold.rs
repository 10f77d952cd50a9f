//! A picture's error over the seconds since its model was opened with nothing in memory, for budgets and rates of reading.

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::record::{Cold, Outcomes, Record};

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let all: Vec<(&Record, &Cold)> =
        records.iter().filter_map(|r| if let Outcomes::Cold(c) = &r.result { Some((r, c)) } else { None }).collect();
    let is_full = all.iter().any(|(r, _)| r.benchmark.ends_with("-full"));
    let all: Vec<_> = all.into_iter().filter(|(r, _)| r.benchmark.ends_with("-full") == is_full).collect();
    let mut rates: Vec<u64> = all.iter().map(|(_, c)| c.rate).collect();
    rates.sort_unstable();
    rates.dedup();
    let mut panels = Vec::new();
    for (scene, title) in pick::scenes(all.iter().map(|(r, _)| *r)) {
        for rate in &rates {
            let of = all.iter().filter(|(r, c)| r.scene == scene && c.rate == *rate);
            let curves: Vec<Curve> = of.map(|(_, cold)| curve(cold)).collect();
            panels.push(Panel {
                title: format!("{title}, {} MB a second", rate >> 20),
                x: Axis::log("seconds since opening began"),
                y: Axis::log("mean depth error, pixels"),
                curves,
            });
        }
    }
    let first = |c: &&Cold| c.pictures.first().map(|m| m.seconds);
    let slowest = all.iter().filter_map(|(_, c)| first(c)).fold(0.0, f64::max);
    let worst = all.iter().filter_map(|(_, c)| Some(c.pictures.first()?.accuracy.mean_px)).fold(0.0, f64::max);
    let title = format!(
        "From nothing in memory a whole picture is there after at most {slowest:.2} s, {worst:.1} pixels off at most, and then gets better"
    );
    let foot = pick::foot(all.iter().map(|(r, _)| *r), "Exact pictures asked for; what does not fit its budget ends coarser.");
    (!panels.is_empty()).then_some(Sheet { title, foot, columns: rates.len(), panels })
}

fn curve(cold: &Cold) -> Curve {
    let point = |m: &crate::record::Moment| Point { x: m.seconds, y: m.accuracy.mean_px, label: String::new() };
    let points = cold.pictures.iter().map(point).collect();
    Curve { name: format!("budget {} MB", cold.budget >> 20), look: Look::Line, points }
}
