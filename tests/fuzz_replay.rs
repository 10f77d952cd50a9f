//! The fuzz targets of `tests/fuzz` on stable Rust: inputs that failed before, the seeds, and damaged seeds.

#[allow(dead_code)]
#[path = "fuzz/src/lib.rs"]
mod fuzz;

use fuzz::mutate::mutated;
use fuzz::rng::Rng;
use fuzz::{TARGETS, Target};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz")
}

/// Runs an input. If it fails, its number or name is printed first.
fn run(target: &Target, what: &str, input: &[u8]) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| (target.run)(input))) {
        let kept = std::env::temp_dir().join(format!("outcrop-fuzz-{}", target.name));
        let _ = std::fs::write(&kept, input);
        eprintln!("target {}, {what}: failed; the input is in {}", target.name, kept.display());
        resume_unwind(panic);
    }
}

/// Runs all inputs that failed before, the seeds, and `count` damaged seeds.
fn replay(name: &str, count: usize) {
    let target = TARGETS.iter().find(|target| target.name == name).expect("a target");
    let mut found: Vec<PathBuf> =
        std::fs::read_dir(folder().join("found").join(name)).into_iter().flatten().map(|e| e.unwrap().path()).collect();
    found.sort();
    for path in &found {
        run(target, &path.display().to_string(), &std::fs::read(path).expect("a found input"));
    }
    let seeds = (target.seeds)();
    for (i, seed) in seeds.iter().enumerate() {
        run(target, &format!("seed {i}"), seed);
    }
    // A failure in the course of a hunt has another number for each seed of the generator.
    let first: u64 = std::env::var("OUTCROP_FUZZ_FIRST").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
    let count = std::env::var("OUTCROP_FUZZ_COUNT").ok().and_then(|text| text.parse().ok()).unwrap_or(count);
    for i in 0..count {
        run(target, &format!("damaged seed {i}"), &mutated(&seeds, &mut Rng::new(first + i as u64)));
    }
    println!("{name}: {} found inputs, {} seeds, {count} damaged seeds", found.len(), seeds.len());
}

macro_rules! replayed {
    ($($name:ident: $count:expr),+ $(,)?) => {
        const REPLAYED: &[&str] = &[$(stringify!($name)),+];
        $(
            #[test]
            fn $name() {
                replay(stringify!($name), $count);
            }
        )+
    };
}

replayed! {
    ply: 400,
    obj: 400,
    stl: 400,
    gltf: 400,
    raw: 200,
    images: 300,
    builds: 200,
    model_files: 200,
    calls: 200,
    sources: 300,
}

/// A target that is missing in one of the lists would not be run.
#[test]
fn all_targets_are_replayed_and_can_be_fuzzed() {
    let names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
    assert_eq!(REPLAYED, names);
    let manifest = std::fs::read_to_string(folder().join("Cargo.toml")).expect("the manifest");
    for name in names {
        let main = std::fs::read_to_string(folder().join(format!("fuzz_targets/{name}.rs"))).expect("a main file");
        assert_eq!(main.matches(&format!("(\"{name}\"")).count(), 2, "{name}");
        assert!(manifest.contains(&format!("\nname = \"{name}\"\npath = \"fuzz_targets/{name}.rs\"\n")), "{name}");
    }
    for entry in std::fs::read_dir(folder().join("found")).expect("the found inputs").map(|e| e.unwrap()) {
        let name = entry.file_name().into_string().expect("a name");
        assert!(!entry.path().is_dir() || REPLAYED.contains(&name.as_str()), "found/{name}: no such target");
    }
}
