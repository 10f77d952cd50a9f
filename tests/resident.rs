//! The form for exact rays: the same answers as the blocks to the bit, inside the budget, and gone when room is needed.

use crate::common::built::{self, Part, WHITE};
use crate::common::frames::{self, all_bytes};
use crate::common::rays::RayMaker;
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::base::progress::Cancel;
use outcrop::import::MaterialDesc;
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions, Want};
use outcrop::render::{FrameSettings, FrameState};
use outcrop::scene::{Context, ContextOptions, Look, Model, Scene};
use outcrop::simd::Isa;
use std::path::Path;
use std::time::{Duration, Instant};

fn context(compact: bool, isa: Isa, memory_budget: u64) -> Context {
    let options = ContextOptions { threads: 0, compact, isa: Some(isa), memory_budget, ..Default::default() };
    Context::new(options).expect("a context")
}

/// A model that is in memory as a whole, with its form unless the context is compact.
fn open(context: &Context, path: &Path, compact: bool) -> Model {
    let model = Model::open(context, path).expect("a model");
    assert!(model.load(&Cancel::new()).expect("a load"));
    while context.step() {}
    assert_eq!(model.memory().resident_form > 0, !compact);
    model
}

fn scene(model: &Model, places: &[DAffine3]) -> Scene {
    let scene = Scene::new(model.context());
    for (place, id) in places.iter().zip(1..) {
        scene.add_instance(model, id, *place).expect("an instance");
    }
    scene.commit().expect("a commit");
    scene
}

type Bits = (u64, [u32; 2], u64, [u32; 6], u64, u64, [u64; 3]);

fn bits(hit: &Hit) -> Bits {
    let (n, s) = (hit.normal, hit.shading_normal);
    let normals = [n.x, n.y, n.z, s.x, s.y, s.z].map(f32::to_bits);
    let position = hit.position.to_array().map(f64::to_bits);
    (hit.t.to_bits(), hit.uv.map(f32::to_bits), hit.prim, normals, hit.part, hit.instance, position)
}

/// Rays of all kinds; those of one origin that go through a grid; and those that end at a light.
fn rays(soup: &[[DVec3; 3]], count: usize, seed: u64) -> [Vec<Ray>; 3] {
    let to_ray = |ray: &crate::common::rays::Ray32| Ray {
        t_min: f64::from(ray.t_min),
        t_max: f64::from(ray.t_max),
        ..Ray::new(ray.org.as_dvec3(), ray.dir)
    };
    let mixed: Vec<Ray> = RayMaker::new(soup, seed).batch(count).iter().map(to_ray).collect();
    let around = soup.iter().flatten();
    let (min, max) = around.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)));
    let (middle, size) = ((min + max) / 2.0, (max - min).length());
    let eye = middle + DVec3::new(0.3, 0.5, 0.8) * size;
    let (right, up) = (DVec3::Y.cross(middle - eye).normalize(), DVec3::Y);
    let side = (count as f64).sqrt() as usize;
    let at = |i: usize| (i as f64 / side as f64 - 0.5) * size;
    let target = |i: usize| middle + right * at(i % side) + up * at(i / side);
    let camera = (0..side * side).map(|i| Ray::new(eye, (target(i) - eye).as_vec3())).collect();
    let light = middle + DVec3::new(-0.2, 1.1, 0.4) * size;
    let segments = (0..count).map(|i| {
        let from = soup[i * 7919 % soup.len()].iter().sum::<DVec3>() / 3.0;
        Ray { t_min: 1e-6, t_max: 1.0, ..Ray::new(from, (light - from).as_vec3()) }
    });
    [mixed, camera, segments.collect()]
}

/// Compares all calls on two scenes.
fn assert_same(name: &str, [one, other]: [&Scene; 2], batches: &[Vec<Ray>; 3]) {
    let states = [one.state(), other.state()];
    for (kind, rays) in batches.iter().enumerate() {
        for coherent in [false, true] {
            let options = QueryOptions { coherent, want: Want::ALL | Want::SHADING_NORMAL, ..Default::default() };
            let [ours, blocks] = [&states[0], &states[1]].map(|state| {
                let (mut hits, mut met) = (vec![Hit::MISS; rays.len()], vec![0; rays.len()]);
                state.closest(rays, options, &mut hits).expect("hits");
                state.any(rays, options, &mut met).expect("hits");
                (hits, met)
            });
            let met = blocks.0.iter().filter(|hit| hit.t < f64::INFINITY).count();
            // The camera looks past thin models.
            assert!(kind != 0 || met > rays.len() / 20, "{name} {kind} {met}");
            for (i, ray) in rays.iter().enumerate() {
                let at = || format!("{name} {kind} {coherent} {i}: {ray:?}\n{:?}\n{:?}", ours.0[i], blocks.0[i]);
                assert_eq!(bits(&ours.0[i]), bits(&blocks.0[i]), "{}", at());
                assert_eq!(ours.1[i], blocks.1[i], "{}", at());
            }
        }
        // One ray in each call.
        let options = QueryOptions { want: Want::ALL, ..Default::default() };
        for ray in rays.iter().step_by(17) {
            let [ours, blocks] = [&states[0], &states[1]].map(|state| {
                let (mut hit, mut met) = ([Hit::MISS], [0]);
                state.closest(std::slice::from_ref(ray), options, &mut hit).expect("a hit");
                state.any(std::slice::from_ref(ray), options, &mut met).expect("a hit");
                (hit[0], met[0])
            });
            assert_eq!((bits(&ours.0), ours.1), (bits(&blocks.0), blocks.1), "{name} {kind}: {ray:?}");
        }
    }
}

#[test]
fn hits_are_those_of_the_blocks() {
    let count = built::sized(20_000, 300);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        for soup in scenes::five() {
            let file = built::parts(&[Part::white(1, soup.tris.clone())]);
            let models = [false, true].map(|compact| open(&context(compact, isa, 0), &file.path, compact));
            let places = [DAffine3::IDENTITY];
            let [one, other] = [&models[0], &models[1]].map(|model| scene(model, &places));
            let name = format!("{}, {}", soup.name, isa.name());
            assert_same(&name, [&one, &other], &rays(&soup.tris, count, 11));
            // Half of the size on a real model: at most 70 bytes for each triangle.
            let (info, memory) = (models[0].info(), models[0].memory());
            assert!(info.triangles_stored < 1000 || memory.resident_form <= 90 * info.triangles_stored, "{name}");
        }
    }
}

/// Several parts in a leaf, some hidden; turned, mirrored and scaled instances.
#[test]
fn hidden_parts_and_placed_models() {
    let soup = scenes::boxes(built::sized(900, 30), 5);
    let parts: Vec<Part> = soup.chunks(3).zip(1..).map(|(tris, id)| Part::white(id, tris.to_vec())).collect();
    let file = built::parts(&parts);
    let turned = DAffine3::from_scale_rotation_translation(
        DVec3::new(0.5, -0.7, 1.2),
        glam::DQuat::from_rotation_y(0.6),
        DVec3::new(0.3, 0.1, -0.4),
    );
    let scenes = [false, true].map(|compact| {
        let model = open(&context(compact, Isa::best(), 0), &file.path, compact);
        let scene = scene(&model, &[DAffine3::IDENTITY, turned]);
        for part in (1..=parts.len() as u64).step_by(3) {
            scene.set_part_look(1, part, Look { visible: false, ..Look::default() }).expect("a look");
        }
        scene.commit().expect("a commit");
        scene
    });
    assert_same("hidden", [&scenes[0], &scenes[1]], &rays(&soup, built::sized(20_000, 200), 3));
}

/// Pictures are equal to the byte: with shadows, transparent parts, several instances, exact and with stand-ins.
#[test]
fn pictures_are_those_of_the_blocks() {
    let scenes = [false, true].map(|compact| {
        let options = ContextOptions { threads: 1, compact, ..Default::default() };
        let context = Context::new(options).expect("a context");
        let rings = built::sized(120, 20);
        let mut parts = vec![Part::white(5, scenes::sphere(rings, 2 * rings))];
        parts.push(Part::white(6, scenes::boxes(built::sized(300, 10), 3)));
        parts.push(Part { id: 8, material: MaterialDesc { opacity: 0.5, ..WHITE }, tris: scenes::plane_grid(4, -1.0) });
        let file = built::parts(&parts);
        let model = Model::open(&context, &file.path).expect("a model");
        if !compact {
            wait_for_form(&model);
        }
        let turned = DAffine3::from_rotation_z(0.5) * DAffine3::from_translation(DVec3::new(2.0, 1.0, -1.0));
        (scene(&model, &[DAffine3::IDENTITY, turned]), file)
    });
    for poe in [0.0, 2.0] {
        let bytes = [&scenes[0].0, &scenes[1].0].map(|scene| {
            let frame = frames::frame(scene.context(), 96, 64);
            let camera = frames::perspective(DVec3::new(3.0, 2.0, 5.0), DVec3::ZERO);
            let settings = FrameSettings { poe, samples: 2, ..Default::default() };
            frame.request(&scene.state(), &camera, &settings).expect("a request");
            assert_eq!(frame.wait(frames::LONG).state, FrameState::Converged);
            all_bytes(&frame)
        });
        assert!(bytes[0] == bytes[1], "{poe}");
    }
}

fn wait_for_form(model: &Model) {
    let begun = Instant::now();
    while model.memory().resident_form == 0 {
        assert!(begun.elapsed() < Duration::from_secs(60), "no form");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// The form counts in the budget, is not made where it does not fit, and goes when another model needs the room.
#[test]
fn the_form_keeps_to_the_budget() {
    let ball = || built::parts(&[Part::white(1, scenes::bumpy_sphere(300, 400, 5))]);
    let (first, second) = (ball(), ball());
    let free = context(false, Isa::best(), 0);
    let model = open(&free, &first.path, false);
    let (form, used) = (model.memory().resident_form, free.memory_used());
    let compact = context(true, Isa::best(), 0);
    let without = open(&compact, &first.path, true);
    assert!(used >= compact.memory_used() + form, "{used} {form}");
    let rays = &rays(&scenes::bumpy_sphere(300, 400, 5), 5000, 3);
    let place = [DAffine3::IDENTITY];

    // Between the need of the compact and of the resident form.
    let blocks = compact.memory_used();
    let tight = context(false, Isa::best(), blocks * 5 / 4 + (4 << 20) + form / 2);
    let model = Model::open(&tight, &first.path).expect("a model");
    assert!(model.load(&Cancel::new()).expect("a load"));
    while tight.step() {}
    assert_eq!(model.memory().resident_form, 0);
    assert!(!model.make_resident().expect("an answer"));
    assert_same("tight", [&scene(&model, &place), &scene(&without, &place)], rays);

    // Room for both models and one form, then for both models alone: the form gives way.
    let budget = blocks * 2 + form + form / 4 + (16 << 20);
    let shared = context(false, Isa::best(), budget);
    let one = open(&shared, &first.path, false);
    let held = scene(&one, &place);
    assert_same("before", [&held, &scene(&without, &place)], rays);
    let mut others = Vec::new();
    for _ in 0..4 {
        let other = Model::open(&shared, &second.path).expect("a model");
        let _ = other.load(&Cancel::new()).expect("a load");
        others.push(other);
        assert!(shared.memory_used() <= budget);
        assert_same("while", [&held, &scene(&without, &place)], rays);
    }
    let forms: u64 = others.iter().chain([&one]).map(|model| model.memory().resident_form).sum();
    assert!(forms < form * 3, "{forms} {form}");
    drop((others, held));
    drop(one);
}

/// A model may go while its form is made, and a form that lacks a block is not made.
#[test]
fn models_go_and_blocks_lack() {
    let file = built::parts(&[Part::white(1, scenes::bumpy_sphere(60, 90, 5))]);
    let context = built::context(2);
    for _ in 0..50 {
        drop(Model::open(&context, &file.path).expect("a model"));
    }
    let begun = Instant::now();
    while context.memory_used() > 0 {
        assert!(begun.elapsed() < Duration::from_secs(60), "{}", context.memory_used());
        std::thread::sleep(Duration::from_millis(1));
    }
    let cold = Model::open_cold(&context, &file.path).expect("a model");
    assert!(!cold.make_resident().expect("an answer"));
    assert_eq!(cold.memory().resident_form, 0);
}
