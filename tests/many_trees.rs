//! Scenes of many placed trees: packets, streams and single walks find the same hits to the bit, whichever way the rays
//! take through the top tree, and a picture does not change because something is placed where no ray goes. (That each
//! is right against brute force is `tests/instances.rs`; rays of a batch once went alone in such scenes, at a fifth of
//! their speed.)

use crate::common::built::{self, Built, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Context, Light, LightKind, Look, Model, Scene, SceneState};
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
        builder.triangles(MeshKey::DIRECT, 0, &ball, Attributes::NONE).expect("triangles");
        let bumpy = builder.shared_mesh(2).expect("a mesh");
        let tris = scenes::bumpy_sphere(16, 24, 3);
        let (low, high) = tris.split_at(300);
        builder.triangles(bumpy, 0, low, Attributes::NONE).expect("triangles");
        builder.triangles(bumpy, 1, high, Attributes::NONE).expect("triangles");
        let cube = builder.shared_mesh(1).expect("a mesh");
        builder.triangles(cube, 0, &scenes::cuboid(-DVec3::ONE, DVec3::ONE), Attributes::NONE).expect("triangles");
        for (i, mesh) in [bumpy, cube, bumpy, cube].into_iter().enumerate() {
            let at = DVec3::new(i as f64 - 1.5, (i % 2) as f64, 0.3) * 1.2;
            let turn = if i == 0 { DQuat::IDENTITY } else { DQuat::from_rotation_y(i as f64) };
            builder
                .instance(
                    mesh,
                    DAffine3::from_scale_rotation_translation(DVec3::splat(0.4), turn, at),
                    1 + 2 * i as u32,
                )
                .expect("an instance");
        }
    })
}

/// `count` instances of `model`, some turned, some scaled, some in the very place of others, some that few rays see;
/// one hidden, parts of others hidden or recoloured.
fn forest(context: &Context, model: &Model, count: u64) -> Arc<SceneState> {
    let mut rng = Rng::new(count);
    let scene = Scene::new(context);
    let side = (count as f64).sqrt() * 2.0;
    let mut place = DAffine3::IDENTITY;
    for id in 0..count {
        if id == 0 || !rng.one_in(5) {
            let at = rng.inside(DVec3::new(-side, -side, -0.5), DVec3::new(side, side, 0.5));
            let turn = if rng.one_in(3) {
                DQuat::IDENTITY
            } else {
                DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0))
            };
            let scale = if rng.one_in(4) { DVec3::new(1.0, -0.5, 2.0) } else { DVec3::ONE };
            place = DAffine3::from_scale_rotation_translation(scale, turn, at);
        }
        scene.add_instance(model, id, place).expect("an instance");
        if rng.one_in(5) {
            scene.set_instance_mask(id, 1 << rng.below(3)).expect("a mask");
        }
        if rng.one_in(6) {
            let state = Look { visible: rng.one_in(2), colour: Some([1.0, 0.0, 0.0, 1.0]), ..Look::default() };
            scene.set_part_look(id, 100 + rng.below(12) as u64, state).expect("a state");
        }
    }
    scene.set_instance_look(0, Look { visible: false, ..Look::default() }).expect("a state");
    scene.commit().expect("a commit");
    scene.state()
}

/// Rays as callers have them, in runs of 32: of neighbouring pixels, from neighbouring points to a light, and from
/// anywhere to anywhere.
fn rays(seed: u64, side: f64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    let (low, high) = (DVec3::new(-side, -side, -1.0), DVec3::new(side, side, 1.0));
    let mut all = Vec::new();
    for run in 0..60 {
        let (eye, toward) =
            (rng.inside(low * 1.5 - DVec3::Z * 9.0, high * 1.5 + DVec3::Z * 9.0), rng.inside(low, high));
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
            if run % 4 == 3 && i % 3 == 0 {
                (ray.t_min, ray.t_max) = (ray.t_max.min(rng.between(0.0, 20.0)), ray.t_max.min(rng.between(5.0, 40.0)));
            }
            all.push(ray);
        }
    }
    // What cannot be traced, and what begins nowhere or far away.
    all[3].dir = Vec3::ZERO;
    all[40].origin.x = f64::NAN;
    all[70].t_max = -1.0;
    all[130].t_max = f64::NAN;
    all[135].t_min = f64::NAN;
    all[140].dir.y = f32::INFINITY;
    all[145].dir.z = f32::NAN;
    all[100] = Ray::new(DVec3::new(1e6, 2e6, 3e6), Vec3::new(-1.0, -2.0, -3.0));
    all
}

fn closest(state: &SceneState, rays: &[Ray], options: QueryOptions) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    state.closest(rays, options, &mut hits).expect("hits");
    hits
}

/// Of the first kind no ray has a width, of the second all have, of the third some.
fn with_widths(mut rays: Vec<Ray>, kind: usize) -> Vec<Ray> {
    let wide = Cone { a: 0.02, b: 0.02 };
    for (i, ray) in rays.iter_mut().enumerate() {
        ray.cone = if kind == 1 || kind == 2 && i % 7 < 3 { wide } else { Cone::ZERO };
    }
    rays
}

fn all_ways_through_a_scene_find_the_same_hits() {
    let file = assembly();
    let context = built::context(1);
    let model = Model::open(&context, &file.path).expect("a model");
    let mut kinds = [0; 4];
    for count in [1, 2, 7, 60, 400] {
        let state = forest(&context, &model, count);
        for kind in 0..3 {
            let rays = with_widths(rays(count + 5, (count as f64).sqrt() * 2.0), kind);
            all_ways_agree(&state, &rays).iter().for_each(|hit| kinds[hit.kind as usize] += 1);
        }
    }
    let most = built::sized(500, 200);
    assert!(kinds[..3].iter().all(|&n| n > most), "misses, exact hits, stand-ins: {kinds:?}");
}

/// Rays pass through several trees that lie in each other, and blocks come while they do: they go on where they were
/// put down, and find what they find where all is in memory.
fn blocks_come_while_rays_are_in_several_trees() {
    let rings = built::sized(120, 30);
    let file = built::parts(&[
        Part::white(1, scenes::bumpy_sphere(rings, 2 * rings, 4)),
        Part::white(2, scenes::sphere(rings, rings)),
    ]);
    let state = |context: &Context, model: &Model| {
        let (scene, mut rng) = (Scene::new(context), Rng::new(3));
        for id in 0..7 {
            let turn = DQuat::from_axis_angle(rng.direction(), rng.between(0.0, 3.0));
            let at = rng.inside(DVec3::splat(-0.7), DVec3::splat(0.7));
            scene.add_instance(model, id, DAffine3::from_rotation_translation(turn, at)).expect("an instance");
        }
        scene.commit().expect("a commit");
        scene.state()
    };
    let warm = built::context(1);
    let model = Model::open(&warm, &file.path).expect("a model");
    assert!(model.info().geometry_blocks > 10, "{} blocks", model.info().geometry_blocks);
    let warm = state(&warm, &model);
    for kind in 0..3 {
        let rays = with_widths(rays(11, 2.0), kind);
        let expected = closest(&warm, &rays, OPTIONS);
        for (coherent, threads) in [(false, 0), (true, 0), (false, 2), (true, 2)] {
            let context = built::context(threads);
            let cold = || state(&context, &Model::open_cold(&context, &file.path).expect("a model"));
            let options = QueryOptions { coherent, ..OPTIONS };
            let hits = closest(&cold(), &rays, options);
            let differ = (0..rays.len()).find(|&i| hits[i] != expected[i]);
            assert_eq!(
                differ.map(|i| (rays[i], hits[i], expected[i])),
                None,
                "coherent: {coherent}, {threads} threads, widths of kind {kind}"
            );
            let mut any = vec![2; rays.len()];
            cold().any(&rays, options, &mut any).expect("answers");
            assert!(
                any.iter().zip(&expected).all(|(any, hit)| *any == u8::from(hit.kind != HitKind::Miss)),
                "any, coherent: {coherent}"
            );
        }
    }
}

/// Closest and any hits of rays in batches, against those of each ray alone; returns the latter.
fn all_ways_agree(state: &SceneState, rays: &[Ray]) -> Vec<Hit> {
    let alone: Vec<Hit> = rays.iter().map(|ray| closest(state, std::slice::from_ref(ray), OPTIONS)[0]).collect();
    for coherent in [false, true] {
        let options = QueryOptions { coherent, ..OPTIONS };
        let together = closest(state, rays, options);
        let differ = (0..rays.len()).find(|&i| alone[i] != together[i]);
        assert_eq!(differ.map(|i| (i, rays[i], alone[i], together[i])), None, "coherent: {coherent}");
        let mut any = vec![2; rays.len()];
        state.any(rays, options, &mut any).expect("answers");
        let expected: Vec<u8> = alone.iter().map(|hit| u8::from(hit.kind != HitKind::Miss)).collect();
        assert_eq!(any, expected, "any, coherent: {coherent}");
    }
    alone
}

/// A ray that begins nowhere hits nothing, and takes no hit from the rays beside it in a batch.
#[test]
fn rays_that_begin_nowhere_leave_the_others_their_hits() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(1, scenes::cuboid(DVec3::ZERO, DVec3::new(3.0, 1.0, 1.0)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    for count in [1, 3] {
        let scene = Scene::new(&context);
        for id in 0..count {
            scene
                .add_instance(&model, id, DAffine3::from_translation(DVec3::Z * (9.0 * id as f64)))
                .expect("an instance");
        }
        scene.commit().expect("a commit");
        for nowhere in [0, 1, 15, 16, 31] {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut rays: Vec<Ray> =
                    (0..32).map(|i| Ray::new(DVec3::new(f64::from(i) + 0.5, 0.5, -10.0), Vec3::Z)).collect();
                rays[nowhere].origin.x = bad;
                let hits = all_ways_agree(&scene.state(), &rays);
                let expected = (0..32).filter(|&i| i < 3 && i != nowhere);
                assert!(
                    (0..32).filter(|&i| hits[i].kind == HitKind::Exact).eq(expected),
                    "{count} instances, {bad} at {nowhere}"
                );
            }
        }
    }
}

/// Instances whose distances grow by a factor: the top tree splits off one after the other, and is deeper than a group
/// of rays looks ahead.
#[test]
fn rays_find_their_way_through_a_deep_top_tree() {
    let context = built::context(1);
    let file = built::parts(&[Part::white(1, scenes::cuboid(DVec3::splat(-0.5), DVec3::splat(0.5)))]);
    let model = Model::open(&context, &file.path).expect("a model");
    let scene = Scene::new(&context);
    for id in 0..150 {
        scene
            .add_instance(&model, id, DAffine3::from_translation(DVec3::X * 17.0f64.powi(id as i32)))
            .expect("an instance");
    }
    scene.commit().expect("a commit");
    let along = |i: i32, from: f64, dir: Vec3| {
        Ray::new(DVec3::new(from, f64::from(i % 8 - 4) * 0.1, f64::from(i / 8 - 2) * 0.1), dir)
    };
    for (from, dir, t) in
        [(-10.0, Vec3::X, 10.5), (1e200, Vec3::NEG_X, f64::INFINITY), (6.0, Vec3::X, 10.5), (6.0, Vec3::NEG_X, 4.5)]
    {
        let rays: Vec<Ray> = (0..32).map(|i| along(i, from, dir)).collect();
        let hits = all_ways_agree(&scene.state(), &rays);
        assert!(t == f64::INFINITY || hits.iter().all(|hit| (hit.t - t).abs() < 1e-6), "from {from}: {:?}", hits[0]);
    }
    let camera =
        Camera::Perspective { eye: DVec3::new(-8.0, 0.0, 0.0), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 5.0 };
    for outputs in [Outputs::ALL, Outputs::of(Buffer::Instance)] {
        let frame = Frame::new(&context, FrameOptions { width: 56, height: 44, outputs, ..FrameOptions::default() })
            .expect("a frame");
        frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
        let instances = frame.map(Buffer::Instance).expect("a buffer");
        assert!(instances.ids().expect("ids").iter().all(|&id| id == 0), "the first fills the view");
    }
}

/// A turned instance shows the stand-ins of its model turned: normals turn, parts and colours stay.
#[test]
fn stand_ins_turn_with_their_instance() {
    let context = built::context(1);
    let file = assembly();
    let model = Model::open(&context, &file.path).expect("a model");
    let state = |turn: DQuat| {
        let scene = Scene::new(&context);
        scene.add_instance(&model, 1, DAffine3::from_quat(turn)).expect("an instance");
        scene.commit().expect("a commit");
        scene.state()
    };
    let turn = DQuat::from_axis_angle(DVec3::new(0.3, -0.5, 0.8).normalize(), 1.1);
    let (straight, turned) = (state(DQuat::IDENTITY), state(turn));
    let mut rng = Rng::new(7);
    let pairs: Vec<[Ray; 2]> = (0..4000)
        .map(|_| {
            let eye = rng.direction() * 6.0;
            let dir = (rng.inside(DVec3::splat(-1.0), DVec3::splat(1.0)) - eye).normalize();
            let ray =
                |turn: DQuat| Ray { cone: Cone { a: 0.0, b: 0.15 }, ..Ray::new(turn * eye, (turn * dir).as_vec3()) };
            [ray(DQuat::IDENTITY), ray(turn)]
        })
        .collect();
    let [a, b] = [(0, &straight), (1, &turned)]
        .map(|(side, state)| closest(state, &pairs.iter().map(|pair| pair[side]).collect::<Vec<_>>(), OPTIONS));
    let cells: Vec<_> = a
        .iter()
        .zip(&b)
        .filter(|(a, b)| a.kind == HitKind::Lod && b.kind == HitKind::Lod && (a.t - b.t).abs() < 1e-4)
        .collect();
    let alike = |(a, b): &&(&Hit, &Hit)| {
        a.part == b.part && ((turn * a.normal.as_dvec3()).as_vec3() - b.normal).length() < 2e-3
    };
    let count = cells.iter().filter(|pair| alike(pair)).count();
    // Rounded to another side of a border some rays meet another cell, or see another side of it.
    assert!(cells.len() > 500 && count * 50 > cells.len() * 49, "{count} of {}", cells.len());
}

/// Every buffer of a scene's picture.
fn picture(context: &Context, state: &Arc<SceneState>, poe: f32) -> Vec<Vec<u8>> {
    let options = FrameOptions { width: 96, height: 64, outputs: Outputs::ALL, ..FrameOptions::default() };
    let frame = Frame::new(context, options).expect("a frame");
    let camera =
        Camera::Perspective { eye: DVec3::new(0.3, -5.0, 2.0), at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    frame.request(state, &camera, &FrameSettings { poe, samples: 2, ..FrameSettings::default() }).expect("a request");
    assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
    Buffer::ALL.iter().map(|&buffer| frame.map(buffer).expect("a buffer").bytes().to_vec()).collect()
}

/// Two models side by side, again and again within each tile: packets that enter one tree are traced in bundles, a
/// bundle for each tree, and show to the bit the picture that is worked out surface by surface (asking for depths asks
/// for that).
#[test]
fn trees_alternate_within_a_tile() {
    let context = built::context(2);
    let balls = built::parts(&[Part::white(1, scenes::sphere(60, 120))]);
    let cubes = built::parts(&[
        Part::white(3, scenes::cuboid(-DVec3::ONE, DVec3::ONE)),
        Part::white(4, scenes::sphere(50, 40)),
    ]);
    let models = [balls, cubes].map(|file| Model::open(&context, &file.path).expect("a model"));
    let scene = Scene::new(&context);
    // Near enough that no ray is moved.
    for id in 0..9i32 {
        let at = DVec3::new(f64::from(id % 3) - 1.0, f64::from(id / 3) - 1.0, 0.0) * 3.0;
        scene.add_instance(&models[(id % 2) as usize], id as u64, DAffine3::from_translation(at)).expect("an instance");
    }
    scene.set_lights(vec![Light::HEADLIGHT]).expect("lights");
    scene.commit().expect("a commit");
    let camera = Camera::Perspective { eye: DVec3::Z * 5.0, at: DVec3::ZERO, up: DVec3::Y, fov_y_degrees: 120.0 };
    for poe in [0.0, 3.0, 300.0] {
        let [plain, all] =
            [Outputs::of(Buffer::ColourLinear) | Outputs::of(Buffer::Instance), Outputs::ALL].map(|outputs| {
                let frame =
                    Frame::new(&context, FrameOptions { width: 256, height: 192, outputs, ..FrameOptions::default() })
                        .expect("a frame");
                frame
                    .request(&scene.state(), &camera, &FrameSettings { poe, ..FrameSettings::default() })
                    .expect("a request");
                assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
                [Buffer::ColourLinear, Buffer::Instance]
                    .map(|buffer| frame.map(buffer).expect("a buffer").bytes().to_vec())
            });
        assert!(plain == all, "at {poe} pixels of error");
    }
}

/// What is placed where no ray goes changes no pixel, nor does the way that rays take: packets of one tree are rendered
/// in bundles, those of several surface by surface.
#[test]
fn a_picture_does_not_depend_on_what_it_does_not_show() {
    let file = assembly();
    let context = built::context(2);
    let model = Model::open(&context, &file.path).expect("a model");
    let headlight = Light { kind: LightKind::Headlight, colour: [1.0; 3], intensity: 0.6, shadows: false };
    let sun = Light {
        kind: LightKind::Directional(DVec3::new(0.3, 0.8, -1.0)),
        colour: [1.0, 0.9, 0.8],
        intensity: 0.5,
        shadows: true,
    };
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
        scene.set_instance_look(99, Look { visible: false, ..Look::default() }).expect("a state");
        scene.commit().expect("a commit");
        for (poe, expected) in [0.0, 3.0].into_iter().zip(&expected) {
            let now = picture(&context, &scene.state(), poe);
            let differs: Vec<_> =
                Buffer::ALL.iter().zip(now.iter().zip(expected)).filter(|(_, (a, b))| a != b).map(|(b, _)| b).collect();
            assert!(differs.is_empty(), "at {poe} pixels of error: {differs:?}");
        }
    }
}

built::on_each_structure!(all_ways_through_a_scene_find_the_same_hits, blocks_come_while_rays_are_in_several_trees);
