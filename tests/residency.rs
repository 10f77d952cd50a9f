//! Exact answers within a budget far below the model's size.

use crate::common::built::{self, Built, OfEach, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::base::tasks::{Executor, Task};
use outcrop::build::Builder;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Query, QueryOptions, QueryState};
use outcrop::scene::{Context, ContextOptions, Model, Scene, SceneState};
use outcrop::store::{CallbackSource, FileSource, Source};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::SeqCst};
use std::time::{Duration, Instant};

/// A file that all tests read.
struct Large {
    path: PathBuf,
    /// Bytes of its geometry in memory.
    bytes: u64,
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

fn large() -> &'static Large {
    static LARGE: OfEach<Large> = OfEach::new();
    LARGE.get(|| {
        let folder = Box::leak(Box::new(tempfile::tempdir().expect("a folder")));
        let path = folder.path().join("bulb.oc");
        let (progress, options) = (Arc::new(Progress::default()), built::options());
        let mut builder = Builder::new(options, progress, Cancel::new()).expect("a builder");
        let options = GenerateOptions { triangles: built::sized(1_200_000, 180_000), seed: 0, ..Default::default() };
        generate("mandelbulb", &options, &Cancel::new(), &mut builder).expect("a bulb");
        builder.finish(&path).expect("a build");
        let rays = rays(20_000, 5, DVec3::ZERO, 1.2);
        let context = built::context(2);
        let (state, model) = scene(&context, Arc::new(FileSource::open(&path).expect("the file"))).expect("it opens");
        assert!(model.load(&Cancel::new()).expect("it loads"), "all of it fits");
        let hits = ask(&state, &rays).expect("answers");
        let met = hits.iter().filter(|h| h.kind == HitKind::Exact).count();
        assert!(met > rays.len() / 4 && met < rays.len(), "{met}");
        Large { path, bytes: model.memory().geometry, rays, hits }
    })
}

fn rays(count: usize, seed: u64, center: DVec3, radius: f64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    let ray = |_| {
        let from = center + rng.direction() * radius * rng.between(0.1, 4.0);
        let to = center + rng.direction() * radius * rng.unit();
        Ray::new(from, (to - from).as_vec3())
    };
    (0..count).map(ray).collect()
}

fn scene(context: &Context, source: Arc<dyn Source>) -> outcrop::Result<(Arc<SceneState>, Model)> {
    let model = Model::open_source(context, source)?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    scene.commit()?;
    Ok((scene.state(), model))
}

fn ask(state: &SceneState, rays: &[Ray]) -> outcrop::Result<Vec<Hit>> {
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(rays, QueryOptions::default(), &mut hits)?;
    Ok(hits)
}

fn same(got: &[Hit], expected: &[Hit], what: &str) {
    let differ = (0..got.len()).find(|&i| got[i] != expected[i]);
    assert_eq!(differ.map(|i| (i, got[i], expected[i])), None, "{what}");
}

/// The host's threads: one for each task.
struct Spawning;

impl Executor for Spawning {
    fn concurrency(&self) -> usize {
        2
    }
    fn submit(&self, task: Task) {
        std::thread::spawn(move || task.run());
    }
}

/// The host's thread that hands a task in runs it, then and there.
struct AtOnce;

impl Executor for AtOnce {
    fn concurrency(&self) -> usize {
        2
    }
    fn submit(&self, task: Task) {
        task.run();
    }
}

fn context(threads: usize, executor: bool, memory_budget: u64) -> Context {
    context_of(threads, executor.then(|| Arc::new(Spawning) as Arc<dyn Executor>), memory_budget)
}

fn context_of(threads: usize, executor: Option<Arc<dyn Executor>>, memory_budget: u64) -> Context {
    Context::new(ContextOptions { threads, executor, memory_budget, ..Default::default() }).expect("a context")
}

/// Runs `f` while another thread watches that the budget is kept; returns the most that was used.
fn watched<T>(context: &Context, f: impl FnOnce() -> T) -> (T, u64) {
    let (stop, most) = (AtomicBool::new(false), AtomicU64::new(0));
    let result = std::thread::scope(|threads| {
        threads.spawn(|| {
            while !stop.load(SeqCst) {
                most.fetch_max(context.memory_used(), SeqCst);
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        let result = f();
        stop.store(true, SeqCst);
        result
    });
    (result, most.into_inner())
}

fn exact_answers_within_a_part_are_those_of_the_whole() {
    let large = large();
    // The least that a model needs is less than an eighth of a large one.
    let budget = large.bytes / built::sized(8, 2);
    for (threads, executor) in [(1, false), (2, false), (0, false), (0, true)] {
        let context = context(threads, executor, budget);
        let (state, model) = scene(&context, Arc::new(FileSource::open(&large.path).unwrap())).expect("it opens");
        let begun = Instant::now();
        let (hits, most) = watched(&context, || ask(&state, &large.rays).expect("answers"));
        let what = format!("{threads} threads, executor {executor}");
        println!("{what}: {:?}, {most} of {budget} bytes, of {}", begun.elapsed(), large.bytes);
        same(&hits, &large.hits, &what);
        assert!(most <= budget && most > budget / 4, "{what}: {most} of {budget}");
        drop((state, model));
    }
}

/// With the least budget there is room for nothing but the lease.
fn exact_answers_with_the_least_budget_are_those_of_the_whole() {
    let large = large();
    let open = |budget| {
        let context = context(2, false, budget);
        scene(&context, Arc::new(FileSource::open(&large.path).unwrap())).map(|opened| (context, opened))
    };
    let Err(Error::OverBudget { need, have: 4096, .. }) = open(4096).map(drop) else { panic!("a page does not do") };
    assert!(need < large.bytes / built::sized(8, 2), "{need} of {}", large.bytes);
    assert!(matches!(open(need - 1).map(drop), Err(Error::OverBudget { .. })));
    let (context, (state, _model)) = open(need).expect("the least does");
    let count = 3000;
    // Several at once: they take turns.
    let (_, most) = watched(&context, || {
        std::thread::scope(|threads| {
            for part in 0..2 {
                let (state, range) = (&state, part * count..(part + 1) * count);
                threads.spawn(move || {
                    let hits = ask(state, &large.rays[range.clone()]).expect("answers");
                    same(&hits, &large.hits[range], "the least budget");
                });
            }
        });
    });
    assert!(most <= need, "{most} of {need}");
    // Boxes too: a visit to most blocks goes on from where it lacked one.
    let whole = built::context(2);
    let (whole, _) = scene(&whole, Arc::new(FileSource::open(&large.path).unwrap())).expect("it opens");
    for half in [0.8, 2.0] {
        let volume = outcrop::math::DBounds { min: DVec3::splat(-half), max: DVec3::splat(half) };
        let met = state.overlap_box(&volume).expect("an answer");
        assert!(!met.is_empty());
        assert_eq!(met, whole.overlap_box(&volume).expect("an answer"));
    }
}

/// Whoever has the lease works on what may need it only for himself: whichever threads there are, calls end.
fn calls_that_take_turns_with_the_least_memory_end_on_any_threads() {
    let large = large();
    let Err(Error::OverBudget { need, .. }) =
        scene(&context(2, false, 4096), Arc::new(FileSource::open(&large.path).unwrap()))
    else {
        panic!("a page does not do")
    };
    let executors =
        [None, None, Some(Arc::new(AtOnce) as Arc<dyn Executor>), Some(Arc::new(Spawning) as Arc<dyn Executor>)];
    for (i, executor) in executors.into_iter().enumerate() {
        let context = context_of(i % 2, executor, need);
        let (state, model) = scene(&context, Arc::new(FileSource::open(&large.path).unwrap())).expect("the least does");
        std::thread::scope(|threads| {
            for part in 0..3 {
                // More than a chunk: with rounds of several items.
                let (state, range) = (&state, part * 1500..(part + 1) * 1500);
                threads.spawn(move || {
                    same(&ask(state, &large.rays[range.clone()]).expect("answers"), &large.hits[range], "taking turns")
                });
            }
        });
        drop((state, model));
    }
}

/// Rays that pass stand-ins walk twice, and lack blocks in both.
#[test]
fn rays_that_pass_stand_ins_end_with_the_least_budget() {
    let file = built::parts(&[Part::white(1, scenes::wire_forest(1500, 24, 6))]);
    let open = |context: &Context| scene(context, Arc::new(FileSource::open(&file.path).unwrap()));
    let mut rng = Rng::new(9);
    let rays: Vec<Ray> = (0..1500)
        .map(|i| {
            // From among them, and from afar.
            let far = [2.0, 60.0][i % 2];
            let from = DVec3::Z * 2.0 + rng.direction() * far * rng.between(0.3, 1.0);
            let to = rng.inside(DVec3::new(-9.0, -9.0, 0.0), DVec3::new(9.0, 9.0, 6.0));
            let dir = (to - from).normalize().as_vec3();
            Ray { cone: Cone { a: 0.0, b: [0.003, 0.01][i / 2 % 2] }, ..Ray::new(from, dir) }
        })
        .collect();
    let whole = built::context(2);
    let (state, model) = open(&whole).expect("it opens");
    assert!(model.load(&Cancel::new()).expect("it loads"), "all of it fits");
    let expected = ask(&state, &rays).expect("answers");
    let transmitted = expected.iter().filter(|h| h.kind == HitKind::Miss && h.t_free < f64::INFINITY).count();
    assert!(transmitted > 50, "{transmitted} transmitted");
    let Err(Error::OverBudget { need, .. }) = open(&context(2, false, 4096)) else { panic!("a page does not do") };
    let least = context(2, false, need);
    let (state, _model) = open(&least).expect("the least does");
    let (hits, most) = watched(&least, || ask(&state, &rays).expect("answers"));
    println!("{transmitted} of {} transmitted, {most} of {need} bytes", rays.len());
    same(&hits, &expected, "the least budget");
    assert!(most <= need, "{most} of {need}");
}

/// What is read for rays of two kinds, with one budget after the other: a larger one is no reason to read more.
fn with_more_memory_no_more_is_read() {
    let large = large();
    let at = |i: usize| DVec3::new(0.03 * (i % 80) as f64 - 1.2, 0.03 * (i / 80) as f64 - 1.2, 4.0);
    let of_a_camera: Vec<Ray> = (0..6400).map(|i| Ray::new(at(i), -glam::Vec3::Z)).collect();
    for (what, rays) in [("any way", &large.rays), ("of a camera", &of_a_camera)] {
        more_memory_reads_no_more(what, rays);
    }
}

fn more_memory_reads_no_more(what: &str, rays: &[Ray]) {
    let large = large();
    let counted = |budget| {
        let (bytes, file) = (Arc::new(AtomicU64::new(0)), FileSource::open(&large.path).unwrap());
        let (sum, len) = (Arc::clone(&bytes), file.len());
        let read = move |at: u64, buf: &mut [u8]| {
            sum.fetch_add(buf.len() as u64, SeqCst);
            file.read_at(at, buf)
        };
        let options = ContextOptions { threads: 1, memory_budget: budget, read_ahead: false, ..Default::default() };
        let context = Context::new(options).expect("a context");
        scene(&context, Arc::new(CallbackSource::new("counted", len, Box::new(read)))).map(|(state, model)| {
            bytes.store(0, SeqCst);
            let hits = ask(&state, rays).expect("answers");
            if rays.len() == large.rays.len() {
                same(&hits, &large.hits, "any budget");
            }
            drop((state, model));
            bytes.load(SeqCst)
        })
    };
    let Err(Error::OverBudget { need, .. }) = counted(4096) else { panic!("a page does not do") };
    let budgets = [10, 11, 12, 15, 20, 40, 80].map(|tenths| need * tenths / 10);
    let read = budgets.map(|budget| counted(budget).expect("it opens"));
    println!("{what}: {read:?} bytes with {budgets:?}, of {} in memory", large.bytes);
    for (i, bytes) in read.iter().enumerate().skip(1) {
        let before = read[..i].iter().min().expect("there was one before");
        assert!(*bytes <= before + before / 16, "{bytes} with {}, {before} with less: {what}, {read:?}", budgets[i]);
    }
    assert!(read[6] < read[0] / 3, "{what}: {read:?}");
}

/// A small model in a budget that is hardly larger than the least, but holds it.
fn what_fits_is_kept_however_small_the_budget() {
    let file = built::parts(&[Part::white(1, scenes::sphere(40, 80))]);
    let rays = rays(2000, 4, DVec3::ZERO, 1.0);
    let (reads, all) = (Arc::new(AtomicUsize::new(0)), std::fs::read(&file.path).expect("the file"));
    let open = |budget| {
        let (count, all) = (Arc::clone(&reads), all.clone());
        let len = all.len() as u64;
        let read = move |at: u64, buf: &mut [u8]| {
            count.fetch_add(1, SeqCst);
            buf.copy_from_slice(&all[at as usize..][..buf.len()]);
            Ok(())
        };
        let options = ContextOptions { threads: 1, memory_budget: budget, read_ahead: false, ..Default::default() };
        let context = Context::new(options).expect("a context");
        scene(&context, Arc::new(CallbackSource::new("counted", len, Box::new(read)))).map(|opened| (context, opened))
    };
    let Err(Error::OverBudget { need, .. }) = open(4096) else { panic!("a page does not do") };
    let budget = need + all.len() as u64 * 4;
    assert!(budget < 8 << 20, "{budget}");
    let (_context, (state, _model)) = open(budget).expect("it opens");
    let first = ask(&state, &rays).expect("answers");
    let before = reads.load(SeqCst);
    same(&ask(&state, &rays).expect("answers"), &first, "once more");
    assert_eq!(reads.load(SeqCst), before, "with {budget} bytes");
}

fn what_was_read_for_rays_is_there_for_the_same_rays() {
    let large = large();
    let reads = Arc::new(AtomicUsize::new(0));
    let (count, file) = (Arc::clone(&reads), FileSource::open(&large.path).unwrap());
    let len = file.len();
    let read = move |at: u64, buf: &mut [u8]| {
        count.fetch_add(1, SeqCst);
        file.read_at(at, buf)
    };
    let context = context(2, false, large.bytes / built::sized(4, 2));
    let (state, _model) = scene(&context, Arc::new(CallbackSource::new("counted", len, Box::new(read)))).unwrap();
    // Into a corner: few blocks.
    let rays: Vec<Ray> = (0..400)
        .map(|i| Ray::new(DVec3::new(0.02 * (i % 20) as f64, 0.02 * (i / 20) as f64, 4.0), -glam::Vec3::Z))
        .collect();
    let first = ask(&state, &rays).unwrap();
    let before = reads.load(SeqCst);
    for _ in 0..3 {
        same(&ask(&state, &rays).unwrap(), &first, "once more");
    }
    assert_eq!(reads.load(SeqCst), before, "reads for what is there");
}

fn sphere() -> Built {
    let rings = built::sized(150, 40);
    built::parts(&[Part::white(5, scenes::sphere(rings, 2 * rings))])
}

/// The disk fails at call N, once or for good: an answer or an error, and never a wait without end.
fn a_read_that_fails_anywhere_ends_in_an_answer_or_an_error() {
    let built = sphere();
    let bytes: Arc<[u8]> = std::fs::read(&built.path).unwrap().into();
    let rays = rays(300, 3, DVec3::ZERO, 1.0);
    let expected = ask(&built::scene(&built::context(0), &built).0.state(), &rays).unwrap();
    for (threads, for_good) in [(0, false), (0, true), (2, true), (1, false)] {
        for fail_at in 0.. {
            let calls = Arc::new(AtomicUsize::new(0));
            let (count, all) = (Arc::clone(&calls), Arc::clone(&bytes));
            let read = move |at: u64, buf: &mut [u8]| {
                let call = count.fetch_add(1, SeqCst);
                if call == fail_at || call > fail_at && for_good {
                    return Err(io::ErrorKind::ConnectionReset.into());
                }
                buf.copy_from_slice(&all[at as usize..at as usize + buf.len()]);
                Ok(())
            };
            let source = Arc::new(CallbackSource::new("failing", bytes.len() as u64, Box::new(read)));
            let context = context(threads, false, 3 << 20);
            let answer = scene(&context, source).and_then(|(state, _)| {
                let hits = Arc::new(Taken(std::sync::Mutex::new(vec![Hit::MISS; rays.len()])));
                let asked: Arc<Given> = Arc::new(Given(rays.clone()));
                let query = Query::closest(&state, asked, hits.clone(), QueryOptions::default())?;
                let status = query.wait(Duration::from_secs(120));
                match status.state {
                    QueryState::Done => Ok(hits.0.lock().unwrap().clone()),
                    QueryState::Failed => Err(Error::clone(&status.error.expect("a reason"))),
                    state => panic!("call {fail_at}: {state:?}"),
                }
            });
            match answer {
                Ok(hits) => same(&hits, &expected, &format!("call {fail_at}")),
                Err(Error::Io { .. }) => {}
                Err(e) => panic!("call {fail_at}: {e}"),
            }
            if calls.load(SeqCst) <= fail_at {
                assert!(fail_at > 10);
                break;
            }
        }
    }
}

struct Given(Vec<Ray>);

impl outcrop::query::Rays for Given {
    fn count(&self) -> usize {
        self.0.len()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        out.copy_from_slice(&self.0[first..first + out.len()]);
    }
}

struct Taken(std::sync::Mutex<Vec<Hit>>);

impl outcrop::query::Hits for Taken {
    fn write(&self, first: usize, hits: &[Hit]) {
        self.0.lock().unwrap()[first..first + hits.len()].copy_from_slice(hits);
    }
}

/// In the background, with threads of ours and without.
fn a_model_that_fits_comes_in_the_background() {
    let large = large();
    for (threads, executor) in [(1, false), (0, true), (0, false)] {
        let context = context(threads, executor, 4 * large.bytes);
        let (_state, model) = scene(&context, Arc::new(FileSource::open(&large.path).unwrap())).unwrap();
        let begun = Instant::now();
        while model.memory().resident < model.memory().geometry {
            assert!(begun.elapsed() < Duration::from_secs(120));
            if threads == 0 && !executor {
                assert!(context.step(), "there is more to do");
            } else {
                std::thread::sleep(Duration::from_millis(5));
            }
        }
    }
}

built::on_each_structure!(
    exact_answers_within_a_part_are_those_of_the_whole,
    exact_answers_with_the_least_budget_are_those_of_the_whole,
    calls_that_take_turns_with_the_least_memory_end_on_any_threads,
    with_more_memory_no_more_is_read,
    what_fits_is_kept_however_small_the_budget,
    what_was_read_for_rays_is_there_for_the_same_rays,
    a_read_that_fails_anywhere_ends_in_an_answer_or_an_error,
    a_model_that_fits_comes_in_the_background,
);
