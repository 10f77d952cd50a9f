//! One tree of a model, of whatever structure, in one snapshot: what rooms above know of structures.
//!
//! An enum and no trait object or type parameter: rays ask it once a packet, stream, bundle or walk, never once a node,
//! so the choice costs nothing beside the answer (a [cursor](Tree::expand), which hands out nodes, asks once for each);
//! a type parameter through the rooms above would copy all kernels once more for each structure (2 MB each). A
//! structure without packets, streams or bundles of its own falls back to single walks (`fallback.rs`).

#[cfg(any(test, feature = "brute"))]
use super::brute;
use super::bvh;
use super::cell::Cells;
use super::cursor::Below;
#[cfg(any(test, feature = "brute"))]
use super::fallback::SingleWalks;
use super::filter::PartFilter;
use super::hit::{Outcome, TriHit, Triangle};
use super::packet::PacketWalk;
use super::place::{Place, Rooted};
use super::stream::Stream;
use super::surface::Surfaces;
use super::walk::Walk;
use crate::base::ids::BlockId;
use crate::lod::OrientedSlabs;
use crate::math::Bounds;
use crate::residency::Snapshot;
use crate::simd::Isa;
use glam::DVec3;

pub use bvh::trace::Bundle;

/// How walks visit a tree.
#[derive(Debug, Clone, Copy, Default)]
pub struct Visit {
    /// Cells stand in for blocks that are not in memory. Else walks ask for these.
    pub accept_missing: bool,
    /// No ray passes a cell that stands in: nothing is before what is hit then.
    pub opaque_cells: bool,
    /// The number of the pass that visits: blocks that it uses stay as long as the pass is needed.
    pub stamp: u32,
}

/// One tree of a model in one snapshot. Cheap to make; borrow it for as long as the job lasts.
#[derive(Debug, Clone, Copy)]
pub enum Tree<'a> {
    /// A wide bounding volume hierarchy.
    Bvh(bvh::trace::TreeView<'a>),
    /// A list of triangles.
    #[cfg(any(test, feature = "brute"))]
    Brute(brute::trace::TreeView<'a>),
}

/// Answers with the structure's own view of the tree.
macro_rules! of_each {
    ($tree:expr, $own:ident => $answer:expr) => {
        match $tree {
            Tree::Bvh($own) => $answer,
            #[cfg(any(test, feature = "brute"))]
            Tree::Brute($own) => $answer,
        }
    };
}

impl<'a> Tree<'a> {
    /// Whether nothing is in it.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.root().is_none()
    }

    /// Which blocks are in memory.
    #[inline]
    pub fn snapshot(&self) -> &'a Snapshot {
        of_each!(self, own => own.snapshot)
    }

    /// Finds the closest hit of the ray that `walk` has begun (or goes on after `Pending`).
    #[inline]
    pub fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        of_each!(self, own => own.closest(filter, walk))
    }

    /// Finds any hit of the ray that `walk` has begun (or goes on after `Pending`).
    #[inline]
    pub fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        of_each!(self, own => own.any(filter, walk))
    }

    /// Finds the closest hits of the rays that `walk` has begun (or goes on after `Pending`): the same, to
    /// the bit, as [`Tree::closest`] finds for each alone.
    #[inline]
    pub fn closest_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        of_each!(self, own => own.closest_together(filter, walk))
    }

    /// Finds any hit of each ray that `walk` has begun (or goes on after `Pending`). Which one may differ from
    /// the one that [`Tree::any`] finds; whether there is one does not.
    #[inline]
    pub fn any_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        of_each!(self, own => own.any_together(filter, walk))
    }

    /// Finds the closest hits of the first of the rays that `stream` has taken over, as [`Tree::closest`] finds them,
    /// at less cost a ray. `hits`: as many as rays, [`crate::math::STREAM`] at most. Those in [`Stream::unfinished`]
    /// have no answer.
    #[inline]
    pub fn closest_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        stream.end(hits.len());
        of_each!(self, own => own.closest_each(filter, stream, hits));
    }

    /// Finds whether each ray hits anything; otherwise like [`Tree::closest_each`]. Which hit is not said.
    #[inline]
    pub fn any_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        stream.end(hits.len());
        of_each!(self, own => own.any_each(filter, stream, hits));
    }

    /// Finds the closest hits of the packets of `among` (bit `i`: packet `i`), which were just started in this tree, of
    /// such as can go together. The rest, all of it where none can, is found by [`Tree::closest_together`] of each
    /// packet: call that in any case.
    #[inline]
    pub fn closest_in_bundle(&self, filter: Option<&PartFilter>, bundle: &mut Bundle, among: u32) {
        match self {
            Tree::Bvh(own) => bundle.closest(own, filter, among),
            #[cfg(any(test, feature = "brute"))]
            Tree::Brute(_) => {}
        }
    }

    /// The triangle of a hit; `None` if its block has left the snapshot. Always inlined: as a call it would write the
    /// struct in small pieces and read it in large ones, which stalls.
    #[inline(always)]
    pub fn triangle(&self, hit: &TriHit) -> Option<Triangle> {
        of_each!(self, own => own.triangle(hit))
    }

    /// The block that a hit needs first: the one that has left the snapshot where [`Tree::triangle`],
    /// [`Tree::surfaces`], [`Tree::cells`] or [`Tree::slabs`] find nothing.
    pub fn block_of(&self, hit: &TriHit) -> BlockId {
        match self {
            Tree::Bvh(_) => BlockId(hit.block),
            #[cfg(any(test, feature = "brute"))]
            Tree::Brute(_) => BlockId(hit.block),
        }
    }

    /// Fills a column for each of `count` triangles, of which `hit` gives a hit. Returns those whose blocks have left
    /// the snapshot (bit `i`: triangle `i`).
    #[inline(always)]
    pub fn surfaces<const N: usize>(&self, count: usize, hit: impl Fn(usize) -> TriHit, out: &mut Surfaces<N>) -> u32 {
        of_each!(self, own => own.surfaces(count, hit, out))
    }

    /// Fills the columns of `rays`, whose hits are cells that stand in. Returns the rays whose blocks have left the
    /// snapshot: their columns hold anything.
    ///
    /// `dir`: a ray's direction in the tree's frame; `is_whole`: boxes and levels of all cells are asked for.
    #[inline(always)]
    pub fn cells<const N: usize>(
        &self,
        rays: u32,
        hit: impl Fn(usize) -> TriHit,
        dir: impl Fn(usize) -> DVec3,
        is_whole: bool,
        out: &mut Cells<N>,
    ) -> u32 {
        of_each!(self, own => own.cells(rays, hit, dir, is_whole, out))
    }

    /// Asks for the memory of what [`Tree::cells`] reads of a cell that was hit: first of its words, and in a second
    /// call (`of_sides`), when those have come, of its sides.
    #[inline]
    pub fn prefetch_cell(&self, hit: &TriHit, of_sides: bool) {
        of_each!(self, own => own.prefetch_cell(hit, of_sides));
    }

    /// Where in its box the content of a cell that was hit is; `None` if its block has left the snapshot.
    pub fn oriented_slabs(&self, hit: &TriHit) -> Option<OrientedSlabs<f32>> {
        of_each!(self, own => own.oriented_slabs(hit))
    }

    /// The primitive id of a hit, or the block that is needed for it; `None` if a file that was made up to be wrong has
    /// none.
    pub fn prim(&self, hit: &TriHit) -> Result<Option<u32>, BlockId> {
        of_each!(self, own => own.prim(hit)).map(|prim| (prim != u32::MAX).then_some(prim))
    }

    /// The sRGB colour of a hit's triangle, or the block that is needed; `None` if the model has none.
    pub fn colour(&self, hit: &TriHit) -> Result<Option<[u8; 4]>, BlockId> {
        of_each!(self, own => own.colour(hit))
    }

    /// Whether single triangles have colours.
    pub fn has_colours(&self) -> bool {
        of_each!(self, own => own.colours_at.is_some())
    }

    /// The block that the stand-in of a hit stands in for, if that block is missing.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        of_each!(self, own => own.wanted(hit))
    }

    /// What is below a place; fails with the block that the place is in if that is not in memory. Counts as a visit.
    pub fn expand(&self, place: Place, below: &mut Below) -> Result<(), BlockId> {
        of_each!(self, own => own.expand(place, below))
    }

    /// Around everything that rays can hit, stand-ins too, in the tree's frame; `None` if that is not in memory, or
    /// nothing. A ray that meets a cell or a leaf has met the boxes of all those above it. (Bounds of triangles will
    /// not do: cells are rounded outward.)
    pub fn around_hits(&self) -> Option<Bounds> {
        let mut all = Bounds::EMPTY;
        let mut below = Below { child: &mut |_, bounds, _| all = all.union(*bounds), triangle: &mut |_, _| {} };
        self.expand(self.root()?, &mut below).ok()?;
        Some(all)
    }
}

impl Rooted for Tree<'_> {
    #[inline(always)]
    fn root(&self) -> Option<Place> {
        of_each!(self, own => own.root())
    }
    #[inline(always)]
    fn max_coord(&self) -> f32 {
        of_each!(self, own => own.max_coord)
    }
    #[inline(always)]
    fn isa(&self) -> Isa {
        of_each!(self, own => own.isa)
    }
}
