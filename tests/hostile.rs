//! Hostile model files with right checksums: each call ends with a status, in the budget and little more.
//!
//! A process of its own: the count of bytes is the process's.

#[path = "common/counting.rs"]
mod counting;
#[path = "hostile/makers.rs"]
mod makers;
#[path = "hostile/raw.rs"]
mod raw;
#[cfg(target_os = "linux")]
#[path = "hostile/stack.rs"]
mod stack;

use glam::{DAffine3, DVec3};
use makers::Child;
use outcrop::base::progress::Cancel;
use outcrop::math::{DBounds, Ray};
use outcrop::query::{Hits, Query, QueryState, Rays};
use outcrop::store::{CallbackSource, FileSource, MemorySource, Outline, Source};
use outcrop::{
    Context, ContextOptions, Error, Frame, FrameOptions, FrameSettings, FrameState, Hit, HitKind, Model, Outputs,
    QueryOptions, Scene, SceneState,
};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Memory beside the budget.
const BESIDE: usize = 64 << 20;
/// No call takes as long. (A bound on hangs.)
const LONGEST: Duration = Duration::from_secs(120);

/// One test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}

fn context(budget: u64) -> Context {
    let options = ContextOptions { threads: 2, memory_budget: budget, ..ContextOptions::default() };
    Context::new(options).unwrap()
}

/// What each kind of job says about a file.
#[derive(Debug)]
struct Said {
    opened: Result<(), Error>,
    jobs: Vec<(&'static str, Result<(), String>)>,
    most: usize,
}

impl Said {
    /// The jobs that succeed.
    fn successes(&self) -> Vec<&'static str> {
        self.jobs.iter().filter(|(_, said)| said.is_ok()).map(|(job, _)| *job).collect()
    }

    fn names(&self, job: &str, words: &str) -> bool {
        self.jobs.iter().any(|(of, said)| *of == job && said.as_ref().is_err_and(|why| why.contains(words)))
    }
}

fn rays() -> Vec<Ray> {
    let ray = |i: u32| Ray::new(DVec3::new(0.2 + f64::from(i % 8) * 0.05, 0.3, 5.0), -DVec3::Z.as_vec3());
    (0..300).map(ray).collect()
}

fn closest(scene: &SceneState, coherent: bool) -> Result<(), String> {
    let rays = rays();
    let mut hits = vec![Hit::MISS; rays.len()];
    let options = QueryOptions { coherent, ..QueryOptions::default() };
    scene.closest(&rays, options, &mut hits).map_err(|error| error.to_string())?;
    if hits.iter().all(|hit| hit.kind == HitKind::Exact) { Ok(()) } else { Err(format!("{:?}", hits[0].kind)) }
}

fn picture(context: &Context, scene: &Arc<SceneState>, model: &Model) -> Result<(), String> {
    let options = FrameOptions { width: 64, height: 48, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).unwrap();
    frame.request(scene, &model.views()[0], &FrameSettings::default()).unwrap();
    let status = frame.wait(LONGEST);
    match (status.state, status.error) {
        (FrameState::Converged | FrameState::CompleteWithinBudget, None) => Ok(()),
        (FrameState::Running, _) => panic!("a frame does not end"),
        (state, error) => Err(format!("{state:?} {error:?}")),
    }
}

fn jobs(context: &Context, model: &Model) -> Vec<(&'static str, Result<(), String>)> {
    let scene = Scene::new(context);
    scene.add_instance(model, 1, DAffine3::IDENTITY).unwrap();
    scene.commit().unwrap();
    let state = scene.state();
    let in_words = |error: Error| error.to_string();
    let single = || {
        let mut hit = [Hit::MISS];
        state.closest(&rays()[..1], QueryOptions::default(), &mut hit).map_err(in_words)
    };
    let any = || {
        let mut hits = vec![0; 300];
        state.any(&rays(), QueryOptions::default(), &mut hits).map_err(in_words)
    };
    let all = DBounds { min: DVec3::splat(-9.0), max: DVec3::splat(9.0) };
    vec![
        ("single", single()),
        ("stream", closest(&state, false)),
        ("packets", closest(&state, true)),
        ("any", any()),
        ("overlap", state.overlap_box(&all).map(drop).map_err(in_words)),
        ("frame", picture(context, &state, model)),
        ("load", model.load(&Cancel::new()).map(drop).map_err(in_words)),
        ("check", model.check(&Cancel::new()).map_err(in_words)),
    ]
}

/// Opens a file in a budget and asks it everything.
fn ask(path: &Path, budget: u64) -> Said {
    let path: PathBuf = path.into();
    let (said, answer) = mpsc::channel();
    std::thread::spawn(move || {
        let ((opened, jobs), most) = counting::most(|| {
            let context = context(budget);
            match Model::open(&context, &path) {
                Ok(model) => (Ok(()), jobs(&context, &model)),
                Err(error) => (Err(error), Vec::new()),
            }
        });
        let _ = said.send(Said { opened, jobs, most });
    });
    let said = answer.recv_timeout(LONGEST).expect("every call ends");
    assert!(said.most as u64 <= budget + BESIDE as u64, "{} bytes in a budget of {budget}: {said:?}", said.most);
    said
}

const ALL: [&str; 8] = ["single", "stream", "packets", "any", "overlap", "frame", "load", "check"];

#[test]
fn the_makers_make_sound_files_too() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("chain.oc");
    for levels in [1, 2, 20] {
        makers::chain(&path, levels);
        makers::edit(&path, |_| {});
        let said = ask(&path, 16 << 20);
        assert_eq!(said.successes(), ALL, "{levels}: {said:?}");
    }
}

/// From level to level all references lead to one node: 8 to the power of the levels visits.
#[test]
fn a_node_with_many_referrers_is_refused() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("dag.oc");
    type Children = fn(u32) -> Vec<Child>;
    let makers: [(&str, Children); 2] = [
        ("eight references", |level| vec![Child::External(level + 1, 0); 8]),
        ("two references", |level| vec![Child::External(level + 1, 0); 2]),
    ];
    for (what, children) in makers {
        for levels in [1, 2, 5, 20, 200] {
            makers::levels(&path, levels, children);
            let said = ask(&path, 64 << 20);
            assert_eq!(said.successes(), [""; 0], "{what}, {levels} levels: {said:?}");
            let why = said.opened.map_or_else(|error| error.to_string(), |()| String::new());
            assert!(why.contains("block 0: two external references refer to one node"), "{why}");
        }
    }
}

/// Each block has one reference to each block of the next level, and so each node has two referrers.
#[test]
fn a_node_with_referrers_in_several_blocks_is_refused() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("diamonds.oc");
    for levels in [1u32, 2, 30] {
        let mut blocks = vec![makers::coarse(&[&[Child::External(1, 0), Child::External(2, 0)]])];
        for level in 0..levels {
            let next = 2 * level + 3;
            let last = level + 1 == levels;
            let below = [Child::External(next, 0), Child::External(next + 1, 0)];
            let children: &[Child] = if last { &below[..1] } else { &below };
            (0..2).for_each(|_| blocks.push(makers::coarse(&[children])));
        }
        blocks.push(makers::fine(&[&[Child::Leaf]]));
        blocks.push(makers::leaves(&[makers::TRIANGLE]));
        makers::file(&path, &blocks, 1);
        // All blocks are read at opening, or only some of them.
        for budget in [64 << 20, 8 << 20] {
            let said = ask(&path, budget);
            assert_eq!(said.successes(), [""; 0], "{levels}: {said:?}");
            let why = said.opened.map_or_else(|error| error.to_string(), |()| String::new());
            assert!(why.contains("that another node refers to"), "{why}");
        }
    }
}

#[test]
fn a_reference_to_a_node_with_a_parent_in_its_block_is_refused() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("inner.oc");
    let make = |node: u32| {
        let blocks = [
            makers::coarse(&[&[Child::External(1, 0), Child::External(1, node)]]),
            makers::fine(&[&[Child::Node], &[Child::Leaf], &[Child::Leaf]]),
            makers::leaves(&[makers::TRIANGLE; 2]),
        ];
        makers::file(&path, &blocks, 1);
        ask(&path, 16 << 20)
    };
    // Node 1 is a child of node 0, node 2 a second root, and there is no node 3.
    assert_eq!(make(2).successes(), ALL);
    for node in [1, 3, 511, 512] {
        let said = make(node);
        assert_eq!(said.successes(), [""; 0], "{said:?}");
        let why = said.opened.map_or_else(|error| error.to_string(), |()| String::new());
        assert!(why.contains("a node"), "{why}");
    }
}

#[test]
fn blocks_that_claim_much_are_refused_before_they_are_read() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("large.oc");
    for len in [200 << 10, 64 << 20] {
        for block_size in [64 << 10, 16 << 20] {
            makers::large_root(&path, block_size, len);
            let root = ask(&path, 16 << 20).opened;
            makers::many_ids(&path, block_size, len as u32, (4 * len as u32).min(block_size));
            let ids = ask(&path, 16 << 20).opened;
            for (opened, what) in [(root, "block 0"), (ids, "block 5")] {
                let why = opened.expect_err("too large").to_string();
                let expected = if block_size > 64 << 10 { "block size out of range" } else { what };
                assert!(why.contains(expected), "{len}, {block_size}: {why}");
            }
        }
    }
    // As large as a block may claim to be: an error of the jobs that need it.
    makers::many_ids(&path, 64 << 10, 100_000, 64 << 10);
    let said = ask(&path, 16 << 20);
    assert!(said.opened.is_ok() && said.names("single", "block 5"), "{said:?}");
    makers::large_root(&path, 64 << 10, 128 << 10);
    let said = ask(&path, 16 << 20);
    assert!(said.opened.is_err_and(|error| error.to_string().contains("block 0: unused bytes")));
}

#[test]
fn a_name_of_any_length_is_paid_for_before_it_is_read() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("name.oc");
    let len = 700 << 20;
    makers::huge_name(&path, len);
    let said = ask(&path, 16 << 20);
    let error = said.opened.expect_err("too large");
    assert!(matches!(error, Error::OverBudget { need, .. } if need > u64::from(len)), "{error}");
    assert!(said.most < 8 << 20, "{}", said.most);
    makers::huge_name(&path, 20 << 20);
    assert!(ask(&path, 64 << 20).opened.is_ok());
    let names: [(&[u8], bool); 4] = [(b"a\0b", true), (b"\0", true), (b"", true), (b"\xff", false)];
    for (name, is_fine) in names {
        makers::named(&path, name);
        assert_eq!(ask(&path, 16 << 20).opened.is_ok(), is_fine, "{name:?}");
    }
}

#[test]
fn tables_are_in_the_budget() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("parts.oc");
    for (count, name_len, budget) in [(300_000, 12, 64 << 20), (300_000, 100, 16 << 20), (3_000_000, 1, 64 << 20)] {
        makers::many_parts(&path, count, name_len);
        let context = context(budget);
        let before = counting::now();
        let (opened, most) = counting::most(|| Model::open(&context, &path));
        let held = counting::now().saturating_sub(before);
        match opened {
            Ok(model) => {
                // Little is not counted, and little is counted that is not there.
                let used = context.memory_used();
                assert!((used as f64 - held as f64).abs() < 0.06 * held as f64, "{used} of {held} bytes");
                assert!(most < held + (2 << 20), "{most} to hold {held} bytes");
                assert_eq!(model.parts().get(count as usize - 1).map(|part| part.name.len()), Some(name_len as usize));
                assert_eq!(model.part_index(u64::from(count - 1) + 10), Some(count - 1));
            }
            Err(error) => {
                assert!(matches!(error, Error::OverBudget { .. }), "{error}");
                assert!(most < 2 << 20, "{most} bytes to refuse {count} parts");
            }
        }
        println!("{count} parts with names of {name_len} bytes: {held} bytes, {most} at most");
    }
}

/// Chains of nodes through many blocks, all of which every ray visits: legal, and slow for a ray that waits for blocks.
#[test]
fn a_query_in_a_deep_tree_is_cancelled_between_blocks() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("deep.oc");
    makers::chain(&path, 20_000);
    let context = context(1 << 30);
    let model = Model::open(&context, &path).unwrap();
    model.load(&Cancel::new()).unwrap();
    let scene = Scene::new(&context);
    // Many placements of it, one behind the other.
    for i in 0..200 {
        scene.add_instance(&model, i, DAffine3::from_translation(DVec3::Z * -3.0 * i as f64)).unwrap();
    }
    scene.commit().unwrap();
    // Past the triangle, through all boxes.
    let rays: Vec<Ray> = (0..100_000).map(|_| Ray::new(DVec3::new(1.8, 1.8, 5.0), -DVec3::Z.as_vec3())).collect();
    let hits = Arc::new(Ignored);
    for coherent in [false, true] {
        let options = QueryOptions { coherent, ..QueryOptions::default() };
        let rays: Arc<dyn Rays + Send + Sync> = Arc::new(Fixed(rays.clone()));
        let query = Query::closest(&scene.state(), rays, hits.clone(), options).unwrap();
        std::thread::sleep(Duration::from_millis(300));
        assert_eq!(query.poll().state, QueryState::Running, "the query is too short to be cancelled");
        let begun = Instant::now();
        query.cancel();
        assert_eq!(query.wait(LONGEST).state, QueryState::Cancelled);
        println!("cancelled within {:?}", begun.elapsed());
        assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    }
}

struct Fixed(Vec<Ray>);

impl Rays for Fixed {
    fn count(&self) -> usize {
        self.0.len()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        out.copy_from_slice(&self.0[first..first + out.len()]);
    }
}

struct Ignored;

impl Hits for Ignored {
    fn write(&self, _: usize, _: &[Hit]) {}
}

/// A read function that queries, opens or waits gets an error; its own read goes on.
#[test]
fn a_read_function_may_not_use_the_library() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("model.oc");
    makers::chain(&path, 3);
    let context = context(64 << 20);
    let other = Scene::new(&context);
    other.add_instance(&Model::open(&context, &path).unwrap(), 1, DAffine3::IDENTITY).unwrap();
    other.commit().unwrap();
    let bytes = MemorySource::new(std::fs::read(&path).unwrap());
    let refused = Arc::new(AtomicU32::new(0));
    let (inner, count, context_too, path_too) = (bytes.clone(), Arc::clone(&refused), context.clone(), path.clone());
    let read = move |at: u64, buf: &mut [u8]| {
        let state = other.state();
        let all = DBounds { min: DVec3::splat(-9.0), max: DVec3::splat(9.0) };
        for rays in [1, 10, 300] {
            let mut hits = vec![Hit::MISS; rays];
            let asked = state.closest(&crate::rays()[..rays], QueryOptions::default(), &mut hits);
            assert!(matches!(asked, Err(Error::BadState(_))), "{asked:?}");
        }
        assert!(matches!(state.overlap_box(&all), Err(Error::BadState(_))));
        assert!(matches!(Model::open(&context_too, &path_too).map(drop), Err(Error::BadState(_))));
        count.fetch_add(1, SeqCst);
        inner.read_at(at, buf)
    };
    let source = CallbackSource::new("callback", bytes.len(), Box::new(read));
    let model = Model::open_source(&context, Arc::new(source)).unwrap();
    assert_eq!(jobs(&context, &model).iter().filter(|(_, said)| said.is_ok()).count(), ALL.len());
    assert!(refused.load(SeqCst) > 4);
}

/// The budget that an error names suffices, at once, for every job.
#[test]
fn the_budget_that_is_named_suffices() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("model.oc");
    type Maker = Box<dyn Fn(&Path)>;
    let makers: [Maker; 4] = [
        Box::new(|path| makers::chain(path, 20)),
        Box::new(|path| makers::many_parts(path, 100_000, 30)),
        Box::new(|path| makers::huge_name(path, 50 << 20)),
        Box::new(|path| makers::chain(path, 3000)),
    ];
    for (i, make) in makers.iter().enumerate() {
        make(&path);
        for budget in [1, 2 << 20, 4 << 20] {
            let Err(Error::OverBudget { need, have, .. }) = ask(&path, budget).opened else { continue };
            assert!(have == budget && need > have);
            assert!(ask(&path, need - 1).opened.is_err(), "file {i}: {need} is not the least");
            let said = ask(&path, need);
            assert_eq!(said.successes(), ALL, "file {i}, {need} instead of {budget}: {said:?}");
            let outline = Outline::read(Arc::new(FileSource::open(&path).unwrap())).unwrap();
            assert!(need < outline.memory() * 5 / 4 + (8 << 20), "file {i}: {need} is more than is needed");
        }
    }
}
