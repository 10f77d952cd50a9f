//! Fuzz targets: each takes any bytes, and panics if the library breaks a promise.
//!
//! `fuzz_targets` runs them under libFuzzer (`make fuzz`). `tests/fuzz_replay.rs` runs them in `make test`, with the
//! inputs in `found`, which failed before, and with some hundred damaged seeds. A target reads no clock but that of
//! [`within`], and starts no thread unless its input asks for one, so that a failure can be repeated.

pub mod base_models;
pub mod builds;
pub mod calls;
pub mod files;
pub mod geometry_calls;
pub mod images;
pub mod importers;
pub mod model_edits;
pub mod model_files;
pub mod mutate;
pub mod objects;
pub mod seeds;
pub mod sources;

#[path = "../../common/brute.rs"]
pub mod brute;
#[path = "../../common/errors.rs"]
pub mod errors;
#[path = "../../common/rays.rs"]
pub mod rays;
#[path = "../../common/rng.rs"]
pub mod rng;
#[path = "../../common/rounding.rs"]
pub mod rounding;
#[path = "../../common/thread_memory.rs"]
pub mod thread_memory;
#[path = "../../common/stored.rs"]
pub mod stored;

use outcrop::Error;
use std::time::{Duration, Instant};

/// A fuzz target.
pub struct Target {
    /// Its name, that of its file in `fuzz_targets` and of its folder in `found`.
    pub name: &'static str,
    /// Panics if the library breaks a promise for this input.
    pub run: fn(&[u8]),
    /// Inputs to begin with.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

/// All targets.
pub const TARGETS: [Target; 10] = [
    Target { name: "ply", run: importers::ply, seeds: seeds::ply },
    Target { name: "obj", run: importers::obj, seeds: seeds::obj },
    Target { name: "stl", run: importers::stl, seeds: seeds::stl },
    Target { name: "gltf", run: importers::gltf, seeds: seeds::gltf },
    Target { name: "raw", run: importers::raw, seeds: seeds::raw },
    Target { name: "images", run: images::run, seeds: seeds::images },
    Target { name: "builds", run: builds::run, seeds: || seeds::noise(600) },
    Target { name: "model_files", run: model_files::run, seeds: || seeds::noise(200) },
    Target { name: "calls", run: calls::run, seeds: || seeds::noise(2000) },
    Target { name: "sources", run: sources::run, seeds: || seeds::noise(60) },
];

/// Set to a folder for seeds: a target then writes its own there, and ends.
pub const SEEDS: &str = "OUTCROP_FUZZ_SEEDS";

/// Runs a target.
pub fn run(name: &str, data: &[u8]) {
    (named(name).run)(data);
}

fn named(name: &str) -> &'static Target {
    TARGETS.iter().find(|target| target.name == name).expect("a target of this name")
}

/// Writes the seeds of a target if [`SEEDS`] asks for them, and ends the process.
pub fn seeds_on_request(name: &str) {
    let Some(folder) = std::env::var_os(SEEDS).map(std::path::PathBuf::from) else { return };
    std::fs::create_dir_all(&folder).expect("a folder for seeds");
    for (i, seed) in (named(name).seeds)().iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{i:03}")), seed).expect("a seed");
    }
    std::process::exit(0);
}

/// Time in which any input of a few kilobytes must be done, however slow the build and the machine. Real hangs take
/// for ever.
const LONGEST: Duration = Duration::from_secs(30);

/// Runs `work`, which must end in [`LONGEST`], and hold at most `bytes` at a time.
pub fn within<T>(bytes: u64, work: impl FnOnce() -> T) -> T {
    let begun = Instant::now();
    let (done, peak) = thread_memory::peak(work);
    let took = begun.elapsed();
    assert!(took < LONGEST, "it took {took:?}");
    assert!(peak <= bytes, "it held {peak} bytes; {bytes} are allowed");
    done
}

/// Panics if an error says that the library is at fault.
pub fn not_internal(error: &Error) {
    assert!(!matches!(error, Error::Internal(_)), "{error}");
    assert!(!error.to_string().is_empty());
}
