//! A cache far smaller than the working set, and cameras that jump: whole pictures at once, and quiet at rest. The
//! budget itself, and several frames at a time, are `tests/streaming.rs`.

use super::pictures::{LONG, POE, Picture, Setting, Stage, frame, lit, perspective, ways};
use crate::common::built::{self, Built, Part};
use crate::common::scenes;
use crate::common::sources::{Gate, OpensAtEnd, meddled};
use glam::{DAffine3, DVec3};
use outcrop::render::{Frame, FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, Model, SceneState};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

struct Scan {
    file: Built,
    /// Bytes of its geometry in memory.
    bytes: u64,
    /// Of each camera, the exact picture.
    exact: Vec<Picture>,
}

fn scan() -> &'static Scan {
    static SCAN: OnceLock<Scan> = OnceLock::new();
    SCAN.get_or_init(|| {
        let file = built::parts(&[Part::white(1, scenes::bumpy_sphere(400, 800, 6))]);
        let bytes = Model::open(&built::context(0), &file.path).expect("it opens").memory().geometry;
        let stage = Stage::new(&file.path, Setting::default());
        let exact = (0..CAMERAS).map(|i| stage.quick(&camera(i), 0.0)).collect();
        Scan { file, bytes, exact }
    })
}

const CAMERAS: usize = 6;

/// From around the model, far, near and very near.
fn camera(i: usize) -> Camera {
    let a = i as f64 * 2.4;
    let eye = DVec3::new(a.cos(), a.sin(), 0.5 * (a * 0.7).sin()) * [3.0, 1.5, 6.0][i % 3];
    perspective(eye, DVec3::new(0.1, 0.3, 0.2))
}

/// Counts reads and their bytes; holds them up while it is shut.
#[derive(Clone, Default)]
struct Disk {
    reads: Arc<AtomicUsize>,
    bytes: Arc<AtomicUsize>,
    is_shut: Arc<AtomicBool>,
    gate: Arc<Gate>,
}

impl Disk {
    /// Whether reads stop: what was under way may still end, on a busy machine late, but nothing new begins.
    fn comes_to_rest(&self) -> bool {
        let mut last = self.reads.load(SeqCst);
        (0..20).any(|_| {
            std::thread::sleep(Duration::from_millis(100));
            let now = self.reads.load(SeqCst);
            std::mem::replace(&mut last, now) == now
        })
    }
}

/// The scan with a small share of it in memory, as little as it opens with.
fn opened(threads: usize, isa: outcrop::simd::Isa, disk: &Disk) -> (Arc<SceneState>, Frame) {
    let open = |memory_budget| {
        let options =
            ContextOptions { threads, isa: Some(isa), memory_budget, read_ahead: false, ..Default::default() };
        let context = Context::new(options).expect("a context");
        let on = disk.clone();
        let source = meddled(&scan().file.path, move |_, read| {
            on.reads.fetch_add(1, SeqCst);
            on.bytes.fetch_add(read.len(), SeqCst);
            if on.is_shut.load(SeqCst) {
                on.gate.pass();
            }
            Ok(())
        });
        Model::open_source(&context, source).map(|model| (context, model))
    };
    let (context, model) = open(scan().bytes / 8).unwrap_or_else(|e| match e {
        outcrop::Error::OverBudget { need, .. } => {
            assert!(need < scan().bytes / 2, "{need} of {} bytes are no small cache", scan().bytes);
            open(need).expect("the least does")
        }
        e => panic!("{e}"),
    });
    let setting = Setting::default();
    let scene = lit(&context, &setting);
    scene.add_instance(&model, 0, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    (scene.state(), frame(&context, setting.size))
}

fn request(frame: &Frame, state: &Arc<SceneState>, i: usize, poe: f32) {
    let settings = FrameSettings { poe, ambient: 0.0, at_once: true, ..Default::default() };
    frame.request(state, &camera(i), &settings).expect("a request");
}

#[test]
fn covered_and_quiet_at_rest() {
    let (mut coarser, mut most) = (0, 0.0f64);
    let file = std::fs::metadata(&scan().file.path).expect("the file").len() as f64;
    for (threads, isa) in ways() {
        let disk = Disk::default();
        let (state, frame) = opened(threads, isa, &disk);
        for (i, poe) in POE.into_iter().enumerate() {
            let before = disk.bytes.load(SeqCst);
            request(&frame, &state, i, poe);
            let status = frame.wait(LONG);
            let ended = [FrameState::Converged, FrameState::CompleteWithinBudget].contains(&status.state);
            assert!(ended && status.pixels_missing == 0, "{status:?}");
            assert!(status.effective_poe >= poe, "{status:?}");
            coarser += usize::from(status.effective_poe > poe);
            assert_eq!(Picture::of(&frame).holes(&scan().exact[i]), 0, "PoE {poe}, {threads} threads, {}", isa.name());
            assert!(disk.comes_to_rest(), "PoE {poe}: still reading after the frame has ended");
            // A frame's time is bounded by what it reads and how many pictures it makes of that: nothing goes round and
            // round.
            let read = (disk.bytes.load(SeqCst) - before) as f64 / file;
            println!(
                "PoE {poe}, {threads} threads, {}: read {read:.3} of the file, {} pictures",
                isa.name(),
                status.pictures
            );
            most = most.max(read);
            assert!(status.pictures < 64, "{status:?}");
        }
    }
    println!("{coarser} pictures did not fit as fine as asked; {most:.2} of the file at the most read for one");
    assert!(coarser > 0, "all fits: the cache is not small");
    // No more than the cache holds.
    assert!(most <= 0.125, "{most} of the file was read for one picture");
}

#[test]
fn a_teleport_shows_a_whole_picture_at_once() {
    for (threads, isa) in ways() {
        let disk = Disk::default();
        let (state, frame) = opened(threads, isa, &disk);
        request(&frame, &state, 0, 1.0);
        frame.wait(LONG);
        // From here nothing more is read: the picture is of what there is.
        disk.is_shut.store(true, SeqCst);
        let _open = OpensAtEnd(Arc::clone(&disk.gate));
        let mut missing = 0;
        for (n, poe) in POE.into_iter().cycle().take(10).enumerate() {
            let i = (n * 5 + 1) % CAMERAS;
            request(&frame, &state, i, poe);
            let status = loop {
                let status = frame.wait(Duration::from_millis(1));
                if status.pictures > 0 {
                    break status;
                }
                assert_eq!(status.state, FrameState::Running, "{status:?}");
            };
            missing += status.pixels_missing;
            let picture = Picture::of(&frame);
            assert_eq!(picture.holes(&scan().exact[i]), 0, "camera {i}, PoE {poe}, {threads} threads, {}", isa.name());
        }
        assert!(missing > 1000, "the camera does not go where it has not been: {missing} pixels lack something");
    }
}
