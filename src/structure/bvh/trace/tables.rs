//! The coordinates of a leaf, to be looked up by the numbers of vertices.

use crate::simd::Simd;
use crate::structure::bvh::leaf::{Coordinates, Leaf};

/// The coordinates of a leaf's vertices, on the axes `k`.
#[inline(always)]
pub(super) fn tables<S: Simd>(s: S, leaf: &Leaf, k: [usize; 3]) -> [S::Table16; 3] {
    [table(s, leaf.coordinates(k[0])), table(s, leaf.coordinates(k[1])), table(s, leaf.coordinates(k[2]))]
}

#[inline(always)]
fn table<S: Simd>(s: S, coordinates: Coordinates) -> S::Table16 {
    match coordinates {
        Coordinates::Whole(all) => s.table16(all),
        Coordinates::Near(first, steps) => s.steps16(first, steps),
    }
}
