//! Speed and size of builds over models, beside Embree's builders and what the paper says of its own (Áfra 2012, table
//! 6).

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::pairs::Spread;
use crate::record::{Built, Outcomes, Record};

/// Of table 6: the kind of model, million triangles, GB of the compressed file, seconds of one thread.
const PAPER: [(&str, f64, f64, f64); 6] = [
    ("scan", 7.0, 0.4, 300.0),
    ("CAD soup", 12.0, 0.5, 420.0),
    ("scan", 28.0, 1.5, 1260.0),
    ("CAD soup", 73.0, 4.6, 3780.0),
    ("CAD soup", 337.0, 31.4, 27780.0),
    ("scan", 354.0, 7.5, 6240.0),
];
const PAPER_NAME: &str = "the paper's kd-tree (table 6: one thread of 2011; its file)";

/// Kinds of models, which have panels of their own.
const KINDS: [&str; 2] = ["scan", "CAD soup"];

/// Peers' ways that are shown.
const SHOWN: [&str; 5] = ["low", "compact", "medium", "high", "default"];

type Row<'a> = (&'a Record, &'a Built);

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let built = records.iter().filter_map(|r| if let Outcomes::Build(b) = &r.result { Some((r, b)) } else { None });
    let mut all: Vec<Row> = built.filter(|(_, b)| SHOWN.contains(&b.quality.as_str())).collect();
    all.sort_by_key(|(r, _)| r.triangles);
    let mut panels = Vec::new();
    for kind in KINDS {
        let of: Vec<Row> = all.iter().copied().filter(|(r, _)| kind_of(r) == kind).collect();
        if of.is_empty() {
            continue;
        }
        let mut speeds = curves(&of, "", |row| Some(speed(row)));
        let size = |(r, _): Row, bytes: u64| Point::new(r.triangles as f64 / 1e6, bytes as f64 / r.triangles as f64);
        speeds.push(paper(kind, |millions, _, seconds| millions / seconds));
        let mut sizes = curves(&of, "", |row| Some(size(row, row.1.bytes_model)));
        sizes.extend(curves(&of, ", file", |row| Some(size(row, row.1.bytes_file?))));
        sizes.push(paper(kind, |millions, gigabytes, _| gigabytes * 1e3 / millions));
        let triangles = || Axis::log("million triangles");
        let (x, y) = (triangles(), Axis::log("million triangles a second"));
        panels.push(Panel { title: format!("Speed of builds: {kind}"), x, y, curves: speeds });
        let (x, y) = (triangles(), Axis::linear("bytes a triangle"));
        panels.push(Panel { title: format!("Size: {kind}"), x, y, curves: sizes });
    }
    let first = all.iter().find(|(_, b)| !b.is_peer)?;
    let of_kind = |kind: &str| {
        let ours =
            all.iter().rev().find(|row| !row.1.is_peer && row.1.side == first.1.side && kind_of(row.0) == kind)?;
        let (speed, bytes) = (speed(*ours).y, ours.1.bytes_file? as f64 / ours.0.triangles as f64);
        Some(format!("{} {speed:.2}, {bytes:.0}", ours.0.title))
    };
    let each: Vec<String> = KINDS.into_iter().filter_map(of_kind).collect();
    let title = format!("Million triangles built a second, bytes of each in the file: {}", each.join("; "));
    let what = format!("{} threads, from triangles in memory; outcrop writes and syncs a file.", first.1.threads);
    let foot = pick::foot(all.iter().map(|(r, _)| *r), &what);
    Some(Sheet { title, foot, columns: 2, panels })
}

/// What the paper's models are of, too.
fn kind_of(record: &Record) -> &'static str {
    if record.title.contains("CAD") { "CAD soup" } else { "scan" }
}

/// Million triangles a second, over million triangles.
fn speed((record, built): Row) -> Point {
    let millions = record.triangles as f64 / 1e6;
    let Spread { median, least, most } = built.seconds;
    Point { range: Some((millions / most, millions / least)), ..Point::new(millions, millions / median) }
}

/// One curve a way of building.
fn curves(all: &[Row], kind: &str, y: impl Fn(Row) -> Option<Point>) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for &(record, built) in all {
        let Some(point) = y((record, built)) else { continue };
        let quality =
            if built.is_peer && built.quality != "default" { format!(" {}", built.quality) } else { String::new() };
        let name = format!("{}{quality}{kind}", pick::name(&built.side, built.is_peer));
        match curves.iter_mut().find(|curve| curve.name == name) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { name, look: Look::Line, points: vec![point] }),
        }
    }
    curves
}

fn paper(kind: &str, y: impl Fn(f64, f64, f64) -> f64) -> Curve {
    let rows = PAPER.iter().filter(|row| row.0 == kind);
    let point = |&(_, millions, gigabytes, seconds): &(&str, f64, f64, f64)| {
        Point::new(millions, y(millions, gigabytes, seconds))
    };
    Curve { name: PAPER_NAME.into(), look: Look::Marks, points: rows.map(point).collect() }
}
