//! Settings as a table.

use crate::record::{Outcomes, Record, Setting};
use std::fmt::Write;

/// A setting on a line.
pub fn line(setting: &Setting) -> String {
    let Setting { seconds, of_headlight, against, differ, levels, .. } = setting;
    let beside = against.as_ref().map_or(String::new(), |a| {
        let call = &a.call;
        format!(", {:.2} [{:.2} .. {:.2}] of {call}", a.ratio.median, a.ratio.least, a.ratio.most)
    });
    let off = differ.map_or(String::new(), |differ| {
        format!("; {:.3} % of pixels differ, colours by {:.2} levels", 100.0 * differ, levels.unwrap_or(0.0))
    });
    format!("{:.1} ms, {of_headlight:.2} x headlight{beside}{off}", seconds.least * 1e3)
}

/// All settings among the records in Markdown, a table a scene; empty if there are none. Times are the least of all
/// rounds, ratios to Embree the medians of pairs.
pub fn table(records: &[Record]) -> String {
    let mut text = String::new();
    let mut last = "";
    for record in records {
        let Outcomes::Settings(setting) = &record.result else { continue };
        if record.scene != last {
            last = &record.scene;
            let end = "|---|---|---|---|---|---|";
            let _ = write!(text, "\n{} ({} triangles)\n\n", record.title, record.triangles);
            let _ = writeln!(
                text,
                "| setting | ms | × headlight | × of Embree | Embree's ms | pixels that differ |\n{end}"
            );
        }
        let none = || "-".to_owned();
        let [ratio, theirs] = match &setting.against {
            Some(a) => [format!("{:.2}", a.ratio.median), format!("{:.1}", a.seconds.least * 1e3)],
            None => [none(), none()],
        };
        let differ = setting.differ.map_or_else(none, |differ| format!("{:.3} %", 100.0 * differ));
        let (ms, over) = (setting.seconds.least * 1e3, setting.of_headlight);
        let _ = writeln!(text, "| {} | {ms:.1} | {over:.2} | {ratio} | {theirs} | {differ} |", setting.setting);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::Spread;
    use crate::record::tests::record;

    #[test]
    fn a_scene_has_a_table_with_a_line_for_each_setting() {
        let spread = |x: f64| Spread { median: x, least: x, most: x };
        let setting = |name: &str, x: f64| {
            let measured =
                Setting { setting: name.into(), seconds: spread(x), of_headlight: x / 0.01, ..Setting::default() };
            record("room", name, Outcomes::Settings(measured))
        };
        assert_eq!(table(&[]), "");
        let text = table(&[setting("headlight", 0.01), setting("sun", 0.025)]);
        assert_eq!(text.matches("| setting |").count(), 1);
        assert!(text.contains("| sun | 25.0 | 2.50 | - | - | - |"), "{text}");
    }
}
