//! Model files that are wrong under right checksums: opened, asked in every way, and drawn. Each call ends with an
//! answer or an error about the file, the same on every instruction set, within the budget.

use super::base_models::NAME;
use super::builds::contexts;
use super::rng::Rng;
use super::{model_edits, within};
use arbitrary::Unstructured;
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::math::{Cone, DBounds, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::scene::{Context, Look, Model, Scene, SceneState};
use outcrop::store::MemorySource;
use outcrop::{Error, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const BUDGET: u64 = 24 << 20;
/// Bytes that may be held beyond the budget, with several contexts at a time.
const BEYOND: u64 = 64 << 20;
const LONG: Duration = Duration::from_secs(30);

/// The target.
pub fn run(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let Ok(Some(bytes)) = model_edits::edited(&mut u) else { return };
    let seed = u.arbitrary().unwrap_or(0);
    let bytes: Arc<[u8]> = bytes.into();
    let contexts = contexts(BUDGET);
    let most = contexts.len() as u64 * BUDGET + BEYOND + 4 * bytes.len() as u64;
    within(most, || {
        let rays = rays(seed);
        let mut first = None;
        for context in &contexts {
            let answers = open(context, &bytes).map(|opened| answers(&opened, &rays));
            let answers = answers.map_err(|e| about_the_file(&e));
            match &first {
                None => first = Some(answers),
                Some(first) => assert!(*first == answers, "another instruction set, another answer"),
            }
        }
        if let Some(context) = contexts.first()
            && let Ok(opened) = open(context, &bytes)
        {
            draw(context, &opened, seed);
        }
    });
    assert!(contexts.iter().all(|context| context.memory_used() == 0), "memory of models that are gone");
}

struct Opened {
    model: Model,
    state: Arc<SceneState>,
}

fn open(context: &Context, bytes: &Arc<[u8]>) -> outcrop::Result<Opened> {
    let model = Model::open_source(context, Arc::new(MemorySource::named(NAME, Arc::clone(bytes))))?;
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY)?;
    // The file may lack these parts.
    let _ = scene.set_part_look(7, 102, Look { visible: false, ..Look::default() });
    let _ = scene.set_part_look(7, 201, Look { colour: Some([1.0, 0.0, 0.0, 0.5]), ..Look::default() });
    scene.commit()?;
    Ok(Opened { model, state: scene.state() })
}

/// Panics if an error says anything but what is wrong with the file, or that the budget or the machine is too small.
fn about_the_file(error: &Error) {
    match error {
        Error::Corrupt { file, .. } | Error::NewerFormat { file, .. } => assert_eq!(file, Path::new(NAME), "{error}"),
        Error::OverBudget { need, have, .. } => assert!(need > have, "{error}"),
        Error::NoMemory { .. } | Error::BadArgument(_) => {}
        other => panic!("{other:?}"),
    }
}

/// To anywhere in and near the base models, some along axes, some wide.
fn rays(seed: u64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    let ray = |i: usize| {
        let from = DVec3::X * 1.5 + rng.direction() * 6.0;
        let to = rng.inside(DVec3::new(-1.0, -1.0, -1.0), DVec3::new(5.0, 1.0, 1.0));
        let mut ray = Ray::new(from, (to - from).as_vec3());
        if i % 5 == 4 {
            ray.dir = DVec3::AXES[rng.below(3)].as_vec3();
        }
        if i % 4 == 3 {
            ray.cone = Cone { a: 0.01, b: 0.02 };
        }
        ray
    };
    (0..36).map(ray).collect()
}

/// The answers of one instruction set; `None` for an error about the file.
fn answers(opened: &Opened, rays: &[Ray]) -> Vec<Option<Vec<u8>>> {
    let state = &opened.state;
    let mut all = Vec::new();
    let mut keep = |answer: outcrop::Result<Vec<u8>>| all.push(answer.map_err(|e| about_the_file(&e)).ok());
    for coherent in [false, true] {
        let mut hits = vec![Hit::MISS; rays.len()];
        let options = QueryOptions { coherent, want: Want::ALL | Want::SHADING_NORMAL, ..QueryOptions::default() };
        let answer = state.closest(rays, options, &mut hits);
        assert!(hits.iter().all(|hit| !hit.t.is_nan()), "NaN: {hits:?}");
        let normals = hits.iter().all(|hit| !hit.shading_normal.is_nan());
        assert!(normals || answer.is_err(), "NaN: {hits:?}");
        keep(answer.map(|()| format!("{hits:?}").into_bytes()));
        hits.retain(|hit| hit.kind == HitKind::Exact);
        keep(state.triangles(&hits, &Cancel::new()).map(|found| format!("{found:?}").into_bytes()));
        let mut any = vec![0; rays.len()];
        let answer = state.any(rays, options, &mut any);
        keep(answer.map(|()| any));
    }
    let parts = |found: Vec<outcrop::PartOverlap>| format!("{found:?}").into_bytes();
    keep(state.overlap_box(&DBounds { min: DVec3::splat(-0.5), max: DVec3::splat(0.5) }).map(parts));
    let mut text = String::new();
    let crossings = state.crossings(&rays, Policy::Exact, &mut |_, met, _| text += &format!("{met:?}"));
    keep(crossings.map(|()| text.into_bytes()));
    let points: Vec<DVec3> = rays.iter().map(|ray| ray.origin * 0.1).collect();
    let mut text = String::new();
    let inside = state.parts_at(&points, &mut |_, parts| text += &format!("{parts:?}"));
    keep(inside.map(|()| text.into_bytes()));
    keep(read_parts(&opened.model));
    keep(opened.model.check(&Cancel::new()).map(|()| Vec::new()));
    all
}

/// The triangles of the first parts.
fn read_parts(model: &Model) -> outcrop::Result<Vec<u8>> {
    let mut all = Vec::new();
    for part in 0..model.parts().len().min(8) {
        let mut reader = model.read_part(part as u32)?;
        loop {
            let some = reader.next(100, &Cancel::new())?;
            if some.is_empty() {
                break;
            }
            all.extend(some.iter().flat_map(|triangle| triangle.prim.to_le_bytes()));
        }
    }
    Ok(all)
}

/// Two pictures, one exact: each ends.
fn draw(context: &Context, opened: &Opened, seed: u64) {
    let options = FrameOptions { width: 16, height: 12, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).expect("a small frame");
    let camera = opened.model.views()[(seed % 4) as usize];
    for poe in [2.0, 0.0] {
        let settings = FrameSettings { poe, ..FrameSettings::default() };
        if let Err(error) = frame.request(&opened.state, &camera, &settings) {
            // Bounds of the file may be such that there is no view of them.
            return about_the_file(&error);
        }
        let status = frame.wait(LONG);
        assert_ne!(status.state, FrameState::Running, "it does not end: {status:?}");
        assert!(!status.fraction.is_nan() && !status.mean_error_px.is_nan(), "{status:?}");
        if let Some(error) = status.error {
            about_the_file(&error);
        }
        if let Err(error) = frame.pick(8, 6) {
            about_the_file(&error);
        }
    }
}
