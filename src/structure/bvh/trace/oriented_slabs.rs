//! Slabs of cells (`lod`), as rays see them: those of a node's eight cells are worked out at once.
//!
//! What is left of a ray's way inside of slabs is worked out in the same steps by all walks: they see the same to the
//! bit.
//!
//! A slab's plane is at `low = axis . p`, the magnitudes of the axis' components adding up to 1 at most, and met at
//! `((low - slack) - org . axis) / (dir . axis)`. Products and sums of `org . axis` are off by `5 h m` at most; the
//! cell's ends along the axis, which where planes are at the ends are all that says where, by `17 h m` (its middle, its
//! extent, and the steps between); products and sums of `dir . axis` by `5 h |dir|` times `t`, where `t |dir|` is at
//! most `2 3^0.5 m`; differences and the quotient by `8 h m`: 50 h m in all. (`h` and `m`: see `stand_in.rs`.)
//!
//! Where they tell which leaves need no visit, the triangle test counts too: it sees corners off by `12 h m` each (a
//! rounded difference of at most `2 m`, sheared by a rounded quotient, a product and a difference) and weighs them by
//! products of those, rounded, which is as if an edge were off by `3 h m` more: so a ray that it accepts passes the
//! triangle as near as `16 h m`, and with the `47.4 h m` that the above comes to exactly that is less than [`SLACK`]
//! still.
#![allow(clippy::needless_range_loop)] // axes index several arrays at once

use super::ray::abs;
use crate::lod::{self, FIELDS, LEAST, LESS, LEVEL, Middle, OrientedSlab, OrientedSlabs};
use crate::simd::{Lanes, Simd};
use crate::structure::bvh::layout::Node;

/// By how much planes give way, as a part of the greatest magnitude of a coordinate: see the module. (With 96 h wires
/// are 1 % thicker.)
const SLACK: f32 = 64.0 / 16_777_216.0;

/// Where rays begin: many of them, or one in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Origin<L> {
    org: [L; 3],
    slack: L,
}

impl<L> Origin<L> {
    /// Of rays of a tree whose coordinates are at most `reach` in magnitude, which is in all lanes.
    #[inline(always)]
    pub fn new<const N: usize>(org: [L; 3], max_coord: L, zero: L) -> Self
    where
        L: Lanes<N>,
    {
        let size = abs(zero, org[0]).max(abs(zero, org[1])).max(abs(zero, org[2])).max(max_coord);
        Self { org, slack: size * L::from_array_like(zero, [SLACK; N]) }
    }

    /// Slabs whose planes are less where rays begin along their axes, and give way.
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

/// What is left inside of slabs as seen of the ways of rays that go along `dir`, `[enter, leave]`: none where one is
/// entered after it is left.
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
    // Along a slab they are infinite, of either sign; in this order a NaN leaves the interval as it was, or wider.
    [low.min(high).max(enter), high.max(low).min(leave)]
}

/// The slabs of a node's cells, as stored.
#[inline(always)]
pub(super) fn of_node<S: Simd>(s: S, node: &Node) -> OrientedSlabs<S::F8> {
    let (zero, half) = (s.splat8(0.0), s.splat8(0.5));
    let step = s.powers8(node.exponents());
    let mut cell = Middle { at: [zero; 3], half: [zero; 3] };
    for axis in 0..3 {
        let (low, high) = (s.bytes8(&node.planes[axis]), s.bytes8(&node.planes[axis + 3]));
        let half = step[axis] * half;
        // Products with powers of two are exact: one rounding, however it is done.
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

/// What part of the areas of a node's cells counts where they may stand in (`lod::Fill`).
#[inline(always)]
pub(super) fn area_shares<S: Simd>(s: S, node: &Node) -> S::F8 {
    let (from, count) = LEVEL;
    (s.splat8(1.0) - s.fields8(&node.slabs, from, count) * s.splat8(LESS)).max(s.splat8(LEAST))
}

/// Those of eight cells in memory: of each slab the axis and the planes.
pub(super) struct Eight([[[f32; 8]; 5]; 2]);

impl Eight {
    pub const NONE: Self = Self([[[0.0; 8]; 5]; 2]);

    /// Those of a node's cells.
    #[inline(always)]
    pub fn of<S: Simd>(s: S, node: &Node) -> Self {
        let mut eight = Self::NONE;
        eight.set(&of_node(s, node));
        eight
    }

    /// Takes over slabs.
    #[inline(always)]
    pub fn set<L: Lanes<8>>(&mut self, slabs: &OrientedSlabs<L>) {
        for which in 0..2 {
            let OrientedSlab { axis, low, high } = slabs[which];
            self.0[which] =
                [axis[0].to_array(), axis[1].to_array(), axis[2].to_array(), low.to_array(), high.to_array()];
        }
    }

    /// All of them, a lane each.
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

    /// That of the cell in `slot`, in all lanes.
    #[inline(always)]
    pub fn one<S: Simd>(&self, s: S, slot: usize) -> OrientedSlabs<S::F16> {
        let ([a, b], i) = (&self.0, slot & 7);
        let axis = [s.splat16(a[0][i]), s.splat16(a[1][i]), s.splat16(a[2][i])];
        let one = OrientedSlab { axis, low: s.splat16(a[3][i]), high: s.splat16(a[4][i]) };
        let axis = [s.splat16(b[0][i]), s.splat16(b[1][i]), s.splat16(b[2][i])];
        [one, OrientedSlab { axis, low: s.splat16(b[3][i]), high: s.splat16(b[4][i]) }]
    }
}
