//! The stack that calls take: a host's threads may have little (128 KB with musl).

use crate::{Context, ContextOptions, alone, folder, makers, picture};
use glam::{DAffine3, DVec3};
use outcrop::math::{DBounds, Ray};
use outcrop::{Hit, Model, QueryOptions, Scene};
use std::ffi::c_void;

/// Most bytes that a call may take.
const MOST: usize = 64 << 10;
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

#[test]
fn calls_take_little_stack() {
    let (_one, dir) = (alone(), folder());
    let path = dir.path().join("model.oc");
    makers::chain(&path, 5);
    let without = depth(Box::new(|| {}));
    // New contexts, for the working memory of a context is made at its first call. Without threads the caller works.
    let context = || {
        let options = ContextOptions { threads: 0, memory_budget: 64 << 20, ..ContextOptions::default() };
        Context::new(options).unwrap()
    };
    let scene = |context: &Context, places: u32| {
        let model = Model::open(context, &path).unwrap();
        let scene = Scene::new(context);
        for i in 0..places {
            let place = DAffine3::from_translation(DVec3::Z * 0.1 * f64::from(i));
            scene.add_instance(&model, u64::from(i), place).unwrap();
        }
        scene.commit().unwrap();
        (model, scene.state())
    };
    let closest = |count: usize, coherent: bool, places: u32| {
        let context = context();
        let (_model, state) = scene(&context, places);
        let ray = |i: usize| Ray::new(DVec3::new(0.2 + (i % 8) as f64 * 0.05, 0.3, 5.0), -DVec3::Z.as_vec3());
        let rays: Vec<Ray> = (0..count).map(ray).collect();
        depth(Box::new(move || {
            let mut hits = vec![Hit::MISS; rays.len()];
            state.closest(&rays, QueryOptions { coherent, ..QueryOptions::default() }, &mut hits).unwrap();
        }))
    };
    let mut found = Vec::new();
    for count in [1, 2, 40, 300, 3000] {
        for coherent in [false, true] {
            for places in [1, 3] {
                found.push((format!("{count} rays, {coherent}, {places} places"), closest(count, coherent, places)));
            }
        }
    }
    let all = DBounds { min: DVec3::splat(-9.0), max: DVec3::splat(9.0) };
    for places in [1, 3] {
        let context = context();
        let (model, state) = scene(&context, places);
        let asked = std::sync::Arc::clone(&state);
        found.push(("overlap".into(), depth(Box::new(move || drop(asked.overlap_box(&all).unwrap())))));
        let own = context.clone();
        found.push(("wait".into(), depth(Box::new(move || drop(picture(&own, &state, &model))))));
    }
    let (own, path) = (context(), path.clone());
    found.push(("open".into(), depth(Box::new(move || drop(Model::open(&own, &path).unwrap())))));
    for (what, depth) in found {
        let own = depth - without;
        println!("{what}: {} KB", own.div_ceil(1024));
        if cfg!(optimised) {
            assert!(own <= MOST, "{what}: {own} bytes of stack");
        }
    }
}
