//! Rays in, hits out, over the blocks of one snapshot.
//!
//! A hit is the least `(t, primitive id)` over all triangles that the watertight test accepts. Box
//! tests are conservative, so the order of visits, the instruction set and whether rays go alone or
//! in packets change what is visited, not the hit. The exception: a sliver met edge-on, whose single-precision
//! `t` falls outside of its own box (`tests/exact.rs` bounds how often).

mod ahead;
mod bundle;
mod bundle_leaf;
mod cell_slabs;
mod cells;
mod gauge;
mod packet;
mod packet_cells;
mod packet_few;
mod packet_leaf;
mod packet_prepare;
mod packet_visit;
mod pass;
mod ray;
mod rays16;
mod single;
mod stand_in;
mod stream;
mod stream_pass;
mod stream_start;
mod tables;
mod walk;

pub use bundle::{BUNDLE, Bundle};
pub use packet::{PACKET, PacketWalk, first_rays};
pub use ray::{LocalRay, PreparedRay, USUAL_DIRS};
pub use stand_in::StandIn;
pub use stream::{STREAM, Stream};
pub use walk::{Counters, Outcome, TriHit, Walk};

use super::layout::{Block, Child, WIDTH};
use super::leaf::Leaf;
use crate::base::ids::BlockId;
use crate::math::Bounds;
use crate::residency::Snapshot;
use crate::simd::Isa;
use glam::Vec3;

/// What rays pass through.
#[derive(Debug, Clone, Copy, Default)]
pub struct PartFilter<'a> {
    /// Bit `i % 64` of word `i / 64`: the model's part `i` is hidden. Parts beyond are visible.
    pub hidden: &'a [u64],
    /// The model's part that the tree's local part 0 is here.
    pub first_part: u32,
    /// The bits (`lod::summary_bit`) of all local parts that are hidden or look otherwise than in the file: a cell
    /// with one of them among others does not stand in.
    pub touched: u32,
    /// What is asked of each hit besides, if anything. Only walks of single rays ask.
    pub within: Option<&'a dyn Within>,
}

/// Who knows better than single precision what is within a ray's interval.
pub trait Within: std::fmt::Debug + Sync {
    /// Whether a triangle that is met at `t` is.
    fn triangle(&self, triangle: &Triangle, t: f32) -> bool;
    /// Whether a cell that is met at `t` is: else what it holds is asked.
    fn cell(&self, t: f32) -> bool;
    /// Whether what is met at `t` is behind where the ray ends.
    fn is_beyond(&self, t: f32) -> bool;
}

impl PartFilter<'_> {
    /// Whether a local part is hidden.
    #[inline]
    pub fn hides(&self, local_part: u32) -> bool {
        let part = u64::from(self.first_part) + u64::from(local_part);
        self.hidden.get((part / 64) as usize).is_some_and(|word| word >> (part % 64) & 1 == 1)
    }

    /// Whether rays pass through triangle `i` of a leaf, which is met at `t`.
    #[inline]
    fn passes(&self, block: Block, leaf: &Leaf, i: usize, t: f32) -> bool {
        let part = || block.part(leaf.part_of(i));
        self.hides(part()) || self.within.is_some_and(|within| !within.triangle(&Triangle { vertices: leaf.triangle(i), part: part() }, t))
    }
}

/// A triangle as stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Corners, around the tree's origin.
    pub vertices: [Vec3; 3],
    /// Local part.
    pub part: u32,
}

/// One tree of a model in one snapshot. Cheap to make; borrow it for as long as the job lasts.
#[derive(Debug, Clone, Copy)]
pub struct TreeView<'a> {
    /// Which blocks are in memory.
    pub snapshot: &'a Snapshot,
    /// Block of the root.
    pub root_block: u32,
    /// Child reference to the root in it; [`TreeView::EMPTY`] for a tree without triangles.
    pub root: u32,
    /// Greatest magnitude of a coordinate of the tree.
    pub reach: f32,
    /// What to add to a fine block's id for the id of its leaf block; 0 for a tree of one block.
    pub leaves_at: u32,
    /// What to add to a block's id for the id of the block with its primitive ids.
    pub prims_at: u32,
    /// The same for its colours; `None` if the model has none.
    pub colours_at: Option<u32>,
    /// Vectors to trace with.
    pub isa: Isa,
    /// Whether cells stand in for blocks that are not in memory. Else walks ask for these.
    pub never_waits: bool,
    /// Whether no ray passes a cell that stands in: what is hit then has nothing before it.
    pub is_solid: bool,
    /// The pass that visits: blocks that it uses stay while it is stood on.
    pub stamp: u32,
}

/// What is left of a visit to the leaves of a tree: blocks, and what in them.
#[derive(Debug, Clone, Default)]
pub struct LeafSweep {
    left: Vec<(u32, u32)>,
}

impl LeafSweep {
    /// Of the whole tree.
    pub fn new(view: &TreeView) -> Self {
        let root = (!view.is_empty()).then_some((view.root_block, view.root));
        Self { left: root.into_iter().collect() }
    }

    /// The blocks that it waits for; some may be named several times.
    pub fn missing(&self) -> impl Iterator<Item = BlockId> {
        self.left.iter().map(|&(id, _)| BlockId(id))
    }
}

impl TreeView<'_> {
    /// Root reference of a tree without triangles.
    pub const EMPTY: u32 = u32::MAX;

    /// Whether the tree has no triangles.
    pub fn is_empty(&self) -> bool {
        self.root == Self::EMPTY
    }

    /// The words of a block that a walk goes through, if it is in memory.
    #[inline(always)]
    fn visit(&self, block: u32) -> Option<&[u32]> {
        self.snapshot.visit(BlockId(block), self.stamp)
    }

    /// The block that a child reference of block `id` counts words or nodes in.
    #[inline(always)]
    fn home_of(&self, id: u32, child: u32) -> u32 {
        id + if Child::is_leaf(child) { self.leaves_at } else { 0 }
    }

    /// Whether the leaves below the nodes of a fine block are not in memory. Of coarse blocks, over no leaves, it says nothing.
    #[inline(always)]
    fn lacks_leaves(&self, id: u32) -> bool {
        self.snapshot.block(BlockId(id + self.leaves_at)).is_none()
    }

    /// Finds the closest hit of the ray that `walk` has begun (or goes on after `Pending`).
    pub fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        single::run::<false>(self, filter, walk)
    }

    /// Finds any hit of the ray that `walk` has begun (or goes on after `Pending`).
    pub fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        single::run::<true>(self, filter, walk)
    }

    #[inline(always)]
    fn leaf_of(&self, hit: &TriHit) -> Option<(Block<'_>, Leaf<'_>, usize)> {
        let block = Block::new(self.snapshot.block(BlockId(hit.block))?);
        Some((block, block.leaf((hit.tri >> 3) as usize), (hit.tri & 7) as usize))
    }

    /// The triangle of a hit; `None` if its block has left the snapshot. Always inlined: as a call it would write the
    /// struct in small pieces and read it in large ones, which stalls.
    #[inline(always)]
    pub fn triangle(&self, hit: &TriHit) -> Option<Triangle> {
        let (block, leaf, index) = self.leaf_of(hit)?;
        Some(Triangle { vertices: leaf.triangle(index), part: block.part(leaf.part_of(index)) })
    }

    /// The primitive id of a hit, or the block that is needed for it.
    pub fn prim(&self, hit: &TriHit) -> Result<u32, BlockId> {
        self.beside(hit, self.prims_at)
    }

    /// The sRGB colour of a hit's triangle, or the block that is needed; `None` if the model has none.
    pub fn colour(&self, hit: &TriHit) -> Result<Option<[u8; 4]>, BlockId> {
        let Some(at) = self.colours_at else { return Ok(None) };
        self.beside(hit, at).map(|c| Some(c.to_le_bytes()))
    }

    /// The word of a hit's triangle in a block beside its own.
    fn beside(&self, hit: &TriHit, offset: u32) -> Result<u32, BlockId> {
        let Some((_, leaf, index)) = self.leaf_of(hit) else { return Err(BlockId(hit.block)) };
        let id = BlockId(hit.block + offset);
        let words = self.visit(id.0).ok_or(id)?;
        // Only a file made up to be wrong has fewer words than its block has triangles.
        Ok(words.get(leaf.first + index).copied().unwrap_or(u32::MAX))
    }

    /// Visits the triangles of all leaves whose boxes `descend` accepts; the first missing block ends it.
    ///
    /// `descend` gets boxes around the tree's origin, rounded outward. A triangle that spatial splits
    /// put into several leaves is visited several times.
    pub fn for_each_leaf(
        &self,
        descend: &mut dyn FnMut(&Bounds) -> bool,
        visit: &mut dyn FnMut(&TriHit, &Triangle),
    ) -> Result<(), BlockId> {
        let mut sweep = LeafSweep::new(self);
        self.sweep_leaves(&mut sweep, descend, visit);
        sweep.missing().next().map_or(Ok(()), Err)
    }

    /// Visits the leaves that are in memory of those that `sweep` has still to visit, like [`TreeView::for_each_leaf`]; it
    /// has ended when nothing is [missing](LeafSweep::missing). Call it again with the same sweep once some of that is
    /// there.
    pub fn sweep_leaves(
        &self,
        sweep: &mut LeafSweep,
        descend: &mut dyn FnMut(&Bounds) -> bool,
        visit: &mut dyn FnMut(&TriHit, &Triangle),
    ) {
        let mut stack = std::mem::take(&mut sweep.left);
        while let Some((id, child)) = stack.pop() {
            match self.snapshot.block(BlockId(id)) {
                Some(words) => self.visit_child(Block::new(words), id, child, &mut stack, descend, visit),
                None => sweep.left.push((id, child)),
            }
        }
    }

    fn visit_child(
        &self,
        block: Block,
        id: u32,
        child: u32,
        stack: &mut Vec<(u32, u32)>,
        descend: &mut dyn FnMut(&Bounds) -> bool,
        visit: &mut dyn FnMut(&TriHit, &Triangle),
    ) {
        match Child::from_bits(child) {
            Some(Child::External(at)) => stack.push(block.external(at)),
            Some(Child::Node(i)) => {
                let node = block.node(i);
                for slot in (0..WIDTH).rev().filter(|s| node.valid >> s & 1 == 1) {
                    if descend(&node.child_box(slot)) {
                        let child = u32::from(node.child[slot]);
                        stack.push((self.home_of(id, child), child));
                    }
                }
            }
            Some(Child::Leaf(at)) => {
                let leaf = block.leaf(at);
                for i in 0..leaf.triangles {
                    let hit = TriHit { block: id, tri: (at as u32) << 3 | i as u32, ..TriHit::none(0.0) };
                    let part = block.part(leaf.part_of(i));
                    visit(&hit, &Triangle { vertices: leaf.triangle(i), part });
                }
            }
            None => {}
        }
    }
}
