//! The oracle is held to closed forms, and its tree to brute force.

use crate::common::brute::{Brute, Hit64, Oracle, Ray64, Tri, meet};
use crate::common::bvh64::Bvh64;
use crate::common::errors::{Answer, Graze, Judge, Summary, Verdict, Wrong};
use crate::common::rays::{Ray32, RayKind, RayMaker};
use crate::common::rng::Rng;
use crate::common::rounding::{Rounding, Seen, point_distance};
use crate::common::scenes;
use glam::DVec3;
use proptest::prelude::*;

fn ray(org: [f64; 3], dir: [f64; 3]) -> Ray64 {
    Ray64::new(DVec3::from(org), DVec3::from(dir))
}

#[test]
fn sphere_distances_lie_between_the_sphere_and_its_sagitta() {
    let (rings, segments) = (40, 80);
    let oracle = Bvh64::new(scenes::sphere(rings, segments));
    // Every triangle spans at most pi/40 of a great circle each way: half the diagonal's angle bounds the sagitta.
    let half = std::f64::consts::PI / rings as f64 * std::f64::consts::SQRT_2 / 2.0;
    let sagitta = 1.0 - half.cos() + 1e-6;
    let mut rng = Rng::new(1);
    for _ in 0..20_000 {
        let from = rng.direction() * 3.0;
        let hit = oracle.closest(&Ray64::new(from, -from)).expect("towards the middle");
        let t = hit.t * 3.0;
        assert!(t >= 2.0 - 1e-6 && t <= 2.0 + sagitta, "{t}");
        let out = oracle.closest(&Ray64::new(DVec3::ZERO, from)).expect("from the middle");
        assert!((out.t * 3.0 - (3.0 - t)).abs() < 2.0 * sagitta);
    }
}

#[test]
fn a_ray_through_a_box_meets_two_faces_where_the_slabs_say() {
    let (min, max) = (DVec3::new(-1.0, -2.0, -3.0), DVec3::new(1.0, 2.0, 3.0));
    let oracle = Brute::new(scenes::cuboid(min, max));
    let mut rng = Rng::new(2);
    for _ in 0..20_000 {
        let org = rng.direction() * 10.0;
        let dir = rng.inside(min, max) - org;
        let (near, far) = (0..3).fold((f64::NEG_INFINITY, f64::INFINITY), |(n, f), k| {
            let (a, b) = ((min[k] - org[k]) / dir[k], (max[k] - org[k]) / dir[k]);
            (n.max(a.min(b)), f.min(a.max(b)))
        });
        let hits = oracle.all(&Ray64::new(org, dir), f64::INFINITY);
        assert!((hits[0].t - near).abs() < 1e-12 && (hits[hits.len() - 1].t - far).abs() < 1e-12);
    }
}

#[test]
fn plane_grids_answer_with_the_cell_below() {
    let n = 16;
    let oracle = Brute::new(scenes::plane_grid(n, 4.0));
    // In the middle of a triangle, on a diagonal, on an edge, on a corner, outside.
    let at = |x: f64, y: f64| oracle.closest_tied(&ray([x, y, 0.0], [0.0, -0.0, 2.0]), 0.0);
    let (hit, tied) = at(3.75, 5.25).expect("inside");
    assert_eq!((hit.t, hit.prim, tied.len()), (2.0, 2 * (5 * 16 + 3), 1));
    assert_eq!((hit.u, hit.v), (0.5, 0.25));
    assert_eq!(at(3.5, 5.5).expect("diagonal").1.len(), 2);
    assert_eq!(at(3.5, 5.0).expect("edge").1.len(), 2);
    let (hit, tied) = at(3.0, 5.0).expect("corner");
    assert_eq!((hit.prim, tied.len()), (2 * (4 * 16 + 2), 6));
    assert!(at(-0.001, 3.0).is_none());
    assert!(oracle.closest(&ray([-1.0, 3.0, 4.0], [1.0, 0.0, 0.0])).is_none(), "in the plane");
}

#[test]
fn range_and_sides() {
    let tri: Tri = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let mut r = ray([0.25, 0.25, 1.0], [0.0, 0.0, -1.0]);
    assert_eq!(meet(&r, &tri, 7), Some(Hit64 { t: 1.0, u: 0.25, v: 0.25, prim: 7 }));
    assert!(meet(&r, &[tri[0], tri[2], tri[1]], 7).is_some(), "two-sided");
    (r.t_min, r.t_max) = (1.0, 1.0);
    assert!(meet(&r, &tri, 7).is_some(), "ends count");
    r.t_min = 1.0 + 1e-15;
    assert!(meet(&r, &tri, 7).is_none());
}

#[test]
fn depth_and_distances_have_closed_forms() {
    let tri: Tri = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
    let depth = |x: f64, y: f64| Seen::new(&ray([x, y, 9.0], [0.0, 0.0, -1e-20]), &tri).depth();
    assert!((depth(1.0, 0.5) - 0.5).abs() < 1e-15);
    assert!((depth(-1.0, -1.0) + 2f64.sqrt()).abs() < 1e-15);
    assert!((depth(2.0, -0.25) + 0.25).abs() < 1e-15);
    assert!((depth(3.0, 3.0) + 2f64.sqrt()).abs() < 1e-15);
    assert!((point_distance(DVec3::new(1.0, 1.0, 3.0), &tri) - 3.0).abs() < 1e-15);
    assert!((point_distance(DVec3::new(-3.0, 0.0, 4.0), &tri) - 5.0).abs() < 1e-15);
}

fn judged(tris: Vec<Tri>, r: &Ray64, got: Option<Answer>) -> Verdict {
    let oracle = Brute::new(tris);
    Judge::new(&oracle, Rounding::NONE).closest(r, oracle.closest(r), got).verdict
}

#[test]
fn the_judge_tells_apart_what_it_should() {
    let grid = || scenes::plane_grid(4, 4.0);
    let inside = ray([1.75, 1.25, 0.0], [0.0, 0.0, 1.0]);
    let prim = 2 * (4 + 1);
    assert_eq!(judged(grid(), &inside, Some(Answer::new(4.0, prim))), Verdict::Same);
    assert_eq!(judged(grid(), &inside, Some(Answer::new(4.0, prim + 1))), Verdict::Wrong(Wrong::Phantom));
    assert_eq!(judged(grid(), &inside, Some(Answer::new(4.0001, prim))), Verdict::Wrong(Wrong::Distance));
    assert_eq!(judged(grid(), &inside, Some(Answer::new(f64::NAN, prim))), Verdict::Wrong(Wrong::Distance));
    assert_eq!(judged(grid(), &inside, None), Verdict::Wrong(Wrong::Lost));
    assert_eq!(judged(grid(), &inside, Some(Answer::new(4.0, 999))), Verdict::Wrong(Wrong::NoSuchPrim));
    // On an inner edge and on an inner corner: either side, but never through.
    for (x, y) in [(1.5, 1.5), (1.5, 1.0), (1.0, 1.0), (1.0 + 1e-9, 1.5)] {
        let r = ray([x, y, 0.0], [0.0, 0.0, 1.0]);
        assert_eq!(judged(grid(), &r, None), Verdict::Wrong(Wrong::Crack), "{x} {y}");
    }
    let r = ray([1.5, 1.5, 0.0], [0.0, 0.0, 1.0]);
    assert_eq!(judged(grid(), &r, Some(Answer::new(4.0, prim + 1))), Verdict::Tied);
    // The border may go either way.
    let r = ray([1e-9, 1.5, 0.0], [0.0, 0.0, 1.0]);
    assert_eq!(judged(grid(), &r, None), Verdict::Grazing(Graze::OpenEdge));
    let r = ray([-1e-9, 1.5, 0.0], [0.0, 0.0, 1.0]);
    assert_eq!(judged(grid(), &r, Some(Answer::new(4.0, 9))), Verdict::Grazing(Graze::Outside));
    // The silhouette of a closed box may; its face may not.
    let cube = || scenes::cuboid(DVec3::ZERO, DVec3::ONE);
    let r = ray([1e-9, 0.3, -2.0], [0.0, 0.0, 1.0]);
    assert_eq!(judged(cube(), &r, None), Verdict::Grazing(Graze::Silhouette));
    let r = ray([0.3, 0.3, -2.0], [0.0, 0.0, 1.0]);
    assert_eq!(judged(cube(), &r, None), Verdict::Wrong(Wrong::Crack), "on the diagonal of both faces");
}

#[test]
fn the_lowest_twin_wins() {
    let tris = [scenes::plane_grid(1, 1.0), scenes::plane_grid(1, 1.0)].concat();
    let r = ray([0.75, 0.25, 0.0], [0.0, 0.0, 1.0]);
    assert_eq!(judged(tris.clone(), &r, Some(Answer::new(1.0, 0))), Verdict::Same);
    assert_eq!(judged(tris, &r, Some(Answer::new(1.0, 2))), Verdict::Wrong(Wrong::HigherTwin));
}

#[test]
fn the_tree_agrees_with_brute_force_on_real_shapes() {
    for (tris, seed) in [(scenes::bumpy_sphere(30, 40, 5), 1), (scenes::blocks(8, 2), 2), (scenes::boxes(100, 3), 3)] {
        let (brute, tree) = (Brute::new(tris.clone()), Bvh64::new(tris.clone()));
        for r in RayMaker::new(&tris, seed).batch(10_000) {
            let r64 = r.wide();
            assert_eq!(brute.closest(&r64), tree.closest(&r64), "{r:?}");
            assert_eq!(brute.any(&r64), tree.any(&r64), "{r:?}");
        }
    }
}

#[test]
fn every_kind_of_ray_is_usable_and_seeded() {
    let tris = scenes::blocks(6, 1);
    let rays = RayMaker::new(&tris, 9).batch(5_000);
    assert_eq!(rays, RayMaker::new(&tris, 9).batch(5_000));
    let oracle = Bvh64::new(tris);
    for kind in RayKind::ALL {
        let mut of_kind = rays.iter().filter(|r| r.kind == kind);
        assert!(of_kind.clone().all(|r| r.dir.is_finite() && r.dir != glam::Vec3::ZERO && r.org.is_finite()));
        assert!(of_kind.any(|r| oracle.any(&r.wide())), "no {kind:?} ray hits");
    }
    let minus = |r: &&Ray32| r.dir.to_array().iter().any(|c| *c == 0.0 && c.is_sign_negative());
    assert!(rays.iter().filter(minus).count() > 100);
    assert!(rays.iter().any(|r| r.dir.to_array().iter().any(|c| c.is_subnormal())));
}

/// The watertight test in f32, plainly: the bounds of `rounding` are held to what they are derived from.
///
/// `leaky`: what lies on an edge is outside, a classic mistake.
fn single_precision(r: &Ray32, tri: &Tri, leaky: bool) -> Option<f32> {
    let k = r.dir.abs().max_position();
    let (kx, ky) = ((k + 1) % 3, (k + 2) % 3);
    let (sx, sy, sz) = (r.dir[kx] / r.dir[k], r.dir[ky] / r.dir[k], 1.0 / r.dir[k]);
    let [a, b, c] = tri.map(|v| v.as_vec3() - r.org);
    let flat = |v: glam::Vec3| (v[kx] - sx * v[k], v[ky] - sy * v[k], sz * v[k]);
    let (a, b, c) = (flat(a), flat(b), flat(c));
    let edge = |p: (f32, f32, f32), q: (f32, f32, f32)| p.0 * q.1 - p.1 * q.0;
    let (mut u, mut v, mut w) = (edge(c, b), edge(a, c), edge(b, a));
    if u == 0.0 || v == 0.0 || w == 0.0 {
        let wide = |p: (f32, f32, f32), q: (f32, f32, f32)| {
            (f64::from(p.0) * f64::from(q.1) - f64::from(p.1) * f64::from(q.0)) as f32
        };
        (u, v, w) = (wide(c, b), wide(a, c), wide(b, a));
    }
    if leaky && (u == 0.0 || v == 0.0 || w == 0.0) {
        return None;
    }
    let det = u + v + w;
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) || det == 0.0 {
        return None;
    }
    let t = (u * a.2 + v * b.2 + w * c.2) / det;
    (t >= r.t_min && t <= r.t_max).then_some(t)
}

fn judge_single_precision(tris: &[Tri], leaky: bool) -> Summary {
    let oracle = Bvh64::new(tris.to_vec());
    let judge = Judge::new(&oracle, Rounding::NONE);
    let mut summary = Summary::default();
    for r in RayMaker::new(tris, 4).batch(20_000) {
        let best = (0u32..)
            .zip(tris)
            .filter_map(|(i, tri)| single_precision(&r, tri, leaky).map(|t| (t, i)))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let got = best.map(|(t, prim)| Answer::new(f64::from(t), prim));
        let truth = oracle.closest(&r.wide());
        let ruling = judge.closest(&r.wide(), truth, got);
        summary.add(r.kind.name(), &ruling, || format!("{r:?}: {got:?}, oracle {truth:?}"));
        let any = judge.any(&r.wide(), truth.is_some(), best.is_some());
        summary.add_verdict("any", any, || format!("{r:?}: {got:?}, oracle {truth:?}"));
    }
    summary
}

#[test]
fn the_bounds_hold_for_a_plain_watertight_test() {
    for (name, tris) in [("bumpy", scenes::bumpy_sphere(30, 40, 5)), ("blocks", scenes::blocks(8, 2))] {
        judge_single_precision(&tris, false).assert_clean(name);
    }
}

#[test]
fn a_leaky_test_is_found_out() {
    for tris in [scenes::bumpy_sphere(30, 40, 5), scenes::blocks(8, 2)] {
        let summary = judge_single_precision(&tris, true);
        assert!(summary.count(|v| v == Verdict::Wrong(Wrong::Crack)) > 10, "{summary}");
    }
}

#[test]
fn the_five_models_are_what_their_names_say() {
    let five = scenes::five();
    let count = |name: &str| five.iter().find(|s| s.name == name).map_or(0, |s| s.tris.len());
    assert!(["scan", "cad", "slivers", "doubles", "far"].iter().all(|n| count(n) > 15_000));
    assert!(five.iter().flat_map(|s| s.tris.iter().flatten()).all(|v| v.is_finite()));
    let slivers = five.iter().find(|s| s.name == "slivers").expect("there");
    let thin = |t: &&Tri| {
        let e = [t[1] - t[0], t[2] - t[1], t[0] - t[2]];
        let longest = e.iter().map(|e| e.length_squared()).fold(0.0, f64::max);
        e[0].cross(e[1]).length() * 0.5 < 1e-3 * longest
    };
    assert!(slivers.tris.iter().filter(thin).count() * 3 > slivers.tris.len());
    let far = five.iter().find(|s| s.name == "far").expect("there");
    assert!(far.tris.iter().flatten().all(|v| v.abs().min_element() > 9e6));
}

fn grid_point() -> impl Strategy<Value = DVec3> {
    // A small integer grid: shared corners, flats, coplanar triangles and parallel rays are common.
    prop::array::uniform3(-3i32..=3).prop_map(|p| DVec3::from(p.map(f64::from)))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]
    #[test]
    fn the_tree_agrees_with_brute_force_on_a_grid(
        tris in prop::collection::vec(prop::array::uniform3(grid_point()), 0..40),
        rays in prop::collection::vec((grid_point(), grid_point(), 0..3u8), 1..20),
    ) {
        let (brute, tree) = (Brute::new(tris.clone()), Bvh64::new(tris));
        for (org, dir, range) in rays.into_iter().filter(|r| r.1 != DVec3::ZERO) {
            let (t_min, t_max) = [(0.0, f64::INFINITY), (0.5, 1.5), (1.0, 1.0)][range as usize];
            let r = Ray64 { org, dir, t_min, t_max };
            prop_assert_eq!(brute.closest_tied(&r, 0.25), tree.closest_tied(&r, 0.25));
            prop_assert_eq!(brute.any(&r), tree.any(&r));
        }
    }
}
