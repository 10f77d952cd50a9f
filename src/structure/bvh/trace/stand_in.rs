//! Where a cell stands in for what it holds, and what a ray meets of it.
//!
//! The test is written once, over any number of lanes, with operations that round alike everywhere: single rays,
//! packets and streams, on any instruction set, see the same stand-ins to the bit. What walks visit does not depend on
//! it otherwise: their own box tests give way by more than this one (see [`super::PreparedRay::new`]), and cells nest as
//! stored, so whoever meets a cell here has met all cells above it there.
//!
//! Metric: Áfra 2012, section 6.2, compares the radius of the enclosing sphere; here it is the area of the cell's own
//! projection along the ray, the sum of |dir| times the areas of its faces, with the square of the ray's width.

use super::{PartFilter, TreeView};
use super::ray::abs;
use super::walk::TriHit;
use crate::simd::{Lanes, Mask};
use crate::structure::bvh::layout::Block;

/// What a plane's distance may be off by here, as a part of the greatest magnitude of a coordinate over the direction:
/// three roundings and that of the reciprocal, on twice the magnitude: 7 times 2^-24; 8 are given.
pub(super) const CELL_SLACK: f32 = 8.0 / 16_777_216.0;

/// In [`TriHit::tri`]: a stand-in, as fine as asked for or finer.
const LOD: u32 = 1 << 31;
/// A stand-in for a block that is not in memory.
const MISSING: u32 = 1 << 30;
/// Of those, one that the ray begins in: `t` is where it begins, for nothing is known of what is nearest from there on.
const INSIDE: u32 = 1 << 29;
const FLAGS: u32 = LOD | MISSING | INSIDE;

/// A stand-in that was hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StandIn {
    /// The node that the cell hangs in.
    pub node: usize,
    /// Its slot there.
    pub slot: usize,
    /// For want of the block below.
    pub is_missing: bool,
    /// The ray begins in it: `t` is where it begins, to be shown where it leaves it.
    pub is_inside: bool,
}

impl TriHit {
    /// The stand-in that was hit, if it was one.
    #[inline(always)]
    pub fn stand_in(&self) -> Option<StandIn> {
        if self.tri & FLAGS == 0 || !self.is_hit() {
            return None;
        }
        let place = (self.tri & !FLAGS) as usize;
        let (is_missing, is_inside) = (self.tri & MISSING != 0, self.tri & INSIDE != 0);
        Some(StandIn { node: place >> 3, slot: place & 7, is_missing, is_inside })
    }
}

/// [`TriHit::tri`] of the cell in `slot` of a node.
#[inline(always)]
pub(super) fn lod_code(node: usize, slot: usize) -> u32 {
    LOD | (node << 3 | slot) as u32
}

/// The same, where the block below is missing; `is_inside`: the ray begins in the cell.
#[inline(always)]
pub(super) fn missing_code(node: usize, slot: usize, is_inside: bool) -> u32 {
    MISSING | if is_inside { INSIDE } else { 0 } | (node << 3 | slot) as u32
}

/// Whether either is a stand-in: then `hit` is better than `best`, at the same distance, by its place.
#[inline(always)]
pub(super) fn untie(hit: &TriHit, best: &TriHit) -> Option<bool> {
    let key = |h: &TriHit| (h.tri & FLAGS, h.block, h.tri);
    ((hit.tri | best.tri) & FLAGS != 0).then(|| key(hit) < key(best))
}

/// Rays as the test needs them: many of them, or one in all lanes.
#[derive(Clone, Copy)]
pub(super) struct ConeRay<L> {
    pub org: [L; 3],
    pub inv: [L; 3],
    /// Magnitudes of the direction.
    pub dir: [L; 3],
    /// See [`CELL_SLACK`].
    pub slack: [L; 3],
    pub t_min: L,
    /// Width, see [`super::LocalRay::cone`].
    pub a: L,
    pub b: L,
}

/// What rays meet of cells.
pub(super) struct Met<L> {
    /// Lanes that meet the cell.
    pub meets: u32,
    /// Of those, lanes that begin outside.
    pub outside: u32,
    /// Of those, lanes for which it may stand in.
    pub small: u32,
    /// Where the ray enters the cell, where it begins if that is later.
    pub enter: L,
}

/// The sum of the areas of a cell's faces, each times |dir| across it.
#[inline(always)]
pub(super) fn area<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], dir: [L; 3], zero: L) -> L {
    let x = abs(zero, far[0] - near[0]);
    let y = abs(zero, far[1] - near[1]);
    let z = abs(zero, far[2] - near[2]);
    dir[0] * (y * z) + dir[1] * (z * x) + dir[2] * (x * y)
}

/// The test. `near` and `far`: planes as stored, rounded once, by the sign of the ray's direction.
#[inline(always)]
pub(super) fn meet<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], ray: &ConeRay<L>, zero: L, infinity: L) -> Met<L> {
    let mut enter = zero - infinity;
    let (mut surely_in, mut surely_out) = (zero - infinity, infinity);
    let mut axis = 0;
    while axis < 3 {
        let from = (near[axis] - ray.org[axis]) * ray.inv[axis];
        let to = (far[axis] - ray.org[axis]) * ray.inv[axis];
        // In this order a NaN leaves things as they were.
        enter = from.max(enter);
        surely_in = (from - ray.slack[axis]).max(surely_in);
        surely_out = (to + ray.slack[axis]).min(surely_out);
        axis += 1;
    }
    // Along an axis that the ray hardly moves on, numbers are beyond all use where it runs in the plane of a side: what
    // is given way to bounds them.
    let t = enter.min(surely_out).max(ray.t_min);
    let width = ray.a + ray.b * t;
    let meets = surely_in.le(surely_out).bits() & ray.t_min.le(surely_out).bits();
    let outside = meets & !surely_in.le(ray.t_min).bits();
    let small = outside & area(near, far, ray.dir, zero).le(width * width).bits();
    Met { meets, outside, small, enter: t }
}

/// What parts have to say about a cell that could stand in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It may.
    Stand,
    /// It holds a part that is hidden, or looks otherwise, among others.
    Descend,
    /// All that it holds is hidden.
    Skip,
}

/// Whether parts allow the cell in `slot` of a node to stand in.
#[inline(always)]
pub(super) fn judge(block: Block, node: usize, slot: usize, filter: Option<&PartFilter>) -> Verdict {
    match filter {
        None => Verdict::Stand,
        Some(filter) => judge_parts(block, node, slot, filter),
    }
}

#[inline(never)]
fn judge_parts(block: Block, node: usize, slot: usize, filter: &PartFilter) -> Verdict {
    let voxel = block.voxel(node, slot);
    match voxel.part() {
        (part, false) if filter.hides(part) => Verdict::Skip,
        (_, false) => Verdict::Stand,
        (_, true) if voxel.summary() & filter.touched == 0 => Verdict::Stand,
        (_, true) => Verdict::Descend,
    }
}

impl<'a> TreeView<'a> {
    /// The block that a stand-in of `hit` stands in for, if that is missing.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        let stand_in = hit.stand_in().filter(|s| s.is_missing)?;
        let block = Block::new(self.snapshot.block(crate::base::ids::BlockId(hit.block))?);
        let child = u32::from(block.node(stand_in.node).child[stand_in.slot]);
        match crate::structure::bvh::layout::Child::from_bits(child) {
            Some(crate::structure::bvh::layout::Child::External(i)) => Some(block.external(i).0),
            _ => None,
        }
    }
}
