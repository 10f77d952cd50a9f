//! Masks of irregular vertices against their defining equation, and against deep uniform subdivision.

use super::super::CagePatches;
use super::super::around::{Finder, Neighbourhood};
use super::super::limit::eigenvalue;
use super::super::pattern::Pattern;
use super::super::plan::Plans;
use super::super::settled::{Ends, Sector};
use super::shapes::{Rng, Shape, fan};
use glam::DVec3;
use std::f64::consts::PI;
use std::sync::Arc;

/// The pattern of face 0 of a shape, at its vertex 0.
fn pattern(shape: &Shape) -> Option<Arc<Pattern>> {
    let (cage, mut found, mut vertices) = (shape.cage(), Neighbourhood::default(), Vec::new());
    Finder::new(&cage).find(0, 0, &mut found, &mut vertices);
    let plan = Plans::new().plan(&found).unwrap();
    plan.patterns.first().cloned()
}

/// Greatest difference of a mask one level deeper from `by` times itself.
fn defect(pattern: &Pattern, mask: &[f64], by: f64) -> f64 {
    let next = pattern.ring.left(mask, mask.len());
    next.iter().zip(mask).map(|(a, b)| (a - by * b).abs()).fold(0.0, f64::max)
}

#[test]
fn masks_of_smooth_vertices_are_eigenvectors() {
    for n in [3, 5, 6, 7, 12, 64, 200] {
        let pattern = pattern(&fan(n, 2, &mut Rng(1))).unwrap();
        let (masks, lambda) = (&pattern.masks, eigenvalue(2.0 * PI / f64::from(n)));
        let within = |mask: &[f64], by: f64| assert!(defect(&pattern, mask, by) < 1e-13, "{n}");
        within(&masks.position, 1.0);
        within(&masks.du, lambda);
        within(&masks.dv, lambda);
        assert!((masks.position.iter().sum::<f64>() - 1.0).abs() < 1e-13 && masks.du.iter().sum::<f64>().abs() < 1e-13);
    }
}

#[test]
fn masks_of_creases_and_corners_are_eigenvectors() {
    for (faces, corner) in [(3, 0.0), (4, 0.0), (5, 0.0), (8, 0.0), (3, 10.0), (4, 10.0), (5, 10.0), (8, 10.0)] {
        // The quad is second in its sector: du is the second mode, dv the first.
        let mut shape = fan(2 * faces, 2, &mut Rng(2));
        shape.creases = vec![(0, 4 * faces - 1, 10.0), (0, 2 * faces - 1, 10.0)];
        shape.corners = vec![(0, corner)];
        let pattern = pattern(&shape).unwrap();
        let masks = &pattern.masks;
        let second = if faces < 5 { 0.5 } else { eigenvalue(2.0 * PI / f64::from(faces)) };
        assert!(defect(&pattern, &masks.position, 1.0) < 1e-14);
        assert!(defect(&pattern, &masks.du, second) < 1e-14, "{faces} {corner}");
        assert!(defect(&pattern, &masks.dv, eigenvalue(PI / f64::from(faces))) < 1e-14, "{faces} {corner}");
    }
}

#[test]
fn vertices_are_limits_of_uniform_subdivision() {
    let rng = &mut Rng(3);
    let mut shapes: Vec<Shape> = [3, 4, 5, 7].into_iter().map(|n| fan(n, 2, rng)).collect();
    let mut with = |n: u32, creases: &[(u32, u32, f32)], corners: &[(u32, f32)]| {
        shapes.push(Shape { creases: creases.to_vec(), corners: corners.to_vec(), ..fan(n, 2, rng) });
    };
    with(5, &[(0, 1, 10.0)], &[]);
    with(5, &[(0, 1, 10.0), (0, 7, 10.0)], &[]);
    with(6, &[(0, 1, 10.0), (0, 7, 10.0), (0, 9, 10.0)], &[]);
    with(4, &[(0, 1, 0.5), (0, 5, 2.5)], &[]);
    with(5, &[], &[(0, 1.7)]);
    for shape in shapes {
        let patches = CagePatches::new(&shape.cage(), &shape.points).unwrap();
        let (mut cage, mut points) = (shape.cage(), shape.points.clone());
        // Differences shrink by up to 0.6² a level: the last ones tell the rest of the sum.
        let mut last = [DVec3::ZERO; 3];
        for _ in 0..6 {
            points = cage.refine_points(&points).unwrap();
            cage = cage.refine().unwrap();
            last = [last[1], last[2], points[0]];
        }
        let limit = patches.evaluate(0, 0, 0.0, 0.0).position;
        let near = last.map(|p| p.distance(limit));
        assert!(near[2] < 1e-2 && near[2] <= 0.7 * near[1] + 1e-12, "{near:?}");
    }
}

#[test]
fn normals_at_vertices_are_limits_of_those_near_them() {
    let rng = &mut Rng(4);
    for (n, ends) in [(3, 0), (5, 0), (12, 0), (6, 3), (6, 5), (9, 5), (9, 7), (8, 4), (5, 1)] {
        // Sharp vertices without sharp edges are spikes, and those of three faces have two ends that decay alike: their
        // normals depend on the direction.
        let corners: &[f32] = if ends == 0 || n - ends == 3 { &[0.0] } else { &[0.0, 10.0] };
        for &corner in corners {
            let creases = if ends > 0 { vec![(0, 1, 10.0), (0, 1 + 2 * ends, 10.0)] } else { Vec::new() };
            let shape = Shape { creases, corners: vec![(0, corner)], ..fan(n, 2, rng) };
            let patches = CagePatches::new(&shape.cage(), &shape.points).unwrap();
            for face in 0..n {
                let near = [20, 46].map(|depth| {
                    let t = 0.5f64.powi(depth);
                    patches.evaluate(face, 0, t, 0.7 * t).normal()
                });
                let vertex = patches.evaluate(face, 0, 0.0, 0.0).normal();
                // Slow: the ratio of eigenvalues is near 1 at high valence, and the decay is 1 / depth where they tie.
                let far = near.map(|normal| normal.distance(vertex));
                assert!(far[1] <= 0.75 * far[0] + 1e-3, "{n} {ends} {corner} face {face}: {far:?}");
            }
        }
    }
}

#[test]
fn a_sector_closes_only_without_sharp_edges() {
    let mut walk = Vec::new();
    let mut shape = fan(5, 1, &mut Rng(5));
    let sector = |shape: &Shape, walk: &mut Vec<u32>| -> Option<Sector> { shape.cage().sector(0, walk) };
    assert_eq!(sector(&shape, &mut walk).unwrap().ends, Ends::Closed);
    shape.creases = vec![(0, 3, 10.0)];
    let dart = sector(&shape, &mut walk).unwrap();
    assert_eq!((dart.ends, dart.faces, dart.position), (Ends::Dart, 5, 4));
    shape.creases = vec![(0, 3, 10.0), (0, 7, 10.0)];
    let crease = sector(&shape, &mut walk).unwrap();
    assert_eq!((crease.ends, crease.faces, crease.position), (Ends::Two, 3, 2));
    shape.creases = vec![(0, 3, 9.0)];
    assert_eq!(sector(&shape, &mut walk), None);
}
