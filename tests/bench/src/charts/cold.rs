//! A picture's error over the seconds since its model was opened with nothing in memory, for budgets and rates of
//! reading.

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::record::{Cold, Moment, Outcomes, Record};

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let all = records.iter().filter_map(|r| if let Outcomes::Cold(c) = &r.result { Some((r, c)) } else { None });
    // Kinds of stand-ins have charts of their own.
    let all: Vec<(&Record, &Cold)> = all.filter(|(r, _)| r.benchmark != super::stand_ins::BENCHMARK).collect();
    let is_full = all.iter().any(|(r, _)| r.benchmark.ends_with("-full"));
    let all: Vec<_> = all.into_iter().filter(|(r, _)| r.benchmark.ends_with("-full") == is_full).collect();
    let mut rates: Vec<u64> = all.iter().map(|(_, c)| c.rate).collect();
    rates.sort_unstable();
    rates.dedup();
    let suffix = |structure: &str| pick::suffix(all.iter().map(|(_, c)| c.structure.as_str()), structure);
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
                let curves: Vec<Curve> =
                    of.map(|(_, cold)| curve(cold, &suffix(&cold.structure), error, least)).collect();
                let title = format!("{title}, {} MiB a second", rate >> 20);
                panels.push(Panel { title, x: Axis::log("seconds since opening began"), y: Axis::log(label), curves });
            }
        }
    }
    let title = format!("First whole picture, from nothing in memory: {}", firsts(&all)?);
    let what = "Exact pictures asked for; what does not fit its budget ends coarser; less than 0.001 pixels or 0.0001 FLIP is drawn as 0.";
    let foot = pick::foot(all.iter().map(|(r, _)| *r), what);
    (!panels.is_empty()).then_some(Sheet { title, foot, columns: rates.len(), panels })
}

/// Of each budget, of all rates: when the first picture is there, and how far it is off, from the least to the most.
fn firsts(all: &[(&Record, &Cold)]) -> Option<String> {
    let mut budgets: Vec<u64> = all.iter().map(|(_, c)| c.budget).collect();
    budgets.sort_unstable();
    budgets.dedup();
    let of = |budget: u64| {
        let first = all.iter().filter(move |(_, c)| c.budget == budget).filter_map(|(_, c)| c.pictures.first());
        let (seconds, off): (Vec<f64>, Vec<f64>) = first.map(|m| (m.seconds, m.accuracy.mean_px)).unzip();
        let most = |all: &[f64]| all.iter().copied().fold(0.0, f64::max);
        let least = |all: &[f64]| all.iter().copied().fold(f64::INFINITY, f64::min);
        let (times, pixels) = ([least(&seconds), most(&seconds)], [least(&off), most(&off)]);
        format!(
            "{} MiB {:.2} to {:.2} s, {:.2} to {:.2} pixels off",
            budget >> 20,
            times[0],
            times[1],
            pixels[0],
            pixels[1]
        )
    };
    (!budgets.is_empty()).then(|| budgets.into_iter().map(of).collect::<Vec<_>>().join("; "))
}

/// Errors below `least` are drawn as none: nobody sees them, and the axis would be theirs.
fn curve(cold: &Cold, suffix: &str, error: fn(&Moment) -> f64, least: f64) -> Curve {
    let drawn = |error: f64| if error < least { 0.0 } else { error };
    let point = |m: &Moment| Point::new(m.seconds, drawn(error(m)));
    let points = cold.pictures.iter().map(point).collect();
    Curve { name: format!("budget {} MiB{suffix}", cold.budget >> 20), look: Look::Line, points }
}
