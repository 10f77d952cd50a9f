//! Ray traversal of the blocks of one snapshot: rays in, hits out.
//!
//! A hit is the least `(t, primitive id)` over all triangles that the watertight test accepts. Box tests are
//! conservative. The order of visits, the instruction set, and the choice between single rays, packets and streams
//! therefore change which nodes are visited, but not the hit. The one exception is a sliver hit edge-on: its
//! single-precision `t` may fall outside its own box (`tests/exact.rs` bounds how often).

mod ahead;
mod bundle;
mod bundle_leaf;
mod oriented_slabs;
mod cells;
mod slab_heuristic;
mod kernel;
mod packet_cells;
mod packet_few;
mod packet_leaf;
mod packet_visit;
mod proxies;
mod rows;
mod coverage;
mod single;
mod stand_in;
mod stream;
mod stream_step;
mod stream_start;
mod tables;

pub use bundle::Bundle;
pub(in crate::structure) use slab_heuristic::SlabHeuristic;
pub(super) use stand_in::cell_hit;
pub(in crate::structure) use stream::{Stack, StreamLanes};

use super::codec_leaves::leaves_in_order;
use super::layout::{Block, Child, HEADER_WORDS, MAX_NODES, NODE_WORDS, WIDTH};
use super::leaf::Leaf;
use super::normals;
use crate::base::ids::BlockId;
use crate::residency::Snapshot;
use crate::simd::Isa;
use crate::store::Proxies;
use crate::structure::cursor::Below;
use crate::structure::filter::{PartFilter, ShownBlocks};
use crate::structure::hit::{self, Counters, Outcome, TriHit, Triangle};
use crate::structure::packet_triangles::Ties;
use crate::structure::place::{Place, Rooted};
use crate::structure::prepared::PreparedRay;
use crate::structure::streams::colours_of;
use crate::structure::walk::{self, Walk};
use crate::structure::{packet, packet_prepare};
use glam::Vec3;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// One tree of a model in one snapshot. It is cheap to create; borrow it for as long as the job lasts.
#[derive(Debug, Clone, Copy)]
pub struct TreeView<'a> {
    /// The blocks in memory.
    pub snapshot: &'a Snapshot,
    /// Id of the block that holds the root.
    pub root_block: u32,
    /// Child reference to the root within `root_block`; [`TreeView::EMPTY`] for a tree without triangles.
    pub root: u32,
    /// Greatest magnitude of a coordinate of the tree.
    pub max_coord: f32,
    /// Offset from the id of a fine block to the id of its leaf block; 0 for a tree of one block.
    pub leaves_at: u32,
    /// Offset from the id of a block to the id of the block that holds its primitive ids.
    pub prims_at: u32,
    /// Offset from the id of a block to the id of the block that holds its colours; `None` if the model has none.
    pub colours_at: Option<u32>,
    /// Offset from the id of a block to the id of the block that holds its normals; `None` if each triangle's is its
    /// own.
    pub normals_at: Option<u32>,
    /// Instruction set to trace with.
    pub isa: Isa,
    /// True if cells stand in for blocks that are not in memory. Otherwise a walk that needs such a block returns
    /// [`Outcome::Pending`].
    pub accept_missing: bool,
    /// True if places decide ties between triangles whose primitive ids are not in memory. Otherwise a walk that meets
    /// such a tie returns [`Outcome::Pending`].
    pub ties_by_place: bool,
    /// Stamp of the pass that traces. Blocks with the stamp of a live pass are not evicted.
    pub stamp: u32,
    /// Blocks that walks pass by, because all parts in and below them are hidden. Walks find [`NOTHING`] there.
    pub shown: Option<&'a ShownBlocks>,
    /// True for a tree over members: streams leave all its rays unfinished.
    pub has_members: bool,
    /// The model's proxies, which give stand-ins their look; `None` if it has none.
    pub proxies: Option<&'a Proxies>,
    /// Once it is set, every block counts as missing.
    pub stop: &'a AtomicBool,
}

/// A block of nodes without children, as walks read it.
static NOTHING: [u32; HEADER_WORDS + MAX_NODES * NODE_WORDS] = [0; HEADER_WORDS + MAX_NODES * NODE_WORDS];

impl TreeView<'_> {
    /// Root reference of a tree without triangles.
    pub const EMPTY: u32 = u32::MAX;

    /// True if the tree has no triangles.
    pub fn is_empty(&self) -> bool {
        self.root == Self::EMPTY
    }

    /// Returns the words of a block if it is in memory, and stamps the block as used. Every walk comes here when it
    /// enters a block, so a walk that is stopped ends soon.
    #[inline(always)]
    fn visit(&self, block: u32) -> Option<&[u32]> {
        if self.stop.load(Relaxed) {
            return None;
        }
        if self.passes_by(block) {
            return Some(&NOTHING);
        }
        self.snapshot.visit(BlockId(block), self.stamp)
    }

    /// Returns the words of a block if it is in memory, without a stamp.
    #[inline(always)]
    fn words(&self, block: u32) -> Option<&[u32]> {
        if self.passes_by(block) {
            return Some(&NOTHING);
        }
        self.snapshot.block(BlockId(block))
    }

    #[inline(always)]
    fn passes_by(&self, block: u32) -> bool {
        self.shown.is_some_and(|shown| shown.lacks(block))
    }

    /// Returns the id of the block that `child` points into. `child` is a reference in block `id`.
    #[inline(always)]
    fn home_of(&self, id: u32, child: u32) -> u32 {
        id + if Child::is_leaf(child) { self.leaves_at } else { 0 }
    }

    /// True if the leaf block of the fine block `id` is not in memory. The result has no meaning for a coarse block,
    /// which has no leaves.
    #[inline(always)]
    fn lacks_leaves(&self, id: u32) -> bool {
        self.snapshot.block(BlockId(id + self.leaves_at)).is_none()
    }

    /// Finds the closest hit of the ray in `walk`. Continues the walk if the last call returned `Pending`.
    pub fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        single::run::<false>(self, filter, walk)
    }

    /// Finds any hit of the ray in `walk`. Continues the walk if the last call returned `Pending`.
    pub fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        single::run::<true>(self, filter, walk)
    }

    #[inline(always)]
    fn leaf_of(&self, hit: &TriHit) -> Option<(Block<'_>, Leaf<'_>, usize)> {
        let block = Block::new(self.snapshot.block(BlockId(hit.block))?);
        Some((block, block.leaf((hit.tri >> 3) as usize), (hit.tri & 7) as usize))
    }

    /// Returns the triangle of a hit, or `None` if its block has left the snapshot. The function is always inlined: a
    /// call would write the struct in small pieces and read it in large ones, which stalls.
    #[inline(always)]
    pub fn triangle(&self, hit: &TriHit) -> Option<Triangle> {
        let (block, leaf, index) = self.leaf_of(hit)?;
        Some(Triangle { vertices: leaf.triangle(index), part: block.part(leaf.part_of(index)) })
    }

    /// Returns the primitive id of a hit. Fails with the id of a block that is not in memory.
    #[inline]
    pub fn prim(&self, hit: &TriHit) -> Result<u32, BlockId> {
        self.prim_at(self.prim_place(hit).ok_or(BlockId(hit.block))?)
    }

    /// See [`crate::structure::Tree::prim_place`].
    #[inline]
    pub fn prim_place(&self, hit: &TriHit) -> Option<Place> {
        let (_, leaf, index) = self.leaf_of(hit)?;
        Some(Place { block: hit.block + self.prims_at, item: (leaf.first + index) as u32 })
    }

    /// Returns the primitive id at a place, or the block of the place if it is not in memory.
    #[inline]
    pub fn prim_at(&self, place: Place) -> Result<u32, BlockId> {
        let words = self.visit(place.block).ok_or(BlockId(place.block))?;
        // Only a corrupt file has fewer words here than the block has triangles.
        Ok(words.get(place.item as usize).copied().unwrap_or(u32::MAX))
    }

    /// Returns the sRGB colours of the corners of a hit's triangle, or `None` if the model has no colours. Fails with
    /// the id of a block that is not in memory.
    pub fn colours(&self, hit: &TriHit) -> Result<Option<[[u8; 4]; 3]>, BlockId> {
        let Some(at) = self.colours_at else { return Ok(None) };
        let (words, leaf, index) = self.beside(hit, at)?;
        Ok(Some(colours_of(words, leaf.first + index)))
    }

    /// Returns the unit normals at the corners of a hit's triangle, in the tree's frame, on the side from which the
    /// corners appear counter-clockwise; `None` if they are the triangle's own. Fails with the id of a block that is
    /// not in memory.
    pub fn normals(&self, hit: &TriHit) -> Result<Option<[Vec3; 3]>, BlockId> {
        let Some(at) = self.normals_at else { return Ok(None) };
        let (words, leaf, index) = self.beside(hit, at)?;
        Ok(normals::of_triangle(words, &leaf, index))
    }

    /// Returns the words of another block, the leaf of a hit's triangle, and the triangle's index in it; `offset` leads
    /// from the id of the triangle's block to that of the other one.
    #[inline(always)]
    fn beside(&self, hit: &TriHit, offset: u32) -> Result<(&[u32], Leaf<'_>, usize), BlockId> {
        let Some((_, leaf, index)) = self.leaf_of(hit) else { return Err(BlockId(hit.block)) };
        let id = BlockId(hit.block + offset);
        Ok((self.visit(id.0).ok_or(id)?, leaf, index))
    }

    /// See [`crate::structure::Tree::triangles_of`].
    pub fn triangles_of(&self, block: BlockId, visit: &mut dyn FnMut(&TriHit, &Triangle)) -> Result<(), BlockId> {
        let leaves = leaves_in_order(&Block::new(self.visit(block.0).ok_or(block)?));
        let mut below = Below { child: &mut |_, _, _| {}, triangle: visit };
        leaves.into_iter().try_for_each(|at| {
            self.expand(Place { block: block.0, item: Child::Leaf(at.into()).to_bits().into() }, &mut below)
        })
    }

    /// Lists the children or the triangles of a place. Fails with the id of the place's block if that is not in memory.
    pub fn expand(&self, place: Place, below: &mut Below) -> Result<(), BlockId> {
        let Place { block: id, item: child } = place;
        let block = Block::new(self.visit(id).ok_or(BlockId(id))?);
        match Child::from_bits(child) {
            Child::Node(index) => {
                let node = block.node(index);
                for slot in (0..WIDTH).filter(|slot| node.valid >> slot & 1 == 1) {
                    let child = u32::from(node.child[slot]);
                    let (to, item) = match Child::from_bits(child) {
                        Child::External(at) => block.external(at),
                        _ => (self.home_of(id, child), child),
                    };
                    (below.child)(Place { block: to, item }, &node.child_box(slot), Child::is_leaf(child));
                }
            }
            Child::Leaf(at) => {
                let leaf = block.leaf(at);
                for i in 0..leaf.triangles {
                    let hit = TriHit { block: id, tri: (at as u32) << 3 | i as u32, ..TriHit::none(0.0) };
                    let triangle = Triangle { vertices: leaf.triangle(i), part: block.part(leaf.part_of(i)) };
                    (below.triangle)(&hit, &triangle);
                }
            }
            // A place never holds an external reference: the node branch above resolves them.
            Child::External(_) | Child::Member(_) => {}
        }
        Ok(())
    }
}

impl Ties for TreeView<'_> {
    #[inline(always)]
    fn is_better(&self, hit: &TriHit, best: &TriHit, counters: &mut Counters) -> Result<bool, BlockId> {
        single::is_better(self, hit, best, counters)
    }
}

impl Rooted for TreeView<'_> {
    #[inline(always)]
    fn root(&self) -> Option<Place> {
        (!self.is_empty()).then_some(Place { block: self.root_block, item: self.root })
    }
    #[inline(always)]
    fn max_coord(&self) -> f32 {
        self.max_coord
    }
    #[inline(always)]
    fn isa(&self) -> Isa {
        self.isa
    }
}
