//! Rays that tracers stumble over: along axes, in split planes, through corners and along edges, from surfaces, with
//! zero, denormal, huge and infinite components. No closed mesh is missed from inside, nothing is a NaN, nothing hangs.

use crate::common::brute::Tri;
use crate::common::built::{self, Built, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DVec3, Vec3};
use outcrop::base::progress::Cancel;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::math::Ray;
use outcrop::query::{Hit, HitKind, QueryOptions};
use outcrop::scene::SceneState;
use std::sync::Arc;

const RAYS: usize = 60_000;

/// A closed mesh, and a ball inside it.
struct Closed {
    name: &'static str,
    file: Built,
    tris: Vec<Tri>,
    inside: (DVec3, f64),
}

fn sphere() -> Closed {
    let tris = scenes::sphere(64, 128);
    Closed { name: "sphere", file: built::parts(&[Part::white(1, tris.clone())]), tris, inside: (DVec3::ZERO, 0.9) }
}

/// Faces in the planes that builders split at; every edge and corner on small integers.
fn grid_box() -> Closed {
    let n = 16;
    let face = |k: usize, z: f64| {
        let turn = move |v: DVec3| DVec3::from(std::array::from_fn(|i| v[(i + k) % 3]));
        scenes::plane_grid(n, z).into_iter().map(move |t| t.map(turn))
    };
    let tris: Vec<Tri> = (0..3).flat_map(|k| face(k, 0.0).chain(face(k, n as f64))).collect();
    Closed {
        name: "grid box",
        file: built::parts(&[Part::white(1, tris.clone())]),
        tris,
        inside: (DVec3::splat(n as f64 / 2.0), n as f64 / 2.0 - 0.5),
    }
}

fn mandelbulb() -> Closed {
    let file = built::build(|builder| {
        let options = GenerateOptions { triangles: 60_000, seed: 0, ..Default::default() };
        generate("mandelbulb", &options, &Cancel::new(), builder).expect("a mandelbulb");
    });
    let tris = crate::common::stored::trees(&file.path).swap_remove(0);
    let tris: Vec<Tri> = tris.tris.iter().map(|t| t.2.map(|v| v + tris.origin)).collect();
    Closed { name: "mandelbulb", file, tris, inside: (DVec3::ZERO, 0.2) }
}

/// Directions of every kind: anything, along axes with both zeros, in planes, with components from denormal to huge.
fn direction(rng: &mut Rng) -> Vec3 {
    let small = [0.0, -0.0, f32::from_bits(1), -1e-42, f32::MIN_POSITIVE, 1e-30, -1e-18, 1e-9, 1e-4];
    let mut dir = rng.direction().as_vec3();
    for k in 0..3 {
        if rng.one_in(2) {
            dir[k] = small[rng.below(small.len())];
        }
    }
    if dir.abs().max_element() < 0.01 {
        dir[rng.below(3)] = if rng.one_in(2) { 1.0 } else { -1.0 };
    }
    // Length is but the unit of t.
    dir * [1.0, 1.0, 1e-3, 1e-20, 1e-35, 1e20, 1e37][rng.below(7)]
}

fn rays_from_inside(closed: &Closed, seed: u64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    let (middle, radius) = closed.inside;
    (0..RAYS)
        .map(|_| {
            let mut origin = match rng.below(4) {
                0 => middle,
                1 => (middle + rng.direction() * radius).round(),
                _ => middle + rng.direction() * radius * rng.unit(),
            };
            if (origin - middle).length() > radius {
                origin = middle;
            }
            let target = closed.tris[rng.below(closed.tris.len())];
            let dir = match rng.below(4) {
                0 => (target[0] - origin).as_vec3(),
                1 => ((target[0] + target[1]) * 0.5 - origin).as_vec3(),
                _ => direction(&mut rng),
            };
            Ray::new(origin, dir)
        })
        .collect()
}

fn ask(scene: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.closest(rays, QueryOptions { coherent, ..Default::default() }, &mut hits).expect("hits");
    hits
}

fn assert_sane(ray: &Ray, hit: &Hit) {
    let numbers = [f64::from(hit.error), hit.t_free, hit.normal.length().into(), hit.uv[0].into(), hit.uv[1].into()];
    let sane = !hit.t.is_nan() && hit.t >= ray.t_min && numbers.iter().all(|x| !x.is_nan());
    assert!(sane && !hit.position.is_nan(), "{ray:?}: {hit:?}");
    if hit.kind != HitKind::Miss {
        assert!(hit.t.is_finite() && hit.position.is_finite() && hit.error.is_finite(), "{ray:?}: {hit:?}");
        assert!((hit.normal.length() - 1.0).abs() < 1e-5, "{ray:?}: {hit:?}");
    }
}

#[test]
fn no_ray_leaves_a_closed_mesh() {
    let context = built::context(2);
    for closed in [sphere(), grid_box(), mandelbulb()] {
        let (scene, _) = built::scene(&context, &closed.file);
        let rays = rays_from_inside(&closed, 3);
        let state = scene.state();
        for coherent in [false, true] {
            let hits = ask(&state, &rays, coherent);
            for (ray, hit) in rays.iter().zip(&hits) {
                assert!(hit.kind == HitKind::Exact, "{}: {ray:?} left", closed.name);
                assert_sane(ray, hit);
            }
        }
        let mut any = vec![0u8; rays.len()];
        state.any(&rays, QueryOptions::default(), &mut any).expect("answers");
        let left = any.iter().position(|&a| a == 0);
        assert_eq!(left.map(|i| rays[i]), None, "{}: left, any hit", closed.name);
    }
}

#[test]
fn rays_from_surfaces_go_in_and_stay_in() {
    let context = built::context(2);
    // Convex: from any point of the surface, any way inward meets the other side (or, at 0, the surface itself).
    for closed in [sphere(), grid_box()] {
        let (scene, _) = built::scene(&context, &closed.file);
        let mut rng = Rng::new(9);
        let rays: Vec<Ray> = (0..RAYS)
            .map(|_| {
                let t = closed.tris[rng.below(closed.tris.len())];
                let origin = match rng.below(3) {
                    0 => t[0],
                    1 => (t[0] + t[1]) * 0.5,
                    _ => (t[0] + t[1] + t[2]) / 3.0,
                };
                let (middle, radius) = closed.inside;
                let to = middle + rng.direction() * radius * rng.unit();
                Ray { t_min: [0.0, f64::MIN_POSITIVE, 1e-6][rng.below(3)], ..Ray::new(origin, (to - origin).as_vec3()) }
            })
            .collect();
        for coherent in [false, true] {
            for (ray, hit) in rays.iter().zip(ask(&scene.state(), &rays, coherent)) {
                assert!(hit.kind == HitKind::Exact, "{}: {ray:?} left", closed.name);
                assert_sane(ray, &hit);
            }
        }
    }
}

#[test]
fn impossible_and_extreme_rays_end_and_are_sane() {
    let context = built::context(2);
    let closed = sphere();
    let (scene, _) = built::scene(&context, &closed.file);
    let values = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::from_bits(1),
        f32::MIN_POSITIVE,
        1e-20,
        1e20,
        f32::MAX,
        -f32::MAX,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    let ends = [0.0, -0.0, 1e-300, 0.5, 1e300, f64::MAX, f64::INFINITY, f64::NAN, -1.0, f64::NEG_INFINITY];
    let origins = [0.0, 2.0, 1e-310, -1e30, 1e300, f64::MAX, f64::INFINITY, f64::NAN];
    let mut rng = Rng::new(4);
    let mut pick = |n: usize| rng.below(n);
    let rays: Vec<Ray> = (0..RAYS)
        .map(|_| {
            let dir = Vec3::from_array(std::array::from_fn(|_| values[pick(values.len())]));
            let origin = DVec3::from_array(std::array::from_fn(|_| {
                origins[if pick(3) > 0 { pick(2) } else { pick(origins.len()) }]
            }));
            Ray { t_min: ends[pick(ends.len())], t_max: ends[pick(ends.len())], ..Ray::new(origin, dir) }
        })
        .collect();
    for coherent in [false, true] {
        for (ray, hit) in rays.iter().zip(ask(&scene.state(), &rays, coherent)) {
            let impossible = !ray.dir.is_finite()
                || !ray.dir.to_array().iter().any(|c| c.is_normal())
                || !ray.origin.is_finite()
                || ray.t_min.is_nan()
                || ray.t_max.is_nan()
                || ray.t_min > ray.t_max;
            if impossible {
                assert!(hit == Hit::MISS, "{ray:?}: {hit:?}");
            } else if hit.kind != HitKind::Miss {
                assert!(hit.t.is_finite() && hit.t >= ray.t_min.max(0.0) && hit.t <= ray.t_max, "{ray:?}: {hit:?}");
                assert!(hit.position.is_finite() && !hit.error.is_nan() && !hit.normal.is_nan(), "{ray:?}: {hit:?}");
            }
        }
    }
}

#[test]
fn denormals_count_as_zero() {
    let context = built::context(1);
    let closed = sphere();
    let (scene, _) = built::scene(&context, &closed.file);
    let of = |dir: Vec3| ask(&scene.state(), &[Ray::new(DVec3::ZERO, dir)], false)[0];
    assert_eq!(of(Vec3::new(1e-40, 0.0, 1.0)), of(Vec3::Z));
    assert_eq!(of(Vec3::new(1e-40, -1e-39, f32::from_bits(1))), Hit::MISS, "no direction at all");
    assert_eq!(of(Vec3::X * f32::MIN_POSITIVE).kind, HitKind::Exact);
}

#[test]
fn neighbouring_rays_of_a_closed_mesh_do_not_leave_in_packets_either() {
    let context = built::context(0);
    let closed = Arc::new(grid_box());
    let (scene, _) = built::scene(&context, &closed.file);
    // A fan in the plane of an edge, one float step from ray to ray: all pass exactly through or beside it.
    let mut rays = Vec::new();
    for k in 0..3 {
        for steps in -2000i32..2000 {
            let mut dir = Vec3::ZERO;
            dir[k] = 1.0;
            dir[(k + 1) % 3] = f32::from_bits(0.25f32.to_bits().wrapping_add_signed(steps));
            rays.push(Ray::new(DVec3::splat(8.0), dir));
            dir[(k + 2) % 3] = dir[(k + 1) % 3];
            rays.push(Ray::new(DVec3::splat(8.0), -dir));
        }
    }
    for coherent in [false, true] {
        let hits = ask(&scene.state(), &rays, coherent);
        for (ray, hit) in rays.iter().zip(&hits) {
            assert!(hit.kind == HitKind::Exact, "{ray:?} left");
            assert!((hit.t - 8.0).abs() < 1e-5, "{ray:?}: {hit:?}");
        }
    }
}
