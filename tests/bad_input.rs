//! Input that makes no sense: budgets too small or too large, accuracies and footprints that are none, sources that lie
//! about their size. Each is a clear error, or counts as what the documentation says.

use crate::common::built;
use glam::DVec3;
use outcrop::Error;
use outcrop::base::progress::Cancel;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, QueryOptions};
use outcrop::render::{Frame, FrameOptions, FrameSettings, FrameState};
use outcrop::scene::{Camera, Context, ContextOptions, Model};
use outcrop::store::{CallbackSource, Source};
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

fn bulb() -> &'static [u8] {
    static BULB: OnceLock<Vec<u8>> = OnceLock::new();
    BULB.get_or_init(|| {
        let options = GenerateOptions { triangles: 300_000, seed: 0, ..Default::default() };
        let bulb = built::build(|sink| {
            generate("mandelbulb", &options, &Cancel::new(), sink).expect("a bulb");
        });
        std::fs::read(bulb.path).expect("the file")
    })
}

fn context(memory_budget: u64) -> outcrop::Result<Context> {
    Context::new(ContextOptions { threads: 2, memory_budget, read_ahead: false, ..Default::default() })
}

/// The bulb, of which its owner says that it has `len` bytes, and of which `there` are.
fn said_to_have(len: u64, there: &Arc<AtomicU64>) -> Arc<dyn Source> {
    let there = Arc::clone(there);
    let read = move |at: u64, buf: &mut [u8]| {
        let end = at + buf.len() as u64;
        if end > there.load(SeqCst) {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        buf.copy_from_slice(&bulb()[at as usize..end as usize]);
        Ok(())
    };
    Arc::new(CallbackSource::new("a liar", len, Box::new(read)))
}

fn whole() -> Arc<AtomicU64> {
    Arc::new(AtomicU64::new(bulb().len() as u64))
}

fn honest() -> Arc<dyn Source> {
    said_to_have(bulb().len() as u64, &whole())
}

#[test]
fn a_budget_too_small_names_the_least_that_does() {
    let mut need = 1;
    for _ in 0..2 {
        let context = context(need).expect("a context");
        match Model::open_source(&context, honest()).map(|_| ()) {
            Err(Error::OverBudget { need: more, have, .. }) => {
                assert!(have == need && more > need);
                need = more;
            }
            Ok(()) => assert!(context.memory_used() <= need),
            Err(other) => panic!("{other}"),
        }
    }
    assert!(Model::open_source(&context(need).expect("a context"), honest()).is_ok());
    let less = Model::open_source(&context(need - 1).expect("a context"), honest());
    assert!(matches!(less.map(|_| ()), Err(Error::OverBudget { need: again, .. }) if again == need));
}

#[test]
fn a_budget_above_the_machines_memory_is_refused() {
    if std::path::Path::new("/proc/meminfo").exists() {
        assert!(matches!(context(u64::MAX).map(|_| ()), Err(Error::BadArgument(why)) if why.contains("machine")));
    }
}

#[test]
fn a_source_is_not_as_long_as_it_says() {
    let (context, len) = (context(0).expect("a context"), bulb().len() as u64);
    for said in [0, 1, 64, len / 2, len - 1, len + 1, len + 4096, 2 * len, u64::MAX] {
        for there in [Arc::new(AtomicU64::new(said)), whole()] {
            // Never more than there is to copy.
            there.fetch_min(len, SeqCst);
            let why = Model::open_source(&context, said_to_have(said, &there)).map(|_| ()).expect_err("it lies");
            assert!(matches!(why, Error::Corrupt { .. } | Error::Io { .. }), "{said}: {why:?}");
            assert!(why.to_string().contains("a liar"), "{why}");
        }
    }
    assert!(Model::open_source(&context, honest()).is_ok());
}

/// Cut short after it was opened: the block that is asked for says so, and frames show stand-ins for it.
#[test]
fn a_source_gets_shorter_while_it_is_open() {
    let budget = 24 << 20;
    let context = context(budget).expect("a context");
    let there = whole();
    let model = Model::open_source(&context, said_to_have(bulb().len() as u64, &there)).expect("it opens");
    assert!(model.memory().resident < model.memory().geometry, "it does not come whole");
    there.store(bulb().len() as u64 / 3, SeqCst);
    let scene = outcrop::scene::Scene::new(&context);
    scene.add_instance(&model, 1, glam::DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    let rays: Vec<Ray> = (0..1000)
        .map(|i| (f64::from(i % 32) / 16.0 - 1.0, f64::from(i / 32) / 16.0 - 1.0))
        .map(|(x, y)| Ray::new(DVec3::new(x, y, 3.0), glam::Vec3::NEG_Z))
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    let why = scene.state().closest(&rays, QueryOptions::default(), &mut hits).expect_err("blocks are gone");
    assert!(matches!(why, Error::Corrupt { .. } | Error::Io { .. }) && why.to_string().contains("a liar"), "{why}");
    let frame = Frame::new(&context, FrameOptions { width: 64, height: 48, ..Default::default() }).expect("a frame");
    let camera =
        Camera::Perspective { eye: DVec3::new(0.0, 0.1, 3.0), at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 40.0 };
    frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
    let status = frame.wait(Duration::from_secs(60));
    assert_eq!(status.state, FrameState::CompleteWithinBudget);
    assert!(status.pixels_missing > 0 && status.error.is_some(), "{status:?}");
}

#[test]
fn accuracies_that_are_none_are_refused() {
    let context = built::context(0);
    let model = Model::open_source(&context, honest()).expect("it opens");
    let frame = Frame::new(&context, FrameOptions { width: 8, height: 8, ..Default::default() }).expect("a frame");
    let scene = outcrop::scene::Scene::new(&context).state();
    let camera = model.views()[0];
    for poe in [f32::NAN, -1.0, -1e-30, f32::INFINITY, f32::NEG_INFINITY] {
        let settings = FrameSettings { poe, ..Default::default() };
        let refused = frame.request(&scene, &camera, &settings);
        assert!(matches!(refused, Err(Error::BadArgument(why)) if why.contains("poe")), "{poe}");
    }
    assert_eq!(frame.poll().state, FrameState::Idle);
}

#[test]
fn footprints_that_are_none_count_as_exact() {
    let context = built::context(2);
    let model = Model::open_source(&context, honest()).expect("it opens");
    let scene = outcrop::scene::Scene::new(&context);
    scene.add_instance(&model, 1, glam::DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    let ask = |cone: Cone, coherent: bool| {
        let ray = |i: i32| Ray {
            cone,
            ..Ray::new(
                DVec3::new(f64::from(i % 32) / 20.0 - 0.8, f64::from(i / 32) / 20.0 - 0.8, 3.0),
                glam::Vec3::NEG_Z,
            )
        };
        let rays: Vec<Ray> = (0..1024).map(ray).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.state().closest(&rays, QueryOptions { coherent, ..Default::default() }, &mut hits).expect("answers");
        hits
    };
    let lod = |hits: &[Hit]| hits.iter().filter(|hit| hit.kind == HitKind::Lod).count();
    for coherent in [false, true] {
        let exact = ask(Cone::ZERO, coherent);
        assert_eq!(lod(&exact), 0);
        assert!(lod(&ask(Cone { a: 0.05, b: 0.0 }, coherent)) > 100, "stand-ins are there to be hit");
        for (a, b) in [(f32::NAN, f32::NAN), (-1.0, 0.0), (0.0, -1.0), (f32::NEG_INFINITY, f32::NAN), (-1e30, -1e30)] {
            assert_eq!(ask(Cone { a, b }, coherent), exact, "{a} {b}");
        }
        // One that is fine beside one that is not.
        let wide = ask(Cone { a: 0.05, b: 0.0 }, coherent);
        assert_eq!(ask(Cone { a: 0.05, b: f32::NAN }, coherent), wide);
        // However wide: an answer.
        ask(Cone { a: f32::INFINITY, b: f32::INFINITY }, coherent);
    }
}
