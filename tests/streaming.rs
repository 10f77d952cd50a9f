//! Frames of models that are not in memory, or do not fit: a whole picture at once, finer as blocks come, inside the
//! budget, and quiet when the camera rests.

use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use crate::common::scenes::{self, rounded};
use crate::common::sources::{Gate, OpensAtEnd};
use glam::{DAffine3, DVec3};
use outcrop::base::error::Error;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Outputs};
use outcrop::scene::{Camera, Context, ContextOptions, Light, LightKind, Model, Scene, SceneState};
use outcrop::store::{CallbackSource, FileSource, ModelFile, Source};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

const LONG: Duration = Duration::from_secs(120);
const SIZE: (u32, u32) = (200, 150);

/// A model that all tests look at.
struct Bulb {
    path: PathBuf,
    /// Bytes of its geometry in memory.
    bytes: u64,
}

fn bulb() -> &'static Bulb {
    static BULB: OnceLock<Bulb> = OnceLock::new();
    BULB.get_or_init(|| {
        let folder = Box::leak(Box::new(tempfile::tempdir().expect("a folder")));
        let path = folder.path().join("bulb.oc");
        let mut builder =
            Builder::new(BuildOptions::default(), Arc::new(Progress::default()), Cancel::new()).expect("a builder");
        let options = GenerateOptions { triangles: 1_000_000, seed: 0, ..Default::default() };
        generate("mandelbulb", &options, &Cancel::new(), &mut builder).expect("a bulb");
        builder.finish(&path).expect("a build");
        let bytes = Model::open(&built::context(0), &path).expect("it opens").memory().geometry;
        Bulb { path, bytes }
    })
}

fn context(threads: usize, memory_budget: u64) -> Context {
    let options = ContextOptions { threads, memory_budget, read_ahead: false, ..Default::default() };
    Context::new(options).expect("a context")
}

/// A source that counts its reads.
fn counted(reads: &Arc<AtomicU64>) -> Arc<dyn Source> {
    held_up(reads, &Hold::default())
}

/// Holds reads up from when it is shut until it is opened.
#[derive(Clone, Default)]
struct Hold {
    is_shut: Arc<AtomicBool>,
    gate: Arc<Gate>,
}

fn held_up(reads: &Arc<AtomicU64>, hold: &Hold) -> Arc<dyn Source> {
    let (file, reads, hold) = (FileSource::open(&bulb().path).expect("the file"), Arc::clone(reads), hold.clone());
    let read = move |at: u64, buf: &mut [u8]| {
        reads.fetch_add(1, SeqCst);
        if hold.is_shut.load(SeqCst) {
            hold.gate.pass();
        }
        file.read_at(at, buf)
    };
    let len = std::fs::metadata(&bulb().path).expect("the file").len();
    Arc::new(CallbackSource::new("bulb", len, Box::new(read)))
}

fn scene(context: &Context, source: Arc<dyn Source>) -> Arc<SceneState> {
    let model = Model::open_source(context, source).expect("it opens");
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    scene.state()
}

fn frame(context: &Context) -> Frame {
    let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs: Outputs::ALL, ..Default::default() };
    Frame::new(context, options).expect("a frame")
}

/// From around the model, near and far; some from inside.
fn camera(i: usize) -> Camera {
    let a = i as f64 * 2.4;
    let distance = [2.6, 1.6, 4.0, 0.9][i % 4];
    let eye = DVec3::new(a.cos(), a.sin(), 0.4 * (a * 0.7).sin()) * distance;
    Camera::Perspective { eye, at: DVec3::new(0.1, 0.0, 0.2), up: DVec3::Z, fov_y_degrees: 40.0 }
}

/// Waits until the last request has a picture.
fn first_picture(frame: &Frame) -> FrameStatus {
    loop {
        let status = frame.wait(Duration::from_millis(1));
        if status.pictures > 0 || status.state != FrameState::Running {
            return status;
        }
    }
}

fn kinds(frame: &Frame) -> Vec<u8> {
    frame.map(Buffer::Kind).expect("a picture").bytes().to_vec()
}

/// What the picture shows when all is in memory and exact.
fn exact(camera: &Camera) -> Vec<Vec<u8>> {
    static WHOLE: OnceLock<(Context, Arc<SceneState>)> = OnceLock::new();
    let (context, state) = WHOLE.get_or_init(|| {
        let context = context(2, 0);
        let model = Model::open(&context, &bulb().path).expect("it opens");
        assert!(model.load(&Cancel::new()).expect("it loads"));
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        let state = scene.state();
        (context, state)
    });
    let frame = frame(context);
    frame.request(state, camera, &FrameSettings::default()).expect("a request");
    let status = frame.wait(LONG);
    assert_eq!((status.state, status.pixels_exact), (FrameState::Converged, status.pixels_total));
    Buffer::ALL.iter().map(|&b| frame.map(b).expect("a picture").bytes().to_vec()).collect()
}

/// Every pixel of the exact picture that something covers is covered.
fn assert_covered(frame: &Frame, camera: &Camera) -> f64 {
    let exact = &exact(camera)[Buffer::Kind as usize];
    let now = kinds(frame);
    let (mut both, mut either) = (0, 0);
    let holes = now
        .iter()
        .zip(exact)
        .filter(|(now, exact)| **now == HitKind::Miss as u8 && **exact != HitKind::Miss as u8)
        .count();
    assert_eq!(holes, 0, "holes at {} pixels of error", frame.wait(Duration::ZERO).effective_poe);
    for (&now, &exact) in now.iter().zip(exact) {
        both += u32::from(now != 0 && exact != 0);
        either += u32::from(now != 0 || exact != 0);
    }
    f64::from(both) / f64::from(either.max(1))
}

#[test]
fn the_first_picture_is_whole_and_the_last_is_exact() {
    for threads in [0, 2] {
        // A quarter of it is read at opening, and all fits.
        let context = context(threads, bulb().bytes * 2);
        let (reads, hold) = (Arc::new(AtomicU64::new(0)), Hold::default());
        let state = scene(&context, held_up(&reads, &hold));
        let frame = frame(&context);
        let camera = camera(0);
        // Without threads of its own a frame that is waited for reads itself.
        hold.is_shut.store(threads > 0, SeqCst);
        let _open = OpensAtEnd(Arc::clone(&hold.gate));
        frame.request(&state, &camera, &FrameSettings::default()).expect("a request");
        let first = first_picture(&frame);
        hold.gate.open();
        assert!(first.pixels_missing > 0 && first.worst_error_px > 0.0, "{first:?}");
        assert_eq!(first.pixels_exact + first.pixels_lod + first.pixels_missing, first.pixels_total);
        let overlap = assert_covered(&frame, &camera);
        println!("first picture: mean error {:.1} px, overlap {overlap:.3}", first.mean_error_px);
        assert!(overlap > 0.9);
        let last = frame.wait(LONG);
        assert_eq!((last.state, last.pixels_exact, last.bytes_wanted), (FrameState::Converged, last.pixels_total, 0));
        assert_eq!((last.fraction, last.effective_poe), (1.0, 0.0));
        for (buffer, exact) in Buffer::ALL.into_iter().zip(exact(&camera)) {
            assert!(frame.map(buffer).expect("a picture").bytes() == exact, "{buffer:?} is not what it is in memory");
        }
    }
}

/// Before its first picture a frame looks at what that will lack, and waits for it; not for ever, and only once.
#[test]
fn the_first_picture_of_a_frame_has_what_comes_soon() {
    let camera = camera(2);
    let lacking = |is_shut: bool| {
        let context = context(2, bulb().bytes * 2);
        let (reads, hold) = (Arc::new(AtomicU64::new(0)), Hold::default());
        let state = scene(&context, held_up(&reads, &hold));
        hold.is_shut.store(is_shut, SeqCst);
        let _open = OpensAtEnd(Arc::clone(&hold.gate));
        let frame = frame(&context);
        frame.request(&state, &camera, &FrameSettings::default()).expect("a request");
        let first = first_picture(&frame);
        // Asked for before there was a picture, and held up.
        assert!(!is_shut || hold.gate.is_reached(LONG));
        assert_covered(&frame, &camera);
        first.pixels_missing
    };
    let (with, without) = (lacking(false), lacking(true));
    println!("{with} pixels lack something, without what comes soon {without}");
    assert!(without > 0 && with < without, "{with}, {without}");
}

/// Without threads the one who waits renders and reads: by turns, not a picture for each block that came.
#[test]
fn who_reads_what_he_renders_makes_few_pictures() {
    let context = context(0, bulb().bytes * 2);
    let reads = Arc::new(AtomicU64::new(0));
    let state = scene(&context, counted(&reads));
    let frame = frame(&context);
    let settings = FrameSettings { poe: 0.0, ..Default::default() };
    for i in 0..2 {
        let (before, begun) = (reads.load(SeqCst), Instant::now());
        frame.request(&state, &camera(i), &settings).expect("a request");
        let status = frame.wait(LONG);
        assert_eq!(status.state, FrameState::Converged);
        // Between two of them he has read for that long, or all that was known to be lacking: which is so some times,
        // as each picture goes deeper.
        let most = 8 + begun.elapsed().as_millis() / 80;
        let reads = reads.load(SeqCst) - before;
        println!("{} pictures, {most} at most, of {reads} reads", status.pictures);
        assert!(u128::from(status.pictures) <= most && reads > 16);
    }
}

#[test]
fn the_same_stand_ins_with_any_threads_and_vectors() {
    let mut seen = Vec::new();
    for (threads, isa) in
        [(1, None), (2, None), (2, Some(outcrop::simd::Isa::Baseline)), (1, Some(outcrop::simd::Isa::Avx2))]
    {
        if isa.is_some_and(|isa| !isa.is_available()) {
            continue;
        }
        let context =
            Context::new(ContextOptions { threads, isa, read_ahead: false, ..Default::default() }).expect("a context");
        let model = Model::open(&context, &bulb().path).expect("it opens");
        assert!(model.load(&Cancel::new()).expect("it loads"));
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        let frame = frame(&context);
        let mut all = Vec::new();
        for poe in [0.5, 3.0, 32.0] {
            frame.request(&scene.state(), &camera(1), &FrameSettings { poe, ..Default::default() }).expect("a request");
            let status = frame.wait(LONG);
            assert_eq!(status.state, FrameState::Converged);
            assert!(status.pixels_lod > 0, "{status:?}");
            all.push(Buffer::ALL.map(|b| frame.map(b).expect("a picture").bytes().to_vec()));
        }
        seen.push(all);
    }
    assert!(seen.windows(2).all(|w| w[0] == w[1]), "the picture depends on threads or vectors");
}

/// Lets a thread end that looks on, also where a test fails.
struct StopsAtEnd<'a>(&'a AtomicBool);

impl Drop for StopsAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, SeqCst);
    }
}

#[test]
fn a_flight_with_teleports_in_a_small_budget() {
    let budget = bulb().bytes / 6;
    let context = context(2, budget);
    let reads = Arc::new(AtomicU64::new(0));
    let state = scene(&context, counted(&reads));
    let (stop, most) = (AtomicBool::new(false), AtomicU64::new(0));
    std::thread::scope(|threads| {
        let _stops = StopsAtEnd(&stop);
        threads.spawn(|| {
            while !stop.load(SeqCst) {
                most.fetch_max(context.memory_used(), SeqCst);
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        let frames = [frame(&context), frame(&context)];
        for i in 0..12 {
            for (k, frame) in frames.iter().enumerate() {
                let settings = FrameSettings { poe: 1.0, ..Default::default() };
                frame.request(&state, &camera(i + 5 * k), &settings).expect("a request");
            }
            for (k, frame) in frames.iter().enumerate() {
                first_picture(frame);
                assert_covered(frame, &camera(i + 5 * k));
            }
            let seen = frames[0].pick(SIZE.0 / 2, SIZE.1 / 2).expect("a pick");
            assert!(seen.kind == HitKind::Exact || seen.kind == HitKind::Miss, "{seen:?}");
        }
        // At rest: it ends, says how coarse it is, and is quiet.
        for (k, frame) in frames.iter().enumerate() {
            let status = frame.wait(LONG);
            let ended = [FrameState::Converged, FrameState::CompleteWithinBudget].contains(&status.state);
            assert!(ended && status.pixels_missing == 0, "{status:?}");
            assert!(status.effective_poe >= 1.0, "{status:?}");
            assert_eq!(status.state == FrameState::Converged, status.effective_poe == 1.0);
            println!("frame {k} ended with {} pixels of error, {} pictures", status.effective_poe, status.pictures);
            assert_covered(frame, &camera(11 + 5 * k));
        }
        let quiet = Instant::now();
        std::thread::sleep(Duration::from_millis(300));
        let before = reads.load(SeqCst);
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(reads.load(SeqCst), before, "still reading {:?} after the frames ended", quiet.elapsed());
    });
    let most = most.into_inner();
    println!("{most} of {budget} bytes at the most");
    assert!(most <= budget);
}

/// A frame that had to be coarse, for the whole model was seen exactly, and is then moved to where all that is seen
/// fits, ended complete within the budget, at some pixels of error, as often as it looked for the pressure before a
/// fetcher had lowered it.
#[test]
fn what_fits_is_shown_as_asked_whatever_was_seen_before() {
    let context = context(2, bulb().bytes / 4);
    let (scene, frame) = (scene(&context, counted(&Arc::default())), frame(&context));
    let exactly = FrameSettings { poe: 0.0, ..Default::default() };
    let near =
        Camera::Perspective { eye: DVec3::new(1.3, 0.5, 0.5), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 6.0 };
    for i in 0..8 {
        let at_once = FrameSettings { at_once: true, ..exactly };
        frame.request(&scene, &camera(2 * i), &at_once).expect("a request");
        assert_eq!(frame.wait(LONG).state, FrameState::CompleteWithinBudget);
        frame.request(&scene, &near, &exactly).expect("a request");
        let status = frame.wait(LONG);
        assert_eq!((status.state, status.effective_poe), (FrameState::Converged, 0.0));
    }
}

/// What frames use goes where a model that is being opened needs its place: their pictures are there, and get coarser
/// when they are next asked for. So models open until the budget is too small for what must stay of them.
#[test]
fn models_open_although_frames_use_the_whole_budget() {
    let context = context(2, bulb().bytes / 3);
    let (first, frame) = (scene(&context, counted(&Arc::default())), frame(&context));
    let exactly = FrameSettings { poe: 0.0, at_once: true, ..Default::default() };
    let mut others = Vec::new();
    let refused = loop {
        let i = others.len();
        frame.request(&first, &camera(i), &exactly).expect("a request");
        // At rest, and in the midst of it.
        if i % 4 == 0 {
            assert_eq!(frame.wait(LONG).state, FrameState::CompleteWithinBudget);
            assert_covered(&frame, &camera(i));
        }
        match Model::open_source(&context, counted(&Arc::default())) {
            Ok(other) => others.push(other),
            Err(why) => break why,
        }
        assert!(context.memory_used() <= context.memory_budget());
    };
    let text = refused.to_string();
    assert!(matches!(refused, Error::OverBudget { .. }) && text.starts_with("opening bulb needs"), "{text}");
    assert!(others.len() > 8 && text.contains("bulb"), "{} models, then {text}", others.len());
    println!("{} models, then {text}", others.len());
}

#[test]
fn a_resting_camera_sees_better_pictures_and_is_woken_for_each() {
    let context = context(2, bulb().bytes * 2);
    let hold = Hold::default();
    let state = scene(&context, held_up(&Arc::default(), &hold));
    let frame = frame(&context);
    let woken = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&woken);
    frame.set_wake(Some(Arc::new(move || {
        count.fetch_add(1, SeqCst);
    })));
    hold.is_shut.store(true, SeqCst);
    let _open = OpensAtEnd(Arc::clone(&hold.gate));
    frame
        .request(&state, &camera(3), &FrameSettings { samples: 8, poe: 0.5, ..Default::default() })
        .expect("a request");
    assert!(first_picture(&frame).pixels_missing > 0);
    hold.gate.open();
    let (mut fraction, mut pictures, mut error) = (0.0, 0, f32::INFINITY);
    let last = loop {
        let status = frame.wait(Duration::from_millis(2));
        assert!(status.fraction >= fraction && status.pictures >= pictures, "{status:?}");
        if status.pictures > pictures && pictures > 0 {
            assert!(status.mean_error_px <= error * 1.5, "{status:?}, it was {error}");
            error = status.mean_error_px;
        }
        (fraction, pictures) = (status.fraction, status.pictures);
        if status.state != FrameState::Running {
            break status;
        }
    };
    assert_eq!((last.state, last.pixels_missing), (FrameState::Converged, 0));
    // The first, at least one with blocks that came, those with 4 and 8 samples.
    assert!(last.pictures >= 4 && woken.load(SeqCst) >= u64::from(last.pictures), "{last:?}, woken {woken:?} times");
}

/// Whatever is lacking for shadows is wanted too: a picture that has converged is that of the whole model.
#[test]
fn a_picture_that_has_converged_is_exact_from_inside_and_in_shadow() {
    let towards = DVec3::new(-0.6, 0.5, -0.7);
    let light = Light { kind: LightKind::Directional(towards), colour: [1.0; 3], intensity: 1.0, shadows: true };
    let picture = |camera: &Camera, is_cold: bool| {
        let context = context(2, if is_cold { bulb().bytes * 3 / 2 } else { 0 });
        let hold = Hold::default();
        let model = Model::open_source(&context, held_up(&Arc::default(), &hold)).expect("it opens");
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
        scene.set_lights(vec![light]).expect("a light");
        scene.commit().expect("a commit");
        let frame = frame(&context);
        if !is_cold {
            assert!(model.load(&Cancel::new()).expect("it loads"));
            // Loading does not read normals; pixels that lack theirs count as missing.
            frame.request(&scene.state(), camera, &FrameSettings::default()).expect("a request");
            assert_eq!(frame.wait(LONG).state, FrameState::Converged);
        }
        hold.is_shut.store(true, SeqCst);
        let _open = OpensAtEnd(Arc::clone(&hold.gate));
        frame.request(&scene.state(), camera, &FrameSettings::default()).expect("a request");
        let first = first_picture(&frame);
        assert_eq!(first.pixels_missing > 0, is_cold, "{first:?}");
        hold.gate.open();
        let status = frame.wait(LONG);
        assert_eq!((status.state, status.pixels_exact), (FrameState::Converged, status.pixels_total));
        Buffer::ALL.map(|b| frame.map(b).expect("a picture").bytes().to_vec())
    };
    // Far, and so near that cells around the eye are missing.
    for (eye, at) in [(DVec3::new(2.4, 0.6, 0.5), DVec3::ZERO), (DVec3::new(0.9, 0.3, 0.2), DVec3::new(0.0, 0.4, 0.0))]
    {
        let camera = Camera::Perspective { eye, at, up: DVec3::Z, fov_y_degrees: 60.0 };
        let pictures = [false, true].map(|is_cold| picture(&camera, is_cold));
        for buffer in Buffer::ALL {
            let [exact, now] = pictures.each_ref().map(|picture| &picture[buffer as usize]);
            let differ = exact.iter().zip(now).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{buffer:?} from {eye}: bytes that differ of {}", exact.len());
        }
    }
}

/// Of triangles at the same distance the picture shows the one with the lowest primitive id, also if no id was in
/// memory when the rays met them.
#[test]
fn ties_do_not_depend_on_what_is_in_memory() {
    let mut rng = Rng::new(5);
    // All lie in one plane, and a ray's way to it is a power of two, so that distances are equal to the bit.
    let mut triangle = |_| {
        let at = DVec3::new(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), 0.0);
        [0, 1, 2].map(|_| rounded(at + DVec3::new(rng.between(-0.03, 0.03), rng.between(-0.03, 0.03), 0.0)))
    };
    let parts: Vec<Part> =
        (0..32).map(|id| Part::white(id, (0..2000).map(&mut triangle).filter(scenes::has_area).collect())).collect();
    let built = built::parts(&parts);
    let eye = DVec3::new(-0.6, 0.5, 1.0);
    let camera = Camera::Orthographic { eye, at: eye - DVec3::Z, up: DVec3::Y, height: 0.4 };
    // A tenth of the model, and then with all of its geometry in memory.
    let [some, all] = [false, true].map(|is_loaded| {
        let context = context(2, 1 << 30);
        let model = Model::open_cold(&context, &built.path).expect("it opens");
        let scene = Scene::new(&context);
        scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
        scene.commit().expect("a commit");
        assert!(!is_loaded || model.load(&Cancel::new()).expect("it loads"));
        let outputs = Outputs::of(Buffer::Part) | Outputs::of(Buffer::Kind);
        let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs, ..Default::default() };
        let frame = Frame::new(&context, options).expect("a frame");
        frame.request(&scene.state(), &camera, &FrameSettings { poe: 0.0, ..Default::default() }).expect("a request");
        let status = frame.wait(LONG);
        assert_eq!((status.state, status.pixels_exact), (FrameState::Converged, status.pixels_total));
        let is_whole = model.memory().resident >= model.memory().geometry;
        assert_eq!(is_whole, is_loaded, "{:?}", model.memory());
        frame.map(Buffer::Part).expect("a picture").bytes().to_vec()
    });
    let differ = some.chunks(8).zip(all.chunks(8)).filter(|(a, b)| a != b).count();
    assert_eq!(differ, 0, "pixels of {} that show other parts", some.len() / 8);
}

/// Each read of a block, by where it begins.
type Places = Arc<Mutex<Vec<u64>>>;

fn noted(places: &Places) -> Arc<dyn Source> {
    let places = Arc::clone(places);
    crate::common::sources::meddled(&bulb().path, move |at, _| {
        places.lock().expect("the list").push(at);
        Ok(())
    })
}

/// What a frame shows stays in memory while others press: what it read is not read again, by nobody, and to render the
/// same once more reads nothing.
#[test]
fn what_a_resting_frame_uses_stays() {
    let context = context(2, bulb().bytes);
    let places = Places::default();
    let state = scene(&context, noted(&places));
    let settings = FrameSettings { poe: 4.0, ..Default::default() };
    let resting = frame(&context);
    let blocks = crate::common::sources::blocks(&bulb().path);
    let geometry = ModelFile::open_path(&bulb().path).expect("the file").header().geometry_blocks as usize;
    let reads = || places.lock().expect("the list").len();
    let render = |frame: &Frame, i| {
        frame.request(&state, &camera(i), &settings).expect("a request");
        let status = frame.wait(LONG);
        assert!([FrameState::Converged, FrameState::CompleteWithinBudget].contains(&status.state), "{status:?}");
        status
    };
    let opened = reads();
    assert_eq!(render(&resting, 0).state, FrameState::Converged);
    let used = places.lock().expect("the list")[opened..].to_vec();
    assert!(used.len() > 10, "{}", used.len());
    let picture = Buffer::ALL.map(|b| resting.map(b).expect("a picture").bytes().to_vec());
    let (other, mut poe, mut is_calm) = (frame(&context), settings.poe, true);
    for round in 0..4 {
        let before = reads();
        // Exact answers from all over the model, and another view that moves.
        let mut rng = crate::common::rng::Rng::new(round);
        let rays: Vec<Ray> = (0..1500)
            .map(|_| {
                let from = rng.direction() * 3.0;
                Ray::new(from, (rng.direction() * 0.9 - from).as_vec3())
            })
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        state.closest(&rays, QueryOptions::default(), &mut hits).expect("answers");
        other.request(&state, &camera(round as usize + 1), &settings).expect("a request");
        other.wait(LONG);
        let since = places.lock().expect("the list")[before..].to_vec();
        assert!(since.len() > 5, "nobody presses: {}", since.len());
        let again: Vec<_> = since.iter().filter(|at| used.contains(at)).collect();
        // A frame that was made coarser used less since.
        assert!(
            !is_calm || again.is_empty(),
            "round {round}: {} of {} blocks were read again",
            again.len(),
            used.len()
        );
        // Others rest: the same view, once more, and yet once more.
        let mut before = reads();
        for _ in 0..3 {
            let status = render(&resting, 0);
            if status.effective_poe != poe {
                (poe, is_calm, before) = (status.effective_poe, false, reads());
            }
            if status.effective_poe == 4.0 {
                let now = Buffer::ALL.map(|b| resting.map(b).expect("a picture").bytes().to_vec());
                assert!(now == picture, "round {round}: another picture of the same");
            }
        }
        let places = places.lock().expect("the list")[before..].to_vec();
        let kind = |at: &u64| blocks.iter().position(|b| b.start == *at).map(|i| (i, i >= geometry));
        let late: Vec<_> = places.iter().map(kind).collect();
        assert!(late.is_empty(), "round {round}: reads for the same view of (block, of ids): {late:?}");
    }
}
