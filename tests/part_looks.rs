//! States of parts and instances under stand-ins: what is hidden never shows, what looks otherwise keeps that look, and
//! a ray sees but the instances of its mask. The promise holds of what is visible.

use crate::common::brute::{Oracle, Ray64, Tri};
use crate::common::built::{self, Built, Part};
use crate::common::bvh64::Bvh64;
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DAffine3, DVec3};
use outcrop::import::MaterialDesc;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::render::{Buffer, Frame, FrameOptions, FrameSettings, FrameState, Outputs};
use outcrop::scene::{Camera, Context, ContextOptions, Look, Model, Scene, Scope};
use std::time::Duration;

/// Pixels of error at which cells stand in: those of a bvh go down to few triangles.
fn poe() -> [f32; 5] {
    built::sized([0.5, 3.0, 10.0, 32.0, 100.0], [100.0, 300.0, 1000.0, 3000.0, 10_000.0])
}
const SIZE: (u32, u32) = (160, 120);
/// Parts, more than a summary has bits.
const PARTS: u64 = 40;
const HIDDEN: [u64; 6] = [2, 3, 11, 17, 30, 39];
const GREEN: [u64; 3] = [5, 6, 21];
const SELECTED: [u64; 2] = [8, 25];

fn part_of(i: usize) -> u64 {
    // Some in large patches, some mixed with others triangle by triangle.
    let patch = (i / built::sized(700, 3000)) as u64;
    if patch.is_multiple_of(3) { (i as u64 * 7 + patch) % PARTS } else { patch % PARTS }
}

/// A bumpy sphere inside a larger one that has gaps where parts are hidden.
fn tris() -> Vec<(u64, Tri)> {
    let outer = scenes::bumpy_sphere(120, 180, 4);
    let inner = scenes::sphere(60, 90).into_iter().map(|t| t.map(|v| scenes::rounded(v * 0.55)));
    let outer = outer.into_iter().enumerate().map(|(i, t)| (part_of(i), t));
    outer.chain(inner.map(|t| (PARTS, t))).collect()
}

fn build(tris: &[(u64, Tri)]) -> Built {
    let grey = |v: f32| MaterialDesc { colour: [v; 3], ..built::WHITE };
    let part = |id: u64| Part {
        id,
        material: grey(0.2 + 0.6 * (id % 7) as f32 / 7.0),
        tris: tris.iter().filter(|t| t.0 == id).map(|t| t.1).collect(),
    };
    built::parts(&(0..=PARTS).map(part).collect::<Vec<_>>())
}

fn is_hidden(part: u64) -> bool {
    HIDDEN.contains(&part)
}

fn set_states(scene: &Scene, instance: u64) {
    let set = |part, state| scene.set_part_look(instance, part, state).expect("a state");
    HIDDEN.iter().for_each(|&p| set(p, Look { visible: false, ..Look::default() }));
    GREEN.iter().for_each(|&p| set(p, Look { colour: Some([0.0, 1.0, 0.0, 1.0]), ..Look::default() }));
    SELECTED.iter().for_each(|&p| set(p, Look { selected: true, ..Look::default() }));
}

fn rays(count: usize, poe: f32) -> Vec<Ray> {
    let mut rng = Rng::new(9);
    let ray = |_| {
        let from = rng.direction() * rng.between(0.1, 5.0);
        let dir = (rng.direction() * rng.between(0.0, 1.3) - from).as_vec3();
        let b = 0.7 / 300.0 * f64::from(poe).sqrt() * dir.as_dvec3().length();
        Ray { cone: Cone { a: 0.0, b: b as f32 }, ..Ray::new(from, dir) }
    };
    (0..count).map(ray).collect()
}

/// `hit` is of what is visible, and says nothing about it that is not so. What is missing may be of hidden parts only:
/// all that is known is that there are others.
fn judge(visible: &Bvh64, ray: &Ray, hit: &Hit) {
    if hit.kind == HitKind::Miss {
        return;
    }
    assert!(!is_hidden(hit.part), "a hidden part: {ray:?}: {hit:?}");
    if hit.kind == HitKind::Missing {
        return;
    }
    let stated = f64::from(hit.error);
    let truth = visible.distance(hit.position, stated * 1.5);
    assert!(truth <= stated, "what is visible is {truth} away, not {stated}: {ray:?}: {hit:?}");
}

fn ask(scene: &Scene, rays: &[Ray], policy: Policy) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    let options = QueryOptions { coherent: false, want: Want::ALL, policy };
    scene.state().closest(rays, options, &mut hits).expect("hits");
    hits
}

fn of_visible(tris: &[(u64, Tri)]) -> Bvh64 {
    Bvh64::new(tris.iter().filter(|t| !is_hidden(t.0)).map(|t| t.1).collect())
}

/// Misses: no visible surface is met well inside of its triangle.
fn assert_missed(visible: &Bvh64, ray: &Ray) {
    let wide = Ray64 { org: ray.origin, dir: ray.dir.as_dvec3(), t_min: ray.t_min, t_max: ray.t_max };
    let inside = |u: f64, v: f64| u > 1e-3 && v > 1e-3 && u + v < 1.0 - 1e-3;
    let met = visible.all(&wide, f64::INFINITY).into_iter().find(|hit| inside(hit.u, hit.v));
    assert_eq!(met, None, "missed: {ray:?}");
}

fn rays_meet_only_what_is_visible() {
    let tris = tris();
    let (built, visible) = (build(&tris), of_visible(&tris));
    // With all in memory, and with stand-ins for what is not.
    for (budget, policy) in [(0, Policy::Exact), (built::sized(4 << 20, 3 << 20), Policy::Now)] {
        let options = ContextOptions { threads: 2, memory_budget: budget, read_ahead: false, ..Default::default() };
        let context = Context::new(options).expect("a context");
        let (scene, _model) = built::scene(&context, &built);
        set_states(&scene, 7);
        scene.commit().expect("a commit");
        let mut kinds = [0; 4];
        for poe in poe() {
            let rays = rays(6000, poe);
            for (ray, hit) in rays.iter().zip(&ask(&scene, &rays, policy)) {
                kinds[hit.kind as usize] += 1;
                judge(&visible, ray, hit);
                if hit.kind == HitKind::Miss {
                    assert_missed(&visible, ray);
                }
            }
        }
        println!("{policy:?}: {kinds:?} misses, exact, lod, missing");
        let stand_in = if policy == Policy::Now { HitKind::Missing } else { HitKind::Lod };
        assert!(kinds[stand_in as usize] > 1000 && kinds[HitKind::Miss as usize] > 100, "{kinds:?}");
        assert_eq!(kinds[HitKind::Missing as usize] > 0, policy == Policy::Now, "{kinds:?}");
    }
}

struct Pixels {
    kind: Vec<u8>,
    part: Vec<u64>,
    colour: Vec<[f32; 3]>,
}

fn pixels(frame: &Frame) -> Pixels {
    let map = |buffer| frame.map(buffer).expect("a picture");
    Pixels {
        kind: map(Buffer::Kind).bytes().to_vec(),
        part: map(Buffer::Part).ids().expect("ids").to_vec(),
        colour: map(Buffer::ColourLinear).floats().expect("floats").chunks(4).map(|c| [c[0], c[1], c[2]]).collect(),
    }
}

/// In light from everywhere each part has one colour: that of its state.
fn parts_keep_their_looks_under_stand_ins() {
    let tris = tris();
    let built = build(&tris);
    let context = built::context(2);
    let (scene, model) = built::scene(&context, &built);
    assert!(model.load(&Default::default()).expect("it loads"));
    set_states(&scene, 7);
    scene.set_lights(vec![]).expect("no lights");
    scene.commit().expect("a commit");
    let options = FrameOptions { width: SIZE.0, height: SIZE.1, outputs: Outputs::ALL, ..Default::default() };
    let frame = Frame::new(&context, options).expect("a frame");
    let eye = DVec3::new(3.0, 4.0, 2.0);
    let camera = Camera::Perspective { eye, at: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 40.0 };
    let render = |poe| {
        let settings = FrameSettings { poe, ambient: 1.0, ..FrameSettings::default() };
        frame.request(&scene.state(), &camera, &settings).expect("a request");
        assert_eq!(frame.wait(Duration::from_secs(120)).state, FrameState::Converged);
        pixels(&frame)
    };
    let exact = render(0.0);
    let mut looks = vec![None; PARTS as usize + 1];
    for (part, colour) in exact.part.iter().zip(&exact.colour).filter(|(part, _)| **part <= PARTS) {
        assert!(!is_hidden(*part));
        assert!(looks[*part as usize].is_none_or(|c| c == *colour), "part {part} has two colours");
        looks[*part as usize] = Some(*colour);
    }
    let mut seen = [0; 3];
    for poe in poe() {
        let now = render(poe);
        for (i, &part) in now.part.iter().enumerate().filter(|(i, _)| now.kind[*i] == HitKind::Lod as u8) {
            let c = now.colour[i];
            let close = |a: &[f32; 3]| a.iter().zip(&c).all(|(a, c)| (a - c).abs() < 0.02);
            assert!(!is_hidden(part), "PoE {poe}, pixel {i} shows hidden part {part}");
            let own = looks[part as usize].as_ref();
            if GREEN.contains(&part) {
                assert_eq!(c, [0.0, 1.0, 0.0], "PoE {poe}, pixel {i}");
                seen[0] += 1;
            } else if SELECTED.contains(&part) {
                assert!(own.is_none_or(close), "PoE {poe}, pixel {i}: {c:?} {own:?}");
                seen[1] += 1;
            } else {
                // Mixed of grey ones, none of them touched.
                assert!((c[0] - c[1]).abs() < 0.02 && (c[1] - c[2]).abs() < 0.02, "PoE {poe}, pixel {i}: {c:?}");
                seen[2] += 1;
            }
        }
    }
    println!("stand-ins: {seen:?} recoloured, selected, others");
    assert!(seen.iter().all(|&n| n > 20), "{seen:?}");
}

fn stand_ins_of_masked_instances_are_seen_by_their_rays_only() {
    let tris = tris();
    let (built, visible) = (build(&tris), of_visible(&tris));
    let context = built::context(2);
    let model = Model::open(&context, &built.path).expect("a model");
    let scene = Scene::new(&context);
    // A larger one around the other, seen by other rays.
    for (id, mask, scale) in [(1, 1, 1.0), (2, 2, 1.5)] {
        scene.add_instance(&model, id, DAffine3::from_scale(DVec3::splat(scale))).expect("an instance");
        scene.set_instance_mask(id, mask).expect("a mask");
        set_states(&scene, id);
    }
    scene.commit().expect("a commit");
    let mut lod = [0; 4];
    for poe in poe() {
        for mask in [1, 2] {
            let rays: Vec<Ray> = rays(3000, poe).into_iter().map(|ray| Ray { mask, ..ray }).collect();
            for (ray, hit) in rays.iter().zip(&ask(&scene, &rays, Policy::Exact)) {
                assert!(hit.kind == HitKind::Miss || hit.instance == u64::from(mask), "{ray:?}: {hit:?}");
                lod[mask as usize] += usize::from(hit.kind == HitKind::Lod);
                if mask == 1 {
                    judge(&visible, ray, hit);
                }
            }
        }
        // Hidden altogether.
        let rays: Vec<Ray> = rays(500, poe).into_iter().map(|ray| Ray { mask: 4, ..ray }).collect();
        assert!(ask(&scene, &rays, Policy::Exact).iter().all(|hit| hit.kind == HitKind::Miss));
    }
    assert!(lod[1] > 200 && lod[2] > 50, "{lod:?}");
}

/// A part of opacity 0 looks as if it were hidden, but rays hit it; a hidden part is hit by no ray.
fn parts_of_opacity_zero_are_hit_and_hidden_ones_are_not() {
    let square = |z: f64| {
        let at = |x: f64, y: f64| DVec3::new(x, y, z);
        vec![[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0)], [at(-1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]]
    };
    let built = built::parts(&[Part::white(1, square(0.0)), Part::white(2, square(1.0))]);
    let context = built::context(1);
    let (scene, _model) = built::scene(&context, &built);
    let frame = Frame::new(&context, FrameOptions { width: 8, height: 8, ..FrameOptions::default() }).expect("a frame");
    let (eye, at) = (DVec3::new(0.1, 0.2, 5.0), DVec3::new(0.1, 0.2, 0.0));
    let camera = Camera::Perspective { eye, at, up: DVec3::Y, fov_y_degrees: 10.0 };
    let transparent = Look { colour: Some([1.0, 0.0, 0.0, 0.0]), ..Look::default() };
    let shown = |look: Look| {
        scene.set_part_look(7, 2, look).expect("a look");
        scene.commit().expect("a commit");
        frame.request(&scene.state(), &camera, &FrameSettings::default()).expect("a request");
        assert_eq!(frame.wait(Duration::MAX).state, FrameState::Converged);
        let colour = frame.map(Buffer::ColourSrgb8).expect("a picture").bytes()[..4].to_vec();
        (colour, frame.pick(4, 4).expect("a pick").part)
    };
    let (opaque, first) = shown(Look::default());
    let (through, second) = shown(transparent);
    let (without, third) = shown(Look { visible: false, ..Look::default() });
    assert_eq!((first, second, third), (2, 2, 1));
    assert!(through == without, "{through:?} {without:?} {opaque:?}");
}

/// Looks belong to the ids of parts: they survive a model that is built anew with its parts in another order. One call
/// takes as many looks as there are parts, and either all or none.
fn looks_survive_a_rebuild() {
    let square = |id: u64| {
        let at = |x: f64, y: f64| DVec3::new(2.0 * id as f64 + x, y, 0.0);
        vec![[at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)]]
    };
    let count = built::sized(100_000, 2000u64);
    let build = |ids: &mut dyn Iterator<Item = u64>| {
        built::parts(&ids.map(|id| Part::white(id, square(id))).collect::<Vec<_>>())
    };
    let (first, second) = (build(&mut (0..count)), build(&mut (1..count).rev()));
    let context = built::context(2);
    let (scene, _model) = built::scene(&context, &first);
    let seen = |id: u64| {
        let from = DVec3::new(2.0 * id as f64 + 0.25, 0.25, 5.0);
        let hit = ask(&scene, &[Ray::new(from, glam::Vec3::NEG_Z)], Policy::Exact)[0];
        (hit.kind != HitKind::Miss).then_some(hit.part)
    };
    let even: Vec<u64> = (0..count).step_by(2).collect();
    let hidden = Look { visible: false, ..Look::default() };
    let with_unknown: Vec<u64> = (0..=count).collect();
    scene.set_parts_look(7, &with_unknown, Scope::Own, hidden).expect_err("one part does not exist");
    scene.commit().expect("a commit");
    assert_eq!(seen(2), Some(2), "none is hidden");
    scene.set_parts_look(7, &even, Scope::Own, hidden).expect("looks");
    scene.commit().expect("a commit");
    let some = [0, 1, 2, 3, count / 2, count - 2, count - 1];
    let before = some.map(seen);
    assert_eq!(before[..4], [None, Some(1), None, Some(3)]);
    scene.set_model(7, &Model::open(&context, &second.path).expect("a model")).expect("exchanged");
    scene.commit().expect("a commit");
    assert_eq!(some.map(seen), before);
    scene.isolate_parts(7, &[2], Scope::Own).expect("one part");
    scene.commit().expect("a commit");
    assert_eq!(some.map(seen), [None, None, Some(2), None, None, None, None]);
}

built::on_each_structure!(
    looks_survive_a_rebuild,
    parts_of_opacity_zero_are_hit_and_hidden_ones_are_not,
    rays_meet_only_what_is_visible,
    parts_keep_their_looks_under_stand_ins,
    stand_ins_of_masked_instances_are_seen_by_their_rays_only,
);
