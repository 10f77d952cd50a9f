//! The charts: each is made of records alone, and says in its title what they show.

mod axis;
mod builds;
mod cold;
mod coverage;
mod draw;
mod lod;
mod mark;
mod memory;
mod mended;
mod pick;
mod speed;
mod stand_ins;
mod surfaces;
mod table5;

use crate::failure::{Failure, Outcome};
use crate::record::Record;
use draw::Sheet;
use std::path::{Path, PathBuf};

/// A committed chart is at most so large.
const MOST: usize = 300_000;

/// Where charts are kept.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("charts")
}

/// Every chart for which there are records, by file name.
fn sheets(records: &[Record]) -> Vec<(&'static str, Sheet)> {
    let all = [
        ("speed", speed::sheet(records)),
        ("coverage", coverage::sheet(records)),
        ("memory", memory::sheet(records)),
        ("lod", lod::sheet(records)),
        ("cold", cold::sheet(records)),
        ("builds", builds::sheet(records)),
        ("surfaces", surfaces::sheet(records)),
        ("stand-ins-foreign", stand_ins::sheet(records, &stand_ins::FOREIGN)),
        ("stand-ins-brightness", stand_ins::sheet(records, &stand_ins::BRIGHTNESS)),
        ("stand-ins-flip", stand_ins::sheet(records, &stand_ins::FLIP)),
    ];
    all.into_iter().filter_map(|(name, sheet)| sheet.map(|sheet| (name, sheet))).collect()
}

/// Draws all into `folder`; says on stderr what each shows.
pub fn draw(records: &[Record], folder: &Path) -> Outcome {
    std::fs::create_dir_all(folder)?;
    for (name, sheet) in sheets(records).into_iter().chain([("mended", mended::sheet()?)]) {
        let svg = draw::svg(&sheet)?;
        let png = draw::png(&svg)?;
        if svg.len() > MOST || png.len() > MOST {
            return Err(Failure::new(format!(
                "{name}: {} and {} bytes, too much to be committed",
                svg.len(),
                png.len()
            )));
        }
        std::fs::write(folder.join(format!("{name}.svg")), svg)?;
        std::fs::write(folder.join(format!("{name}.png")), png)?;
        eprintln!("{name}: {}", sheet.title);
    }
    if let Some(table) = table5::table(records) {
        std::fs::write(folder.join("table5.md"), table)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::Spread;
    use crate::record::tests::{record, trace};
    use crate::record::{Accuracy, Built, Cold, Moment, Outcomes, Surfaced};
    use resvg::usvg::roxmltree::Document;

    fn records() -> Vec<Record> {
        let mut all = Vec::new();
        for scene in ["a scan", "a soup"] {
            for rays in ["primary", "shadow", "bounce", "picture"] {
                for (poe, mrays, off) in [(0.0, 10.0, 0.0), (1.0, 14.0, 0.5), (3.0, 16.0, 1.0), (10.0, 20.0, 2.0)] {
                    let mut one = trace(scene, "bvh", rays, poe, mrays, off);
                    one.benchmark = if rays == "picture" { "pictures" } else { "speed" }.into();
                    all.push(one.clone());
                    one.benchmark = "table5".into();
                    one.key += " table";
                    all.push(one);
                }
                if rays != "picture" {
                    all.push(trace(scene, "embree", rays, 0.0, 12.0, 0.0));
                    all.push(trace(scene, "parry3d", rays, 0.0, 3.0, 0.0));
                }
            }
        }
        let moment = |seconds: f64, mean_px: f64| {
            let some = Some(mean_px / 10.0);
            let accuracy = Accuracy { mean_px, flip: some, foreign: some, brightness: some, ..Accuracy::default() };
            Moment { seconds, bytes_read: (1e6 * seconds) as u64, accuracy }
        };
        let cold = |structure: &str, budget| Cold {
            structure: structure.into(),
            view: 0,
            poe: 0.0,
            threads: 2,
            budget,
            rate: 100 << 20,
            opened_seconds: 0.1,
            pictures: vec![moment(0.2, 5.0), moment(0.9, 0.0)],
            bytes_resident: 1,
        };
        for budget in [16 << 20, 1 << 30] {
            all.push(record("a scan", &format!("cold {budget}"), Outcomes::Cold(cold("bvh", budget))));
        }
        for kind in ["voxels", "proxies"] {
            let mut one = record("a soup", &format!("cold {kind}"), Outcomes::Cold(cold(kind, 1 << 30)));
            one.benchmark = stand_ins::BENCHMARK.into();
            all.push(one);
        }
        let outcome = |side: &str, quality: &str| {
            let seconds = Spread { median: 0.5, least: 0.4, most: 0.9 };
            let (side, is_peer) = (side.to_owned(), side != "bvh");
            let bytes_file = (!is_peer).then_some(14_000_000);
            Outcomes::Build(Built {
                side,
                is_peer,
                quality: quality.into(),
                threads: 2,
                seconds,
                bytes_model: 30_000_000,
                bytes_file,
            })
        };
        for (side, rays) in [("patch", "primary"), (crate::surfaces::GRID, "primary"), ("patch", "bounce")] {
            for level in [3, 4] {
                let is_peer = side != "patch";
                let (side, rays) = (side.to_owned(), rays.to_owned());
                let key = format!("surfaces {side} {rays} {level}");
                let found = Surfaced { side, is_peer, rays, level, bytes: 8000, mrays: 2.0, ..Surfaced::default() };
                all.push(record("a car", &key, Outcomes::Surfaces(Box::new(found))));
            }
        }
        for (side, quality) in [("bvh", "default"), ("embree", "low"), ("embree", "high")] {
            all.push(record("a scan", &format!("build {quality}"), outcome(side, quality)));
            all.push(record("a CAD soup", &format!("soup {quality}"), outcome(side, quality)));
        }
        all
    }

    #[test]
    fn every_chart_is_drawn_and_can_be_read() {
        let drawn = sheets(&records());
        assert_eq!(
            drawn.iter().map(|s| s.0).collect::<Vec<_>>(),
            [
                "speed",
                "coverage",
                "memory",
                "lod",
                "cold",
                "builds",
                "surfaces",
                "stand-ins-foreign",
                "stand-ins-brightness",
                "stand-ins-flip"
            ]
        );
        for (name, sheet) in drawn {
            let svg = draw::svg(&sheet).expect("a chart");
            let parsed = Document::parse(&svg).expect("an XML file");
            let texts: Vec<&str> = parsed.descendants().filter_map(|n| n.text()).map(str::trim).collect();
            let has = |text: &str| texts.contains(&text);
            assert!(has(&sheet.title) && has(&sheet.foot), "{name}: {texts:?}");
            for panel in &sheet.panels {
                assert!(has(&panel.title) && has(&panel.x.label) && has(&panel.y.label), "{name}: {}", panel.title);
                assert!(panel.curves.iter().all(|curve| has(&curve.name)), "{name}: {}", panel.title);
                assert!(
                    panel.curves.iter().any(|curve| !curve.points.is_empty()),
                    "{name}: nothing in {}",
                    panel.title
                );
            }
            let png = draw::png(&svg).expect("a picture");
            assert!(png.starts_with(b"\x89PNG") && png.len() < MOST && svg.len() < MOST, "{name}: {}", png.len());
        }
    }

    #[test]
    fn without_records_there_are_no_charts() {
        assert!(sheets(&[]).is_empty());
        assert_eq!(table5::table(&[]), None);
    }

    #[test]
    fn the_table_has_a_row_a_scene() {
        let table = table5::table(&records()).expect("a table");
        assert!(
            table.contains("| a scan |") && table.contains("| a soup |") && table.contains("Boeing 777"),
            "{table}"
        );
    }
}
