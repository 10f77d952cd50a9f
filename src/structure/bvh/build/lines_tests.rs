//! Tests of lines through regions against closed forms and a test of their own.

use super::*;
use crate::lod::OrientedSlab;
use crate::simd::{Isa, Op, dispatch};

const WIDE: OrientedSlab<f32> = OrientedSlab { axis: [0.0, 0.0, 1.0], low: -10.0, high: 10.0 };

/// Returns the faces of a box.
fn faces(b: Bounds) -> Vec<[Vec3; 3]> {
    let corner = |i: usize| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), b.max, b.min);
    let quad = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, c, d]].map(|t| t.map(corner));
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        .into_iter()
        .flat_map(quad)
        .collect()
}

/// Computes the weights of all lines, of those that hit none of the triangles, and of the latter again by a formula
/// of its own in double precision.
struct Share<'a>(&'a Region, &'a [[Vec3; 3]]);

impl Op for Share<'_> {
    type Out = [f32; 3];

    fn run<S: Simd>(self, s: S) -> [f32; 3] {
        let mut lines = Lines::new();
        lines.through(s, self.0, [0, GROUPS]);
        let (mut left, mut exact) = (lines.all, NONE);
        for triangle in self.1 {
            lines.leave(s, &mut left, triangle);
        }
        for i in numbers(lines.all) {
            put(&mut exact, i, !self.1.iter().any(|t| meets(&lines, i, t)));
        }
        [lines.all, left, exact].map(|set| lines.weight(&set))
    }
}

/// Tests for a hit by the signs of volumes.
fn meets(lines: &Lines, i: usize, triangle: &[Vec3; 3]) -> bool {
    let line = lines.one(i, 0.0);
    let at = |axis: usize| f64::from(lines.dir[i / GROUP][axis][i % GROUP]);
    let (org, dir) = (line.org.as_dvec3(), glam::DVec3::new(at(0), at(1), at(2)));
    let [a, b, c] = triangle.map(|v| v.as_dvec3() - org);
    let volumes = [b.cross(c).dot(dir), c.cross(a).dot(dir), a.cross(b).dot(dir)];
    let across = (b - a).cross(c - a);
    let t = across.dot(a) / across.dot(dir);
    let is_on = volumes.iter().all(|v| *v >= 0.0) || volumes.iter().all(|v| *v <= 0.0);
    is_on && t >= f64::from(line.way[0]) && t <= f64::from(line.way[1])
}

/// Returns the share of the lines that hit any of the triangles, over many regions with lines shifted differently.
/// (With few lines it is some hundredths too large: short lines are seldom found, and weigh much.)
fn share(bounds: Bounds, slabs: &OrientedSlabs<f32>, triangles: &[[Vec3; 3]], isa: Isa) -> f32 {
    let mut sums = [0.0; 2];
    for round in 0..32 {
        let by = Vec3::splat(round as f32 / 64.0);
        let moved: Vec<_> = triangles.iter().map(|t| t.map(|v| v + by)).collect();
        let slabs = slabs.map(|s| {
            let along = by.dot(s.axis.into());
            OrientedSlab { low: s.low + along, high: s.high + along, ..s }
        });
        let mut region = Region::around(&Bounds { min: bounds.min + by, max: bounds.max + by }, &slabs, 0.0);
        for _ in 0..4 {
            let [all, left, exact] = dispatch(isa, Share(&region, &moved));
            // A line through an edge may be classified either way.
            assert!((left - exact).abs() < 0.03 * all, "{left}, {exact} of {all}");
            sums = [sums[0] + all, sums[1] + left];
            region.go_on();
        }
    }
    1.0 - sums[1] / sums[0]
}

const UNIT: Bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };

/// Cauchy: the share of the lines through a convex body that hit a convex body inside it is the ratio of their
/// surface areas.
#[test]
fn lines_meet_convex_bodies_by_their_surfaces() {
    let slabs = [WIDE, OrientedSlab { axis: [0.0, 1.0, 0.0], ..WIDE }];
    let inner = faces(Bounds { min: Vec3::splat(0.1), max: Vec3::splat(0.6) });
    // Slabs that leave a plate of the cell, and a square inside it: both of its sides count.
    let plate = [OrientedSlab { axis: [0.0, 0.0, 1.0], low: 0.45, high: 0.55 }, slabs[1]];
    let square = [[0.2, 0.7], [0.7, 0.2]]
        .map(|[x, y]| [Vec3::new(0.2, 0.2, 0.5), Vec3::new(0.7, 0.7, 0.5), Vec3::new(x, y, 0.5)]);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let of_cube = share(UNIT, &slabs, &inner, isa);
        // Lines across corners, which count for less, mostly miss it.
        assert!((of_cube - 0.25).abs() < 0.01, "{of_cube}");
        let of_square = share(UNIT, &plate, &square, isa);
        assert!((of_square - 0.5 / 2.4).abs() < 0.008, "{of_square}");
    }
}
