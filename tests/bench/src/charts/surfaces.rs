//! Surfaces over levels: bytes of a triangle, and speed of rays, beside Embree's grids and its own subdivision.

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::record::{Outcomes, Record, Surfaced};
use crate::surfaces::{GRID, KINDS};
use std::collections::BTreeSet;

type Row<'a> = (&'a Record, &'a Surfaced);

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let all: Vec<Row> = records
        .iter()
        .filter_map(|r| if let Outcomes::Surfaces(it) = &r.result { Some((r, &**it)) } else { None })
        .collect();
    let mut names: Vec<(String, f32)> = Vec::new();
    for (_, it) in &all {
        if !names.iter().any(|(side, poe)| *side == it.side && *poe == it.poe) {
            names.push((it.side.clone(), it.poe));
        }
    }
    let level = || Axis::linear("level: 2 to this power segments along each side of a face");
    let bytes = Panel {
        title: "Memory".into(),
        x: level(),
        y: Axis::log("bytes a triangle"),
        curves: names.iter().filter(|name| name.1 == 0.0).map(|name| curve(&all, name, None, &of_bytes)).collect(),
    };
    let mut panels = vec![bytes];
    for kind in KINDS {
        let of_kind = |name: &(String, f32)| curve(&all, name, Some(kind.name()), &|(_, it)| it.mrays);
        let curves: Vec<Curve> = names.iter().map(of_kind).filter(|curve| !curve.points.is_empty()).collect();
        if curves.is_empty() {
            continue;
        }
        let title = format!("Rays: {}", kind.name());
        panels.push(Panel { title, x: level(), y: Axis::linear("million rays a second"), curves });
    }
    let title = title(&all)?;
    let what = "One thread, mean of views, sides in turn; Embree's best call, its subdivision of the same cage.";
    let foot = pick::foot(all.iter().map(|(r, _)| *r), what);
    Some(Sheet { title, foot, columns: 2, panels })
}

fn of_bytes((record, it): Row) -> f64 {
    it.bytes as f64 / record.triangles as f64
}

/// At the highest level: bytes, and speed of primary rays as a share of Embree's grids.
fn title(all: &[Row]) -> Option<String> {
    let highest = all.iter().map(|(_, it)| it.level).max()?;
    let of = |side: &str| {
        let here = |row: &&Row| row.1.level == highest && row.1.side == side && row.1.poe == 0.0;
        let rows: Vec<Row> = all.iter().filter(here).copied().collect();
        let primary: Vec<f64> = rows.iter().filter(|(_, it)| it.rays == "primary").map(|(_, it)| it.mrays).collect();
        Some((of_bytes(*rows.first()?), primary.iter().sum::<f64>() / primary.len().max(1) as f64))
    };
    let first = all.iter().find(|(_, it)| !it.is_peer)?;
    let (bytes, mrays) = of(&first.1.side)?;
    let text = format!("{} at level {highest}: {bytes:.1} bytes a triangle", first.0.title);
    Some(match of(GRID) {
        Some((grid, theirs)) => {
            format!("{text}, Embree's grids {grid:.1}; primary rays at {:.2} of their speed", mrays / theirs)
        }
        None => text,
    })
}

/// A side over levels; speeds are means over views.
fn curve(all: &[Row], (side, poe): &(String, f32), rays: Option<&str>, y: &dyn Fn(Row) -> f64) -> Curve {
    let is_of = |row: &&Row| row.1.side == *side && row.1.poe == *poe && rays.is_none_or(|rays| row.1.rays == rays);
    let rows: Vec<Row> = all.iter().filter(is_of).copied().collect();
    let levels: BTreeSet<u32> = rows.iter().map(|(_, it)| it.level).collect();
    let point = |level: &u32| {
        let here: Vec<f64> = rows.iter().filter(|(_, it)| it.level == *level).map(|row| y(*row)).collect();
        Point::new(f64::from(*level), here.iter().sum::<f64>() / here.len() as f64)
    };
    let name = if *poe == 0.0 { side.clone() } else { format!("{side}, {poe} pixels of error") };
    Curve { name, look: Look::Line, points: levels.iter().map(point).collect() }
}
