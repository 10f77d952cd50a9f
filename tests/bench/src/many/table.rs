//! Tables of what was measured, in Markdown.

use crate::pairs::Spread;
use crate::record::{Many, Outcomes, Record};
use std::fmt::Write;

/// What is not told.
const NONE: &str = "–";

/// A number, if there is one.
fn told(value: Option<f64>, text: impl Fn(f64) -> String) -> String {
    value.filter(|value| value.is_finite()).map_or_else(|| NONE.to_owned(), text)
}

/// How many times as fast as the opponent.
fn ratio(found: &Many) -> String {
    found.against.as_ref().map_or_else(
        || NONE.to_owned(),
        |against| {
            let Spread { median, least, most } = against.ratio;
            format!("{median:.2} [{least:.2} .. {most:.2}] of {}", against.call)
        },
    )
}

/// A commit or an edit.
fn commit(found: &Many) -> String {
    let Many { asked, side, call, instances, .. } = found;
    let side = if found.is_peer { call } else { side };
    let us = found.seconds.median * 1e6 / *instances as f64;
    let of_commit = told(found.of_commit, |share| format!("{share:.5}"));
    let [own, grew] = [0, 1].map(|i| told(found.bytes.map(|bytes| bytes[i]), |bytes| format!("{bytes:.0}")));
    format!("| {asked} | {side} | {us:.4} | {of_commit} | {} | {own} | {grew} |", ratio(found))
}

/// Rays.
fn rays(found: &Many) -> String {
    let Many { asked, side, call, count, poe, .. } = found;
    let (side, poe) = if found.is_peer { (call, NONE.to_owned()) } else { (side, poe.to_string()) };
    let ns = found.seconds.median * 1e9 / *count as f64;
    let percent = |share: f64| format!("{:.3} %", 100.0 * share);
    let stand_ins = told(found.stand_ins.map(|n| n as f64 / *count as f64), percent);
    let [flips, otherwise] =
        [found.accuracy.as_ref().map(|it| it.differ), found.accuracy.as_ref().and_then(|it| it.otherwise)]
            .map(|share| told(share, percent));
    let differ = found.differ.map_or_else(|| NONE.to_owned(), |n| n.to_string());
    let rms = told(found.rms, |rms| format!("{:.3} %", 100.0 * rms));
    let stated = told(found.stated, |stated| format!("{stated:.3}"));
    let accuracy = format!("{differ} of {count} | {flips} | {otherwise} | {rms} | {stated}");
    format!("| {asked} | {side} | {poe} | {ns:.0} | {} | {stand_ins} | {accuracy} |", ratio(found))
}

/// All commits and rays among the records, a table of each for every benchmark; empty if there are none.
pub fn table(records: &[Record]) -> String {
    let mut text = String::new();
    let mut last = None;
    for record in records {
        let Outcomes::Many(found) = &record.result else { continue };
        let is_of_rays = found.count > 0;
        if last != Some((&record.benchmark, is_of_rays)) {
            last = Some((&record.benchmark, is_of_rays));
            let _ = writeln!(text, "\n{}, {} instances of {}\n", record.benchmark, found.instances, record.title);
            let head = if is_of_rays {
                "| rays | side | PoE | ns a ray | times as fast | stand-ins | end elsewhere | hit in one only | \
                 a pixel off | root mean square of t | stated, px |\n|---|---|---|---|---|---|---|---|---|---|---|"
            } else {
                "| commit | side | µs an instance | of a commit | times as fast | bytes | resident bytes |\n\
                 |---|---|---|---|---|---|---|"
            };
            let _ = writeln!(text, "{head}");
        }
        let _ = writeln!(text, "{}", if is_of_rays { rays(found) } else { commit(found) });
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::record;

    #[test]
    fn commits_and_rays_have_tables_of_their_own() {
        let commit = Many { asked: "commit".into(), instances: 1000, bytes: Some([91.0, f64::NAN]), ..Many::default() };
        let rays = Many { asked: "whole, primary".into(), count: 10, differ: Some(3), ..commit.clone() };
        let all = [commit, rays].map(|found| record("plant", "key", Outcomes::Many(Box::new(found))));
        let text = table(&all);
        let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| ")).collect();
        assert_eq!(rows.len(), 4, "{text}");
        assert!(rows[1].ends_with("| 91 | – |") && rows[3].contains("3 of 10"), "{text}");
        // Each row has the cells of its head.
        let cells = |row: &str| row.matches('|').count();
        assert_eq!([cells(rows[1]), cells(rows[3])], [cells(rows[0]), cells(rows[2])], "{text}");
        assert_eq!(table(&[]), "");
    }
}
