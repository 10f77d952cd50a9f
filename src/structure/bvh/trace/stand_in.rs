//! Stand-ins: decides if a cell (the stored box and the voxel of a child) may stand in for its content, and where a ray
//! enters it.
//!
//! The test is written once, over any number of lanes, with operations that round alike everywhere. So single rays,
//! packets and streams find the same stand-ins to the bit, on any instruction set. The nodes that a walk visits do not
//! matter: its box tests have at least as much slack (see [`super::PreparedRay::new`]), and cells nest as stored, so a
//! ray that enters a cell here has entered all cells above it.
//!
//! Metric: Áfra 2012, section 6.2, compares the radius of the enclosing sphere. Here the area of the cell's projection
//! along the ray, the sum of |dir| times the areas of its faces, is compared with the square of the ray's width.
//!
//! A ray enters a stand-in where it has entered the cell and both oriented slabs of its voxel (`oriented_slabs.rs`). A
//! ray that misses the slabs misses the content for certain, and goes on. Cells that are not walls also transmit some
//! of the other rays (`coverage.rs`). For a ray that begins inside a cell the slabs are not tested.

use super::hit::{StandIn, TriHit};
use super::kernel::Here;
use super::{PartFilter, TreeView};
use crate::simd::{Lanes, Mask};
use crate::structure::bvh::layout::{Block, Child, Node, WIDTH};
use crate::structure::cell::CellParts;
pub(super) use crate::structure::packet_boxes::{area, faces};

/// Returns [`TriHit::tri`] for the cell in `slot` of a node.
#[inline(always)]
pub(super) fn lod_code(node: usize, slot: usize) -> u32 {
    StandIn { item: (node << 3 | slot) as u32, is_missing: false, is_inside: false }.code()
}

/// Returns the hit of a cell, in `slot` of a node, of which only the content is of interest.
pub fn cell_hit(block: u32, node: usize, slot: usize) -> TriHit {
    TriHit { block, tri: lod_code(node, slot), ..TriHit::none(0.0) }
}

/// Returns [`TriHit::tri`] for the cell in `slot` of a node if the block below is not in memory. `is_inside`: the ray
/// begins in the cell.
#[inline(always)]
pub(super) fn missing_code(node: usize, slot: usize, is_inside: bool) -> u32 {
    StandIn { item: (node << 3 | slot) as u32, is_missing: true, is_inside }.code()
}

/// Returns the node of which a stand-in's cell is a child, and the slot of the cell there.
#[inline(always)]
pub(super) fn place_of(stand_in: StandIn) -> (usize, usize) {
    ((stand_in.item >> 3) as usize, (stand_in.item & 7) as usize)
}

/// Rays as the stand-in test needs them: many rays, or one ray in all lanes.
#[derive(Clone, Copy)]
pub(super) struct ConeRay<L> {
    /// Magnitudes of the direction; or the direction itself, if the faces have the same signs.
    pub dir: [L; 3],
    pub t_min: L,
    /// Width of the rays, see [`super::LocalRay::cone`].
    pub a: L,
    pub b: L,
}

/// Result of the test of rays against cells.
pub(super) struct Met<L> {
    /// Lanes of rays that enter the cell.
    pub meets: u32,
    /// Of `meets`, lanes of rays that begin outside the cell.
    pub outside: u32,
    /// Of `outside`, lanes for which the cell is small enough to stand in.
    pub small: u32,
    /// Distance at which the ray enters the cell, or `t_min` if that is greater.
    pub enter: L,
}

/// Returns the areas as they count in the stand-in test, see [`super::oriented_slabs::area_shares`].
#[inline(always)]
pub(super) fn counted<const N: usize, L: Lanes<N>>(faces: [L; 3], share: L) -> [L; 3] {
    [faces[0] * share, faces[1] * share, faces[2] * share]
}

/// Returns the distances at which rays enter and leave cells. The planes are relative to the origin and moved outward
/// by at least the rounding error. So the entry is never beyond the exact one, and before it by at most the slack.
///
/// Rounding error: the distance of a plane `p` is at least `((p - slack) - org) * inv`. The two differences, the
/// product and `inv` are rounded once each, on magnitudes of at most `2 m` with `m = max(|org|, max_coord)`. With `h =
/// 2^-24` that is `7 h m |inv|` in all.
#[inline(always)]
pub(super) fn cross<const N: usize, L: Lanes<N>>(near: [L; 3], far: [L; 3], inv: [L; 3]) -> [L; 2] {
    let enter = (near[0] * inv[0]).max(near[1] * inv[1]).max(near[2] * inv[2]);
    let leave = (far[0] * inv[0]).min(far[1] * inv[1]).min(far[2] * inv[2]);
    [enter, leave]
}

/// Factor that exceeds the relative error of a test of areas and widths with other roundings than those of [`meet`].
pub(super) const MARGIN: f32 = 1.01;

/// The conservative test whether a cell may stand in, made before the entry distance is known. Rays, cells or both are
/// in lanes. `area` is the area of the cells along the rays, and `width` the width of the rays where they leave the
/// cells, or more. A negative result is always right; for the others [`meet`] decides.
#[inline(always)]
pub(super) fn may_stand<const N: usize, L: Lanes<N>>(area: L, width: L, margin: L) -> u32 {
    area.le(width * width * margin).bits()
}

/// Evaluates the stand-in test, given the distances at which rays enter and leave the cells.
#[inline(always)]
pub(super) fn meet<const N: usize, L: Lanes<N>>([enter, leave]: [L; 2], faces: [L; 3], ray: &ConeRay<L>) -> Met<L> {
    let t = enter.max(ray.t_min);
    let width = ray.a + ray.b * t;
    let meets = t.le(leave).bits();
    let outside = meets & !enter.le(ray.t_min).bits();
    // A ray of width 0 gets no cell of area 0, such as a flat one seen edge-on: only triangles may answer exact rays.
    let least = L::from_array_like(width, [f32::MIN_POSITIVE; N]);
    let small = outside & least.max(area(faces, ray.dir)).le(width * width).bits();
    Met { meets, outside, small, enter: t }
}

/// Returns the children of a node that are leaves.
#[inline(always)]
pub(super) fn leaves(node: &Node) -> u32 {
    let mut leaves = 0;
    for slot in 0..WIDTH {
        leaves |= u32::from(Child::is_leaf(u32::from(node.child[slot]))) << slot;
    }
    leaves & u32::from(node.valid)
}

/// The decision of the part filter about a cell that could stand in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The cell may stand in.
    Stand,
    /// The part that covers most of the cell is hidden, and others are visible, or the cell never stands in: the walk
    /// descends.
    Descend,
    /// All parts in the cell are hidden: the walk skips it.
    Skip,
}

/// Decides if the parts in the cell in `slot` of a node allow it to stand in.
#[inline(always)]
pub(super) fn judge(view: &TreeView, here: Here, slot: usize, filter: Option<&PartFilter>) -> Verdict {
    if here.node().never_stands_in(slot) {
        return Verdict::Descend;
    }
    match filter {
        None => Verdict::Stand,
        Some(filter) => judge_parts(view, here, slot, filter),
    }
}

#[inline(never)]
fn judge_parts(view: &TreeView, here: Here, slot: usize, filter: &PartFilter) -> Verdict {
    let voxel = here.block.voxel(here.index, slot);
    let (part, is_mixed) = voxel.part();
    if !filter.hides(part) {
        return Verdict::Stand;
    }
    // A summary has 32 bits for all parts of the model, so that it often has the bit of a visible part which is not in
    // the cell. The visible parts of one block are few.
    let listed = view.shown.map_or(u32::MAX, |shown| shown.bits(lister(here, slot)));
    if is_mixed && voxel.summary() & filter.visible_bits & listed != 0 { Verdict::Descend } else { Verdict::Skip }
}

/// Returns the block whose list of parts has all parts of the cell in `slot` of a node.
fn lister(here: Here, slot: usize) -> u32 {
    match Child::from_bits(u32::from(here.node().child[slot])) {
        Child::External(at) => here.block.external(at).0,
        _ => here.id,
    }
}

impl<'a> TreeView<'a> {
    /// See [`crate::structure::Tree::parts_in_cell`].
    pub fn parts_in_cell(&self, hit: &TriHit) -> Option<CellParts> {
        let block = Block::new(self.snapshot.block(crate::base::ids::BlockId(hit.block))?);
        let (index, slot) = place_of(hit.stand_in()?);
        let voxel = block.voxel(index, slot);
        let (part, is_mixed) = voxel.part();
        let listed_by = lister(Here { block, id: hit.block, index }, slot);
        Some(CellParts { part, is_mixed, summary: voxel.summary(), listed_by, shown: voxel.shown().unwrap_or(0) })
    }

    /// Returns the id of the missing block that the stand-in of `hit` replaces, if there is one.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        let stand_in = hit.stand_in().filter(|s| s.is_missing)?;
        let block = Block::new(self.snapshot.block(crate::base::ids::BlockId(hit.block))?);
        let (node, slot) = place_of(stand_in);
        let child = u32::from(block.node(node).child[slot]);
        match Child::from_bits(child) {
            Child::External(at) => Some(block.external(at).0),
            Child::Leaf(_) => Some(hit.block + self.leaves_at),
            _ => None,
        }
    }
}
