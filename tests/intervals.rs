//! The ends of rays' intervals, held in double precision: layer after layer is peeled off with the next number behind
//! each hit, and what each interval holds is found again by brute force, whatever way the rays go.

use crate::common::asked::ask;
use crate::common::brute::{Ray64, Tri, meet_line};
use crate::common::built::{self, Part};
use crate::common::rng::Rng;
use glam::{DAffine3, DQuat, DVec3, Vec3};
use outcrop::Error;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, Policy, QueryOptions, Want};
use outcrop::scene::{Context, ContextOptions, Model, Scene, SceneState};
use std::sync::Arc;

/// Coordinates are multiples of this: they stay as they are on their way into the model.
const GRID: f64 = 1.0 / 1024.0;

fn soup(count: usize, seed: u64) -> Vec<Tri> {
    let mut rng = Rng::new(seed);
    let mut corner =
        |around: DVec3, far: f64| ((around + rng.inside(DVec3::splat(-far), DVec3::splat(far))) / GRID).round() * GRID;
    (0..count)
        .map(|_| {
            let around = corner(DVec3::ZERO, 1.0);
            [0; 3].map(|_| corner(around, 0.8))
        })
        .collect()
}

/// Of each ray all distances at which it meets something, in order; `None` where it passes an edge so closely, meets a
/// triangle so nearly edge-on, or two so near to each other, that single precision may tell otherwise.
fn layers(ray: &Ray, tris: &[Tri]) -> Option<Vec<f64>> {
    let wide = Ray64::new(ray.origin, ray.dir.as_dvec3());
    let mut all = Vec::new();
    for tri in tris {
        let normal = (tri[1] - tri[0]).cross(tri[2] - tri[0]);
        let cosine = normal.dot(wide.dir).abs() / (normal.length() * wide.dir.length());
        let t = normal.dot(tri[0] - wide.org) / normal.dot(wide.dir);
        let at = wide.at(t);
        let depth = (0..3).map(|i| {
            let (a, b) = (tri[i], tri[(i + 1) % 3]);
            (b - a).cross(at - a).dot(normal) / ((b - a).length() * normal.length())
        });
        let depth = depth.fold(f64::INFINITY, f64::min);
        if t > 0.0 && depth.abs() < 1e-4 || cosine < 0.08 && depth > -1e-3 {
            return None;
        }
        all.extend(meet_line(&wide, tri).filter(|(t, ..)| *t >= 0.0).map(|(t, ..)| t));
    }
    all.sort_by(f64::total_cmp);
    let are_apart =
        all.windows(2).all(|two| two[1] - two[0] > 1e-4 * two[1].max(1.0)) && all.first().is_none_or(|&t| t > 1e-4);
    are_apart.then_some(all)
}

/// Peels rays all together: what each finds, one after the other.
fn peel(state: &Arc<SceneState>, rays: &[Ray], options: QueryOptions, at_once: usize) -> Vec<Vec<Hit>> {
    let mut left: Vec<Ray> = rays.to_vec();
    let mut found = vec![Vec::<Hit>::new(); rays.len()];
    for _ in 0..200 {
        let hits: Vec<Hit> = left.chunks(at_once).flat_map(|rays| ask(state, rays, options)).collect();
        let mut any = vec![2u8; left.len()];
        state.any(&left, options, &mut any).unwrap();
        for (i, hit) in hits.iter().enumerate() {
            assert!(
                hit.kind == HitKind::Miss || hit.t >= left[i].t_min,
                "{} before {}, {:?}",
                hit.t,
                left[i].t_min,
                rays[i]
            );
            if options.want == Want::ALL {
                assert_eq!(any[i] == 1, hit.kind != HitKind::Miss, "any, from {}, {:?}", left[i].t_min, rays[i]);
            }
            if hit.kind == HitKind::Miss {
                left[i].t_max = -1.0;
            } else {
                found[i].push(*hit);
                left[i].t_min = hit.t.next_up();
            }
        }
        if hits.iter().all(|hit| hit.kind == HitKind::Miss) {
            return found;
        }
    }
    panic!("does not end");
}

/// Rays in an octant from a point, those of neighbouring pixels side by side; then such as have nothing in common.
fn rays(seed: u64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    let mut rays: Vec<Ray> = (0..256)
        .map(|i| {
            Ray::new(
                DVec3::new(-1.5, -1.4, 3.0),
                Vec3::new(0.3 + (i % 16) as f32 * 0.01, 0.3 + (i / 16) as f32 * 0.01, -1.0),
            )
        })
        .collect();
    rays.extend((0..256).map(|_| {
        let from = rng.direction() * rng.between(0.0, 5.0);
        Ray::new(from, ((rng.direction() - from) * rng.between(0.2, 4.0)).as_vec3())
    }));
    rays
}

fn scene(context: &Context, model: &Model, transforms: &[DAffine3]) -> Scene {
    let scene = Scene::new(context);
    for (id, transform) in transforms.iter().enumerate() {
        scene.add_instance(model, id as u64, *transform).unwrap();
    }
    scene.commit().unwrap();
    scene
}

const ALL: QueryOptions = QueryOptions { coherent: false, want: Want::ALL, policy: Policy::Exact };

fn what_is_behind_a_hit_is_found_from_the_next_number_on() {
    let tris = soup(300, 5);
    let file = built::parts(&[Part::white(1, tris.clone())]);
    let context = built::context(1);
    let model = Model::open(&context, &file.path).unwrap();
    let far = DVec3::new(3e7, -5e7, 2e7);
    let turn = DAffine3::from_scale_rotation_translation(
        DVec3::new(1.0, 0.5, 2.0),
        DQuat::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 1.1),
        DVec3::new(0.25, 0.5, 0.0),
    );
    let one = [DAffine3::IDENTITY];
    let several = [turn, DAffine3::from_translation(DVec3::new(0.0, 0.0, 1.5))];
    for (name, transforms, origin) in [
        ("one", &one[..], DVec3::ZERO),
        ("turned", &[turn], DVec3::ZERO),
        ("far", &[DAffine3::from_translation(far)], far),
        ("several", &several, DVec3::ZERO),
    ] {
        let scene = scene(&context, &model, transforms);
        let state = scene.state();
        let world: Vec<Tri> =
            transforms.iter().flat_map(|m| tris.iter().map(move |tri| tri.map(|v| m.transform_point3(v)))).collect();
        let mut rays = rays(6);
        rays.iter_mut().for_each(|ray| ray.origin += origin);
        let expected: Vec<_> = rays.iter().map(|ray| layers(ray, &world)).collect();
        let (certain, met) =
            (expected.iter().flatten().count(), expected.iter().flatten().map(Vec::len).sum::<usize>());
        assert!(certain > 150 && met > 5 * certain, "{name}: {certain} rays, {met} hits");
        for (at_once, coherent) in [(rays.len(), false), (rays.len(), true), (1, false), (7, false)] {
            for want in [Want::ALL, Want::POSITION, Want::NORMAL | Want::UV, Want::NOTHING] {
                let found = peel(&state, &rays, QueryOptions { want, coherent, ..ALL }, at_once);
                for ((ray, found), expected) in rays.iter().zip(&found).zip(&expected) {
                    let Some(expected) = expected else { continue };
                    let t: Vec<f64> = found.iter().map(|hit| hit.t).collect();
                    assert_eq!(t.len(), expected.len(), "{name}, {want:?}: {t:?} for {expected:?} of {ray:?}");
                    // Single precision, or rounding of the world's coordinates.
                    let most = if want.has(Want::POSITION) { 1e-12 + origin.length() * 1e-15 } else { 1e-4 };
                    for (a, b) in t.iter().zip(expected) {
                        assert!((a - b).abs() <= most * (1.0 + b), "{name}, {want:?}: {a} for {b} of {ray:?}");
                    }
                }
            }
        }
        // Each end alone, to the last digit, is within.
        let found = peel(&state, &rays, ALL, rays.len());
        for ((ray, found), expected) in rays.iter().zip(&found).zip(&expected) {
            if expected.is_none() {
                continue;
            }
            for (i, hit) in found.iter().enumerate() {
                let before = if i > 0 { found[i - 1].t.next_up() } else { 0.0 };
                let ends = [
                    (hit.t, hit.t, true),
                    (before, hit.t, true),
                    (hit.t, f64::INFINITY, true),
                    (before, hit.t.next_down(), false),
                ];
                let rays = ends.map(|(t_min, t_max, _)| Ray { t_min, t_max, ..*ray });
                let mut any = [2; 4];
                state.any(&rays, ALL, &mut any).unwrap();
                for (k, got) in ask(&state, &rays, ALL).into_iter().enumerate() {
                    let wanted = if ends[k].2 { (hit.t, hit.prim, 1) } else { (f64::INFINITY, Hit::MISS.prim, 0) };
                    assert_eq!((got.t, got.prim, any[k]), wanted, "{name}, {:?} of {ray:?}", ends[k]);
                }
            }
        }
    }
}

/// Cells that stand in are passed too: then what they hold is met.
fn stand_ins_are_peeled_off_too() {
    let file = built::parts(&[
        Part::white(1, crate::common::scenes::sphere(100, 200)),
        Part::white(2, crate::common::scenes::boxes(2000, 4)),
    ]);
    let context = built::context(1);
    let (scene, _) = built::scene(&context, &file);
    let cone = built::sized(Cone { a: 0.002, b: 0.01 }, Cone { a: 0.02, b: 0.1 });
    let rays: Vec<Ray> = rays(8).into_iter().map(|ray| Ray { cone, ..ray }).collect();
    let mut kinds = [0; 4];
    for at_once in [rays.len(), 1] {
        for hits in peel(&scene.state(), &rays, ALL, at_once) {
            hits.iter().for_each(|hit| kinds[hit.kind as usize] += 1);
        }
    }
    let [_, exact, cells, _] = kinds;
    assert!(exact > 100 && cells > 500, "{kinds:?}");
}

/// With the least memory that a model of many blocks opens in, blocks of which a walk needs more than it may hold come
/// one after the other: the answers are those of the model that is in memory as a whole, whatever the rays' widths and
/// the lengths of their directions.
fn what_is_peeled_off_does_not_depend_on_memory() {
    let (rings, boxes) = built::sized((150, 3000), (40, 300));
    let file = built::parts(&[
        Part::white(1, crate::common::scenes::sphere(rings, 2 * rings)),
        Part::white(2, crate::common::scenes::boxes(boxes, 4)),
    ]);
    let context_of = |memory_budget| {
        Context::new(ContextOptions { threads: 2, memory_budget, read_ahead: false, ..ContextOptions::default() })
            .unwrap()
    };
    let Err(Error::OverBudget { need, .. }) = Model::open(&context_of(4096), &file.path).map(drop) else {
        panic!("a page does not do")
    };
    let (tight, wide) = (context_of(need), context_of(0));
    let [tight, wide] = [&tight, &wide].map(|context| built::scene(context, &file));
    let long = [0.004, 0.7, 1.0, 1000.0];
    let rays: Vec<Ray> = rays(9)
        .into_iter()
        .enumerate()
        .map(|(i, ray)| {
            let wide = if i % 2 == 0 { Cone { a: 0.002, b: 0.01 } } else { Cone::ZERO };
            let long = long[i / 2 % 4];
            Ray { dir: ray.dir * long, cone: Cone { a: wide.a, b: wide.b * long }, ..ray }
        })
        .collect();
    let expected = peel(&wide.0.state(), &rays, ALL, rays.len());
    assert!(expected.iter().map(Vec::len).sum::<usize>() > 1000);
    for at_once in [rays.len(), 40, 1] {
        let found = peel(&tight.0.state(), &rays, ALL, at_once);
        let differ = (0..rays.len()).find(|&i| found[i] != expected[i]);
        assert_eq!(differ.map(|i| (rays[i], &found[i], &expected[i])), None, "{at_once} at a time");
    }
    // Without waiting, nothing outside is given either.
    let options = QueryOptions { policy: Policy::Now, ..ALL };
    for (hits, ray) in expected.iter().zip(&rays) {
        for hit in hits.iter().take(3) {
            let (t_min, t_max) = (hit.t * 0.9, hit.t.next_down());
            let got = ask(&tight.0.state(), &[Ray { t_min, t_max, ..*ray }], options)[0];
            assert!(
                got.kind == HitKind::Miss || (t_min..=t_max).contains(&got.t),
                "{got:?}, {t_min} to {t_max}, {ray:?}"
            );
        }
    }
}

built::on_each_structure!(
    what_is_behind_a_hit_is_found_from_the_next_number_on,
    stand_ins_are_peeled_off_too,
    what_is_peeled_off_does_not_depend_on_memory,
);
