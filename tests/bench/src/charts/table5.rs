//! Table 5 of Áfra 2012 for scenes of the same kinds: 1024 x 768, three pixels of error, four views.

use super::pick;
use crate::record::Record;
use std::collections::BTreeSet;

/// The paper's rows of such scenes: pictures a second of primary rays, with shadow rays, with two diffuse rays too, and
/// the working sets in MB (four cores of 2011, 8 threads).
const PAPER: [(&str, &str, [&str; 6]); 3] = [
    ("Lucy (scan)", "28 M", ["62", "143", "41.4", "145", "7.7", "148"]),
    ("Boeing 777 (CAD)", "337 M", ["36.6", "834", "24.5", "945", "6.6", "1019"]),
    ("Mandelbulb", "354 M", ["28.2", "598", "16.4", "667", "3.5", "693"]),
];

/// As Markdown; `None` without records.
pub fn table(records: &[Record]) -> Option<String> {
    let traces = pick::traces(records, "table5");
    let mut text = String::from(
        "| model | triangles | pictures of primary rays | working set | and shadow rays | working set | and two \
         diffuse rays | working set |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let scenes = pick::scenes(traces.iter().map(|(r, _)| *r));
    let structures: BTreeSet<&str> = traces.iter().map(|(_, t)| t.side.as_str()).collect();
    let rows = scenes.iter().flat_map(|scene| structures.iter().map(move |side| (scene, *side)));
    for ((scene, title), side) in rows {
        let of = |rays: &str| {
            let picked =
                traces.iter().filter(|(r, t)| r.scene == *scene && t.rays == rays && t.side == side).map(|(_, t)| *t);
            let sums = pick::views_together(picked);
            sums.into_iter().find(|s| s.poe == 3.0)
        };
        let triangles = traces.iter().find(|(r, _)| r.scene == *scene)?.0.triangles as f64 / 1e6;
        let suffix = pick::suffix(structures.iter().copied(), side);
        text += &format!("| {title}{suffix} | {triangles:.1} M |");
        // A picture takes the rays of all kinds so far: two diffuse ones a pixel, and a shadow ray after each of them,
        // which is taken to cost what one of a pixel costs. Working sets are those of the kind that needs most.
        let (mut seconds, mut bytes, mut shadow) = (0.0, 0u64, 0.0);
        for rays in ["primary", "shadow", "bounce"] {
            match of(rays) {
                Some(sum) => {
                    seconds += if rays == "bounce" { 2.0 * (sum.seconds.median + shadow) } else { sum.seconds.median };
                    shadow = sum.seconds.median;
                    bytes = bytes.max(sum.counters.bytes_working_set.unwrap_or(0));
                    text += &format!(" {:.1} a second | {:.0} MB |", 1.0 / seconds, bytes as f64 / 1e6);
                }
                None => text += " | |",
            }
        }
        text += "\n";
    }
    for (model, triangles, cells) in PAPER {
        let [a, b, c, d, e, f] = cells;
        text += &format!(
            "| {model}, in the paper | {triangles} | {a} a second | {b} MB | {c} a second | {d} MB | {e} a second | \
            {f} MB |\n"
        );
    }
    text += &format!(
        "\n{}\n",
        pick::foot(
            traces.iter().map(|(r, _)| *r),
            "Rays alone, without shading and filtering; shadow rays of diffuse hits are not traced, but taken to cost \
             what those of pixels cost. Working sets: decoded blocks that the kind of rays needs that needs most."
        )
    );
    (!scenes.is_empty()).then_some(text)
}
