//! Which records a chart takes, and several views taken together.

use super::draw::{Curve, Look, Point};
use crate::pairs::Spread;
use crate::record::{Accuracy, Counters, Record, Trace};
use std::collections::BTreeMap;

/// Records of rays of one benchmark, at the most threads.
pub fn traces<'a>(records: &'a [Record], benchmark: &str) -> Vec<(&'a Record, &'a Trace)> {
    let of_it = records.iter().filter(|r| r.benchmark == benchmark);
    let mut all: Vec<(&Record, &Trace)> = of_it.filter_map(|r| Some((r, r.trace()?))).collect();
    let most = all.iter().map(|(_, t)| t.threads).max();
    all.retain(|(_, t)| Some(t.threads) == most);
    all
}

/// What was measured of one side, setting and kind of rays, all views together.
#[derive(Debug, Clone)]
pub struct Sum {
    pub side: String,
    pub is_peer: bool,
    pub poe: f32,
    /// How many times as fast it is as what all are paired with: median, least and most over pairs, the mean over
    /// views. 1 for that itself.
    pub ratio: Spread,
    /// What that is.
    pub opponent: Option<String>,
    /// Of a view.
    pub seconds: Spread,
    pub counters: Counters,
    pub accuracy: Accuracy,
}

/// All views together, by side and setting.
pub fn views_together<'a>(traces: impl Iterator<Item = &'a Trace>) -> Vec<Sum> {
    let mut groups: BTreeMap<(bool, &str, u32), Vec<&Trace>> = BTreeMap::new();
    for t in traces {
        // Bits of what is not negative are in its order.
        groups.entry((t.is_peer, &t.side, t.poe.to_bits())).or_default().push(t);
    }
    groups.into_values().map(|group| together(&group)).collect()
}

fn together(group: &[&Trace]) -> Sum {
    let n = group.len() as f64;
    let spread = |of: &dyn Fn(&Trace) -> Spread| {
        let mean = |end: fn(Spread) -> f64| group.iter().map(|t| end(of(t))).sum::<f64>() / n;
        Spread { median: mean(|s| s.median), least: mean(|s| s.least), most: mean(|s| s.most) }
    };
    let itself = Spread { median: 1.0, least: 1.0, most: 1.0 };
    let mean = |of: fn(&Accuracy) -> f64| group.iter().map(|t| of(&t.accuracy)).sum::<f64>() / n;
    let bytes = |of: fn(&Counters) -> Option<u64>| {
        let all: Option<Vec<u64>> = group.iter().map(|t| of(&t.counters)).collect();
        all.map(|all| all.iter().sum::<u64>() / all.len() as u64)
    };
    Sum {
        side: group[0].side.clone(),
        is_peer: group[0].is_peer,
        poe: group[0].poe,
        ratio: spread(&|t| t.against.as_ref().map_or(itself, |a| a.ratio)),
        opponent: group[0].against.as_ref().map(|a| a.side.clone()),
        seconds: spread(&|t| t.seconds),
        counters: Counters {
            bytes_model: bytes(|c| c.bytes_model),
            bytes_working_set: bytes(|c| c.bytes_working_set),
            stand_ins: bytes(|c| c.stand_ins),
            ..Counters::default()
        },
        accuracy: Accuracy {
            mean_px: mean(|a| a.mean_px),
            p95_px: mean(|a| a.p95_px),
            p999_px: mean(|a| a.p999_px),
            worst_px: group.iter().map(|t| t.accuracy.worst_px).fold(0.0, f64::max),
            overlap: mean(|a| a.overlap),
            coverage: mean(|a| a.coverage),
            differ: mean(|a| a.differ),
            otherwise: group.iter().map(|t| t.accuracy.otherwise).sum::<Option<f64>>().map(|sum| sum / n),
            ..Accuracy::default()
        },
    }
}

/// Scenes in the order of their first record: name and title.
pub fn scenes<'a>(records: impl Iterator<Item = &'a Record>) -> Vec<(&'a str, &'a str)> {
    let mut all: Vec<(&str, &str)> = Vec::new();
    for record in records {
        if all.iter().all(|(name, _)| *name != record.scene) {
            all.push((&record.scene, &record.title));
        }
    }
    all
}

/// What follows a name where more than one structure is drawn: which it is.
pub fn suffix<'a>(mut sides: impl Iterator<Item = &'a str>, side: &str) -> String {
    let is_alone = sides.all(|other| other == side);
    if is_alone { String::new() } else { format!(", {side}") }
}

/// As charts call a side.
pub fn name(side: &str, is_peer: bool) -> String {
    match (side, is_peer) {
        ("embree", _) => "Embree".into(),
        (_, true) => side.into(),
        (_, false) => format!("outcrop, {side}"),
    }
}

/// One curve a side: structures as lines over their settings, peers as marks.
pub fn by_side(sums: &[Sum], x: impl Fn(&Sum) -> f64, y: impl Fn(&Sum) -> Option<f64>) -> Vec<Curve> {
    by_side_within(sums, x, |sum| y(sum).map(|height| (height, None)))
}

/// Likewise, with the ends of what was measured.
pub fn by_side_within(
    sums: &[Sum],
    x: impl Fn(&Sum) -> f64,
    y: impl Fn(&Sum) -> Option<(f64, Option<(f64, f64)>)>,
) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for sum in sums {
        let Some((height, range)) = y(sum) else { continue };
        let (called, look) = (name(&sum.side, sum.is_peer), if sum.is_peer { Look::Marks } else { Look::Line });
        let label = if sum.is_peer { String::new() } else { format!("{}", sum.poe) };
        let point = Point { x: x(sum), y: height, label, range };
        match curves.iter_mut().find(|curve| curve.name == called) {
            Some(curve) => curve.points.push(point),
            None => curves.push(Curve { name: called, look, points: vec![point] }),
        }
    }
    curves
}

/// Where and when: of the last record.
pub fn foot<'a>(records: impl Iterator<Item = &'a Record>, what: &str) -> String {
    let Some(last) = records.last() else { return what.to_owned() };
    let run = &last.run;
    format!("{what} {}, {}, version {}, {}.", run.machine, run.isa, run.commit, run.date)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Outcomes;
    use crate::record::tests::trace;

    #[test]
    fn views_are_taken_together() {
        let records = [trace("a", "bvh", "primary", 1.0, 10.0, 1.0), trace("a", "bvh", "primary", 1.0, 30.0, 3.0)];
        let picked = traces(&records, "speed");
        let sums = views_together(picked.iter().map(|(_, t)| *t));
        assert_eq!(sums.len(), 1);
        let Sum { ratio, seconds, .. } = &sums[0];
        // 1/10 and 1/30 of a second, and 10/12 and 30/12 times as fast.
        assert!((seconds.median - 1.0 / 15.0).abs() < 1e-9 && (ratio.median - 20.0 / 12.0).abs() < 1e-9, "{ratio:?}");
        assert!(ratio.least < ratio.median && ratio.median < ratio.most);
        assert!((sums[0].accuracy.mean_px - 2.0).abs() < 1e-9);
        assert_eq!(sums[0].opponent.as_deref(), Some("embree"));
    }

    #[test]
    fn structures_are_named_where_there_are_several() {
        assert_eq!(suffix(["bvh", "bvh"].into_iter(), "bvh"), "");
        assert_eq!(suffix(["bvh", "octree"].into_iter(), "bvh"), ", bvh");
    }

    #[test]
    fn one_benchmark_and_the_most_threads() {
        let mut records = [trace("a", "bvh", "primary", 0.0, 1.0, 0.0), trace("b", "bvh", "primary", 0.0, 1.0, 0.0)];
        assert_eq!(traces(&records, "speed").len(), 2);
        if let Outcomes::Trace(t) = &mut records[0].result {
            t.threads -= 1;
        }
        let picked = traces(&records, "speed");
        assert_eq!((picked.len(), picked[0].0.scene.as_str()), (1, "b"));
        records[1].benchmark = "large".into();
        assert_eq!(traces(&records, "speed")[0].0.scene, "a");
        assert_eq!(traces(&records, "large")[0].0.scene, "b");
    }
}
