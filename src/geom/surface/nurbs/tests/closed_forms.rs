//! Spheres, tori, cylinders and cones, whose points, normals and curvatures are known.

use super::{Owned, Rng};
use crate::geom::surface::nurbs::Nurbs;
use glam::{DVec2, DVec3, DVec4};
use std::f64::consts::FRAC_1_SQRT_2;

/// Quarter circles around the origin as Bézier curves of degree 2 in homogeneous coordinates: the points of `quarters`
/// of them, counter-clockwise from `first`.
fn circle(first: DVec2, quarters: usize) -> Vec<(DVec2, f64)> {
    let corner = |i: usize| (0..i % 4).fold(first, |p, _| p.perp());
    (0..=2 * quarters)
        .map(|i| match i % 2 {
            0 => (corner(i / 2), 1.0),
            _ => (corner(i / 2) + corner(i / 2 + 1), FRAC_1_SQRT_2),
        })
        .collect()
}

fn circle_knots(quarters: usize) -> Vec<f64> {
    let mut knots: Vec<f64> = (0..=quarters).flat_map(|i| [i as f64; 2]).collect();
    knots.insert(0, 0.0);
    knots.push(quarters as f64);
    knots
}

/// A surface of revolution around z: u along the full circle, v along the profile of radius, height and weight.
fn revolved(profile: &[(DVec2, f64)], degree: u32, knots_v: Vec<f64>) -> Owned {
    let around = circle(DVec2::X, 4);
    let (mut points, mut weights) = (Vec::new(), Vec::new());
    for (on_circle, weight) in &around {
        for (at, other) in profile {
            points.push((*on_circle * at.x).extend(at.y));
            weights.push(weight * other);
        }
    }
    let counts = [around.len() as u32, profile.len() as u32];
    Owned { degree: [2, degree], counts, knots: [circle_knots(4), knots_v], points, weights: Some(weights) }
}

pub(crate) fn sphere() -> Owned {
    revolved(&circle(DVec2::NEG_Y, 2), 2, circle_knots(2))
}

fn torus(major: f64) -> Owned {
    let profile: Vec<_> = circle(DVec2::X, 4).into_iter().map(|(p, w)| (p + DVec2::X * major, w)).collect();
    revolved(&profile, 2, circle_knots(4))
}

fn line(from: DVec2, to: DVec2) -> Owned {
    revolved(&[(from, 1.0), (to, 1.0)], 1, vec![0.0, 0.0, 1.0, 1.0])
}

/// Checks points of the whole domain, its borders and corners included: `truth` returns the distance of a point from
/// the surface, the normal and the principal curvatures.
fn check(owned: &Owned, scale: f64, truth: impl Fn(DVec3) -> (f64, DVec3, [f64; 2])) {
    let (surface, mut rng) = (owned.surface(), Rng::new(4));
    let [[u0, u1], [v0, v1]] = surface.domain();
    let share = |rng: &mut Rng| match rng.below(6) {
        0 => 0.0,
        1 => 1.0,
        2 => 10f64.powf(rng.between(-12.0, 0.0)),
        _ => rng.unit(),
    };
    for _ in 0..20_000 {
        let (u, v) = (u0 + (u1 - u0) * share(&mut rng), v0 + (v1 - v0) * share(&mut rng));
        let position = surface.evaluate(u, v).position;
        let (distance, normal, curvatures) = truth(position);
        assert!(distance.abs() <= 1e-14 * scale, "({u}, {v}): {distance:e}");
        let found = surface.normal_limit(u, v);
        assert!(found.distance(normal) <= 1e-7, "({u}, {v}): {found} not {normal}");
        let found = surface.curvature_limit(u, v).expect("curvatures");
        for (a, b) in found.into_iter().zip(curvatures) {
            assert!((a - b).abs() <= 1e-6, "({u}, {v}): {found:?} not {curvatures:?}");
        }
    }
}

#[test]
fn a_sphere_with_its_poles() {
    check(&sphere(), 1.0, |p| (p.length() - 1.0, p.normalize(), [-1.0, -1.0]));
}

#[test]
fn a_torus() {
    check(&torus(3.0), 4.0, |p| {
        let centre = p.truncate().normalize() * 3.0;
        let normal = (p - centre.extend(0.0)).normalize();
        let along = -(p.truncate().length() - 3.0) / p.truncate().length();
        (p.distance(centre.extend(0.0)) - 1.0, normal, [along.max(-1.0), along.min(-1.0)])
    });
}

#[test]
fn a_cylinder_and_a_cone() {
    check(&line(DVec2::new(1.0, -1.0), DVec2::new(1.0, 2.0)), 1.0, |p| {
        let out = p.truncate().normalize().extend(0.0);
        (p.truncate().length() - 1.0, out, [0.0, -1.0])
    });
    // At the apex the normal is that of the ruling, and the curvature has no limit.
    let cone = line(DVec2::new(0.0, 1.0), DVec2::new(1.0, 0.0)).surface();
    for u in [0.0, 0.3, 1.0, 2.5, 4.0] {
        let out = cone.evaluate(u, 1.0).position.normalize();
        let normal = (out + DVec3::Z).normalize() * -1.0;
        assert!(cone.normal_limit(u, 0.0).distance(normal) < 1e-12, "{u}");
        assert_eq!(cone.curvature_limit(u, 0.0), None);
    }
}

#[test]
fn a_sphere_of_higher_degree_whose_poles_have_no_derivative_at_all() {
    // Degree raised by a reparametrisation v = 1 − (1 − s)²: dv vanishes at the pole, too.
    let profile = circle(DVec2::NEG_Y, 1);
    let square = |i: usize| profile[i].0.extend(1.0).extend(0.0) * profile[i].1;
    let blossom = |a: f64, b: f64| {
        square(0) * ((1.0 - a) * (1.0 - b)) + square(1) * (a * (1.0 - b) + b * (1.0 - a)) + square(2) * (a * b)
    };
    // The square s² has the blossom values 0, 0, 0, and so on: the curve of degree 4 is the product of two quadratics.
    let [c0, c1, c2]: [DVec4; 3] = [blossom(0.0, 0.0), blossom(0.0, 1.0), blossom(1.0, 1.0)];
    // b(s²) = c0 (1 − s²)² + 2 c1 s² (1 − s²) + c2 s⁴, in Bernstein form of degree 4.
    let four = [c0, c0, c0 * (2.0 / 3.0) + c1 / 3.0, c1, c2];
    let profile: Vec<_> = four.map(|c| (DVec2::new(c.x, c.y) / c.z, c.z)).to_vec();
    let owned = revolved(&profile, 4, [vec![0.0; 5], vec![1.0; 5]].concat());
    let surface = owned.surface();
    for (u, v) in [0.0, 0.7, 1.0, 3.9].into_iter().flat_map(|u| [0.0, 1e-9, 1e-6, 1e-3, 0.5].map(|v| (u, v))) {
        let (position, normal) = (surface.evaluate(u, v).position, surface.normal_limit(u, v));
        assert!((position.length() - 1.0).abs() < 1e-14 && normal.distance(position) < 1e-8, "{u} {v} {normal}");
    }
    assert_eq!(surface.evaluate(0.3, 0.0).normal(), DVec3::ZERO);
}

#[test]
fn a_surface_without_area_has_no_normal() {
    let owned = Owned { points: vec![DVec3::ONE; 45], ..sphere() };
    assert_eq!(owned.surface().normal_limit(0.5, 0.5), DVec3::ZERO);
    assert_eq!(owned.surface().curvature_limit(0.5, 0.5), None);
    assert_eq!(owned.surface().piece([0, 0]).normal_cone(), None);
}

#[test]
fn far_from_zero_nothing_is_lost_but_the_last_sum() {
    // Steps of 1/8 keep the control points exact at 10⁷, but for those at √½ … of weights, which do not move.
    let (here, mut there) = (sphere(), sphere());
    let offset = DVec3::new(1e7, -1e7, 3e7);
    there.points.iter_mut().for_each(|p| *p += offset);
    let (here, there): (Nurbs, Nurbs) = (here.surface(), there.surface());
    let mut rng = Rng::new(5);
    for _ in 0..1000 {
        let (u, v) = (rng.between(0.0, 4.0), rng.between(0.0, 2.0));
        let (a, b) = (here.evaluate(u, v), there.evaluate(u, v));
        assert!(a.position.distance(b.position - offset) < 1e-8);
        assert!(a.du.distance(b.du) < 1e-14 && a.dvv.distance(b.dvv) < 1e-13);
    }
}

#[test]
fn a_periodic_surface_closes_by_its_knots() {
    // A uniform cubic tube: the first three rows are repeated.
    let ring: Vec<_> = (0..11).map(|i| DVec2::from_angle(f64::from(i % 8) * 0.25 * std::f64::consts::PI)).collect();
    let points = ring.iter().flat_map(|p| [p.extend(0.0), p.extend(1.0)]).collect();
    let knots = [(0..15).map(f64::from).collect(), vec![0.0, 0.0, 1.0, 1.0]];
    let surface = Owned { degree: [3, 1], counts: [11, 2], knots, points, weights: None }.surface();
    assert_eq!(surface.domain()[0], [3.0, 11.0]);
    let (a, b) = (surface.evaluate(3.0, 0.4), surface.evaluate(11.0, 0.4));
    for (a, b) in [(a.position, b.position), (a.du, b.du), (a.duu, b.duu)] {
        assert!(a.distance(b) < 1e-14, "{a} {b}");
    }
}
