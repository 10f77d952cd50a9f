//! Scenes of many placed trees: packets, streams and single walks find the same hits to the bit, whichever way the rays take through the top
//! tree, and a picture does not change because something is placed where no ray goes. (That each is right against brute force is
//! `tests/instances.rs`; rays of a batch once went alone in such scenes, at a fifth of their speed.)

mod common;

use common::built::{self, Built};
use common::rng::Rng;
use common::scenes;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::import::{MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Context, Light, LightKind, Model, Scene, SceneState, State};
use std::sync::Arc;
use std::time::Duration;

const OPTIONS: QueryOptions = QueryOptions { coherent: false, want: Want::ALL, policy: Policy::Exact };

/// A ball placed directly, and a bumpy ball of two parts and a cube, placed several times each in the model itself.
fn assembly() -> Built {
    built::build(|builder| {
        for id in 0..12 {
            builder.part(PartDesc { id: Some(100 + id), ..Default::default() }).expect("a part");
        }
        let ball: Vec<_> = scenes::sphere(12, 18).into_iter().map(|t| t.map(|v| v * 0.5)).collect();
        builder.triangles(MeshKey::DIRECT, 0, &ball, None).expect("triangles");
        let bumpy = builder.shared_mesh(2).expect("a mesh");
        let tris = scenes::bumpy_sphere(16, 24, 3);
        let (low, high) = tris.split_at(300);
        builder.triangles(bumpy, 0, low, None).expect("triangles");
        builder.triangles(bumpy, 1, high, None).expect("triangles");
        let cube = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(cube, 0, &scenes::cuboid(-DVec3::ONE, DVec3::ONE), None).expect("triangles");
        for (i, mesh) in [bumpy, cube, bumpy, cube].into_iter().enumerate() {
            let at = DVec3::new(i as f64 - 1.5, (i % 2) as f64, 0.3) * 1.2;
            let turn = if i == 0 { DQuat::IDENTITY } else { DQuat::from_rotation_y(i as f64) };
            builder.instance(mesh, DAffine3::from_scale_rotation_translation(DVec3::splat(0.4), turn, at), 1 + 2 * i as u32).expect("an instance");
        }
    })
}

/// `count` instances of `model`, some turned, some scaled, some on top of others, some that few rays see; one hidden, parts of others hidden or
/// recoloured.
fn forest(context: &Context, model: &Model, count: u64) -> Arc<SceneState> {
    let mut rng = Rng::new(count);
    let scene = Scene::new(context);
    let side = (count as f64).sqrt() * 2.0;
    for id in 0..count {
        let at = rng.inside(DVec3::new(-side, -side, -0.5), DVec3::new(side, side, 0.5));
        let turn = if rng.one_in(3) { DQuat::IDENTITY } else { DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0)) };
        let scale = if rng.one_in(4) { DVec3::new(1.0, -0.5, 2.0) } else { DVec3::ONE };
        scene.add_instance(model, id, DAffine3::from_scale_rotation_translation(scale, turn, at)).expect("an instance");
        if rng.one_in(5) {
            scene.set_instance_mask(id, 1 << rng.below(3)).expect("a mask");
        }
        if rng.one_in(6) {
            let state = State { visible: rng.one_in(2), colour: Some([1.0, 0.0, 0.0, 1.0]), ..State::default() };
            scene.set_part_state(id, 100 + rng.below(12) as u64, state).expect("a state");
        }
    }
    scene.set_instance_state(0, State { visible: false, ..State::default() }).expect("a state");
    scene.commit().expect("a commit");
    scene.state()
}

/// Rays as callers have them, in runs of 32: of neighbouring pixels, from neighbouring points to a light, and from anywhere to anywhere.
fn rays(seed: u64, side: f64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    let (low, high) = (DVec3::new(-side, -side, -1.0), DVec3::new(side, side, 1.0));
    let mut all = Vec::new();
    for run in 0..60 {
        let (eye, toward) = (rng.inside(low * 1.5 - DVec3::Z * 9.0, high * 1.5 + DVec3::Z * 9.0), rng.inside(low, high));
        for i in 0..32 {
            let pixel = DVec3::new(f64::from(i % 8), f64::from(i / 8), 0.0) * 0.02;
            let mut ray = match run % 3 {
                0 => Ray::new(eye, (toward - eye + pixel).as_vec3().normalize()),
                1 => Ray { t_max: 1.0, ..Ray::new(toward + pixel, (eye - toward).as_vec3()) },
                _ => Ray::new(rng.inside(low, high), rng.direction().as_vec3()),
            };
            if run % 5 == 4 {
                ray.mask = 1 + (i & 1);
            }
            all.push(ray);
        }
    }
    // What cannot be traced, and what begins nowhere or far away.
    all[3].dir = Vec3::ZERO;
    all[40].origin.x = f64::NAN;
    all[70].t_max = -1.0;
    all[100] = Ray::new(DVec3::new(1e6, 2e6, 3e6), Vec3::new(-1.0, -2.0, -3.0));
    all
}

fn closest(state: &SceneState, rays: &[Ray], options: QueryOptions) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(rays, options, &mut hits).expect("hits");
    hits
}

#[test]
fn all_ways_through_a_scene_find_the_same_hits() {
    let file = assembly();
    let context = built::context(1);
    let model = Model::open(&context, &file.path).expect("a model");
    let mut kinds = [0; 4];
    for count in [1, 2, 7, 60, 400] {
        let state = forest(&context, &model, count);
        for cone in [Cone::ZERO, Cone { a: 0.02, b: 0.02 }] {
            let mut rays = rays(count + 5, (count as f64).sqrt() * 2.0);
            rays.iter_mut().for_each(|ray| ray.cone = cone);
            let alone: Vec<Hit> = rays.iter().map(|ray| closest(&state, std::slice::from_ref(ray), OPTIONS)[0]).collect();
            for coherent in [false, true] {
                let options = QueryOptions { coherent, ..OPTIONS };
                let together = closest(&state, &rays, options);
                let differ = (0..rays.len()).find(|&i| alone[i] != together[i]);
                assert_eq!(differ.map(|i| (i, rays[i], alone[i], together[i])), None, "{count} instances, coherent: {coherent}, {cone:?}");
                let mut any = vec![2; rays.len()];
                state.any(&rays, options, &mut any).expect("answers");
                let differ = (0..rays.len()).find(|&i| u8::from(alone[i].kind != HitKind::Miss) != any[i]);
                assert_eq!(differ.map(|i| (i, rays[i], alone[i], any[i])), None, "any, {count} instances, coherent: {coherent}, {cone:?}");
            }
            alone.iter().for_each(|hit| kinds[hit.kind as usize] += 1);
        }
    }
    assert!(kinds[..3].iter().all(|&n| n > 500), "misses, exact hits, stand-ins: {kinds:?}");
}

/// Every buffer of a scene's picture.
fn picture(context: &Context, state: &Arc<SceneState>, poe: f32) -> Vec<Vec<u8>> {
    let options = FrameOptions { width: 96, height: 64, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).expect("a frame");
    let camera = Camera::Perspective { eye: DVec3::new(0.3, -5.0, 2.0), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    frame.request(state, &camera, &FrameSettings { poe, samples: 2, ..FrameSettings::default() }).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
    Buffer::ALL.iter().map(|&buffer| frame.map(buffer).expect("a buffer").bytes().to_vec()).collect()
}

/// What is placed where no ray goes changes no pixel, nor does the way that rays take: packets of one tree are rendered in vectors, those of several
/// ray by ray.
#[test]
fn a_picture_does_not_depend_on_what_it_does_not_show() {
    let file = assembly();
    let context = built::context(2);
    let model = Model::open(&context, &file.path).expect("a model");
    let headlight = Light { kind: LightKind::Headlight, colour: [1.0; 3], intensity: 0.6, shadows: false };
    let sun = Light { kind: LightKind::Directional(DVec3::new(0.3, 0.8, -1.0)), colour: [1.0, 0.9, 0.8], intensity: 0.5, shadows: true };
    for lights in [vec![headlight], vec![headlight, sun]] {
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::from_translation(DVec3::new(0.0, 0.4, -0.2))).expect("an instance");
        scene.set_lights(lights).expect("lights");
        scene.commit().expect("a commit");
        let expected = [0.0, 3.0].map(|poe| picture(&context, &scene.state(), poe));
        assert!(expected[0][0].chunks_exact(4).any(|pixel| pixel[3] == 255), "something is seen");
        for id in 2..40 {
            let (far, turn) = (DVec3::new(40.0 * id as f64, -60.0, 9.0), DQuat::from_rotation_z(id as f64));
            scene.add_instance(&model, id, DAffine3::from_rotation_translation(turn, far)).expect("an instance");
        }
        // And one in view that no camera's ray sees.
        scene.add_instance(&model, 99, DAffine3::from_translation(DVec3::new(0.1, -1.0, 0.0))).expect("an instance");
        scene.set_instance_state(99, State { visible: false, ..State::default() }).expect("a state");
        scene.commit().expect("a commit");
        for (poe, expected) in [0.0, 3.0].into_iter().zip(&expected) {
            let now = picture(&context, &scene.state(), poe);
            let differs: Vec<_> = Buffer::ALL.iter().zip(now.iter().zip(expected)).filter(|(_, (a, b))| a != b).map(|(b, _)| b).collect();
            assert!(differs.is_empty(), "at {poe} pixels of error: {differs:?}");
        }
    }
}
