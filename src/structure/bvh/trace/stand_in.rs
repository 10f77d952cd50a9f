//! Where a cell stands in for what it holds, and what a ray meets of it.
//!
//! The test is written once, over any number of lanes, with operations that round alike everywhere: single rays,
//! packets and streams, on any instruction set, see the same stand-ins to the bit. What walks visit does not depend on
//! it otherwise: their own box tests give way by as much at least (see [`super::PreparedRay::new`]), and cells nest as
//! stored, so a ray that meets a cell here has met all cells above it there.
//!
//! Metric: Áfra 2012, section 6.2, compares the radius of the enclosing sphere; here it is the area of the cell's own
//! projection along the ray, the sum of |dir| times the areas of its faces, with the square of the ray's width.
//!
//! What is shown of a cell is met where the ray enters it and both of its voxel's slabs (`oriented_slabs.rs`); a ray
//! that misses them misses all that the cell holds, for certain, and passes. Of cells that are no walls some of those
//! that do not miss them pass too (`coverage.rs`). Only rays that begin in a cell do not ask for slabs.
//!
//! A plane `p` is met at `((p - slack) - org) * inv` at the earliest. The two differences and the product are rounded
//! once each and `inv` once, on magnitudes of at most `2 m` with `m = max(|org|, reach)`: `7 h m |inv|` in all, `h =
//! 2^-24`.

use super::hit::{StandIn, TriHit};
use super::ray::abs;
use super::{PartFilter, TreeView};
use crate::simd::{Lanes, Mask};
use crate::structure::bvh::layout::{Block, Child, Node, WIDTH};

/// [`TriHit::tri`] of the cell in `slot` of a node.
#[inline(always)]
pub(super) fn lod_code(node: usize, slot: usize) -> u32 {
    StandIn { item: (node << 3 | slot) as u32, is_missing: false, is_inside: false }.code()
}

/// The same, where the block below is missing; `is_inside`: the ray begins in the cell.
#[inline(always)]
pub(super) fn missing_code(node: usize, slot: usize, is_inside: bool) -> u32 {
    StandIn { item: (node << 3 | slot) as u32, is_missing: true, is_inside }.code()
}

/// The node that a stand-in's cell hangs in, and its slot there.
#[inline(always)]
pub(super) fn place_of(stand_in: StandIn) -> (usize, usize) {
    ((stand_in.item >> 3) as usize, (stand_in.item & 7) as usize)
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

/// The areas of cells' faces between planes as stored.
#[inline(always)]
pub(super) fn faces<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], zero: L) -> [L; 3] {
    let x = abs(zero, far[0] - near[0]);
    let y = abs(zero, far[1] - near[1]);
    let z = abs(zero, far[2] - near[2]);
    [y * z, z * x, x * y]
}

/// What they count for where cells may stand in: see [`super::oriented_slabs::area_shares`].
#[inline(always)]
pub(super) fn counted<const N: usize, L: Lanes<N>>(faces: [L; 3], share: L) -> [L; 3] {
    [faces[0] * share, faces[1] * share, faces[2] * share]
}

/// The sum of the areas of a cell's faces, each times |dir| across it.
#[inline(always)]
pub(super) fn area<const N: usize, L: Lanes<N>>(faces: [L; 3], dir: [L; 3]) -> L {
    dir[0] * faces[0] + dir[1] * faces[1] + dir[2] * faces[2]
}

/// Where rays enter cells and where they leave them; of cells that are larger by what single precision may do to where
/// planes are met. So where one is entered is no farther than where the ray enters the cell itself, and at most that
/// much outside of it.
#[inline(always)]
pub(super) fn cross<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], inv: [L; 3]) -> [L; 2] {
    let enter = (near[0] * inv[0]).max(near[1] * inv[1]).max(near[2] * inv[2]);
    let leave = (far[0] * inv[0]).min(far[1] * inv[1]).min(far[2] * inv[2]);
    [enter, leave]
}

/// More than a test of areas and widths by other roundings than [`meet`]'s may be off by: a hundredth.
pub(super) const MARGIN: f32 = 1.01;

/// The one test whether a cell may stand in, before it is known where its ray enters it, for rays, cells or both in
/// lanes: cells of `area`, seen along the rays, for rays that are `width` wide where they leave the cells, or wider.
/// Never wrong where it says no; [`meet`] decides.
#[inline(always)]
pub(super) fn may_stand<const N: usize, L: Lanes<N>>(area: L, width: L, margin: L) -> u32 {
    area.le(width * width * margin).bits()
}

/// What is decided of cells by where rays cross them.
#[inline(always)]
pub(super) fn meet<const N: usize, L: Lanes<N>>([enter, leave]: [L; 2], faces: [L; 3], ray: &ConeRay<L>) -> Met<L> {
    let t = enter.max(ray.t_min);
    let width = ray.a + ray.b * t;
    let meets = t.le(leave).bits();
    let outside = meets & !enter.le(ray.t_min).bits();
    // Rays of no width have no use for cells of no area, as flat ones seen edge-on are: only triangles answer them.
    let least = L::from_array_like(width, [f32::MIN_POSITIVE; N]);
    let small = outside & least.max(area(faces, ray.dir)).le(width * width).bits();
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
        let (node, slot) = place_of(stand_in);
        let child = u32::from(block.node(node).child[slot]);
        match Child::from_bits(child) {
            Some(Child::External(at)) => Some(block.external(at).0),
            Some(Child::Leaf(_)) => Some(hit.block + self.leaves_at),
            _ => None,
        }
    }
}
