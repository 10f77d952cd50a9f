//! Awkward rays with cones, so that stand-ins answer: no closed mesh is missed from inside, nothing is a NaN, nothing
//! hangs. Rays without cones are `tests/robust_rays.rs`.

use super::pictures::{POE, ways};
use crate::common::brute::Tri;
use crate::common::built::{self, Built, Part};
use crate::common::rng::Rng;
use crate::common::scenes;
use glam::{DVec3, Vec3};
use outcrop::build::BuildOptions;
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, QueryOptions};
use outcrop::scene::{Context, ContextOptions, SceneState};

const RAYS: usize = 4000;
/// A pixel, as a share of the distance: of 24 rows at 40 degrees, so that there are triangles smaller than pixels.
const PIXEL: f32 = 0.7 / 24.0;

fn sphere() -> Vec<Tri> {
    scenes::sphere(200, 400)
}

/// Faces in the planes that builders split at.
fn grid_box(n: usize) -> Vec<Tri> {
    let face = |k: usize, z: f64| {
        let turn = move |v: DVec3| DVec3::from(std::array::from_fn(|i| v[(i + k) % 3]));
        scenes::plane_grid(n, z).into_iter().map(move |t| t.map(turn).map(|v| v / (0.5 * n as f64) - 1.0))
    };
    (0..3).flat_map(|k| face(k, 0.0).chain(face(k, n as f64))).collect()
}

/// Along axes with both zeros, in planes, with components from denormal to huge, or anything.
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
    dir * [1.0, 1.0, 1e-3, 1e-12, 1e12][rng.below(5)]
}

/// A pixel's cone; the threshold is in it, as a factor of its width.
fn cone(dir: Vec3, poe: f32, parallel: bool) -> Cone {
    let width = PIXEL * poe.sqrt();
    if parallel { Cone { a: width, b: 0.0 } } else { Cone { a: 0.0, b: width * dir.as_dvec3().length() as f32 } }
}

/// From within 0.9 of the middle: at anything, at corners, edges and surfaces; or from the surface inward.
fn rays(tris: &[Tri], poe: f32) -> Vec<Ray> {
    let mut rng = Rng::new(31 + u64::from(poe.to_bits()));
    let ray = |_| {
        let target = tris[rng.below(tris.len())];
        let mut origin = rng.direction() * 0.9 * rng.unit();
        let dir = match rng.below(6) {
            0 => (target[0] - origin).as_vec3(),
            1 => ((target[0] + target[1]) * 0.5 - origin).as_vec3(),
            2 => {
                origin =
                    [target[0], (target[0] + target[1]) * 0.5, (target[0] + target[1] + target[2]) / 3.0][rng.below(3)];
                (rng.direction() * 0.9 * rng.unit() - origin).as_vec3()
            }
            3 => {
                origin = (origin * 32.0).round() / 32.0;
                direction(&mut rng)
            }
            _ => direction(&mut rng),
        };
        Ray { cone: cone(dir, poe, rng.one_in(3)), ..Ray::new(origin, dir) }
    };
    (0..RAYS).map(ray).collect()
}

fn ask(scene: &SceneState, rays: &[Ray], coherent: bool) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.closest(rays, QueryOptions { coherent, ..Default::default() }, &mut hits).expect("hits");
    hits
}

fn assert_sane(ray: &Ray, hit: &Hit) {
    let numbers = [f64::from(hit.error), hit.t_free, hit.normal.length().into(), hit.uv[0].into(), hit.uv[1].into()];
    assert!(!hit.t.is_nan() && numbers.iter().all(|x| !x.is_nan()) && !hit.position.is_nan(), "{ray:?}: {hit:?}");
    if hit.kind != HitKind::Miss {
        assert!(hit.t.is_finite() && hit.position.is_finite() && hit.error.is_finite(), "{ray:?}: {hit:?}");
        assert!(hit.t >= ray.t_min && hit.t <= ray.t_max, "{ray:?}: {hit:?}");
        assert!((hit.normal.length() - 1.0).abs() < 1e-4, "{ray:?}: {hit:?}");
    }
}

/// The same in every way, one answer of a kind.
fn in_all_ways(file: &Built, rays: &[Ray], mut check: impl FnMut(&Ray, &Hit)) -> usize {
    let mut truth: Option<Vec<Hit>> = None;
    for (threads, isa) in ways() {
        let options = ContextOptions { threads, isa: Some(isa), ..Default::default() };
        let context = Context::new(options).expect("a context");
        let (scene, _) = built::scene(&context, file);
        for coherent in [false, true] {
            let hits = ask(&scene.state(), rays, coherent);
            rays.iter().zip(&hits).for_each(|(ray, hit)| check(ray, hit));
            let differs = truth.get_or_insert_with(|| hits.clone()).iter().zip(&hits).position(|(a, b)| a != b);
            assert_eq!(
                differs.map(|i| (rays[i], hits[i])),
                None,
                "{threads} threads, {}, coherent {coherent}",
                isa.name()
            );
        }
    }
    truth.into_iter().flatten().filter(|hit| hit.kind == HitKind::Lod).count()
}

#[test]
fn no_cone_leaves_a_closed_mesh() {
    // In one piece, or in several chunks, which are built without knowing what is beside them.
    let whole = |tris: &[Tri]| built::parts(&[Part::white(1, tris.to_vec())]);
    let in_chunks = |tris: &[Tri]| {
        let options = BuildOptions { threads: 1, memory_budget: 32 << 20, ..Default::default() };
        let (file, report) = built::build_with(options, |builder| built::push(builder, &Part::white(1, tris.to_vec())));
        assert!(report.chunks > 2, "{} chunks", report.chunks);
        file
    };
    let fine_box = grid_box(128);
    let cases = [
        ("sphere", sphere(), whole(&sphere())),
        ("grid box", grid_box(64), whole(&grid_box(64))),
        ("sphere in chunks", sphere(), in_chunks(&sphere())),
        ("grid box in chunks", fine_box.clone(), in_chunks(&fine_box)),
    ];
    for (name, tris, file) in cases {
        for poe in POE {
            let stand_ins = in_all_ways(&file, &rays(&tris, poe), |ray, hit| {
                assert!(hit.kind != HitKind::Miss, "{name}, PoE {poe}: {ray:?} left");
                assert_sane(ray, hit);
            });
            println!("{name}, PoE {poe}: {stand_ins} of {RAYS} rays met stand-ins");
            assert!(poe < 3.0 || stand_ins * 4 > RAYS, "{name}, PoE {poe}: {stand_ins} stand-ins");
        }
    }
}

#[test]
fn impossible_cones_end_and_are_sane() {
    let widths = [0.0, -0.0, -1.0, f32::from_bits(1), 1e-20, 1e-3, 1.0, 1e20, f32::MAX, f32::INFINITY, f32::NAN];
    let mut rng = Rng::new(6);
    let ray = |_| {
        let cone = Cone { a: widths[rng.below(widths.len())], b: widths[rng.below(widths.len())] };
        let ends = [0.0, -1.0, 1e-300, 0.5, 1e300, f64::INFINITY];
        let (t_min, t_max) = (ends[rng.below(4)], ends[3 + rng.below(3)]);
        let origin = rng.direction() * [0.0, 0.5, 2.0, 1e6][rng.below(4)];
        Ray { cone, t_min, t_max, ..Ray::new(origin, direction(&mut rng)) }
    };
    let rays: Vec<Ray> = (0..RAYS).map(ray).collect();
    let file = built::parts(&[Part::white(1, scenes::sphere(60, 90))]);
    let stand_ins = in_all_ways(&file, &rays, |ray, hit| {
        let clamped = Ray { t_min: ray.t_min.max(0.0), ..*ray };
        assert_sane(&clamped, hit);
    });
    assert!(stand_ins > RAYS / 20, "{stand_ins}");
}
