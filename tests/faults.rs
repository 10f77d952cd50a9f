//! Disks that fail, files that are damaged or replaced, sources that stall or dawdle: what can be read is shown as it
//! is, a stand-in for what cannot, and the error names it. Nobody waits for ever, and nothing wrong is shown.

#[path = "faults/searches.rs"]
mod searches;

use crate::common::built::{self, Built, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use crate::common::sources::{Calls, Gate, OpensAtEnd, blocks, meddled, reaches};
use glam::{DAffine3, DVec3};
use outcrop::Error;
use outcrop::base::progress::Cancel;
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, Hits, Query, QueryOptions, QueryState, Rays};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs};
use outcrop::scene::{Camera, Context, ContextOptions, LogLevel, Model, Scene, SceneState};
use outcrop::store::{FileSource, ModelFile, Source};
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

const LONG: Duration = Duration::from_secs(120);
/// What is prompt, on a busy machine.
const PROMPT: Duration = Duration::from_secs(5);
const SIZE: (u32, u32) = (96, 72);

/// The model of all tests, and what is to be seen of it.
struct Whole {
    built: Built,
    /// Bytes of its geometry in memory.
    bytes: u64,
    coarse: u32,
    picture: Vec<Vec<u8>>,
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

fn whole() -> &'static Whole {
    static WHOLE: OnceLock<Whole> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let tris = scenes::bumpy_sphere(220, 440, 6);
        let (low, high) = tris.split_at(tris.len() / 3);
        let built = built::parts(&[Part::white(5, low.to_vec()), Part::white(6, high.to_vec())]);
        let file = ModelFile::open_path(&built.path).expect("the file");
        let coarse = file.trees()[0].class_blocks[0];
        let context = built::context(2);
        let (scene, model) = built::scene(&context, &built);
        assert!(model.load(&Cancel::new()).expect("it loads"));
        let frame = frame(&context);
        frame.request(&scene.state(), &camera(), &FrameSettings::default()).expect("a request");
        let status = frame.wait(LONG);
        assert_eq!((status.state, status.pixels_exact), (FrameState::Converged, status.pixels_total));
        let rays = rays(300);
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.state().closest(&rays, QueryOptions::default(), &mut hits).expect("answers");
        let bytes = model.memory().geometry;
        assert!(model.info().geometry_blocks > coarse + 20, "{coarse} of {} blocks", model.info().geometry_blocks);
        Whole { picture: bytes_of(&frame), built, bytes, coarse, rays, hits }
    })
}

fn rays(count: usize) -> Vec<Ray> {
    let mut rng = Rng::new(12);
    let ray = |_| {
        let from = rng.direction() * rng.between(0.2, 3.0);
        Ray::new(from, (rng.direction() * rng.unit() - from).as_vec3())
    };
    (0..count).map(ray).collect()
}

fn camera() -> Camera {
    Camera::Perspective { eye: DVec3::new(2.2, 1.3, 1.0), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 45.0 }
}

fn frame(context: &Context) -> Frame {
    let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs: Outputs::ALL, ..Default::default() };
    Frame::new(context, options).expect("a frame")
}

/// All buffers of one picture: while a frame runs, a better one may come between two of them.
fn bytes_of(frame: &Frame) -> Vec<Vec<u8>> {
    let all =
        || -> Vec<Vec<u8>> { Buffer::ALL.iter().map(|&b| frame.map(b).expect("a picture").bytes().to_vec()).collect() };
    let mut last = all();
    loop {
        let now = all();
        if now == last {
            return now;
        }
        last = now;
    }
}

type Lines = Arc<Mutex<Vec<(LogLevel, String)>>>;

/// With room for all of the model, of which opening reads but the coarse blocks.
fn context(threads: usize) -> (Context, Lines) {
    let lines = Lines::default();
    let log = Arc::clone(&lines);
    let options = ContextOptions {
        threads,
        memory_budget: 3 * whole().bytes,
        read_ahead: false,
        log: Some(Arc::new(move |level, line: &str| log.lock().expect("the log").push((level, line.to_string())))),
        ..Default::default()
    };
    (Context::new(options).expect("a context"), lines)
}

fn open(context: &Context, source: Arc<dyn Source>) -> outcrop::Result<(Arc<SceneState>, Model)> {
    let model = Model::open_source(context, source)?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    scene.commit()?;
    Ok((scene.state(), model))
}

/// A picture, rendered until it ends.
fn render(frame: &Frame, state: &Arc<SceneState>) -> FrameStatus {
    frame.request(state, &camera(), &FrameSettings::default()).expect("a request");
    let status = frame.wait(LONG);
    assert_ne!(status.state, FrameState::Running, "it does not end: {status:?}");
    status
}

/// Covers what the exact picture covers, and shows what that shows wherever it says that it is exact. `prims`: ids were
/// there too. Returns how many pixels are stand-ins.
fn judge(frame: &Frame, prims: bool) -> usize {
    let (now, exact) = (bytes_of(frame), &whole().picture);
    let (kind, exact_kind) = (&now[Buffer::Kind as usize], &exact[Buffer::Kind as usize]);
    let mut stand_ins = 0;
    for i in 0..kind.len() {
        let miss = |kinds: &[u8]| kinds[i] == HitKind::Miss as u8;
        assert!(!miss(kind) || miss(exact_kind), "a hole at pixel {i}");
        if kind[i] != HitKind::Exact as u8 && !miss(kind) {
            stand_ins += 1;
            continue;
        }
        for buffer in Buffer::ALL.into_iter().filter(|b| prims || *b != Buffer::Primitive) {
            let size = buffer.pixel_bytes();
            let at = |all: &[Vec<u8>]| all[buffer as usize][i * size..(i + 1) * size].to_vec();
            assert_eq!(at(&now), at(exact), "pixel {i} of {buffer:?} is said to be exact, and is not");
        }
    }
    stand_ins
}

/// Right answers or an error that `is_expected`; never a mixture.
fn judge_queries(state: &SceneState, is_expected: impl Fn(&Error) -> bool) -> bool {
    let whole = whole();
    let mut hits = vec![Hit::MISS; whole.rays.len()];
    match state.closest(&whole.rays, QueryOptions::default(), &mut hits) {
        Ok(()) => assert!(hits == whole.hits, "a wrong answer"),
        Err(e) => {
            assert!(is_expected(&e), "{e}");
            return false;
        }
    }
    true
}

/// The error says that a block of the file could not be read.
fn names_an_unread_block(error: Option<&Error>, at: &Path) -> bool {
    matches!(error, Some(Error::Io { path, source, .. }) if path == at && source.to_string().starts_with("block "))
}

/// The error says that a block of the file is not what was written.
fn names_a_damaged_block(error: Option<&Error>, at: &Path) -> bool {
    matches!(error, Some(Error::Corrupt { file, block: Some(_), .. }) if file == at)
}

/// The disk fails at each read of a frame in turn.
fn fails_at_each_read(threads: usize, for_good: bool, step: usize) {
    let path = &whole().built.path;
    for fail_at in (0..).step_by(step) {
        let calls = Arc::new(Calls::default());
        let count = Arc::clone(&calls);
        let source = meddled(path, move |_, _| match count.next() {
            Some(call) if call == fail_at || for_good && call > fail_at => Err(io::ErrorKind::ConnectionReset.into()),
            _ => Ok(()),
        });
        let (context, lines) = context(threads);
        let (state, model) = open(&context, source).expect("it opens");
        calls.arm();
        let frame = frame(&context);
        let status = render(&frame, &state);
        let what = format!("{threads} threads, call {fail_at} of {}: {status:?}", calls.count());
        if calls.count() <= fail_at {
            assert_eq!(status.state, FrameState::Converged, "{what}");
            assert_eq!((judge(&frame, true), model.blocks_read_again()), (0, 0));
            assert!(fail_at > 5, "{what}");
            return;
        }
        let warned = lines.lock().expect("the log").iter().any(|(level, _)| *level == LogLevel::Warning);
        assert!(model.blocks_read_again() > 0 && warned, "{what}");
        if for_good {
            assert_eq!(status.state, FrameState::CompleteWithinBudget, "{what}");
            assert!(names_an_unread_block(status.error.as_deref(), path), "{what}");
            assert_eq!(status.fraction, 1.0);
            judge(&frame, false);
        } else {
            assert!(status.state == FrameState::Converged && status.error.is_none(), "{what}");
            assert_eq!(judge(&frame, true), 0);
        }
        let answered = judge_queries(&state, |e| for_good && matches!(e, Error::Io { .. }));
        assert!(answered || for_good);
    }
}

#[test]
fn a_read_that_fails_once_is_made_up_for() {
    fails_at_each_read(0, false, 1);
    fails_at_each_read(2, false, 3);
}

#[test]
fn a_disk_that_fails_for_good_leaves_stand_ins() {
    fails_at_each_read(0, true, 1);
    fails_at_each_read(2, true, 3);
}

/// A network is gone for a while: what could not be read is asked for again by the next request; and said once, not by
/// each.
#[test]
fn a_disk_that_is_back_is_read_again() {
    let path = &whole().built.path;
    for threads in [0, 2] {
        let gone = Arc::new(AtomicBool::new(false));
        let is_gone = Arc::clone(&gone);
        let source = meddled(path, move |_, _| match is_gone.load(SeqCst) {
            true => Err(io::ErrorKind::NetworkUnreachable.into()),
            false => Ok(()),
        });
        let (context, lines) = context(threads);
        let (state, _model) = open(&context, source).expect("it opens");
        let said = || lines.lock().expect("the log").len();
        let frame = frame(&context);
        gone.store(true, SeqCst);
        let mut once = 0;
        for request in 0..3 {
            let status = render(&frame, &state);
            assert_eq!(status.state, FrameState::CompleteWithinBudget, "{status:?}");
            assert!(names_an_unread_block(status.error.as_deref(), path), "{status:?}");
            judge(&frame, false);
            once = if request == 0 { said() } else { once };
            assert_eq!((said(), once > 0), (once, true));
        }
        gone.store(false, SeqCst);
        // They are asked for again four times a second at most.
        std::thread::sleep(Duration::from_millis(300));
        let status = render(&frame, &state);
        assert!(status.state == FrameState::Converged && status.error.is_none(), "{status:?}");
        assert_eq!(judge(&frame, true), 0);
    }
}

/// Ids decide which of two surfaces at the same distance is shown. Without them one of the two is shown: no hole.
#[test]
fn ids_that_cannot_be_read_leave_no_holes() {
    let tris = scenes::bumpy_sphere(60, 90, 1);
    let built = built::parts(&[Part::white(5, tris.clone()), Part::white(6, tris)]);
    let geometry = ModelFile::open_path(&built.path).expect("the file").header().geometry_blocks;
    let ids = blocks(&built.path).split_off(geometry as usize);
    assert!(!ids.is_empty());
    let depths = |fails: bool| {
        let ids = ids.clone();
        let source = meddled(&built.path, move |at, read| {
            let is_id = ids.iter().any(|block| reaches(at, read.len(), block));
            if fails && is_id { Err(io::ErrorKind::ConnectionReset.into()) } else { Ok(()) }
        });
        let context = built::context(2);
        let (state, _model) = open(&context, source).expect("it opens");
        let frame = frame(&context);
        frame.request(&state, &camera(), &FrameSettings { poe: 0.0, ..Default::default() }).expect("a request");
        let status = frame.wait(LONG);
        assert_eq!(status.state == FrameState::Converged, !fails, "{status:?}");
        bytes_of(&frame).swap_remove(Buffer::Depth as usize)
    };
    let exact = depths(false);
    assert!(exact.chunks(4).filter(|depth| depth != &f32::INFINITY.to_le_bytes()).count() > 1000);
    assert!(depths(true) == exact, "pixels lack their surface");
}

#[test]
fn exact_queries_of_a_failing_disk_end() {
    let path = &whole().built.path;
    for (threads, for_good) in [(0, false), (0, true), (2, true)] {
        for fail_at in 0.. {
            let calls = Arc::new(Calls::default());
            let count = Arc::clone(&calls);
            let source = meddled(path, move |_, _| match count.next() {
                Some(call) if call == fail_at || for_good && call > fail_at => Err(io::ErrorKind::TimedOut.into()),
                _ => Ok(()),
            });
            let (context, _) = context(threads);
            let (state, _model) = open(&context, source).expect("it opens");
            calls.arm();
            let answered = judge_queries(&state, |e| for_good && matches!(e, Error::Io { .. }));
            if calls.count() <= fail_at {
                assert!(answered && fail_at > 3, "call {fail_at}");
                break;
            }
            assert_eq!(answered, !for_good, "call {fail_at}");
        }
    }
}

/// A byte of each block in turn is another than was written.
#[test]
fn a_damaged_block_is_reported_and_stood_in_for() {
    let whole = whole();
    let path = &whole.built.path;
    let blocks = blocks(path);
    let geometry = ModelFile::open_path(path).expect("the file").header().geometry_blocks as usize;
    let (mut rng, mut seen) = (Rng::new(3), 0);
    for (id, place) in blocks.iter().enumerate().step_by(3) {
        let at = place.start + rng.below((place.end - place.start) as usize) as u64;
        let source = meddled(path, move |from, buf| {
            if reaches(from, buf.len(), &(at..at + 1)) {
                buf[(at - from) as usize] ^= 1 << (at % 8);
            }
            Ok(())
        });
        let (context, lines) = context(2);
        let is_it = |e: &Error| matches!(e, Error::Corrupt { block: Some(n), .. } if *n as usize == id);
        let opened = open(&context, source);
        let Ok((state, _model)) = opened else {
            let e = opened.map(drop).expect_err("it failed");
            assert!(is_it(&e) && id < whole.coarse as usize, "block {id}: {e}");
            continue;
        };
        let frame = frame(&context);
        let status = render(&frame, &state);
        let stand_ins = judge(&frame, id < geometry);
        let names_it = status.error.as_deref().is_some_and(is_it);
        let logged = lines.lock().expect("the log").iter().any(|(_, line)| line.contains(&format!("block {id}")));
        let lacks = status.state == FrameState::CompleteWithinBudget;
        assert!(lacks || status.state == FrameState::Converged, "block {id}: {status:?}");
        assert_eq!((names_it, logged), (lacks, lacks), "block {id}: {status:?}, {:?}", lines.lock());
        // Primitive ids have blocks of their own: nothing stands in for those.
        assert_eq!(stand_ins > 0, lacks && id < geometry, "block {id}: {status:?}");
        assert!(stand_ins < SIZE.0 as usize * SIZE.1 as usize / 4, "block {id}: {stand_ins} pixels");
        seen += usize::from(stand_ins > 0);
        judge_queries(&state, is_it);
    }
    assert!(seen > 3, "{seen} damaged blocks were in sight");
}

/// Another model renamed over the file, the file cut short, and another model written into it, while it is open.
#[test]
fn a_file_that_is_replaced_shows_nothing_of_the_other() {
    let original = std::fs::read(&whole().built.path).expect("the file");
    let other = built::parts(&[Part::white(9, scenes::sphere(220, 440))]);
    let other = std::fs::read(&other.path).expect("the other");
    type Fault = fn(&Path, &[u8]);
    let faults: [(&str, bool, Fault); 3] = [
        ("renamed over", true, |path, other| {
            let beside = path.with_extension("other");
            std::fs::write(&beside, other).expect("another file");
            std::fs::rename(&beside, path).expect("a rename");
        }),
        ("cut short", false, |path, _| {
            let file = std::fs::OpenOptions::new().write(true).open(path).expect("the file");
            let len = file.metadata().expect("the file").len();
            file.set_len(len / 2).expect("a cut");
        }),
        // Into the same file.
        ("written over", false, |path, other| std::fs::write(path, other).expect("a write")),
    ];
    for (what, is_harmless, fault) in faults {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("model.oc");
        std::fs::write(&path, &original).expect("the file");
        let (context, _) = context(2);
        let (state, _model) = open(&context, Arc::new(FileSource::open(&path).expect("it opens"))).expect("it opens");
        fault(&path, &other);
        let frame = frame(&context);
        let status = render(&frame, &state);
        let stand_ins = judge(&frame, is_harmless);
        if is_harmless {
            assert_eq!((status.state, stand_ins), (FrameState::Converged, 0), "{what}");
        } else {
            assert_eq!(status.state, FrameState::CompleteWithinBudget, "{what}");
            assert!(names_a_damaged_block(status.error.as_deref(), &path), "{what}: {status:?}");
            assert!(stand_ins > 0, "{what}");
        }
        let answered = judge_queries(&state, |e| matches!(e, Error::Io { .. } | Error::Corrupt { .. }));
        assert_eq!(answered, is_harmless, "{what}");
    }
}

struct Given(Vec<Ray>);

impl Rays for Given {
    fn count(&self) -> usize {
        self.0.len()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        out.copy_from_slice(&self.0[first..first + out.len()]);
    }
}

struct Forgotten;

impl Hits for Forgotten {
    fn write(&self, _: usize, _: &[Hit]) {}
}

/// Waits until `is_so` of the frame's status; whether it was within a while.
fn until(frame: &Frame, is_so: impl Fn(&FrameStatus) -> bool) -> FrameStatus {
    let begun = Instant::now();
    loop {
        let status = frame.wait(Duration::from_millis(2));
        if is_so(&status) {
            return status;
        }
        assert!(begun.elapsed() < LONG / 4, "it never was: {status:?}");
    }
}

/// Where a block is that the picture needs.
fn a_block_in_sight() -> Range<u64> {
    let path = &whole().built.path;
    let (reads, armed) = (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)));
    let (list, on) = (Arc::clone(&reads), Arc::clone(&armed));
    let source = meddled(path, move |at, _| {
        if on.load(SeqCst) {
            list.lock().expect("the list").push(at);
        }
        Ok(())
    });
    let (context, _) = context(0);
    let (state, _model) = open(&context, source).expect("it opens");
    armed.store(true, SeqCst);
    render(&frame(&context), &state);
    let geometry = ModelFile::open_path(path).expect("the file").header().geometry_blocks as usize;
    let reads = reads.lock().expect("the list");
    let in_sight: Vec<_> =
        blocks(path)[..geometry].iter().filter(|block| reads.contains(&block.start)).cloned().collect();
    assert!(in_sight.len() > 2, "{in_sight:?}");
    in_sight[in_sight.len() / 2].clone()
}

/// A source that never comes back from one block, until it is let go.
#[test]
fn a_source_that_stalls_holds_up_nothing_else() {
    let whole = whole();
    let stalled = a_block_in_sight();
    let (gate, armed) = (Arc::new(Gate::default()), Arc::new(AtomicBool::new(false)));
    let (wait_at, on) = (Arc::clone(&gate), Arc::clone(&armed));
    let source = meddled(&whole.built.path, move |at, buf| {
        if on.load(SeqCst) && reaches(at, buf.len(), &stalled) {
            wait_at.pass();
        }
        Ok(())
    });
    let (context, _) = context(2);
    let (state, _model) = open(&context, source).expect("it opens");
    armed.store(true, SeqCst);
    let frame = frame(&context);
    // Before the frame, were this to fail.
    let _opens = OpensAtEnd(Arc::clone(&gate));
    frame.request(&state, &camera(), &FrameSettings::default()).expect("a request");
    assert!(gate.is_reached(LONG / 4), "the block is not in sight");
    // All else comes: what is left is what was read together.
    let status = until(&frame, |s| s.pictures > 1 && s.bytes_wanted > 0 && s.pixels_exact * 10 > s.pixels_total * 7);
    assert_eq!(status.state, FrameState::Running);
    assert!(judge(&frame, false) > 0);
    let begun = Instant::now();
    frame.cancel();
    assert_eq!(frame.wait(LONG).state, FrameState::Cancelled);
    assert!(begun.elapsed() < PROMPT, "{:?}", begun.elapsed());
    // The picture stays, and others are made.
    assert!(judge(&frame, false) > 0);
    frame.request(&state, &camera(), &FrameSettings::default()).expect("a request");
    until(&frame, |s| s.pictures > 0);
    judge(&frame, false);
    // An exact query waits for the block too; dropping it would wait with it.
    let query =
        Query::closest(&state, Arc::new(Given(whole.rays.clone())), Arc::new(Forgotten), QueryOptions::default());
    let query = query.expect("a query");
    // Before the query, were this to fail.
    let _opens = OpensAtEnd(Arc::clone(&gate));
    assert_eq!(query.wait(Duration::from_millis(200)).state, QueryState::Running);
    // A frame that goes does not wait for the disk.
    let begun = Instant::now();
    let another = self::frame(&context);
    another.request(&state, &camera(), &FrameSettings::default()).expect("a request");
    until(&another, |s| s.pictures > 0);
    drop(another);
    assert!(begun.elapsed() < PROMPT, "{:?}", begun.elapsed());
    gate.open();
    assert_eq!(query.wait(LONG).state, QueryState::Done);
    let status = frame.wait(LONG);
    assert_eq!((status.state, judge(&frame, true)), (FrameState::Converged, 0), "{status:?}");
    drop(frame);
    assert!(judge_queries(&state, |_| false));
}

/// All goes while a fetcher is held up; the last to go waits for it.
#[test]
fn all_is_dropped_while_a_source_stalls() {
    let (gate, armed) = (Arc::new(Gate::default()), Arc::new(AtomicBool::new(false)));
    let (wait_at, on) = (Arc::clone(&gate), Arc::clone(&armed));
    let source = meddled(&whole().built.path, move |_, _| {
        if on.load(SeqCst) {
            wait_at.pass();
        }
        Ok(())
    });
    let (context, _) = context(2);
    let (state, model) = open(&context, source).expect("it opens");
    armed.store(true, SeqCst);
    let frame = frame(&context);
    let opens = OpensAtEnd(Arc::clone(&gate));
    frame.request(&state, &camera(), &FrameSettings::default()).expect("a request");
    assert!(gate.is_reached(LONG / 4));
    until(&frame, |s| s.pictures > 0);
    judge(&frame, false);
    let begun = Instant::now();
    drop((frame, state, model));
    assert!(begun.elapsed() < PROMPT, "{:?}", begun.elapsed());
    drop(opens);
    drop(context);
}

/// Two million bytes a second.
#[test]
fn a_slow_source_shows_something_at_once_and_more_with_time() {
    const RATE: f64 = 2e6;
    let (slow, armed) = (Arc::new(Mutex::new(())), Arc::new(AtomicBool::new(false)));
    let (line, on) = (Arc::clone(&slow), Arc::clone(&armed));
    let source = meddled(&whole().built.path, move |_, buf| {
        if on.load(SeqCst) {
            let _one_at_a_time = line.lock().expect("the line");
            std::thread::sleep(Duration::from_secs_f64(buf.len() as f64 / RATE));
        }
        Ok(())
    });
    let (context, _) = context(2);
    let (state, _model) = open(&context, source).expect("it opens");
    armed.store(true, SeqCst);
    let frame = frame(&context);
    frame.request(&state, &camera(), &FrameSettings::default()).expect("a request");
    let first = until(&frame, |s| s.pictures > 0);
    let (mut fraction, mut error, mut pictures, mut foreseen) = (first.fraction, first.mean_error_px, 1, 0);
    let last = loop {
        let status = frame.wait(Duration::from_millis(5));
        assert!(status.fraction >= fraction && status.pictures >= pictures, "{status:?}");
        assert!(!status.seconds_to_go.is_nan() && status.seconds_to_go >= 0.0, "{status:?}");
        if status.pictures > pictures {
            assert!(status.mean_error_px <= error * 1.2, "{status:?}, it was {error}");
            error = status.mean_error_px;
        }
        (fraction, pictures) = (status.fraction, status.pictures);
        if status.state != FrameState::Running {
            break status;
        }
        foreseen += usize::from(status.seconds_to_go.is_finite() && status.bytes_wanted > 0);
    };
    assert_eq!((last.state, judge(&frame, true)), (FrameState::Converged, 0));
    println!(
        "first picture after {:.3} s, all after {:.3} s in {} pictures",
        first.seconds, last.seconds, last.pictures
    );
    assert!(last.pictures > 3 && foreseen > 3, "{foreseen} of {last:?}");
    assert!(first.seconds < last.seconds / 3.0, "the first picture after {} s of {}", first.seconds, last.seconds);
}
