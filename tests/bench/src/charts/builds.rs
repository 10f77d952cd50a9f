//! Speed and size of builds over models, beside Embree's builders and what the paper says of its own (Áfra 2012, table 6).

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
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

/// Peers' ways that are shown.
const SHOWN: [&str; 5] = ["low", "compact", "medium", "high", "default"];

type Row<'a> = (&'a Record, &'a Built);

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let built = records.iter().filter_map(|r| if let Outcomes::Build(b) = &r.result { Some((r, b)) } else { None });
    let mut all: Vec<Row> = built.filter(|(_, b)| SHOWN.contains(&b.quality.as_str())).collect();
    all.sort_by_key(|(r, _)| r.triangles);
    let mut panels = Vec::new();
    for kind in ["scan", "CAD soup"] {
        let of: Vec<Row> = all.iter().copied().filter(|(r, _)| kind_of(r) == kind).collect();
        if of.is_empty() {
            continue;
        }
        let mut speeds = curves(&of, "", |row| Some(speed(row)));
        speeds.push(paper(kind, |millions, _, seconds| millions / seconds));
        let mut sizes = curves(&of, "", |(r, b)| Some(b.bytes_model as f64 / r.triangles as f64));
        sizes.extend(curves(&of, ", file", file));
        sizes.push(paper(kind, |millions, gigabytes, _| gigabytes * 1e3 / millions));
        let triangles = || Axis::log("million triangles");
        let (x, y) = (triangles(), Axis::log("million triangles a second"));
        panels.push(Panel { title: format!("Speed of builds: {kind}"), x, y, curves: speeds });
        let (x, y) = (triangles(), Axis::linear("bytes a triangle"));
        panels.push(Panel { title: format!("Size: {kind}"), x, y, curves: sizes });
    }
    let ours = all.iter().rev().find(|(_, b)| !b.is_peer)?;
    let title = format!(
        "{}: {:.1} million triangles a second to a file of {:.1} bytes each",
        ours.0.title,
        speed(*ours),
        file(*ours)?
    );
    let what = format!("{} threads, from triangles in memory; outcrop writes and syncs a file.", ours.1.threads);
    let foot = pick::foot(all.iter().map(|(r, _)| *r), &what);
    Some(Sheet { title, foot, columns: 2, panels })
}

/// What the paper's models are of, too.
fn kind_of(record: &Record) -> &'static str {
    if record.title.contains("CAD") { "CAD soup" } else { "scan" }
}

fn speed((record, built): Row) -> f64 {
    record.triangles as f64 / built.seconds.median / 1e6
}

fn file((record, built): Row) -> Option<f64> {
    Some(built.bytes_file? as f64 / record.triangles as f64)
}

/// One curve a way of building.
fn curves(all: &[Row], kind: &str, y: impl Fn(Row) -> Option<f64>) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for &(record, built) in all {
        let Some(y) = y((record, built)) else { continue };
        let quality = if built.is_peer && built.quality != "default" { format!(" {}", built.quality) } else { String::new() };
        let name = format!("{}{quality}{kind}", pick::name(&built.side, built.is_peer));
        let point = Point { x: record.triangles as f64 / 1e6, y, label: String::new() };
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
        Point { x: millions, y: y(millions, gigabytes, seconds), label: String::new() }
    };
    Curve { name: PAPER_NAME.into(), look: Look::Marks, points: rows.map(point).collect() }
}
