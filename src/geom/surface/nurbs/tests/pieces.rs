//! Bézier patches are the surface, and parts of them too; neighbours share bits.

use super::{Owned, Rng};
use crate::geom::surface::SurfacePoint;
use crate::geom::surface::nurbs::BezierPatch;
use glam::DVec4;

fn differ(a: &SurfacePoint, b: &SurfacePoint) -> f64 {
    let by = |a: glam::DVec3, b: glam::DVec3, least: f64| a.distance(b) / b.length().max(least);
    let first = by(a.du, b.du, 10.0).max(by(a.dv, b.dv, 10.0));
    let second = by(a.duu, b.duu, 1e3).max(by(a.duv, b.duv, 1e3)).max(by(a.dvv, b.dvv, 1e3));
    by(a.position, b.position, 1.0).max(first).max(second)
}

#[test]
fn patches_are_the_surface() {
    let mut rng = Rng::new(6);
    for _ in 0..100 {
        let surface = Owned::random(&mut rng, 6, true).surface();
        for patch in surface.pieces() {
            let [[u0, u1], [v0, v1]] = patch.domain();
            assert!(u0 < u1 && v0 < v1);
            for _ in 0..4 {
                let (u, v) = (rng.between(u0, u1), rng.between(v0, v1));
                let worst = differ(&patch.evaluate(u, v), &surface.evaluate(u, v));
                assert!(worst < 1e-13, "{worst:e}");
            }
        }
    }
}

#[test]
fn parts_are_the_patch() {
    let mut rng = Rng::new(7);
    for _ in 0..200 {
        let surface = Owned::random(&mut rng, 5, false).surface();
        let patch = surface.piece([0, 0]);
        let [u, v] = patch.domain().map(|[a, b]| {
            let (s, t) = (rng.between(a, b), rng.between(a, b));
            if rng.one_in(4) { [a, t] } else { [s.min(t), s.max(t)] }
        });
        let part = patch.part([u, v]);
        assert_eq!(part.domain(), [u, v]);
        let halves = part.halves(rng.below(2));
        assert_eq!(halves[0].domain()[0][0], u[0]);
        for piece in [&part, &halves[0], &halves[1]] {
            let [[u0, u1], [v0, v1]] = piece.domain();
            let (u, v) = (rng.between(u0, u1), rng.between(v0, v1));
            let (a, b) = (piece.evaluate(u, v), surface.evaluate(u, v));
            assert!(a.position.distance(b.position) < 1e-14, "{a:?} {b:?}");
            assert!(a.du.distance(b.du) * (u1 - u0) < 1e-12 && a.dv.distance(b.dv) * (v1 - v0) < 1e-12);
        }
    }
}

/// Control points of a border: axis 0 or 1, first or last.
fn border(patch: &BezierPatch, axis: usize, is_last: bool) -> Vec<DVec4> {
    let (rows, columns) = (patch.degree()[0] + 1, patch.degree()[1] + 1);
    let (_, points) = patch.control_points();
    match axis {
        0 => (0..columns).map(|j| points[if is_last { rows - 1 } else { 0 } * columns + j]).collect(),
        _ => (0..rows).map(|i| points[i * columns + if is_last { columns - 1 } else { 0 }]).collect(),
    }
}

#[test]
fn neighbours_share_the_bits_of_their_border() {
    let mut rng = Rng::new(8);
    for _ in 0..200 {
        let surface = Owned::random(&mut rng, 6, false).surface();
        let [rows, columns] = surface.piece_counts();
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let here = surface.piece([i, j]);
            for (axis, next) in [[i + 1, j], [i, j + 1]].into_iter().enumerate() {
                if next[0] < rows && next[1] < columns {
                    let next = surface.piece(next);
                    assert_eq!(border(&here, axis, true), border(&next, axis, false));
                    // Both split alike along the border.
                    let (a, b) = (here.halves(1 - axis), next.halves(1 - axis));
                    assert_eq!(border(&a[1], axis, true), border(&b[1], axis, false));
                }
            }
        }
        let [a, b] = surface.piece([0, 0]).halves(0);
        assert_eq!(border(&a, 0, true), border(&b, 0, false));
    }
}

#[test]
fn a_clamped_surface_begins_at_its_control_points() {
    let mut owned = Owned::random(&mut Rng::new(9), 1, false);
    owned.degree = [3, 3];
    owned.counts = [4, 4];
    owned.knots = [vec![0., 0., 0., 0., 1., 1., 1., 1.], vec![2., 2., 2., 2., 5., 5., 5., 5.]];
    owned.points = (0..16).map(|i| glam::DVec3::new(f64::from(i), f64::from(i * i), 1.0)).collect();
    owned.weights = None;
    let (origin, patch) = (owned.surface(), owned.surface().piece([0, 0]));
    assert_eq!((origin.piece_counts(), patch.degree(), patch.is_rational()), ([1, 1], [3, 3], false));
    let (origin, points) = patch.control_points();
    for (found, given) in points.iter().zip(&owned.points) {
        assert_eq!((origin + found.truncate(), found.w), (*given, 1.0));
    }
}

#[test]
fn a_part_without_extent_has_points_and_no_nan() {
    let patch = Owned::random(&mut Rng::new(10), 4, false).surface().piece([0, 0]);
    let [[u0, _], [v0, v1]] = patch.domain();
    let part = patch.part([[u0, u0], [v0, v1]]);
    let point = part.evaluate(u0, v0);
    assert_eq!(point.position, patch.evaluate(u0, v0).position);
    assert!(point.du.is_finite() && point.duu.is_finite() && point.dvv.is_finite());
    assert!(part.normal_cone().is_none());
}

#[test]
fn pieces_within_a_rectangle_cover_it_and_no_more() {
    let mut rng = Rng::new(15);
    for _ in 0..100 {
        let surface = Owned::random(&mut rng, 3, false).surface();
        let rectangle = surface.domain().map(|[a, b]| {
            let (s, t) = (rng.between(a, b), rng.between(a, b));
            [s.min(t), s.max(t)]
        });
        let area = |[[u0, u1], [v0, v1]]: [[f64; 2]; 2]| (u1 - u0) * (v1 - v0);
        let is_within = |d: [[f64; 2]; 2]| (0..2).all(|k| rectangle[k][0] <= d[k][0] && d[k][1] <= rectangle[k][1]);
        let parts: Vec<_> = surface.pieces_within(rectangle).map(|part| part.domain()).collect();
        assert!(parts.iter().all(|&domain| is_within(domain) && area(domain) > 0.0));
        let sum: f64 = parts.into_iter().map(area).sum();
        assert!((sum - area(rectangle)).abs() < 1e-12, "{sum} {rectangle:?}");
        assert_eq!(surface.pieces_within(surface.domain()).count(), surface.pieces().count());
    }
}
