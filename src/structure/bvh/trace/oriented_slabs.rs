//! Intersection of rays with the oriented slabs of cells (`lod`). The slabs of a node's eight cells are computed at
//! once.
//!
//! All walks clip the interval of a ray to the slabs in the same steps, so their results are identical to the bit.
#![allow(clippy::needless_range_loop)] // axes index several arrays at once

use crate::lod::{self, FIELDS, LEAST, LESS, LEVEL, Middle, OrientedSlab, OrientedSlabs};
use crate::simd::{Lanes, Simd};
use crate::structure::bvh::layout::Node;
use crate::structure::ray::abs;

/// Distance by which planes are moved outward, as a fraction of the greatest magnitude of a coordinate. (With 96 h,
/// wires are 1 % thicker.)
///
/// Error of a plane's distance. A plane is at `low = axis . p`, where the magnitudes of the components of the axis add
/// up to at most 1. Its distance is `((low - slack) - org . axis) / (dir . axis)`. With `h` and `m` as in
/// `stand_in.rs`, the errors are at most:
///
/// - `5 h m` for the products and sums of `org . axis`;
/// - `17 h m` for the cell's ends along the axis (its middle, its extent, and the steps between), which alone determine
///   a plane that is stored at an end;
/// - `5 h |dir|` times `t` for the products and sums of `dir . axis`, where `t |dir|` is at most `2 3^0.5 m`;
/// - `8 h m` for the differences and the quotient.
///
/// The total is 50 h m.
///
/// Where slabs decide which leaves need no visit, the error of the triangle test counts too. It computes corners with
/// an error of `12 h m` each (a rounded difference of at most `2 m`, sheared by a rounded quotient, a product and a
/// difference). It weights them by rounded products, which has the effect of an edge off by another `3 h m`. So a ray
/// that the test accepts comes within `16 h m` of the triangle. Together with `47.4 h m`, the exact value of the total
/// above, this is still less than 64 h.
const SLACK: f32 = 64.0 / 16_777_216.0;

/// Origins of rays: of many rays, or of one ray in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Origin<L> {
    org: [L; 3],
    slack: L,
}

impl<L> Origin<L> {
    /// Creates the origins of rays in a tree with coordinates of at most `max_coord` in magnitude, which is in all
    /// lanes.
    #[inline(always)]
    pub fn new<const N: usize>(org: [L; 3], max_coord: L, zero: L) -> Self
    where
        L: Lanes<N>,
    {
        let size = abs(zero, org[0]).max(abs(zero, org[1])).max(abs(zero, org[2])).max(max_coord);
        Self { org, slack: size * L::from_array_like(zero, [SLACK; N]) }
    }

    /// Returns slabs relative to the origins, with planes moved outward by the slack.
    #[inline(always)]
    pub fn see<const N: usize>(&self, slabs: &OrientedSlabs<L>) -> OrientedSlabs<L>
    where
        L: Lanes<N>,
    {
        [self.see_one(&slabs[0]), self.see_one(&slabs[1])]
    }

    #[inline(always)]
    fn see_one<const N: usize>(&self, slab: &OrientedSlab<L>) -> OrientedSlab<L>
    where
        L: Lanes<N>,
    {
        let Self { org, slack } = *self;
        let from = org[0] * slab.axis[0] + org[1] * slab.axis[1] + org[2] * slab.axis[2];
        OrientedSlab { axis: slab.axis, low: slab.low - slack - from, high: slab.high + slack - from }
    }
}

/// Clips the intervals `[enter, leave]` of rays of direction `dir` to slabs that are relative to their origins. An
/// interval with `enter > leave` is empty.
#[inline(always)]
pub(super) fn within<const N: usize, L: Lanes<N>>(
    dir: [L; 3],
    slabs: &OrientedSlabs<L>,
    way: [L; 2],
    one: L,
) -> [L; 2] {
    between(dir, &slabs[1], between(dir, &slabs[0], way, one), one)
}

#[inline(always)]
fn between<const N: usize, L: Lanes<N>>(dir: [L; 3], slab: &OrientedSlab<L>, [enter, leave]: [L; 2], one: L) -> [L; 2] {
    let inv = one.div(dir[0] * slab.axis[0] + dir[1] * slab.axis[1] + dir[2] * slab.axis[2]);
    let (low, high) = (slab.low * inv, slab.high * inv);
    // For a ray parallel to the slab, `low` and `high` are infinite, of either sign. In this order of operands a NaN
    // leaves the interval unchanged, or makes it wider.
    [low.min(high).max(enter), high.max(low).min(leave)]
}

/// Returns the oriented slabs of a node's cells, as stored.
#[inline(always)]
pub(super) fn of_node<S: Simd>(s: S, node: &Node) -> OrientedSlabs<S::F8> {
    let (zero, half) = (s.splat8(0.0), s.splat8(0.5));
    let step = s.powers8(node.exponents());
    let mut cell = Middle { at: [zero; 3], half: [zero; 3] };
    for axis in 0..3 {
        let (low, high) = (s.bytes8(&node.planes[axis]), s.bytes8(&node.planes[axis + 3]));
        let half = step[axis] * half;
        // Products with powers of two are exact: there is one rounding, fused or not.
        cell.at[axis] = (low + high).mul_add(half, s.splat8(node.origin[axis]));
        cell.half[axis] = (high - low) * half;
    }
    let mut fields = [zero; 5];
    for i in 0..FIELDS.len() {
        let (from, count) = FIELDS[i];
        fields[i] = s.fields8(&node.slabs, from, count);
    }
    let sign = s.splat8(128.0);
    lod::oriented_slabs(fields, [s.bytes8(&node.normal[0]) - sign, s.bytes8(&node.normal[1]) - sign], &cell)
}

/// Returns the factors by which the areas of a node's cells count in the stand-in test (`lod::Fill`).
#[inline(always)]
pub(super) fn area_shares<S: Simd>(s: S, node: &Node) -> S::F8 {
    let (from, count) = LEVEL;
    (s.splat8(1.0) - s.fields8(&node.slabs, from, count) * s.splat8(LESS)).max(s.splat8(LEAST))
}

/// Oriented slabs of eight cells in memory: for each slab the components of its axis, then its planes.
pub(super) struct Eight([[[f32; 8]; 5]; 2]);

impl Eight {
    pub const NONE: Self = Self([[[0.0; 8]; 5]; 2]);

    /// Returns the slabs of a node's cells.
    #[inline(always)]
    pub fn of<S: Simd>(s: S, node: &Node) -> Self {
        let mut eight = Self::NONE;
        eight.set(&of_node(s, node));
        eight
    }

    /// Stores slabs.
    #[inline(always)]
    pub fn set<L: Lanes<8>>(&mut self, slabs: &OrientedSlabs<L>) {
        for which in 0..2 {
            let OrientedSlab { axis, low, high } = slabs[which];
            self.0[which] =
                [axis[0].to_array(), axis[1].to_array(), axis[2].to_array(), low.to_array(), high.to_array()];
        }
    }

    /// Returns all slabs, one cell per lane.
    #[inline(always)]
    pub fn all<S: Simd>(&self, s: S) -> OrientedSlabs<S::F8> {
        let [a, b] = &self.0;
        let one = OrientedSlab {
            axis: [s.load8(&a[0]), s.load8(&a[1]), s.load8(&a[2])],
            low: s.load8(&a[3]),
            high: s.load8(&a[4]),
        };
        let other = OrientedSlab {
            axis: [s.load8(&b[0]), s.load8(&b[1]), s.load8(&b[2])],
            low: s.load8(&b[3]),
            high: s.load8(&b[4]),
        };
        [one, other]
    }

    /// Returns the slabs of the cell in `slot`, in all lanes.
    #[inline(always)]
    pub fn one<S: Simd>(&self, s: S, slot: usize) -> OrientedSlabs<S::F16> {
        let ([a, b], i) = (&self.0, slot & 7);
        let axis = [s.splat16(a[0][i]), s.splat16(a[1][i]), s.splat16(a[2][i])];
        let one = OrientedSlab { axis, low: s.splat16(a[3][i]), high: s.splat16(a[4][i]) };
        let axis = [s.splat16(b[0][i]), s.splat16(b[1][i]), s.splat16(b[2][i])];
        [one, OrientedSlab { axis, low: s.splat16(b[3][i]), high: s.splat16(b[4][i]) }]
    }
}
