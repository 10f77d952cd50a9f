//! The stack that calls take: a host's threads may have little (128 KB with musl).

use crate::{LONGEST, alone, folder, makers, picture};
use glam::{DAffine3, DVec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::{DBounds, Ray};
use outcrop::query::{Hits, Plane, Query, QueryState, Rays};
use outcrop::render::Prefetch;
use outcrop::scene::{Look, Scope};
use outcrop::{
    Context, ContextOptions, Frame, FrameOptions, FrameSettings, Hit, HitKind, Model, QueryOptions, Scene, SceneState,
};
use std::ffi::c_void;
use std::path::Path;
use std::sync::Arc;

/// Most bytes that a call may take, as the header states.
const MOST: usize = 64 << 10;
/// Most bytes that a build in the caller's thread may take.
const MOST_OF_BUILDS: usize = 1 << 20;
const STACK: usize = 2 << 20;
const PAINT: u8 = 0xa5;

/// A page of a stack.
#[derive(Clone, Copy)]
#[repr(align(4096))]
struct Page([u8; 4096]);

type Call<'a> = Box<dyn FnOnce() + Send + 'a>;

extern "C" fn run(call: *mut c_void) -> *mut c_void {
    // SAFETY: `depth` passes a box of a call.
    let call = unsafe { Box::from_raw(call.cast::<Call>()) };
    call();
    std::ptr::null_mut()
}

/// Runs a call in a thread with a painted stack, and returns the bytes from the top of the stack to the deepest one
/// that lost its paint.
fn depth(call: Call) -> usize {
    let mut pages = vec![Page([PAINT; 4096]); STACK / 4096];
    let call = Box::into_raw(Box::new(call));
    // SAFETY: the attributes are initialised before they are used. Stack and call outlive the thread, which is joined.
    unsafe {
        let mut attributes = std::mem::zeroed::<libc::pthread_attr_t>();
        assert_eq!(libc::pthread_attr_init(&raw mut attributes), 0);
        assert_eq!(libc::pthread_attr_setstack(&raw mut attributes, pages.as_mut_ptr().cast(), STACK), 0);
        let mut thread = std::mem::zeroed();
        assert_eq!(libc::pthread_create(&raw mut thread, &raw const attributes, run, call.cast()), 0);
        assert_eq!(libc::pthread_join(thread, std::ptr::null_mut()), 0);
        libc::pthread_attr_destroy(&raw mut attributes);
    }
    let bytes = pages.iter().flat_map(|page| page.0);
    STACK - bytes.take_while(|&byte| byte == PAINT).count()
}

/// A call, and the bytes of stack that it takes.
type Found = (String, usize);

/// A context whose working memory is not made yet. Without threads the caller works.
fn context() -> Context {
    let options = ContextOptions { threads: 0, memory_budget: 64 << 20, ..ContextOptions::default() };
    Context::new(options).unwrap()
}

fn place(i: u32) -> DAffine3 {
    DAffine3::from_translation(DVec3::Z * 0.1 * f64::from(i))
}

fn scene(context: &Context, path: &Path, places: u32) -> (Model, Arc<SceneState>) {
    let model = Model::open(context, path).unwrap();
    let scene = Scene::new(context);
    (0..places).for_each(|i| scene.add_instance(&model, u64::from(i), place(i)).unwrap());
    scene.commit().unwrap();
    (model, scene.state())
}

fn many_rays(count: usize) -> Vec<Ray> {
    let ray = |i: usize| Ray::new(DVec3::new(0.2 + (i % 8) as f64 * 0.05, 0.3, 5.0), -DVec3::Z.as_vec3());
    (0..count).map(ray).collect()
}

/// Rays of a batch, and the taker of its hits.
struct Batch(Vec<Ray>);

impl Rays for Batch {
    fn count(&self) -> usize {
        self.0.len()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        self.0[..].read(first, out);
    }
}

impl Hits for Batch {
    fn write(&self, _: usize, hits: &[Hit]) {
        assert!(hits.iter().all(|hit| hit.kind != HitKind::Missing));
    }
}

fn queries(path: &Path, count: usize, coherent: bool, places: u32) -> Vec<Found> {
    let options = QueryOptions { coherent, ..QueryOptions::default() };
    let name = |call| format!("{call}: {count} rays, {coherent}, {places} places");
    let ask = |call: &dyn Fn(Arc<SceneState>, Vec<Ray>) -> usize| {
        let context = context();
        let (_model, state) = scene(&context, path, places);
        call(state, many_rays(count))
    };
    let closest = |state: Arc<SceneState>, rays: Vec<Ray>| {
        let mut hits = vec![Hit::MISS; rays.len()];
        depth(Box::new(move || state.closest(&rays, options, &mut hits).unwrap()))
    };
    let any = |state: Arc<SceneState>, rays: Vec<Ray>| {
        let mut hits = vec![0; rays.len()];
        depth(Box::new(move || state.any(&rays, options, &mut hits).unwrap()))
    };
    let start = |state: Arc<SceneState>, rays: Vec<Ray>| {
        depth(Box::new(move || {
            let query = Query::closest(&state, Arc::new(Batch(rays)), Arc::new(Batch(Vec::new())), options).unwrap();
            assert_eq!(query.wait(LONGEST).state, QueryState::Done);
        }))
    };
    vec![(name("closest"), ask(&closest)), (name("any"), ask(&any)), (name("closest_start"), ask(&start))]
}

fn overlaps_and_frames(path: &Path, places: u32) -> Vec<Found> {
    let all = DBounds { min: DVec3::splat(-9.0), max: DVec3::splat(9.0) };
    let planes = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y].map(|normal| Plane { normal, d: 9.0 });
    let context = context();
    let (model, state) = scene(&context, path, places);
    let by = || (context.clone(), Arc::clone(&state), model.clone());
    let mut found = Vec::new();
    let mut add = |call: &str, work: Call| found.push((format!("{call}, {places} places"), depth(work)));
    let (_, state, _) = by();
    add("overlap_box", Box::new(move || drop(state.overlap_box(&all).unwrap())));
    let (_, state, _) = by();
    add("overlap_frustum", Box::new(move || drop(state.overlap_frustum(&planes).unwrap())));
    let (own, state, model) = by();
    add("frame_wait", Box::new(move || picture(&own, &state, &model).unwrap()));
    let (own, state, model) = by();
    add(
        "frame_pick, resize and release",
        Box::new(move || {
            let frame = Frame::new(&own, FrameOptions { width: 64, height: 48, ..FrameOptions::default() }).unwrap();
            frame.request(&state, &model.views()[0], &FrameSettings::default()).unwrap();
            frame.pick(32, 24).unwrap();
            frame.resize(32, 32).unwrap();
            frame.request(&state, &model.views()[1], &FrameSettings::default()).unwrap();
        }),
    );
    let (_, state, _) = by();
    add("prefetch", Box::new(move || drop(Prefetch::of_box(&state, &all, 0.0).unwrap().wait(LONGEST))));
    found
}

fn models_and_scenes(path: &Path) -> Vec<Found> {
    let mut found = Vec::new();
    let mut add = |call: &str, work: Call| found.push((call.to_owned(), depth(work)));
    let (own, file) = (context(), path.to_path_buf());
    add("context_create", Box::new(|| drop(context())));
    add("open and release", Box::new(move || drop(Model::open(&own, &file).unwrap())));
    let (own, file) = (context(), path.to_path_buf());
    add(
        "commit, looks and release",
        Box::new(move || {
            let model = Model::open(&own, &file).unwrap();
            let scene = Scene::new(&own);
            (0..100).for_each(|i| scene.add_instance(&model, u64::from(i), place(i)).unwrap());
            let parts: Vec<u64> = model.parts().iter().map(|part| part.id).collect();
            scene.isolate_parts(3, &parts, Scope::Below).unwrap();
            let look = Look { visible: false, ..Look::default() };
            scene.set_parts_look(4, &parts, Scope::Own, look).unwrap();
            scene.commit().unwrap();
        }),
    );
    let own = context();
    let (model, _) = scene(&own, path, 1);
    add(
        "load and check",
        Box::new(move || {
            model.load(&Cancel::new()).unwrap();
            model.check(&Cancel::new()).unwrap();
        }),
    );
    let (own, file) = (context(), path.to_path_buf());
    // The last reference to the context.
    let (model, state) = scene(&own, &file, 3);
    add("release of all", Box::new(move || drop((state, model, own))));
    found
}

fn builds(folder: &Path, threads: usize) -> Vec<Found> {
    let path = folder.join("built.oc");
    let work = move || {
        let options = BuildOptions { threads, temp_dir: None, ..BuildOptions::default() };
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
        generate(
            "mandelbulb",
            &GenerateOptions { triangles: 20_000, seed: 0, ..Default::default() },
            &Cancel::new(),
            &mut builder,
        )
        .unwrap();
        builder.finish(&path).unwrap();
    };
    vec![(format!("build, {threads} threads"), depth(Box::new(work)))]
}

#[test]
fn calls_take_little_stack() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("model.oc");
    makers::chain(&path, 5);
    let without = depth(Box::new(|| {}));
    let mut found = models_and_scenes(&path);
    for count in [1, 2, 40, 300, 3000] {
        for coherent in [false, true] {
            [1, 3].into_iter().for_each(|places| found.extend(queries(&path, count, coherent, places)));
        }
    }
    [1, 3].into_iter().for_each(|places| found.extend(overlaps_and_frames(&path, places)));
    let check = |found: Vec<Found>, most: usize| {
        for (call, depth) in found {
            let own = depth - without;
            println!("{call}: {} KB", own.div_ceil(1024));
            if cfg!(optimised) {
                assert!(own <= most, "{call}: {own} bytes of stack");
            }
        }
    };
    check(found, MOST);
    check([1, 2].into_iter().flat_map(|threads| builds(dir.path(), threads)).collect(), MOST_OF_BUILDS);
}
