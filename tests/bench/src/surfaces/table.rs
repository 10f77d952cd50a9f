//! Surfaces as tables, in Markdown.

use crate::record::{Outcomes, Record, Surfaced};
use std::fmt::Write;

/// All rays on surfaces among the records, a table a benchmark; empty if there are none.
pub fn table(records: &[Record]) -> String {
    let mut text = String::new();
    let mut last = None;
    for record in records {
        let Outcomes::Surfaces(found) = &record.result else { continue };
        if last != Some(&record.benchmark) {
            last = Some(&record.benchmark);
            let _ = writeln!(
                text,
                "\n{}, {}\n\n| level | triangles | rays, view | side | PoE | bytes a triangle | million rays a s | \
                 of Embree GRID | end elsewhere |\n|---|---|---|---|---|---|---|---|---|",
                record.benchmark, record.title
            );
        }
        let Surfaced { side, call, level, view, rays, poe, count, mrays, bytes, differ, .. } = &**found;
        let side = if found.is_peer { format!("{side} ({call})") } else { side.clone() };
        let each = *bytes as f64 / record.triangles as f64;
        let ratio = of_grid(records, record).map_or_else(|| "–".into(), |ratio| format!("{ratio:.2}"));
        let _ = writeln!(
            text,
            "| {level} | {} | {rays}, {view} | {side} | {poe} | {each:.2} | {mrays:.2} | {ratio} | {:.3} % |",
            record.triangles,
            100.0 * *differ as f64 / *count as f64
        );
    }
    text
}

/// How many times as fast it is as Embree's grids, by the medians of the same rounds.
fn of_grid(records: &[Record], record: &Record) -> Option<f64> {
    let Outcomes::Surfaces(found) = &record.result else { return None };
    let is_its = |other: &&Record| {
        let Outcomes::Surfaces(it) = &other.result else { return false };
        let place = |it: &Surfaced| (it.level, it.view, it.rays.clone());
        other.benchmark == record.benchmark && it.side == super::GRID && place(it) == place(found)
    };
    let Outcomes::Surfaces(grid) = &records.iter().find(is_its)?.result else { return None };
    Some(found.mrays / grid.mrays)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::record;

    #[test]
    fn sides_are_beside_embrees_grids() {
        let of = |side: &str, mrays: f64| {
            let found = Surfaced { side: side.into(), level: 5, count: 10, mrays, bytes: 3000, ..Surfaced::default() };
            let key = format!("surfaces {side}");
            let mut one = record("car", &key, Outcomes::Surfaces(Box::new(found)));
            one.triangles = 1000;
            one
        };
        let text = table(&[of("patch", 3.0), of(super::super::GRID, 6.0)]);
        assert!(text.contains("| patch | 0 | 3.00 | 3.00 | 0.50 |"), "{text}");
        assert_eq!(table(&[]), "");
    }
}
