//! What walks answer: where a ray meets a tree, and what a structure says of that place.
//!
//! A hit names its place by a block and an item of that block. The item belongs to the structure: a triangle, a point
//! of a patch, a cell that stands in. Rooms above hand it back to the structure that made it
//! ([`super::Tree::triangle`], [`super::Tree::surfaces`], [`super::Tree::cells`]).

use crate::base::ids::BlockId;
use glam::Vec3;

/// Whether a walk has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The answer is in the walk.
    Done,
    /// This block is needed. Call again with the same walk once it is in memory. A step may need up to four blocks at
    /// once, one after the other: a batch keeps the last four that it has asked for in memory.
    Pending(BlockId),
}

/// Where a ray meets a tree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriHit {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// Weight of the second vertex.
    pub u: f32,
    /// Weight of the third vertex.
    pub v: f32,
    /// The block that holds what is met.
    pub block: u32,
    /// What is met in the block, by the structure's own count; the upper bits are those of [`Self::FLAGS`].
    pub tri: u32,
}

impl TriHit {
    /// No hit up to `t_max`.
    pub const fn none(t_max: f32) -> Self {
        Self { t: t_max, u: 0.0, v: 0.0, block: u32::MAX, tri: 0 }
    }

    /// Whether there is a hit.
    #[inline(always)]
    pub fn is_hit(&self) -> bool {
        self.block != u32::MAX
    }
}

/// What walks did; added up over rays, never reset by them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Nodes whose children's boxes were tested.
    pub nodes: u64,
    /// Leaves visited.
    pub leaves: u64,
    /// Cache lines that these are in.
    pub leaf_lines: u64,
    /// Triangles tested.
    pub triangles: u64,
    /// Times that the walk went from one block to another.
    pub blocks: u64,
    /// Ties that primitive ids had to decide.
    pub ties: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, o: Self) {
        self.nodes += o.nodes;
        self.leaves += o.leaves;
        self.leaf_lines += o.leaf_lines;
        self.triangles += o.triangles;
        self.blocks += o.blocks;
        self.ties += o.ties;
    }
}

/// In [`TriHit::tri`]: a stand-in, as fine as asked for or finer.
const LOD: u32 = 1 << 31;
/// A stand-in for a block that is not in memory.
const MISSING: u32 = 1 << 30;
/// Of those, one that the ray begins in: `t` is where the ray begins, for nothing is known of what is nearest from
/// there on.
const INSIDE: u32 = 1 << 29;

/// A stand-in that was hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StandIn {
    /// Which cell of the block, by the structure's own count.
    pub(super) item: u32,
    /// The block below is not in memory.
    pub is_missing: bool,
    /// The ray begins in the cell: `t` is where it begins, and the cell is shown where the ray leaves it.
    pub is_inside: bool,
}

impl StandIn {
    /// As [`TriHit::tri`].
    #[inline(always)]
    pub(super) fn code(self) -> u32 {
        self.item | if self.is_missing { MISSING } else { LOD } | if self.is_inside { INSIDE } else { 0 }
    }
}

impl TriHit {
    /// The bits of [`TriHit::tri`] that tell stand-ins; an original triangle has none of them.
    pub(super) const FLAGS: u32 = LOD | MISSING | INSIDE;

    /// The stand-in that was hit, if it was one.
    #[inline(always)]
    pub fn stand_in(&self) -> Option<StandIn> {
        if self.tri & Self::FLAGS == 0 || !self.is_hit() {
            return None;
        }
        let (is_missing, is_inside) = (self.tri & MISSING != 0, self.tri & INSIDE != 0);
        Some(StandIn { item: self.tri & !Self::FLAGS, is_missing, is_inside })
    }

    /// Where this or `best` is a stand-in: whether this wins at the same distance. Places decide, so that the order of
    /// visits does not.
    #[inline(always)]
    pub(super) fn untie(&self, best: &Self) -> Option<bool> {
        let key = |h: &Self| (h.tri & Self::FLAGS, h.block, h.tri);
        ((self.tri | best.tri) & Self::FLAGS != 0).then(|| key(self) < key(best))
    }
}

/// The flat piece of original surface that a hit is on: a triangle as stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Corners, around the tree's origin.
    pub vertices: [Vec3; 3],
    /// Local part.
    pub part: u32,
}
