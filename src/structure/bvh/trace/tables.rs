//! Coordinates of a leaf as tables that are indexed by vertex number.

use super::single::LeafRay;
use crate::geom::watertight::{Sheared, shear};
use crate::simd::Simd;
use crate::structure::bvh::leaf::{Coordinates, Leaf};

/// Returns the coordinates of a leaf's vertices on the axes `k`.
#[inline(always)]
pub(super) fn tables<S: Simd>(s: S, leaf: &Leaf, k: [usize; 3]) -> [[S::F8; 2]; 3] {
    [table(s, leaf.coordinates(k[0])), table(s, leaf.coordinates(k[1])), table(s, leaf.coordinates(k[2]))]
}

#[inline(always)]
fn table<S: Simd>(s: S, coordinates: Coordinates) -> [S::F8; 2] {
    match coordinates {
        Coordinates::Whole(all) => s.table16(all),
        Coordinates::Near(first, steps) => s.steps16(first, steps),
    }
}

/// Returns the corners of a leaf's triangles, sheared for a ray. The function shears vertices and then looks up the
/// corners, because a leaf mostly has fewer vertices than corners.
#[inline(always)]
pub(super) fn sheared_corners<S: Simd>(s: S, leaf: &Leaf, ray: &LeafRay<S>) -> [Sheared<S::F8>; 3] {
    let ([x, y, z], [a, b, c]) = (tables(s, leaf, ray.k), ray.org);
    let low = shear([x[0] - a, y[0] - b, z[0] - c], ray.shear);
    let high = shear([x[1] - a, y[1] - b, z[1] - c], ray.shear);
    [
        corner(s, &low, &high, leaf.corners8(0)),
        corner(s, &low, &high, leaf.corners8(1)),
        corner(s, &low, &high, leaf.corners8(2)),
    ]
}

/// Returns one corner of each triangle. This is no closure: closures are not compiled for the instruction set of the
/// caller.
#[inline(always)]
fn corner<S: Simd>(s: S, low: &Sheared<S::F8>, high: &Sheared<S::F8>, corners: &[u8; 8]) -> Sheared<S::F8> {
    let index = s.index8(corners);
    Sheared {
        x: s.lookup16([low.x, high.x], index),
        y: s.lookup16([low.y, high.y], index),
        z: s.lookup16([low.z, high.z], index),
    }
}
