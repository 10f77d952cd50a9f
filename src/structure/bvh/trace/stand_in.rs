//! Where a cell stands in for what it holds, and what a ray meets of it.
//!
//! The test is written once, over any number of lanes, with operations that round alike everywhere: single rays,
//! packets and streams, on any instruction set, see the same stand-ins to the bit. What walks visit does not depend on
//! it otherwise: their own box tests give way by as much at least (see [`super::PreparedRay::new`]), and cells nest as
//! stored, so whoever meets a cell here has met all cells above it there.
//!
//! Metric: Áfra 2012, section 6.2, compares the radius of the enclosing sphere; here it is the area of the cell's own
//! projection along the ray, the sum of |dir| times the areas of its faces, with the square of the ray's width.
//!
//! What is shown of a cell is met where the ray enters it and both of its voxel's slabs (`cell_slabs.rs`); who misses them misses
//! what the cell holds, for certain, and passes. Of cells that are no walls some of those that do not miss them pass too (`pass.rs`).
//! Only rays that begin in a cell do not ask for slabs.
//!
//! A plane `p` is met at `((p - slack) - org) * inv` at the earliest. The two differences and the product are rounded once
//! each and `inv` once, on magnitudes of at most `2 m` with `m = max(|org|, reach)`: `7 h m |inv|` in all, `h = 2^-24`.

use super::{PartFilter, TreeView};
use super::ray::abs;
use super::walk::TriHit;
use crate::simd::{Lanes, Mask};
use crate::structure::bvh::layout::{Block, Child, Node, WIDTH};

/// How much larger a cell is taken, as a part of the greatest magnitude of a coordinate: 7 h for rounding (see the module), the
/// rest as in [`super::ray::BOX_SLACK`], for packets test the boxes of triangles so too.
pub(super) const SLACK: f32 = 32.0 / 16_777_216.0;

/// In [`TriHit::tri`]: a stand-in, as fine as asked for or finer.
const LOD: u32 = 1 << 31;
/// A stand-in for a block that is not in memory.
const MISSING: u32 = 1 << 30;
/// Of those, one that the ray begins in: `t` is where it begins, for nothing is known of what is nearest from there on.
const INSIDE: u32 = 1 << 29;
/// The bits of which a triangle has none.
pub(super) const FLAGS: u32 = LOD | MISSING | INSIDE;

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
    /// Magnitudes of the direction; or, with faces of the same sign, the direction.
    pub dir: [L; 3],
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

/// How far planes give way for a ray with origin `org` along an axis on which it goes as `inv` is signed: what is taken from
/// those that are met first, and added to those that are met last.
#[inline(always)]
pub(super) fn slack(org: f32, inv: f32, reach: f32) -> f32 {
    (org.abs().max(reach) * SLACK).copysign(inv)
}

/// The areas of cells' faces between planes as stored.
#[inline(always)]
pub(super) fn faces<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], zero: L) -> [L; 3] {
    let x = abs(zero, far[0] - near[0]);
    let y = abs(zero, far[1] - near[1]);
    let z = abs(zero, far[2] - near[2]);
    [y * z, z * x, x * y]
}

/// What they count for where cells may stand in: see [`super::cell_slabs::area_shares`].
#[inline(always)]
pub(super) fn counted<const N: usize, L: Lanes<N>>(faces: [L; 3], share: L) -> [L; 3] {
    [faces[0] * share, faces[1] * share, faces[2] * share]
}

/// The sum of the areas of a cell's faces, each times |dir| across it.
#[inline(always)]
pub(super) fn area<const N: usize, L: Lanes<N>>(faces: [L; 3], dir: [L; 3]) -> L {
    dir[0] * faces[0] + dir[1] * faces[1] + dir[2] * faces[2]
}

/// Where rays enter cells and where they leave them; of cells that are larger by what single precision may do to where planes
/// are met. So where one is entered is no farther than where the ray enters the cell itself, and at most that much outside of it.
#[inline(always)]
pub(super) fn cross<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], inv: [L; 3]) -> [L; 2] {
    let enter = (near[0] * inv[0]).max(near[1] * inv[1]).max(near[2] * inv[2]);
    let leave = (far[0] * inv[0]).min(far[1] * inv[1]).min(far[2] * inv[2]);
    [enter, leave]
}

/// What is decided of cells by where rays cross them.
#[inline(always)]
pub(super) fn meet<const N: usize, L: Lanes<N>>([enter, leave]: [L; 2], faces: [L; 3], ray: &ConeRay<L>) -> Met<L> {
    let t = enter.max(ray.t_min);
    let width = ray.a + ray.b * t;
    let meets = t.le(leave).bits();
    let outside = meets & !enter.le(ray.t_min).bits();
    let small = outside & area(faces, ray.dir).le(width * width).bits();
    Met { meets, outside, small, enter: t }
}

/// The children of a node that are leaves.
#[inline(always)]
pub(super) fn leaves(node: &Node) -> u32 {
    let mut leaves = 0;
    for slot in 0..WIDTH {
        leaves |= u32::from(Child::is_leaf(u32::from(node.child[slot]))) << slot;
    }
    leaves & u32::from(node.valid)
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
        match Child::from_bits(child) {
            Some(Child::External(at)) => Some(block.external(at).0),
            Some(Child::Leaf(_)) => Some(hit.block + self.leaves_at),
            _ => None,
        }
    }
}
