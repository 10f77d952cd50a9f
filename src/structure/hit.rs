//! Results of walks: the hit of a ray in a tree, and the data that a structure returns for a hit.
//!
//! A hit names a block and an item of that block. The meaning of the item belongs to the structure: a triangle, a point
//! of a patch, or a cell shown as a stand-in. The modules above pass the hit back to the structure that made it
//! ([`super::Tree::triangle`], [`super::Tree::surfaces`], [`super::Tree::cells`]).

use crate::base::ids::BlockId;
use glam::Vec3;

/// State of a walk after a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The walk has ended and holds the result.
    Done,
    /// The walk needs this block. The caller calls again with the same walk once the block is in memory. One step may
    /// need up to four blocks at the same time, which it requests one after the other. A batch therefore keeps the last
    /// four blocks that it requested in memory.
    Pending(BlockId),
    /// The walk is at the member with this number of a tree over members ([`super::Members`]). The caller traces the
    /// ray there, shortens the walk by the hit that it found, and calls again.
    Member(u32),
}

/// Hit of a ray in a tree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriHit {
    /// Distance in units of the length of the ray's direction.
    pub t: f32,
    /// Barycentric weight of the second vertex.
    pub u: f32,
    /// Barycentric weight of the third vertex.
    pub v: f32,
    /// The block that holds the triangle or cell that was hit; `u32::MAX` if there is no hit.
    pub block: u32,
    /// Index of the triangle or cell in the block, as the structure counts. The upper bits are those of
    /// [`Self::FLAGS`].
    pub tri: u32,
}

impl TriHit {
    /// Orders the triangles of a tree: by block, then by item.
    #[inline]
    pub(super) fn place(&self) -> (u32, u32) {
        (self.block, self.tri)
    }

    /// No hit up to `t_max`.
    pub const fn none(t_max: f32) -> Self {
        Self { t: t_max, u: 0.0, v: 0.0, block: u32::MAX, tri: 0 }
    }

    /// True if there is a hit.
    #[inline(always)]
    pub fn is_hit(&self) -> bool {
        self.block != u32::MAX
    }
}

/// Work done by walks. Walks add to these counters and never reset them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Nodes visited, each with one test of its children's boxes.
    pub nodes: u64,
    /// Leaves visited.
    pub leaves: u64,
    /// Cache lines that these leaves occupy.
    pub leaf_lines: u64,
    /// Triangles tested.
    pub triangles: u64,
    /// Number of times that a walk went from one block to another.
    pub blocks: u64,
    /// Hits at equal distance that primitive ids had to decide.
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

/// Flag in [`TriHit::tri`]: a stand-in that satisfies the ray's threshold.
const LOD: u32 = 1 << 31;
/// Flag: a stand-in for a block that is not in memory.
const MISSING: u32 = 1 << 30;
/// Flag, only together with [`MISSING`]: the ray begins inside of the cell. `t` is then where the ray begins, because
/// the nearest surface from there on is unknown.
const INSIDE: u32 = 1 << 29;

/// A stand-in that was hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StandIn {
    /// Index of the cell in the block, as the structure counts.
    pub(super) item: u32,
    /// True if the block below is not in memory.
    pub is_missing: bool,
    /// True if the ray begins in the cell. `t` is then where the ray begins, and the cell is shown where the ray leaves
    /// it.
    pub is_inside: bool,
}

impl StandIn {
    /// The stand-in encoded as [`TriHit::tri`].
    #[inline(always)]
    pub(super) fn code(self) -> u32 {
        self.item | if self.is_missing { MISSING } else { LOD } | if self.is_inside { INSIDE } else { 0 }
    }
}

impl TriHit {
    /// The bits of [`TriHit::tri`] that mark stand-ins. An original triangle has none of them.
    pub(super) const FLAGS: u32 = LOD | MISSING | INSIDE;

    /// Returns the stand-in if the hit is one.
    #[inline(always)]
    pub fn stand_in(&self) -> Option<StandIn> {
        if self.tri & Self::FLAGS == 0 || !self.is_hit() {
            return None;
        }
        let (is_missing, is_inside) = (self.tri & MISSING != 0, self.tri & INSIDE != 0);
        Some(StandIn { item: self.tri & !Self::FLAGS, is_missing, is_inside })
    }

    /// Replaces `best` if this stand-in is better: nearer, or first by [`TriHit::untie`].
    #[inline(always)]
    pub(super) fn offer_to(self, best: &mut Self) {
        if self.t < best.t || self.t == best.t && (!best.is_hit() || self.untie(best) == Some(true)) {
            *best = self;
        }
    }

    /// Decides a tie in which this hit or `best` is a stand-in: true if this hit wins at the same distance. Returns
    /// `None` if both are triangles. The decision uses flags, blocks and items, so it does not depend on the order of
    /// visits.
    #[inline(always)]
    pub(super) fn untie(&self, best: &Self) -> Option<bool> {
        let key = |h: &Self| (h.tri & Self::FLAGS, h.block, h.tri);
        ((self.tri | best.tri) & Self::FLAGS != 0).then(|| key(self) < key(best))
    }
}

/// Where a hit lies on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InFace {
    /// Primitive id of the face.
    pub face: u32,
    /// A face with other than four corners consists of a quad at each: the corner of the hit's, as the face's vertices
    /// are ordered. 0 for a face with four.
    pub corner: u32,
    /// Parameters in the face, or in that quad, from 0 to 1.
    pub uv: [f32; 2],
}

/// The original triangle that a hit lies on, as stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Corners relative to the tree's origin.
    pub vertices: [Vec3; 3],
    /// The tree's local part.
    pub part: u32,
}
