//! Speed and size of builds over models, beside Embree's builders and what the paper says of its own (Áfra 2012, table 6).

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::record::{Built, Outcomes, Record};

/// Of table 6: million triangles, GB of the compressed file, seconds of one thread.
const PAPER: [(f64, f64, f64); 6] = [
    (7.0, 0.4, 300.0),
    (12.0, 0.5, 420.0),
    (28.0, 1.5, 1260.0),
    (73.0, 4.6, 3780.0),
    (337.0, 31.4, 27780.0),
    (354.0, 7.5, 6240.0),
];
const PAPER_NAME: &str = "kd-tree of the paper's table 6 (file, 1 thread, 2011)";

pub fn sheet(records: &[Record]) -> Option<Sheet> {
    let mut all: Vec<(&Record, &Built)> =
        records.iter().filter_map(|r| if let Outcomes::Build(b) = &r.result { Some((r, b)) } else { None }).collect();
    all.sort_by_key(|(r, _)| r.triangles);
    let each = |r: &Record, b: &Built| Some(b.bytes_model as f64 / r.triangles as f64);
    let speed = |r: &Record, b: &Built| Some(r.triangles as f64 / b.seconds.median / 1e6);
    let file = |r: &Record, b: &Built| Some(b.bytes_file? as f64 / r.triangles as f64);
    let mut speeds = curves(&all, "", speed);
    speeds.push(paper(|(millions, _, seconds)| millions / seconds));
    let mut sizes = curves(&all, "", each);
    sizes.extend(curves(&all, ", file", file));
    sizes.push(paper(|(millions, gigabytes, _)| gigabytes * 1e3 / millions));
    let ours = all.iter().rev().find(|(_, b)| !b.is_peer)?;
    let embree = all.iter().find(|(r, b)| r.scene == ours.0.scene && b.quality == "medium" && b.side == "embree");
    let beside = embree.map_or(String::new(), |(r, b)| {
        format!("; Embree's medium builder {:.1} in memory, at {:.0} bytes", speed(r, b).unwrap_or(0.0), each(r, b).unwrap_or(0.0))
    });
    let title = format!(
        "{}: {:.1} million triangles a second into a file of {:.1} bytes each{beside}",
        ours.0.title,
        speed(ours.0, ours.1)?,
        file(ours.0, ours.1)?
    );
    let triangles = || Axis::log("million triangles");
    let panels = vec![
        Panel { title: "Speed of builds".into(), x: triangles(), y: Axis::log("million triangles a second"), curves: speeds },
        Panel { title: "Size".into(), x: triangles(), y: Axis::linear("bytes a triangle"), curves: sizes },
    ];
    let what = format!("{} threads, from triangles in memory; ours to a file that is synced.", ours.1.threads);
    let foot = pick::foot(all.iter().map(|(r, _)| *r), &what);
    Some(Sheet { title, foot, columns: 2, panels })
}

/// One curve a way of building.
fn curves(all: &[(&Record, &Built)], kind: &str, y: impl Fn(&Record, &Built) -> Option<f64>) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for (record, built) in all {
        let Some(y) = y(record, built) else { continue };
        let quality = if built.is_peer && built.quality != "default" { format!(" {}", built.quality) } else { String::new() };
        let name = format!("{}{quality}{kind}", pick::name(&built.side, built.is_peer));
        let point = Point { x: record.triangles as f64 / 1e6, y, label: String::new() };
        match curves.iter_mut().find(|curve| curve.name == name) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { name, look: Look::Marks, points: vec![point] }),
        }
    }
    curves
}

fn paper(y: impl Fn((f64, f64, f64)) -> f64) -> Curve {
    let points = PAPER.iter().map(|&row| Point { x: row.0, y: y(row), label: String::new() }).collect();
    Curve { name: PAPER_NAME.into(), look: Look::Marks, points }
}
