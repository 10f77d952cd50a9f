//! The memory of a flight: all bytes of the process beside the budget and the buffers of the frame stay few, whatever
//! the budget and the number of triangles, parts and instances. A budget that is too small is refused with one that
//! suffices.
//!
//! A process of its own: the count of bytes is the process's. `make flights` runs the large ones, each in a process of
//! its own, because memory that the system's allocator keeps is part of the resident bytes. OUTCROP_FLIGHTS names the
//! folder of their models (`target/figures` by default; a gigabyte, built by the first run).

#[path = "common/changed.rs"]
mod changed;
#[path = "common/counting.rs"]
mod counting;
#[path = "flight_memory/flight.rs"]
mod flight;
#[path = "flight_memory/models.rs"]
mod models;

use flight::{Content, Flight, fly};
use models::{airliner, instances};
use outcrop::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

const MIB: u64 = 1 << 20;
const MB: f64 = 1e6;

/// Most bytes beside the budget and the buffers.
const BESIDE: u64 = 32_000_000;

/// Most refusals of a model: opening names a budget that suffices for it, and so does a commit.
const REFUSALS: usize = 2;
/// Most refusals of many instances: each addition names a budget for twice as many, because it cannot know how many
/// follow.
const REFUSALS_OF_INSTANCES: usize = 16;

/// Flies in `budget` or, if that is refused, in the budget that the refusal names. Returns also the budgets refused.
fn fly_in(content: &Content, budget: u64, pictures: u32) -> (Flight, Vec<u64>) {
    let (mut budget, mut refused) = (budget, Vec::new());
    let most = if matches!(content, Content::Model(_)) { REFUSALS } else { REFUSALS_OF_INSTANCES };
    loop {
        match fly(content, budget, pictures) {
            Ok(flight) => return (flight, refused),
            Err(Error::OverBudget { need, have, what }) => {
                assert!(have == budget && need > budget, "{what}: {need} of {have}");
                refused.push(budget);
                assert!(refused.len() <= most, "{what}: {refused:?}, then {need}");
                budget = need;
            }
            Err(other) => panic!("{other}"),
        }
    }
}

/// One test: the count is the process's.
#[test]
fn flights_keep_to_their_budgets() {
    let folder = tempfile::tempdir().expect("a folder");
    let contents = [
        ("500,000 triangles", Content::Model(airliner(folder.path(), 500_000, 1))),
        ("50,000 parts", Content::Model(airliner(folder.path(), 500_000, 10))),
        ("8,000 instances", instances(folder.path(), 8000)),
    ];
    for (name, content) in contents {
        for budget in [4 * MIB, 24 * MIB] {
            let (flight, refused) = fly_in(&content, budget, 8);
            println!("{name}, refused {refused:?}: {flight}");
            assert!(flight.used <= flight.budget, "{name}: {flight}");
            assert!(flight.beside(flight.counted) <= BESIDE as i64 / 2, "{name}: {flight}");
        }
    }
}

/// The folder of large models.
fn folder() -> PathBuf {
    let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join("target/figures");
    std::env::var_os("OUTCROP_FLIGHTS").map_or_else(default, PathBuf::from)
}

const LARGE: [&str; 3] = ["triangles", "parts", "instances"];

fn large(name: &str) -> Content {
    let folder = folder();
    std::fs::create_dir_all(&folder).expect("a folder");
    match name {
        "triangles" => Content::Model(airliner(&folder, 10_000_000, 1)),
        "parts" => Content::Model(airliner(&folder, 10_000_000, 61)),
        _ => instances(&folder, 100_000),
    }
}

/// The bytes that the system has given to this process and that are no file's, now.
fn resident() -> u64 {
    flight::resident().expect("Linux")
}

#[test]
#[ignore = "one flight of `large_flights`"]
fn one_flight() {
    let asked = std::env::var("OUTCROP_FLIGHT").expect("a model and a budget");
    let (name, budget) = asked.split_once(' ').expect("a model and a budget");
    let content = large(name);
    let before = resident();
    let (flight, refused) = fly_in(&content, budget.parse().expect("bytes"), 60);
    println!("{name:>9} {flight} {:>6.1} before, refused {refused:?}", before as f64 / MB);
    assert!(flight.used <= flight.budget && flight.beside(flight.counted) <= BESIDE as i64);
    assert!(flight.beside(flight.resident) <= BESIDE as i64);
}

#[test]
#[ignore = "measures large models: make flights"]
fn large_flights() {
    let mut missed = 0;
    for name in LARGE {
        drop(large(name));
        for budget in [4, 8, 16, 32, 64, 128, 256] {
            let output = Command::new(std::env::current_exe().expect("a program"))
                .args(["--exact", "one_flight", "--ignored", "--nocapture"])
                .env("OUTCROP_FLIGHT", format!("{name} {}", budget * MIB))
                .output()
                .expect("a flight");
            let text = String::from_utf8_lossy(&output.stdout);
            let row = text.lines().find(|line| line.trim_start().starts_with(name));
            println!("{}", row.unwrap_or("no flight"));
            if !output.status.success() {
                missed += 1;
                println!("    MISSED: {}", String::from_utf8_lossy(&output.stderr));
            }
        }
    }
    assert_eq!(missed, 0);
}
