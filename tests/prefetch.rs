//! Prefetches: what a box or a camera needs is there before it is asked for, the most important first, as far as it
//! fits, and no frame shows less for it.

use crate::common::built::{self, OfEach};
use glam::{DAffine3, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::Builder;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::DBounds;
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::render::{Frame, FrameOptions, FrameSettings, FrameState, Prefetch, PrefetchState};
use outcrop::scene::{Camera, Context, ContextOptions, Model, Scene, SceneState};
use outcrop::store::{CallbackSource, FileSource, Source};
use outcrop::{Error, math::Ray};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::SeqCst};
use std::time::Duration;

const LONG: Duration = Duration::from_secs(120);

fn bulb() -> &'static PathBuf {
    static BULB: OfEach<PathBuf> = OfEach::new();
    BULB.get(|| {
        let path = Box::leak(Box::new(tempfile::tempdir().expect("a folder"))).path().join("bulb.oc");
        let mut builder =
            Builder::new(built::options(), Arc::new(Progress::default()), Cancel::new()).expect("a builder");
        let options = GenerateOptions { triangles: built::sized(1_000_000, 180_000), seed: 0, ..Default::default() };
        generate("mandelbulb", &options, &Cancel::new(), &mut builder).expect("a bulb");
        builder.finish(&path).expect("a build");
        path
    })
}

/// Holds all of the model, and has a small part of it read at opening.
fn ample() -> u64 {
    built::sized(48 << 20, 16 << 20)
}

fn context(threads: usize, memory_budget: u64) -> Context {
    let options = ContextOptions { threads, memory_budget, read_ahead: false, ..Default::default() };
    Context::new(options).expect("a context")
}

/// Two instances, side by side, of the bulb.
fn scene(context: &Context, model: &Model) -> Arc<SceneState> {
    let scene = Scene::new(context);
    scene.add_instance(model, 1, DAffine3::IDENTITY).expect("an instance");
    scene.add_instance(model, 2, DAffine3::from_translation(DVec3::X * 4.0)).expect("an instance");
    scene.commit().expect("a commit");
    scene.state()
}

fn opened(context: &Context) -> (Model, Arc<SceneState>) {
    let model = Model::open(context, bulb()).expect("it opens");
    let scene = scene(context, &model);
    (model, scene)
}

fn boxed(min: DVec3, max: DVec3) -> DBounds {
    DBounds { min, max }
}

/// Rays that begin somewhere in the box, and end before they leave it.
fn rays_inside(b: &DBounds) -> Vec<Ray> {
    let at =
        |i: u64, salt: u64| ((i * 3 + salt).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 / (1u64 << 53) as f64;
    let point = |i: u64| b.min + b.extent() * DVec3::new(at(i, 0), at(i, 1), at(i, 2));
    let ray = |i: u64| {
        let (from, to) = (point(2 * i), point(2 * i + 1));
        Ray { t_max: 1.0, ..Ray::new(from, (to - from).as_vec3()) }
    };
    (0..4000).map(ray).collect()
}

fn now(scene: &SceneState, rays: &[Ray]) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    let options = QueryOptions { policy: Policy::Now, want: Want::NOTHING, ..Default::default() };
    scene.closest(rays, options, &mut hits).expect("answers");
    hits
}

fn missing(hits: &[Hit]) -> usize {
    hits.iter().filter(|hit| hit.kind == HitKind::Missing).count()
}

fn what_lies_in_a_box_is_there_and_little_else() {
    for threads in [2, 0] {
        let context = context(threads, ample());
        let (model, scene) = opened(&context);
        let b = boxed(DVec3::new(0.2, -1.2, -0.3), DVec3::new(1.3, 0.1, 0.5));
        let rays = rays_inside(&b);
        let before = missing(&now(&scene, &rays));
        assert!(before > 100, "{before} of {} lack something at first", rays.len());
        let prefetch = Prefetch::of_box(&scene, &b, 0.0).expect("a prefetch");
        let woken = Arc::new(AtomicU32::new(0));
        let waker = Arc::clone(&woken);
        prefetch.set_wake(Some(Arc::new(move || {
            waker.fetch_add(1, SeqCst);
        })));
        let status = prefetch.wait(LONG);
        assert_eq!((status.state, status.fraction, status.bytes_wanted), (PrefetchState::Done, 1.0, 0));
        assert!(status.blocks > 10 && status.bytes > built::sized(1 << 20, 1 << 18));
        let hits = now(&scene, &rays);
        assert_eq!(missing(&hits), 0);
        assert!(hits.iter().any(|hit| hit.kind == HitKind::Exact));
        let memory = model.memory();
        assert!(memory.resident * 2 < memory.geometry, "{memory:?}: a box of an eighth");
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(woken.load(SeqCst), 1);
    }
}

fn cells_of_a_length_are_enough_where_that_was_asked() {
    let context = context(2, ample());
    let (model, scene) = opened(&context);
    let all = boxed(DVec3::splat(-9.0), DVec3::splat(9.0));
    let mut last = model.memory().resident;
    for cell in built::sized([0.3, 0.06, 0.0], [0.6, 0.3, 0.0]) {
        let status = Prefetch::of_box(&scene, &all, cell).expect("a prefetch").wait(LONG);
        assert_eq!(status.state, PrefetchState::Done);
        let resident = model.memory().resident;
        assert!(resident >= last, "{resident} after {last}");
        assert_eq!(resident >= model.memory().geometry, cell == 0.0, "{resident} at {cell}");
        last = resident;
    }
}

fn a_camera_finds_its_picture_read() {
    let context = context(2, ample());
    let (model, scene) = opened(&context);
    let opened = model.memory().resident;
    let camera =
        Camera::Perspective { eye: DVec3::new(2.0, -1.0, 0.5), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    let frame = Frame::new(&context, FrameOptions { width: 200, height: 150, ..Default::default() }).expect("a frame");
    let settings = FrameSettings { poe: 1.0, ..Default::default() };
    let status = Prefetch::of_camera(&scene, &camera, (200, 150), 1.0).expect("a prefetch").wait(LONG);
    assert_eq!(status.state, PrefetchState::Done);
    assert!(status.blocks > 10, "{status:?}");
    let ready = model.memory().resident;
    frame.request(&scene, &camera, &settings).expect("a request");
    let status = frame.wait(LONG);
    assert_eq!(status.state, FrameState::Converged);
    // One ray in sixteen finds nearly all.
    let rest = model.memory().resident - ready;
    assert!(rest * 4 < ready - opened, "the frame had {rest} bytes read, the prefetch {}", ready - opened);
}

fn it_ends_when_the_budget_is_full_and_takes_nothing_from_frames() {
    let whole = {
        let context = context(0, 0);
        opened(&context).0.memory().geometry
    };
    for threads in [2, 0] {
        let context = context(threads, whole / 3 + (4 << 20));
        let (_model, scene) = opened(&context);
        let frame =
            Frame::new(&context, FrameOptions { width: 100, height: 75, ..Default::default() }).expect("a frame");
        let camera =
            Camera::Perspective { eye: DVec3::new(3.0, -1.0, 0.5), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
        let settings = FrameSettings { poe: 4.0, ..Default::default() };
        let look = || {
            frame.request(&scene, &camera, &settings).expect("a request");
            frame.wait(LONG)
        };
        let before = look();
        assert_eq!((before.state, before.effective_poe), (FrameState::Converged, 4.0));
        let all = boxed(DVec3::splat(-9.0), DVec3::splat(9.0));
        let prefetch = Prefetch::of_box(&scene, &all, 0.0).expect("a prefetch");
        let status = prefetch.wait(LONG);
        assert_eq!(status.state, PrefetchState::Full, "{status:?}");
        assert!(status.fraction > 0.1 && status.fraction < 1.0 && status.bytes > whole / 8, "{status:?}");
        assert!(context.memory_used() <= context.memory_budget());
        // The frame has kept what it stood on.
        let after = look();
        assert_eq!((after.state, after.effective_poe, after.pictures), (FrameState::Converged, 4.0, 1));
    }
}

fn dropping_it_ends_the_reading() {
    let context = context(2, ample());
    let (file, reads) = (FileSource::open(bulb()).expect("the file"), Arc::new(AtomicU64::new(0)));
    let (len, count) = (Source::len(&file), Arc::clone(&reads));
    // A smaller model has fewer reads, which take longer.
    let each = Duration::from_millis(built::sized(10, 100));
    let slow = move |at: u64, buf: &mut [u8]| {
        count.fetch_add(1, SeqCst);
        std::thread::sleep(each);
        file.read_at(at, buf)
    };
    let model =
        Model::open_source(&context, Arc::new(CallbackSource::new("slow", len, Box::new(slow)))).expect("it opens");
    let scene = scene(&context, &model);
    let all = boxed(DVec3::splat(-9.0), DVec3::splat(9.0));
    let prefetch = Prefetch::of_box(&scene, &all, 0.0).expect("a prefetch");
    let status = prefetch.wait(Duration::from_millis(50));
    assert_eq!(status.state, PrefetchState::Running);
    prefetch.cancel();
    assert_eq!(prefetch.poll().state, PrefetchState::Cancelled);
    drop(prefetch);
    // Reads in flight are done with; no more come.
    std::thread::sleep(Duration::from_millis(300));
    let after = reads.load(SeqCst);
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(reads.load(SeqCst), after);
    assert!(model.memory().resident < model.memory().geometry);
}

fn a_block_that_cannot_be_read_is_said_and_the_rest_is_there() {
    let context = context(2, ample());
    let file = FileSource::open(bulb()).expect("the file");
    let len = Source::len(&file);
    let (from, to) = (len / 2, len / 2 + 1000);
    let armed = Arc::new(AtomicU32::new(0));
    let is_armed = Arc::clone(&armed);
    let faulty = move |at: u64, buf: &mut [u8]| {
        if is_armed.load(SeqCst) == 1 && at < to && at + buf.len() as u64 > from {
            return Err(std::io::Error::other("a bad sector"));
        }
        file.read_at(at, buf)
    };
    let model =
        Model::open_source(&context, Arc::new(CallbackSource::new("disk", len, Box::new(faulty)))).expect("it opens");
    armed.store(1, SeqCst);
    let scene = scene(&context, &model);
    let all = boxed(DVec3::splat(-9.0), DVec3::splat(9.0));
    let status = Prefetch::of_box(&scene, &all, 0.0).expect("a prefetch").wait(LONG);
    assert_eq!(status.state, PrefetchState::Failed);
    let why = status.error.expect("a reason").to_string();
    assert!(why.contains("disk") && why.contains("bad sector"), "{why}");
    let memory = model.memory();
    assert!(memory.resident * 10 > memory.geometry * 9, "{memory:?}");
}

fn nonsense_is_refused_and_nothing_is_nothing() {
    let context = context(0, 0);
    let (_model, scene) = opened(&context);
    let refused = |prefetch: outcrop::Result<Prefetch>| matches!(prefetch.map(|_| ()), Err(Error::BadArgument(_)));
    let b = boxed(DVec3::ZERO, DVec3::ONE);
    assert!(refused(Prefetch::of_box(&scene, &boxed(DVec3::NAN, DVec3::ONE), 0.0)));
    for cell in [f64::NAN, -1.0] {
        assert!(refused(Prefetch::of_box(&scene, &b, cell)));
    }
    let camera = Camera::Perspective { eye: DVec3::X, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    for poe in [f32::NAN, -1.0, f32::INFINITY] {
        assert!(refused(Prefetch::of_camera(&scene, &camera, (10, 10), poe)));
    }
    assert!(refused(Prefetch::of_camera(&scene, &camera, (0, 10), 0.0)));
    let blind = Camera::Perspective { eye: DVec3::X, at: DVec3::X, up: DVec3::Z, fov_y_degrees: 40.0 };
    assert!(refused(Prefetch::of_camera(&scene, &blind, (10, 10), 0.0)));
    for nothing in [DBounds::EMPTY, boxed(DVec3::splat(50.0), DVec3::splat(60.0))] {
        let status = Prefetch::of_box(&scene, &nothing, 0.0).expect("a prefetch").wait(LONG);
        assert_eq!((status.state, status.blocks), (PrefetchState::Done, 0));
    }
    let empty = Scene::new(&context).state();
    assert_eq!(Prefetch::of_box(&empty, &b, 0.0).expect("a prefetch").wait(LONG).state, PrefetchState::Done);
}

built::on_each_structure!(
    what_lies_in_a_box_is_there_and_little_else,
    cells_of_a_length_are_enough_where_that_was_asked,
    a_camera_finds_its_picture_read,
    it_ends_when_the_budget_is_full_and_takes_nothing_from_frames,
    dropping_it_ends_the_reading,
    a_block_that_cannot_be_read_is_said_and_the_rest_is_there,
    nonsense_is_refused_and_nothing_is_nothing,
);
