//! The memory that batches, overlaps, frames and scenes take in addition to the budget: not more than the table in
//! `src/guide/budgets.md` and the comment of `oc_context_desc.memory_budget` state.
//!
//! A process of its own: the count of bytes is the process's.

#[path = "common/counting.rs"]
mod counting;

use glam::{DAffine3, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::{DBounds, Ray};
use outcrop::query::Policy;
use outcrop::{
    Context, ContextOptions, Error, Frame, FrameOptions, FrameSettings, FrameState, Hit, Model, Outputs, QueryOptions,
    Result, Scene,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

const LONG: Duration = Duration::from_secs(1200);
const THREADS: usize = 2;
/// Rays of batches that wait for blocks.
const WAITING: u64 = 24 << 20;
/// Working memory of each thread that traces, the caller's included; and of what a batch begins at once.
const OF_THREAD: u64 = 2 << 20;
/// Three blocks for each thread that reads: the four that the library has for it, and those that trace.
const READING: u64 = (4 + THREADS as u64 + 1) * (192 << 10);
/// The context itself, and what is too little to be counted.
const REST: u64 = 1 << 20;
const OF_CALLS: u64 = WAITING + (THREADS as u64 + 1) * OF_THREAD + READING + REST;

/// Less work where the code is not optimised.
fn sized(optimised: usize, other: usize) -> usize {
    if cfg!(optimised) { optimised } else { other }
}

fn build(path: &Path, fill: impl FnOnce(&mut Builder)) {
    let options = BuildOptions { threads: THREADS, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
    fill(&mut builder);
    builder.finish(path).unwrap();
}

fn open(path: &Path, memory_budget: u64, places: usize) -> Result<(Context, Scene, Model)> {
    let options = ContextOptions { threads: THREADS, memory_budget, read_ahead: false, ..Default::default() };
    let context = Context::new(options)?;
    let model = Model::open_cold(&context, path)?;
    let scene = Scene::new(&context);
    let place = |i: usize| DAffine3::from_translation(DVec3::new((i % 300) as f64, (i / 300) as f64, 0.0) * 3.0);
    (0..places).try_for_each(|i| scene.add_instance(&model, i as u64, place(i)))?;
    scene.commit()?;
    Ok((context, scene, model))
}

/// Rays through random points of the bounds.
fn rays(count: usize, bounds: &DBounds) -> Vec<Ray> {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut point = || bounds.min + bounds.extent() * DVec3::new(random(), random(), random());
    let far = bounds.extent().length();
    let ray = |(a, b): (DVec3, DVec3)| {
        let dir = (b - a).normalize_or(DVec3::X);
        Ray::new(a - dir * far, dir.as_vec3())
    };
    (0..count).map(|_| (point(), point())).map(ray).collect()
}

/// The bytes above the budget, all that is held `since` included but `own`.
fn above(budget: u64, since: usize, own: usize, most: usize, now: usize) -> i64 {
    (now + most - since - own) as i64 - budget as i64
}

fn batches(path: &Path) {
    for budget in [6 << 20, 16 << 20] {
        let since = counting::now();
        let (_context, scene, model) = open(path, budget, 1).unwrap();
        let before = counting::now();
        let rays = rays(sized(100_000, 20_000), &scene.state().bounds());
        let mut hits = vec![Hit::MISS; rays.len()];
        let own = counting::now() - before;
        let now = counting::now();
        let state = scene.state();
        let ((), most) = counting::most(|| state.closest(&rays, QueryOptions::default(), &mut hits).unwrap());
        let batch = above(budget, since, own, most, now);
        assert!(hits.iter().any(|hit| hit.t.is_finite()));
        let now = counting::now();
        let (parts, most) = counting::most(|| state.overlap_box(&state.bounds()).unwrap().len());
        let overlap = above(budget, since, own, most, now);
        println!(
            "{budget} bytes, model of {}: a batch takes {batch} more, an overlap of {parts} parts {overlap}",
            model.memory().geometry
        );
        assert!(batch <= OF_CALLS as i64, "a batch takes {batch} bytes above {budget}");
        assert!(overlap <= (OF_CALLS + 96 * parts as u64) as i64, "an overlap takes {overlap} bytes above {budget}");
    }
}

fn frames(path: &Path) {
    let budget = 16 << 20;
    let (width, height) = (sized(640, 320) as u32, sized(400, 200) as u32);
    for (outputs, bytes) in [(Outputs::COLOUR, 4), (Outputs::ALL, 65)] {
        let since = counting::now();
        let (context, scene, model) = open(path, budget, 1).unwrap();
        let now = counting::now();
        let (status, most) = counting::most(|| {
            let frame = Frame::new(&context, FrameOptions { width, height, outputs, ..Default::default() }).unwrap();
            frame.request(&scene.state(), &model.views()[0], &FrameSettings::default()).unwrap();
            frame.wait(LONG)
        });
        assert!(matches!(status.state, FrameState::Converged | FrameState::CompleteWithinBudget), "{status:?}");
        let above = above(budget, since, 0, most, now);
        let pixels = u64::from(width * height);
        println!("{budget} bytes: a frame of {width}x{height} takes {above} more; {} a pixel", above / pixels as i64);
        let bound = pixels * (3 * bytes + 16) + OF_CALLS;
        assert!(above <= bound as i64, "a frame takes {above} bytes above {budget}, not {bound}");
    }
}

/// Rays through a stack of sheets, each with as many crossings as a single ray may have, almost.
fn crossings(path: &Path) {
    const SHEETS: usize = 30_000;
    build(path, |builder| {
        let part = builder.part(PartDesc::default()).unwrap();
        let corners = [DVec3::new(-3.0, -3.0, 0.0), DVec3::new(3.0, -3.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
        let sheets: Vec<[DVec3; 3]> = (0..SHEETS).map(|z| corners.map(|p| p + DVec3::Z * z as f64)).collect();
        builder.triangles(MeshKey::DIRECT, part, &sheets, Attributes::NONE).unwrap();
    });
    let budget = 32 << 20;
    let (_context, scene, _) = open(path, budget, 1).unwrap();
    for count in [1, 2, 40] {
        let rays: Vec<Ray> =
            (0..count).map(|i| Ray::new(DVec3::new(f64::from(i) * 0.01, 0.0, -9.0), glam::Vec3::Z)).collect();
        let mut found = 0;
        // The blocks come at the first time.
        for time in 0..2 {
            let ((), most) = counting::most(|| {
                scene
                    .state()
                    .crossings(&&rays[..], Policy::Exact, &mut |_, crossings, _| found += crossings.len())
                    .unwrap();
            });
            let bound = (8 << 20) + budget as usize / 4;
            println!("{} rays with {SHEETS} crossings take {most} bytes of {bound}", rays.len());
            assert!(time == 0 || most <= bound, "{most} of {bound}");
        }
        assert_eq!(found, 2 * rays.len() * SHEETS);
    }
}

/// Scenes count: all that they take fits the budget, also while they are made.
fn scenes(path: &Path) {
    let places = sized(100_000, 10_000);
    let mut budget = 4096;
    let most = loop {
        let (outcome, most) = counting::most(|| open(path, budget, places).map(drop));
        match outcome {
            Ok(()) => break most,
            Err(Error::OverBudget { need, .. }) => {
                assert!(most as u64 <= budget + READING + REST, "{most} bytes in {budget}, until it is too little");
                budget = need;
            }
            Err(other) => panic!("{other}"),
        }
    };
    println!("{places} instances: {most} of {budget} bytes");
    assert!(most as u64 <= budget + READING + REST, "{most} of {budget}");
    assert!(budget / places as u64 <= 1200 + (8 << 20) / places as u64, "{budget} bytes for {places} instances");
}

/// One test: the count is the process's.
#[test]
fn calls_keep_to_the_budget_and_the_stated_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| -> PathBuf { folder.path().join(name) };
    build(&file("small.oc"), |builder| {
        let part = PartDesc { id: Some(1), name: "one".into(), parent: None, material: None };
        let part = builder.part(part).unwrap();
        builder.triangles(MeshKey::DIRECT, part, &[[DVec3::ZERO, DVec3::X, DVec3::Y]], Attributes::NONE).unwrap();
    });
    scenes(&file("small.oc"));
    let options = GenerateOptions { triangles: sized(300_000, 100_000) as u64, seed: 0, ..Default::default() };
    build(&file("large.oc"), |builder| {
        generate("airliner", &options, &Cancel::new(), builder).unwrap();
    });
    batches(&file("large.oc"));
    frames(&file("large.oc"));
    crossings(&file("stack.oc"));
}
