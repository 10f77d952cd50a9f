//! A picture's error over the seconds since its model was opened with nothing in memory, for budgets and rates of reading.

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::record::{Cold, Moment, Outcomes, Record};

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let all: Vec<(&Record, &Cold)> =
        records.iter().filter_map(|r| if let Outcomes::Cold(c) = &r.result { Some((r, c)) } else { None }).collect();
    let is_full = all.iter().any(|(r, _)| r.benchmark.ends_with("-full"));
    let all: Vec<_> = all.into_iter().filter(|(r, _)| r.benchmark.ends_with("-full") == is_full).collect();
    let mut rates: Vec<u64> = all.iter().map(|(_, c)| c.rate).collect();
    rates.sort_unstable();
    rates.dedup();
    let mut panels = Vec::new();
    type Error = fn(&Moment) -> f64;
    let errors: [(&str, Error, f64); 2] = [
        ("mean depth error, pixels", |m| m.accuracy.mean_px, 1e-3),
        ("mean FLIP", |m| m.accuracy.flip.unwrap_or(0.0), 1e-4),
    ];
    for (scene, title) in pick::scenes(all.iter().map(|(r, _)| *r)) {
        for (label, error, least) in errors {
            for rate in &rates {
                let of = all.iter().filter(|(r, c)| r.scene == scene && c.rate == *rate);
                let curves: Vec<Curve> = of.map(|(_, cold)| curve(cold, error, least)).collect();
                let title = format!("{title}, {} MB a second", rate >> 20);
                panels.push(Panel { title, x: Axis::log("seconds since opening began"), y: Axis::log(label), curves });
            }
        }
    }
    let first = |c: &&Cold| c.pictures.first().map(|m| m.seconds);
    let slowest = all.iter().filter_map(|(_, c)| first(c)).fold(0.0, f64::max);
    let worst = all.iter().filter_map(|(_, c)| Some(c.pictures.first()?.accuracy.mean_px)).fold(0.0, f64::max);
    let title = format!("From nothing in memory the first whole picture is there after at most {slowest:.2} s, at most {worst:.1} pixels off");
    let what = "Exact pictures asked for; what does not fit its budget ends coarser; less than 0.001 pixels or 0.0001 FLIP is drawn as 0.";
    let foot = pick::foot(all.iter().map(|(r, _)| *r), what);
    (!panels.is_empty()).then_some(Sheet { title, foot, columns: rates.len(), panels })
}

/// Errors below `least` are drawn as none: nobody sees them, and the axis would be theirs.
fn curve(cold: &Cold, error: fn(&Moment) -> f64, least: f64) -> Curve {
    let drawn = |error: f64| if error < least { 0.0 } else { error };
    let point = |m: &Moment| Point { x: m.seconds, y: drawn(error(m)), label: String::new() };
    let points = cold.pictures.iter().map(point).collect();
    Curve { name: format!("budget {} MB", cold.budget >> 20), look: Look::Line, points }
}
