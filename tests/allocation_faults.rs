//! The allocator fails at each of its calls in turn, in builds, opens, queries and pictures: once, or from there on.
//! Each case runs in a child process.
#![cfg(target_os = "linux")]

mod common;

use common::built::{self, Part};
use common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::base::reserve::{LARGEST, Reserve};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions};
use outcrop::scene::{Camera, Context, ContextOptions, Model, Scene};
use outcrop::{Error, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicUsize, Ordering::SeqCst};
use std::time::Duration;

/// Fails at one call, or from it on.
struct Failing;

static ARMED: AtomicBool = AtomicBool::new(false);
/// Calls until the one that fails.
static LEFT: AtomicI64 = AtomicI64::new(0);
/// Calls that are smaller never fail.
static LEAST: AtomicUsize = AtomicUsize::new(0);
static FOR_GOOD: AtomicBool = AtomicBool::new(false);
/// Set to print where the failing allocation is.
static SITES: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// Set while [`say_where`] allocates.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

fn fails(size: usize) -> bool {
    if !ARMED.load(SeqCst) || size < LEAST.load(SeqCst) || INSIDE.try_with(Cell::get).unwrap_or(true) {
        return false;
    }
    let left = LEFT.fetch_sub(1, SeqCst);
    if left == 0 && SITES.load(SeqCst) {
        INSIDE.set(true);
        say_where(size);
        INSIDE.set(false);
    }
    left == 0 || left < 0 && FOR_GOOD.load(SeqCst)
}

/// Prints the functions of the library that asked for this memory.
fn say_where(size: usize) {
    let trace = std::backtrace::Backtrace::force_capture().to_string();
    let names = trace.lines().filter_map(|line| line.split_once(": ").map(|(_, name)| name));
    let ours: Vec<&str> =
        names.filter(|name| name.contains("outcrop::") && !name.contains("Reserve")).take(4).collect();
    eprintln!("{size} bytes are refused in {}", ours.join(" < "));
}

// SAFETY: every call goes to the system's allocator unchanged, or fails.
unsafe impl GlobalAlloc for Failing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        if fails(layout.size()) { std::ptr::null_mut() } else { unsafe { System.alloc(layout) } }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        if fails(layout.size()) { std::ptr::null_mut() } else { unsafe { System.alloc_zeroed(layout) } }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size > layout.size() && fails(size) {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Reserve<Failing> = Reserve(Failing);

/// A build of a mesh file with a material, and of pushed triangles with colours.
fn build(out: &Path, input: &Path, triangles: &[[DVec3; 3]], memory_budget: u64) -> outcrop::Result<()> {
    let temp_dir = out.parent().map(Path::to_path_buf);
    let options = BuildOptions { threads: 1, memory_budget, temp_dir, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new())?;
    builder.add_file(input)?;
    let part = builder.part(PartDesc { name: "a part".into(), ..PartDesc::default() })?;
    for some in triangles.chunks(3000) {
        builder.triangles(MeshKey::DIRECT, part, some, Attributes::colours(&vec![[[0.5; 3]; 3]; some.len()]))?;
    }
    builder.finish(out).map(drop)
}

fn options() -> ContextOptions {
    ContextOptions { threads: 0, memory_budget: 64 << 20, ..ContextOptions::default() }
}

struct Opened {
    _model: Model,
    scene: Scene,
}

fn open(context: &Context, path: &Path) -> outcrop::Result<Opened> {
    let model = Model::open(context, path)?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    scene.commit()?;
    Ok(Opened { _model: model, scene })
}

fn query(opened: &Opened) -> outcrop::Result<()> {
    let rays: Vec<Ray> =
        (0..100).map(|i| Ray::new(DVec3::Z * 4.0, DVec3::new(f64::from(i) * 0.002, 0.0, -1.0).as_vec3())).collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    opened.scene.state().closest(&rays, QueryOptions::default(), &mut hits)
}

fn picture(context: &Context, opened: &Opened) -> outcrop::Result<()> {
    let frame =
        Frame::new(context, FrameOptions { width: 40, height: 30, outputs: Outputs::ALL, ..Default::default() })?;
    let camera = Camera::Perspective { eye: DVec3::Z * 4.0, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 45.0 };
    frame.request(&opened.scene.state(), &camera, &FrameSettings::default())?;
    let status = frame.wait(Duration::from_secs(20));
    assert_ne!(status.state, FrameState::Running);
    status.error.map_or(Ok(()), |error| Err(Error::clone(&error)))
}

/// Ends of a child process.
const RIGHT: i32 = 0;
const NO_MEMORY: i32 = 1;
const ANOTHER_ERROR: i32 = 2;
const PANIC: i32 = 3;
const NOT_AFTERWARDS: i32 = 4;

/// Runs `work` in a child process while allocations fail, and once more when they do not. Returns how it ended; 100 and
/// the number of the signal if one ended it.
fn child(work: &mut dyn FnMut() -> outcrop::Result<()>) -> i32 {
    // SAFETY: this thread alone goes on in the child, which ends below. No other thread of the test is in a lock.
    let pid = unsafe { libc::fork() };
    assert!(pid >= 0, "no child process");
    if pid == 0 {
        // SAFETY: an alarm for this process, were it to hang.
        unsafe { libc::alarm(120) };
        let mut run = || catch_unwind(AssertUnwindSafe(&mut *work));
        ARMED.store(true, SeqCst);
        let done = run();
        ARMED.store(false, SeqCst);
        let end = match done {
            Ok(Ok(())) => RIGHT,
            Ok(Err(Error::NoMemory { .. })) => NO_MEMORY,
            Ok(Err(Error::Io { source, .. })) if source.kind() == std::io::ErrorKind::OutOfMemory => NO_MEMORY,
            Ok(Err(_)) => ANOTHER_ERROR,
            Err(_) => PANIC,
        };
        let again = end > NO_MEMORY || matches!(run(), Ok(Ok(())));
        // SAFETY: ends this process.
        unsafe { libc::_exit(if again { end } else { NOT_AFTERWARDS }) };
    }
    let mut status = 0;
    // SAFETY: a child of this process, and a place for its status.
    assert_eq!(unsafe { libc::waitpid(pid, &raw mut status, 0) }, pid);
    if libc::WIFEXITED(status) { libc::WEXITSTATUS(status) } else { 100 + libc::WTERMSIG(status) }
}

/// Fails allocations of at least `least` bytes in about `most` places of `work`: one, and then all from there on.
fn fails_in(name: &str, least: usize, most: usize, work: &mut dyn FnMut() -> outcrop::Result<()>) {
    LEAST.store(least, SeqCst);
    FOR_GOOD.store(false, SeqCst);
    LEFT.store(i64::MAX / 2, SeqCst);
    ARMED.store(true, SeqCst);
    let done = work();
    ARMED.store(false, SeqCst);
    done.expect("it works");
    let count = usize::try_from(i64::MAX / 2 - LEFT.load(SeqCst)).expect("a count");
    let most: usize = std::env::var("OUTCROP_TEST_PLACES").ok().and_then(|text| text.parse().ok()).unwrap_or(most);
    let mut faults = Vec::new();
    for for_good in [false, true] {
        let mut ends = BTreeMap::new();
        for n in (0..count).step_by(count.div_ceil(most).max(1)) {
            LEFT.store(n as i64, SeqCst);
            FOR_GOOD.store(for_good, SeqCst);
            let end = child(work);
            *ends.entry(end).or_insert(0) += 1;
            if end > NO_MEMORY {
                faults.push(format!("{name}: allocation {n}, for good: {for_good}: it ends with {end}"));
                SITES.store(true, SeqCst);
                LEFT.store(n as i64, SeqCst);
                child(work);
                SITES.store(false, SeqCst);
            }
        }
        println!("{name}: {count} allocations of at least {least} bytes, for good: {for_good}: {ends:?}");
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

/// One test: the allocator is that of the process.
#[test]
fn failed_allocations_are_made_up_for_or_end_the_work_with_an_error() {
    let folder = folder();
    let (out, input) = (folder.path().join("m.oc"), folder.path().join("m.obj"));
    std::fs::write(folder.path().join("m.mtl"), "newmtl red\nKd 1 0 0\n").expect("an input");
    std::fs::write(&input, "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n").expect("an input");
    let small = scenes::bumpy_sphere(12, 24, 3);
    fails_in("a small build", 0, 80, &mut || build(&out, &input, &small, 0));
    // What the reserve does not serve.
    let large = scenes::bumpy_sphere(160, 320, 3);
    fails_in("a large build", LARGEST + 1, 20, &mut || build(&out, &input, &large, 0));
    fails_in("a build with scratch files", LARGEST + 1, 8, &mut || build(&out, &input, &large, 32 << 20));
    let file = built::parts(&[Part::white(1, scenes::bumpy_sphere(60, 120, 3))]);
    fails_in("a context", 0, 30, &mut || Context::new(options()).map(drop));
    let context = Context::new(options()).expect("a context");
    fails_in("an open", 0, 60, &mut || open(&context, &file.path).map(drop));
    let opened = open(&context, &file.path).expect("it opens");
    fails_in("a query", 0, 40, &mut || query(&opened));
    fails_in("a picture", 0, 40, &mut || picture(&context, &opened));
}
