//! What goes on in the background, and whoever waits for it.

use crate::common::built::{self, Built, Part};
use crate::common::scenes;
use glam::DVec3;
use outcrop::Error;
use outcrop::base::progress::{Cancel, Phase, Progress};
use outcrop::base::tasks::{Executor, Task};
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions, Want};
use outcrop::render::{Frame, FrameOptions, FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, LogLevel, Model, Scene};
use outcrop::store::{CallbackSource, ModelFile, Source};
use std::io;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Barrier, Condvar, Mutex};
use std::time::Duration;

const LONG: Duration = Duration::from_secs(120);

/// Threads of a host that take a task only once they are let go, and then drop it.
struct Held {
    submitting: Barrier,
    let_go: Barrier,
}

impl Executor for Held {
    fn concurrency(&self) -> usize {
        1
    }
    fn submit(&self, task: Task) {
        self.submitting.wait();
        self.let_go.wait();
        drop(task);
    }
}

/// A wait that comes while another thread is still beginning the request sleeps until the job is there.
#[test]
fn a_wait_in_the_middle_of_a_request_learns_of_its_job() {
    let held = Arc::new(Held { submitting: Barrier::new(2), let_go: Barrier::new(2) });
    let executor = Arc::clone(&held) as Arc<dyn Executor>;
    let options = ContextOptions { executor: Some(executor), ..Default::default() };
    let context = Context::new(options).expect("a context");
    // No model: making one would hand in tasks too.
    let scene = Scene::new(&context);
    let frame = Frame::new(&context, FrameOptions { width: 8, height: 8, ..Default::default() }).expect("a frame");
    let camera = Camera::Perspective { eye: DVec3::Z, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 40.0 };
    std::thread::scope(|threads| {
        threads.spawn(|| frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request"));
        held.submitting.wait();
        assert_eq!(frame.wait(Duration::from_millis(20)).state, FrameState::Running);
        let waiter = threads.spawn(|| frame.wait(LONG));
        // Asleep by now, most likely; either way it has to end.
        std::thread::sleep(Duration::from_millis(20));
        held.let_go.wait();
        assert_eq!(waiter.join().expect("the waiter").state, FrameState::Converged);
    });
}

/// Enough for several workers: about 30 blocks of geometry.
fn sphere() -> Built {
    built::parts(&[Part::white(5, scenes::sphere(150, 300))])
}

/// A source of the built file; `on_block` is called, with the number of reads of blocks before, for each read
/// of a block, and may change what was read.
fn watched(
    built: &Built,
    on_block: impl Fn(usize, &mut [u8]) -> io::Result<()> + Send + Sync + 'static,
) -> Arc<dyn Source> {
    let bytes = std::fs::read(&built.path).expect("the file");
    let blocks = blocks(built);
    let reads = AtomicUsize::new(0);
    let read = move |at: u64, buf: &mut [u8]| {
        buf.copy_from_slice(&bytes[at as usize..at as usize + buf.len()]);
        if blocks.contains(&at) { on_block(reads.fetch_add(1, SeqCst), buf) } else { Ok(()) }
    };
    let len = std::fs::metadata(&built.path).expect("the file").len();
    Arc::new(CallbackSource::new("watched", len, Box::new(read)))
}

/// Where the blocks of the built file begin.
fn blocks(built: &Built) -> Range<u64> {
    let file = ModelFile::open_path(&built.path).expect("the file");
    let rows = file.directory();
    rows[0].offset..rows[rows.len() - 1].end()
}

/// Two reads at the same time need two workers.
#[test]
fn a_model_is_opened_by_all_workers_of_the_context() {
    let built = sphere();
    let together = Arc::new((Mutex::new(0), Condvar::new()));
    let meeting = Arc::clone(&together);
    let source = watched(&built, move |_, _| {
        let (count, changed) = &*meeting;
        let mut count = count.lock().expect("the count");
        *count += 1;
        changed.notify_all();
        // The first waits for a second, in vain where there is one worker only.
        let (count, waited) = changed.wait_timeout_while(count, LONG, |n| *n < 2).expect("the count");
        drop(count);
        if waited.timed_out() { Err(io::ErrorKind::TimedOut.into()) } else { Ok(()) }
    });
    let model = Model::open_source(&built::context(2), source).expect("a model");
    assert!(model.info().geometry_blocks > 16);
}

#[test]
fn opening_tells_how_far_it_is_and_counts_the_bytes_of_blocks() {
    let built = sphere();
    let progress = Arc::new(Progress::default());
    let (seen, watch) = (Arc::new(Mutex::new(Vec::new())), Arc::clone(&progress));
    let told = Arc::clone(&seen);
    let source = watched(&built, move |_, _| {
        told.lock().expect("the list").push(watch.fraction());
        Ok(())
    });
    let model = Model::open_watched(&built::context(0), source, &progress, &Cancel::new()).expect("a model");
    let seen = seen.lock().expect("the list");
    // Neighbours are read together.
    assert!((3..model.info().geometry_blocks as usize / 2).contains(&seen.len()), "{} reads", seen.len());
    assert!(seen[0] == 0.0 && seen.is_sorted() && seen.last().is_some_and(|&f| 0.2 < f && f < 1.0), "{seen:?}");
    assert_eq!(progress.phase(), Phase::Read);
    let file = ModelFile::open_path(&built.path).expect("the file");
    let geometry = model.info().geometry_blocks as usize;
    let stored: u64 = file.directory()[..geometry].iter().map(|row| u64::from(row.stored_len)).sum();
    assert_eq!(progress.bytes_read.load(SeqCst), stored);
}

#[test]
fn a_cancel_ends_opening_between_two_reads_and_gives_the_memory_back() {
    let built = sphere();
    for threads in [0, 2] {
        let context = built::context(threads);
        let (cancel, reads) = (Cancel::new(), Arc::new(AtomicUsize::new(0)));
        let (stop, count) = (cancel.clone(), Arc::clone(&reads));
        let source = watched(&built, move |n, _| {
            count.fetch_add(1, SeqCst);
            if n == 1 {
                stop.cancel();
            }
            Ok(())
        });
        let opened = Model::open_watched(&context, source, &Progress::default(), &cancel);
        assert!(matches!(opened, Err(Error::Cancelled)));
        // The one that cancelled, those before, and one in flight for each other worker.
        assert!(reads.load(SeqCst) <= 2 + threads, "{} reads", reads.load(SeqCst));
        assert_eq!(context.memory_used(), 0);
    }
}

/// A read that fails once, or brings other bytes once, is tried again, and the log says so; the second time it
/// is an error that names the block.
#[test]
fn a_block_that_cannot_be_read_is_read_once_more() {
    type Fault = fn(&mut [u8]) -> io::Result<()>;
    let faults: [Fault; 2] = [
        |_| Err(io::ErrorKind::ConnectionReset.into()),
        |buf| {
            buf[7] ^= 1;
            Ok(())
        },
    ];
    let built = sphere();
    for (fault, times) in [(faults[0], 1), (faults[1], 1), (faults[0], 2), (faults[1], 2)] {
        let lines = Arc::new(Mutex::new(Vec::new()));
        let log = Arc::clone(&lines);
        let options = ContextOptions {
            threads: 0,
            log: Some(Arc::new(move |level, line: &str| log.lock().expect("the log").push((level, line.to_string())))),
            ..Default::default()
        };
        let context = Context::new(options).expect("a context");
        let source = watched(&built, move |n, buf| if (1..1 + times).contains(&n) { fault(buf) } else { Ok(()) });
        let opened = Model::open_source(&context, source);
        let lines = lines.lock().expect("the log");
        let warnings: Vec<_> = lines.iter().filter(|(level, _)| *level == LogLevel::Warning).collect();
        assert!(warnings.len() == 1 && warnings[0].1.contains("watched"), "{lines:?}");
        match (opened, times) {
            (Ok(model), 1) => assert_eq!(model.blocks_read_again(), 1),
            (Err(Error::Corrupt { block: Some(1..), .. } | Error::Io { .. }), 2) => {}
            (opened, _) => panic!("{times} faults: {:?}", opened.map(|m| m.info().clone())),
        }
        drop(lines);
        assert!(times == 1 || context.memory_used() == 0);
    }
}

/// Two jobs want the same block at once: one of them reads it. Meanwhile no lock is held, so that the caller's
/// function may ask for what is in memory, and other blocks can be read.
#[test]
fn what_two_want_is_read_once() {
    let built = sphere();
    let context = built::context(0);
    let reads = Arc::new(AtomicUsize::new(0));
    let (count, armed) = (Arc::clone(&reads), Arc::new(AtomicBool::new(false)));
    let on = Arc::clone(&armed);
    let both = Arc::new(Barrier::new(2));
    let begun = Arc::clone(&both);
    let source = watched(&built, move |_, _| {
        if on.load(SeqCst) && count.fetch_add(1, SeqCst) == 0 {
            // The other is on its way.
            begun.wait();
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(())
    });
    let model = Model::open_source(&context, source).expect("a model");
    let scene = Scene::new(&context);
    scene.add_instance(&model, 1, glam::DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    let state = scene.state();
    armed.store(true, SeqCst);
    let ask = || {
        // Primitive ids are not in memory yet.
        let options = QueryOptions { want: Want::ALL, ..Default::default() };
        let mut hit = [Hit::MISS];
        state.closest(&[Ray::new(DVec3::new(0.1, 0.2, 5.0), glam::Vec3::NEG_Z)], options, &mut hit).expect("an answer");
        hit[0]
    };
    let (one, other) = std::thread::scope(|threads| {
        let one = threads.spawn(ask);
        both.wait();
        let other = threads.spawn(ask);
        (one.join().expect("one"), other.join().expect("the other"))
    });
    assert_eq!((one.prim, one.t), (other.prim, other.t));
    assert_eq!(reads.load(SeqCst), 1);
}
