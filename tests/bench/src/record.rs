//! Results: one JSON object a line, appended to `target/bench/results.jsonl`.

use crate::failure::{Failure, Outcome};
use crate::pairs::Spread;
use serde::{Deserialize, Serialize};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// One measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// What the answers are expected under, and who gave them: a later record of the same key replaces an earlier one.
    pub key: String,
    pub benchmark: String,
    pub scene: String,
    /// The scene, as charts call it.
    pub title: String,
    pub triangles: u64,
    #[serde(flatten)]
    pub run: Run,
    #[serde(flatten)]
    pub result: Outcomes,
}

/// Where and when.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    pub machine: String,
    pub isa: String,
    pub commit: String,
    pub date: String,
    /// Whether `cargo bench` was told the CPU: peers that choose their vector instructions when compiled need that.
    pub compiled_for: String,
}

impl Record {
    /// If it is one of rays.
    pub fn trace(&self) -> Option<&Trace> {
        if let Outcomes::Trace(trace) = &self.result { Some(trace) } else { None }
    }
}

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "measure", rename_all = "lowercase")]
pub enum Outcomes {
    Trace(Box<Trace>),
    Cold(Cold),
    Build(Built),
    Decode(Decoded),
    Settings(Setting),
    Clash(Clashed),
    Nearest(Near),
    Many(Box<Many>),
    Surfaces(Box<Surfaced>),
}

/// Time of tracing rays, or of a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trace {
    /// A structure of outcrop, or a peer.
    pub side: String,
    pub is_peer: bool,
    /// Version and way of asking, of a peer.
    pub call: String,
    pub residency: String,
    pub view: usize,
    pub rays: String,
    pub poe: f32,
    pub threads: usize,
    pub count: usize,
    pub hits: usize,
    pub seconds: Spread,
    pub mrays: f64,
    /// What it was paired with, and how many times as fast it is, of each pair; none for what nothing is paired with.
    pub against: Option<Against>,
    pub counters: Counters,
    /// Against exact answers.
    pub accuracy: Accuracy,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Against {
    pub side: String,
    pub call: String,
    pub seconds: Spread,
    pub ratio: Spread,
}

/// What is counted beside times; none for what a side does not tell.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// All of the structure with its triangles, as traced.
    pub bytes_model: Option<u64>,
    /// Blocks decoded for these rays, of a model with none in memory.
    pub bytes_working_set: Option<u64>,
    /// Hits that were stand-ins.
    pub stand_ins: Option<u64>,
    /// Of single rays (`counted.rs`), of a model of one tree.
    pub each: Option<PerRay>,
    /// Likewise, of rays that are traced in packets where that is how they are asked.
    #[serde(default)]
    pub together: Option<PerRay>,
}

/// What is done for a ray, on the mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PerRay {
    /// Nodes whose children's boxes were tested.
    pub nodes: f64,
    /// Leaves visited.
    pub leaves: f64,
    /// Triangles tested.
    pub triangles: f64,
    /// Times that the walk went from one block to another.
    pub blocks: f64,
    /// Of nodes, of the cache lines of leaves, and of references to other blocks; what tells of a hit is not in it.
    pub bytes: f64,
    /// Cache lines of 64 bytes that these are in, each counted as often as it is visited.
    pub lines: f64,
}

/// How far answers are off those of exact rays, in widths of a ray that covers a pixel (`tests/common/picture.rs`).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    pub mean_px: f64,
    pub p95_px: f64,
    pub p999_px: f64,
    pub worst_px: f64,
    /// Rays that hit in both over rays that hit in either.
    pub overlap: f64,
    /// Rays that hit over rays that hit exactly.
    pub coverage: f64,
    /// Share of rays that hit only in one of both.
    pub differ: f64,
    /// Share of rays that hit only in one of both, or end more than the width of a pixel's ray away; of pictures none.
    pub otherwise: Option<f64>,
    /// Median of stated error over true error of stand-ins, of rays (`tests/common/promise.rs`; where the promise is
    /// broken there is no record).
    pub slack: Option<f64>,
    /// Mean angle between normals, of pictures.
    pub normal_degrees: Option<f64>,
    /// Mean FLIP, of pictures (`tests/common/perceived.rs`).
    pub flip: Option<f64>,
    /// Mean SSIM, of pictures.
    pub ssim: Option<f64>,
    /// Of the pixels with surface, the share that shows a part which the exact picture has nowhere near
    /// (`tests/common/foreign.rs`), of cold pictures of several parts.
    pub foreign: Option<f64>,
    /// Linear brightness over that of the exact picture, of cold pictures.
    pub brightness: Option<f64>,
}

/// A picture from nothing in memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cold {
    pub structure: String,
    pub view: usize,
    pub poe: f32,
    pub threads: usize,
    pub budget: u64,
    /// Bytes a second that the source gives.
    pub rate: u64,
    pub opened_seconds: f64,
    /// Seconds since opening began, and how far the picture is off then.
    pub pictures: Vec<Moment>,
    pub bytes_resident: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    pub seconds: f64,
    /// Since opening began.
    #[serde(default)]
    pub bytes_read: u64,
    pub accuracy: Accuracy,
}

/// A build.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Built {
    pub side: String,
    pub is_peer: bool,
    pub quality: String,
    pub threads: usize,
    pub seconds: Spread,
    /// As traced, with its triangles.
    pub bytes_model: u64,
    /// None for what has no file.
    pub bytes_file: Option<u64>,
}

/// Decoding of all geometry blocks in one thread; seconds of each step, and of all.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Decoded {
    pub structure: String,
    pub bytes_stored: u64,
    /// As traced.
    pub bytes_trace: u64,
    /// Checksum and LZ4.
    pub opened: Spread,
    pub decoded: Spread,
    pub linked: Spread,
    pub all: Spread,
}

/// A picture in one setting, by the CPU time of the one thread that made it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    pub setting: String,
    pub view: usize,
    /// Pixels that show a surface.
    pub hits: usize,
    pub seconds: Spread,
    /// The least time over that of the headlight picture.
    pub of_headlight: f64,
    /// Embree, with how many times as fast outcrop is.
    pub against: Option<Against>,
    /// Share of pixels that hit only in one of both, or whose depths differ by more than a thousandth.
    pub differ: Option<f64>,
    /// Mean difference of colours from Embree's, in levels of 255: normals between corners and dark fringes differ.
    pub levels: Option<f64>,
}

/// A search for all pairs of triangles that meet.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Clashed {
    /// A structure of outcrop, or a peer.
    pub side: String,
    pub is_peer: bool,
    /// What is asked for, or the peer's version and test.
    pub call: String,
    pub threads: usize,
    /// Bytes; 0: all is in memory.
    pub budget: u64,
    pub seconds: Spread,
    /// What it was paired with, and how many times as fast it is.
    pub against: Option<Against>,
    /// Pairs of triangles that meet.
    pub pairs: usize,
    /// Pairs that a peer finds which are apart by exact arithmetic, and pairs that it misses.
    pub wrong: Option<[usize; 2]>,
    /// Pairs of places of two trees.
    pub places: Option<u64>,
    /// Pairs of triangles whose boxes overlap.
    pub tested: Option<u64>,
    /// Seconds until it is known whether any pair meets.
    pub first: Option<Spread>,
    /// Blocks that a search reads if all of them can stay, and with the budget.
    pub blocks: Option<[usize; 2]>,
    /// Most bytes of the context's memory at one time.
    pub bytes_most: Option<u64>,
}

/// A search for the nearest points of a batch, or for the distance of two sets.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Near {
    /// A structure of outcrop, or a peer.
    pub side: String,
    pub is_peer: bool,
    /// The peer's version and way of asking.
    pub call: String,
    /// Kind of points, or the gap of two sets.
    pub asked: String,
    /// Number of points; 1 for two sets.
    pub count: usize,
    /// For all of them.
    pub seconds: Spread,
    /// What it was paired with, and how many times as fast it is.
    pub against: Option<Against>,
    /// Greatest error of a distance, in diagonals of the model.
    pub worst: f64,
    /// Distances that are off by more than a millionth of the diagonal.
    pub wrong: usize,
}

/// A commit of a scene of many instances, or rays in it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Many {
    /// A structure of outcrop, or a peer.
    pub side: String,
    pub is_peer: bool,
    /// The peer's version, quality and way of asking.
    pub call: String,
    /// An edit that is committed, or the view and the kind of rays.
    pub asked: String,
    pub poe: f32,
    pub instances: usize,
    /// Rays; of commits 0.
    pub count: usize,
    /// Of all rays, or of a commit with its edits.
    pub seconds: Spread,
    /// What it was paired with (exact rays), and how many times as fast it is.
    pub against: Option<Against>,
    /// The median over that of adding and committing all instances, of the same side.
    pub of_commit: Option<f64>,
    /// Bytes an instance: counted by the side itself, and by which the program's resident memory grew.
    pub bytes: Option<[f64; 2]>,
    /// Rays that end elsewhere than exact ones of outcrop: they hit only in one of both, or farther or nearer by more
    /// than a ten thousandth.
    pub differ: Option<usize>,
    /// Hits that were stand-ins; any hits do not say what they are.
    pub stand_ins: Option<usize>,
    /// Root of the mean square of the difference of `t` from that of the exact hit, over that, of rays that hit in
    /// both.
    pub rms: Option<f64>,
    /// Mean error that stand-ins state, in widths of a ray that covers a pixel.
    pub stated: Option<f64>,
    /// Against exact answers of outcrop.
    pub accuracy: Option<Accuracy>,
}

/// Rays on a surface at a level.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Surfaced {
    /// A structure of outcrop, or a kind of Embree's geometries.
    pub side: String,
    pub is_peer: bool,
    /// The peer's version and way of asking.
    pub call: String,
    /// 2 to this power segments along each side of a face.
    pub level: u32,
    pub view: usize,
    pub rays: String,
    pub poe: f32,
    pub count: usize,
    /// Of exact rays.
    pub hits: usize,
    pub seconds: Spread,
    /// By the median of seconds.
    pub mrays: f64,
    /// All that rays need of the surface in memory.
    pub bytes: u64,
    /// Rays that hit only in one of both, or end elsewhere than exact ones of the first structure.
    pub differ: usize,
}

/// Behind a commit that is not all of what was measured.
const CHANGED: &str = ", changed";

impl Run {
    /// Whether it is of no commit.
    pub fn is_changed(&self) -> bool {
        self.commit.ends_with(CHANGED)
    }

    /// Of this machine, now.
    pub fn now(isa: &str) -> Self {
        let said = |program: &str, arguments: &[&str]| {
            let output = Command::new(program).args(arguments).output().ok().filter(|o| o.status.success());
            output.map(|o| String::from_utf8_lossy(&o.stdout).trim().to_owned())
        };
        // Texts and charts change no results.
        let measured = ["--", ".", ":!*.md", ":!tests/bench/charts"];
        let git = |arguments: &[&str]| said("git", &[arguments, &measured].concat());
        let commit = git(&["log", "-1", "--format=%h"]).unwrap_or_else(|| "unknown".into());
        let is_changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|s| !s.is_empty());
        let compiled_for = if cfg!(target_feature = "avx512f") {
            "AVX-512"
        } else if cfg!(target_feature = "avx2") {
            "AVX2"
        } else {
            "baseline"
        };
        Self {
            machine: machine(),
            isa: isa.into(),
            commit: if is_changed { format!("{commit}{CHANGED}") } else { commit },
            date: said("date", &["-u", "+%Y-%m-%d %H:%M"]).unwrap_or_else(|| "unknown".into()),
            compiled_for: compiled_for.into(),
        }
    }
}

/// As "2 cores of AMD EPYC".
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split(": ").nth(1));
    format!("{cores} cores of {}", name.unwrap_or(std::env::consts::ARCH))
}

/// The file of results.
pub fn path() -> PathBuf {
    crate::scenes::folder().join("results.jsonl")
}

/// Appends.
pub fn append(path: &Path, records: &[Record]) -> Outcome {
    std::fs::create_dir_all(path.parent().expect("results are in a folder"))?;
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    for record in records {
        writeln!(file, "{}", serde_json::to_string(record).map_err(|e| e.to_string())?)?;
    }
    Ok(())
}

/// The last record of each key, in the order in which keys came.
pub fn read(path: &Path) -> Result<Vec<Record>, Failure> {
    let text = match std::fs::read_to_string(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        read => read?,
    };
    let mut records: Vec<Record> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let advice = "is it of an older version of the benchmarks? Move the file away";
        let wrong = |e| format!("{}, line {}: {e}; {advice}", path.display(), i + 1);
        let record: Record = serde_json::from_str(line).map_err(wrong)?;
        match records.iter_mut().find(|r| r.key == record.key) {
            Some(old) => *old = record,
            None => records.push(record),
        }
    }
    Ok(records)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    fn run() -> Run {
        let text = String::from;
        Run { machine: text("m"), isa: text("i"), commit: text("c"), date: text("d"), compiled_for: text("f") }
    }

    /// A record of rays, for charts too.
    pub fn trace(scene: &str, side: &str, rays: &str, poe: f32, mrays: f64, mean_px: f64) -> Record {
        let seconds = Spread { median: 1.0 / mrays, least: 0.9 / mrays, most: 1.2 / mrays };
        // Of rays that Embree traces at 12 million a second.
        let ratio = Spread { median: mrays / 12.0, least: mrays / 13.0, most: mrays / 11.0 };
        let is_peer = side != "bvh";
        let trace = Trace {
            side: side.into(),
            is_peer,
            call: "8 medium".into(),
            residency: "all".into(),
            view: 0,
            rays: rays.into(),
            poe,
            threads: 2,
            count: 1_000_000,
            hits: 400_000,
            seconds,
            mrays,
            against: (side != "embree").then(|| Against {
                side: "embree".into(),
                call: "16 high".into(),
                seconds,
                ratio,
            }),
            counters: Counters {
                bytes_model: Some(30_000_000),
                bytes_working_set: (!is_peer).then_some((20e6 / (1.0 + poe)) as u64),
                stand_ins: Some(7),
                each: Some(PerRay {
                    nodes: 9.25,
                    leaves: 2.0,
                    triangles: 5.5,
                    blocks: 1.0,
                    bytes: 1500.5,
                    lines: 27.0,
                }),
                together: None,
            },
            accuracy: Accuracy { mean_px, overlap: 1.0 - mean_px / 100.0, coverage: 1.0, ..Accuracy::default() },
        };
        let key = format!("{scene} {side} {rays} {poe}");
        record(scene, &key, Outcomes::Trace(Box::new(trace)))
    }

    pub fn record(scene: &str, key: &str, result: Outcomes) -> Record {
        let benchmark = "speed".into();
        Record {
            key: key.into(),
            benchmark,
            scene: scene.into(),
            title: scene.into(),
            triangles: 1_000_000,
            run: run(),
            result,
        }
    }

    #[test]
    fn lines_come_back_as_they_were_and_later_ones_replace_earlier_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("of/results.jsonl");
        assert_eq!(read(&path).expect("no results yet"), []);
        let cold = Cold {
            structure: "bvh".into(),
            view: 1,
            poe: 1.0,
            threads: 2,
            budget: 64 << 20,
            rate: 100 << 20,
            opened_seconds: 0.01,
            pictures: vec![Moment {
                seconds: 0.1,
                bytes_read: 3,
                accuracy: Accuracy { mean_px: 1.0 / 3.0, ..Accuracy::default() },
            }],
            bytes_resident: 5,
        };
        let seconds = Spread { median: 2.0, least: 1.0, most: 3.0 };
        let built = Built {
            side: "embree".into(),
            is_peer: true,
            quality: "low".into(),
            threads: 2,
            seconds,
            bytes_model: 9,
            bytes_file: None,
        };
        let decoded = Decoded {
            structure: "bvh".into(),
            bytes_stored: 3,
            bytes_trace: 4,
            opened: seconds,
            decoded: seconds,
            linked: seconds,
            all: Spread { median: 6.0, ..seconds },
        };
        let all = [
            trace("a", "bvh", "primary", 0.5, 3.0, 0.1),
            record("a", "cold", Outcomes::Cold(cold)),
            record("a", "build", Outcomes::Build(built)),
            record("a", "decode", Outcomes::Decode(decoded)),
        ];
        append(&path, &all[..2]).expect("written");
        append(&path, &all[2..]).expect("written");
        assert_eq!(read(&path).expect("results"), all);
        let newer = trace("a", "bvh", "primary", 0.5, 4.0, 0.1);
        append(&path, std::slice::from_ref(&newer)).expect("written");
        let now = read(&path).expect("results");
        assert_eq!((now.len(), &now[0]), (4, &newer));
        std::fs::write(&path, "{}\n").expect("written");
        assert!(read(&path).expect_err("no record").to_string().contains("line 1"));
    }
}
