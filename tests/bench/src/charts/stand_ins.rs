//! Kinds of stand-ins in pictures from nothing in memory: how far off they are over the bytes that were read and over
//! seconds, a chart for each measure.

use super::axis::Axis;
use super::draw::{Curve, Look, Panel, Point, Sheet};
use super::pick;
use crate::record::{Accuracy, Cold, Moment, Outcomes, Record};

/// The benchmark that these charts show.
pub const BENCHMARK: &str = "stand-ins";

/// A measure of pictures.
pub struct Measured {
    /// In titles.
    title: &'static str,
    axis: fn() -> Axis,
    of: fn(&Accuracy) -> Option<f64>,
    /// Less is drawn as none: the axis would be its.
    least: f64,
    /// Digits behind the point in titles.
    digits: usize,
    note: &'static str,
}

pub const FOREIGN: Measured = Measured {
    title: "foreign parts in %",
    axis: || Axis::log("foreign parts, % of pixels"),
    of: |a| Some(100.0 * a.foreign?),
    least: 0.01,
    digits: 1,
    note: "Foreign: a part that the exact picture has nowhere within 2 pixels (a scan of one part has none).",
};

pub const BRIGHTNESS: Measured = Measured {
    title: "brightness over the exact one",
    axis: || Axis::span("linear brightness / exact"),
    of: |a| a.brightness,
    least: 0.0,
    digits: 3,
    note: "Mean linear brightness over the pixels that the exact picture covers.",
};

pub const FLIP: Measured = Measured {
    title: "mean FLIP",
    axis: || Axis::log("mean FLIP"),
    of: |a| a.flip,
    least: 1e-4,
    digits: 3,
    note: "Less than 0.0001 is drawn as 0.",
};

/// Scenes in columns: over bytes above, over seconds below.
pub fn sheet(records: &[Record], measured: &Measured) -> Option<Sheet> {
    let of_it = records.iter().filter(|r| r.benchmark == BENCHMARK);
    let colds = of_it.filter_map(|r| if let Outcomes::Cold(cold) = &r.result { Some((r, cold)) } else { None });
    let has_any = |cold: &Cold| cold.pictures.iter().any(|m| (measured.of)(&m.accuracy).is_some());
    let all: Vec<(&Record, &Cold)> = colds.filter(|(_, cold)| has_any(cold)).collect();
    let rate = all.first()?.1.rate >> 20;
    let scenes = pick::scenes(all.iter().map(|(r, _)| *r));
    let seconds = format!("seconds since opening began, {rate} MiB a second");
    type Way = fn(&Moment) -> f64;
    let ways: [(Way, &str); 2] =
        [(|m| m.bytes_read as f64 / 1e6, "MB read since opening began"), (|m| m.seconds, &seconds)];
    let mut panels = Vec::new();
    for (way, label) in ways {
        for (scene, title) in &scenes {
            let of_scene = all.iter().filter(|(r, _)| r.scene == *scene);
            let curves = of_scene.map(|(_, cold)| curve(cold, measured, way)).collect();
            panels.push(Panel { title: (*title).into(), x: Axis::log(label), y: (measured.axis)(), curves });
        }
    }
    let title = format!("Stand-ins in first pictures, {}: {}", measured.title, firsts(&all, &scenes, measured));
    let foot = pick::foot(all.iter().map(|(r, _)| *r), &format!("Exact pictures asked for. {}", measured.note));
    Some(Sheet { title, foot, columns: scenes.len(), panels })
}

fn curve(cold: &Cold, measured: &Measured, way: fn(&Moment) -> f64) -> Curve {
    let drawn = |value: f64| if value < measured.least { 0.0 } else { value };
    let point = |m: &Moment| Some(Point::new(way(m), drawn((measured.of)(&m.accuracy)?)));
    Curve { name: cold.structure.clone(), look: Look::Line, points: cold.pictures.iter().filter_map(point).collect() }
}

/// Of the first picture of each scene, by each kind.
fn firsts(all: &[(&Record, &Cold)], scenes: &[(&str, &str)], measured: &Measured) -> String {
    let of_scene = |(scene, title): &(&str, &str)| {
        let first = |(_, cold): &(&Record, &Cold)| {
            let value = (measured.of)(&cold.pictures.first()?.accuracy)?;
            Some(format!("{value:.*} {}", measured.digits, cold.structure))
        };
        let values: Vec<String> = all.iter().filter(|(r, _)| r.scene == *scene).filter_map(first).collect();
        let short = title.split([' ', ',']).next().unwrap_or(title);
        format!("{short} {}", values.join(", "))
    };
    scenes.iter().map(of_scene).collect::<Vec<_>>().join("; ")
}
