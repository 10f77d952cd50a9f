//! One tree of a model, of any structure, in one snapshot: the interface that the modules above use.
//!
//! It is an enum and neither a trait object nor a type parameter. Rays dispatch on it once for each packet, stream,
//! bundle or walk, never once for each node, so the dispatch costs nothing compared to the traversal. (The
//! [cursor](Tree::expand), which returns nodes, dispatches once for each node.) A type parameter in the modules above
//! would duplicate all kernels for each structure (2 MB each). A structure without packets, streams or bundles of its
//! own falls back to single walks (`fallback.rs`).

#[cfg(any(test, feature = "brute"))]
use super::brute;
use super::bvh;
use super::cell::{CellParts, Cells};
use super::cursor::Below;
use super::fallback::SingleWalks;
use super::filter::{PartFilter, ShownBlocks};
use super::hit::{InFace, Outcome, TriHit, Triangle};
use super::packet::PacketWalk;
use super::patch;
use super::place::{Place, Rooted};
use super::resident::Resident;
use super::resident::trace::Both;
use super::rows::Rows;
use super::stream::{Rays16, Stream};
use super::surface::Surfaces;
use super::walk::Walk;
use crate::base::ids::BlockId;
use crate::geom::surface::ShadingPoint;
use crate::lod::OrientedSlabs;
use crate::math::{Bounds, Cone};
use crate::residency::Snapshot;
use crate::simd::Isa;
use crate::store::Proxies;
use glam::{DVec3, Vec3};
use std::sync::atomic::AtomicBool;

pub use bvh::appearance::{Appearance, MemberLook};
pub use bvh::members::{Child as MemberChild, Members};
pub use bvh::refit::Move;
pub use bvh::trace::Bundle;

/// A flag that nothing sets, for walks that nothing stops.
pub static NEVER: AtomicBool = AtomicBool::new(false);

/// Options of walks through a tree.
#[derive(Debug, Clone, Copy)]
pub struct Visit<'a> {
    /// Walks show stand-ins for blocks that are not in memory. Otherwise they stop at these blocks and request them.
    pub accept_missing: bool,
    /// Walks decide ties between triangles by their places in the tree if primitive ids are not in memory. Otherwise
    /// they stop at the blocks of the ids and request them.
    pub ties_by_place: bool,
    /// Number of the pass. Blocks that the walk reads get it as their last-used stamp, and stay in memory as long as
    /// the pass needs them.
    pub stamp: u32,
    /// Blocks that walks pass by, if parts are hidden.
    pub shown: Option<&'a ShownBlocks>,
    /// The proxies of the model, if it has any.
    pub proxies: Option<&'a Proxies>,
    /// Once it is set, walks end at the next block that they enter, as if it were missing. Their results have no
    /// meaning then.
    pub stop: &'a AtomicBool,
}

impl Default for Visit<'_> {
    fn default() -> Self {
        Self { accept_missing: false, ties_by_place: false, stamp: 0, shown: None, proxies: None, stop: &NEVER }
    }
}

/// One tree of a model in one snapshot. Cheap to make; it borrows the snapshot as long as it is in use.
#[derive(Debug, Clone, Copy)]
pub struct Tree<'a> {
    blocks: Blocks<'a>,
    /// The same tree in the form for exact rays, if there is one.
    resident: Option<&'a Resident>,
}

/// The blocks of a tree, which hold all of it.
#[derive(Debug, Clone, Copy)]
pub enum Blocks<'a> {
    /// A wide bounding volume hierarchy.
    Bvh(bvh::trace::TreeView<'a>),
    /// Surfaces as grids under quadtrees.
    Patch(patch::trace::TreeView<'a>),
    /// A list of triangles.
    #[cfg(any(test, feature = "brute"))]
    Brute(brute::trace::TreeView<'a>),
}

/// Evaluates an expression with the view of the tree's own structure.
macro_rules! of_each {
    ($tree:expr, $own:ident => $answer:expr) => {
        match $tree {
            Blocks::Bvh($own) => $answer,
            Blocks::Patch($own) => $answer,
            #[cfg(any(test, feature = "brute"))]
            Blocks::Brute($own) => $answer,
        }
    };
}

impl<'a> Tree<'a> {
    /// A tree with the form for exact rays, if there is one.
    pub fn new(blocks: Blocks<'a>, resident: Option<&'a Resident>) -> Self {
        Self { blocks, resident }
    }

    /// The same tree with a form for exact rays.
    pub fn with_resident<'b>(&self, form: &'b Resident) -> Tree<'b>
    where
        'a: 'b,
    {
        Tree { blocks: self.blocks, resident: Some(form) }
    }

    /// Both forms, if there are both and a filter allows rays in the form for exact rays.
    #[inline(always)]
    fn both(&self, filter: Option<&PartFilter>) -> Option<Both<'_>> {
        let form = self.resident.filter(|_| !PartFilter::is_by_ray(filter))?;
        Some(Both { form, blocks: &self.blocks })
    }

    /// Traces the ray that `walk` has begun in the form for exact rays, if it may. Returns false if it has no result.
    #[inline(always)]
    fn single<const ANY: bool>(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> bool {
        let may = std::mem::take(&mut walk.is_new) && walk.ray.cone == Cone::ZERO;
        may && self.both(filter).is_some_and(|both| both.single::<ANY>(filter, walk))
    }

    /// Traces the packet that has begun in the form for exact rays, if it may. Returns false if rays have no result.
    #[inline(always)]
    fn packet<const ANY: bool>(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> bool {
        if !(std::mem::take(&mut walk.is_new) && walk.is_exact()) {
            return false;
        }
        let Some(both) = self.both(filter) else { return false };
        let lost = both.packet::<ANY>(filter, walk);
        if lost != 0 {
            walk.begin_again(self, lost);
        }
        lost == 0
    }

    /// Traces the first rays of a stream in the form for exact rays, if they may. Returns false if they have no
    /// results.
    #[inline(always)]
    fn stream<const ANY: bool>(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) -> bool {
        let Some(both) = self.both(filter).filter(|_| stream.groups(hits.len()).iter().all(Rays16::is_exact)) else {
            return false;
        };
        both.stream::<ANY>(filter, stream, hits);
        true
    }

    /// True if the tree is empty.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.root().is_none()
    }

    /// Snapshot with the blocks in memory.
    #[inline]
    pub fn snapshot(&self) -> &'a Snapshot {
        of_each!(&self.blocks, own => own.snapshot)
    }

    /// Finds the closest hit of the ray that `walk` has begun, or continues after `Pending`.
    #[inline]
    pub fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        if self.single::<false>(filter, walk) {
            return Outcome::Done;
        }
        of_each!(&self.blocks, own => own.closest(filter, walk))
    }

    /// Finds any hit of the ray that `walk` has begun, or continues after `Pending`.
    #[inline]
    pub fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        if self.single::<true>(filter, walk) {
            return Outcome::Done;
        }
        of_each!(&self.blocks, own => own.any(filter, walk))
    }

    /// Finds the closest hits of the rays that `walk` has begun, or continues after `Pending`. The hits are identical,
    /// to the bit, to those that [`Tree::closest`] finds for each ray.
    #[inline]
    pub fn closest_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        if self.packet::<false>(filter, walk) {
            return Outcome::Done;
        }
        of_each!(&self.blocks, own => own.closest_together(filter, walk))
    }

    /// Finds any hit of each ray that `walk` has begun, or continues after `Pending`. The hit may differ from the one
    /// that [`Tree::any`] finds, but both agree on its existence.
    #[inline]
    pub fn any_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        if self.packet::<true>(filter, walk) {
            return Outcome::Done;
        }
        of_each!(&self.blocks, own => own.any_together(filter, walk))
    }

    /// Finds the closest hits of the first rays of `stream`, as [`Tree::closest`] does but at lower cost for each ray.
    /// `hits` has one entry for each ray, at most [`crate::math::STREAM`]. The rays in [`Stream::unfinished`] have no
    /// result.
    #[inline]
    pub fn closest_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        stream.end(hits.len());
        if !self.stream::<false>(filter, stream, hits) {
            of_each!(&self.blocks, own => own.closest_each(filter, stream, hits));
        }
    }

    /// Finds out whether each ray hits anything; otherwise like [`Tree::closest_each`]. Which hit it returns is
    /// unspecified.
    #[inline]
    pub fn any_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        stream.end(hits.len());
        if !self.stream::<true>(filter, stream, hits) {
            of_each!(&self.blocks, own => own.any_each(filter, stream, hits));
        }
    }

    /// Finds the closest hits of those packets of `among` (bit `i`: packet `i`) that can be traced as one bundle. All
    /// of them were just started in this tree. [`Tree::closest_together`] finds the hits of the other packets: the
    /// caller calls it for each packet in any case.
    #[inline]
    pub fn closest_in_bundle(&self, filter: Option<&PartFilter>, bundle: &mut Bundle, among: u32) {
        match &self.blocks {
            Blocks::Bvh(own) => bundle.closest(own, filter, among),
            Blocks::Patch(_) => {}
            #[cfg(any(test, feature = "brute"))]
            Blocks::Brute(_) => {}
        }
    }

    /// True if exact rays walk the [resident](super::resident) form.
    pub fn has_form(&self) -> bool {
        self.resident.is_some()
    }

    /// Returns the triangle of a hit; `None` if its block has left the snapshot. Always inlined: a call would write the
    /// struct in small pieces and read it in large ones, which stalls.
    #[inline(always)]
    pub fn triangle(&self, hit: &TriHit) -> Option<Triangle> {
        of_each!(&self.blocks, own => own.triangle(hit))
    }

    /// Returns the block that a hit needs first. If [`Tree::triangle`], [`Tree::surfaces`], [`Tree::cells`] or
    /// [`Tree::oriented_slabs`] find nothing, this is the block that has left the snapshot.
    pub fn block_of(&self, hit: &TriHit) -> BlockId {
        match &self.blocks {
            Blocks::Bvh(_) | Blocks::Patch(_) => BlockId(hit.block),
            #[cfg(any(test, feature = "brute"))]
            Blocks::Brute(_) => BlockId(hit.block),
        }
    }

    /// Fills a column for each of `count` triangles; `hit` returns a hit on each. Returns the triangles (bit `i`:
    /// triangle `i`) in blocks that have left the snapshot.
    #[inline(always)]
    pub fn surfaces<const N: usize>(&self, count: usize, hit: impl Fn(usize) -> TriHit, out: &mut Surfaces<N>) -> u32 {
        of_each!(&self.blocks, own => out.fill(count, |column| own.triangle(&hit(column))))
    }

    /// Fills the columns of `rays`, all of which hit stand-ins. Returns the rays for which a block has left the
    /// snapshot: their columns hold arbitrary values.
    ///
    /// `dir` returns a ray's direction in the tree's frame. With `is_whole`, boxes and levels of all cells are filled.
    /// Curtains that may show a part with a bit in `unseen` are left out.
    #[inline(always)]
    pub fn cells<const N: usize>(
        &self,
        rays: u32,
        hit: impl Fn(usize) -> TriHit,
        dir: impl Fn(usize) -> DVec3,
        (is_whole, unseen): (bool, u32),
        out: &mut Cells<N>,
    ) -> u32 {
        of_each!(&self.blocks, own => own.cells(rays, hit, dir, (is_whole, unseen), out))
    }

    /// Prefetches the memory that [`Tree::cells`] reads for a cell that was hit. A first call prefetches the cell's
    /// words. A second call (`of_sides`), once those are in the cache, prefetches the samples of its sides.
    #[inline]
    pub fn prefetch_cell(&self, hit: &TriHit, of_sides: bool) {
        of_each!(&self.blocks, own => own.prefetch_cell(hit, of_sides));
    }

    /// Returns the oriented slabs that bound the content of a cell that was hit; `None` if its block has left the
    /// snapshot.
    pub fn oriented_slabs(&self, hit: &TriHit) -> Option<OrientedSlabs<f32>> {
        of_each!(&self.blocks, own => own.oriented_slabs(hit))
    }

    /// Returns the primitive id of a hit, or the block that is needed for it; `None` if a deliberately malformed file
    /// has no id for the triangle.
    pub fn prim(&self, hit: &TriHit) -> Result<Option<u32>, BlockId> {
        of_each!(&self.blocks, own => own.prim(hit)).map(|prim| (prim != u32::MAX).then_some(prim))
    }

    /// Returns the place of a hit's primitive id. It needs the hit's block; `None` if that has left the snapshot.
    pub fn prim_place(&self, hit: &TriHit) -> Option<Place> {
        of_each!(&self.blocks, own => own.prim_place(hit))
    }

    /// Returns the primitive id at a [place](Self::prim_place), or the block of the place if it is not in memory; no
    /// other block is needed. `None` if a deliberately malformed file has no id there.
    pub fn prim_at(&self, place: Place) -> Result<Option<u32>, BlockId> {
        of_each!(&self.blocks, own => own.prim_at(place)).map(|prim| (prim != u32::MAX).then_some(prim))
    }

    /// Returns the sRGB colours of the corners of a hit's triangle, or the block that is needed for them; `None` if the
    /// model has no colours.
    pub fn colours(&self, hit: &TriHit) -> Result<Option<[[u8; 4]; 3]>, BlockId> {
        of_each!(&self.blocks, own => own.colours(hit))
    }

    /// True if single triangles have colours.
    pub fn has_colours(&self) -> bool {
        of_each!(&self.blocks, own => own.colours_at.is_some())
    }

    /// Returns the unit normals at the corners of a hit's triangle, in the tree's frame, on the side from which the
    /// corners appear counter-clockwise, or the block that is needed for them; `None` if they are the triangle's own.
    pub fn normals(&self, hit: &TriHit) -> Result<Option<[Vec3; 3]>, BlockId> {
        of_each!(&self.blocks, own => own.normals(hit))
    }

    /// True if triangles may have normals other than their own.
    pub fn has_normals(&self) -> bool {
        of_each!(&self.blocks, own => own.normals_at.is_some())
    }

    /// Returns what the tree's content looks like as a whole; `colour_of` returns the linear colour of a local part.
    /// `None` if the root is not in memory or the tree is empty, and for trees over members ([`Members::appearance`]).
    pub fn appearance(&self, colour_of: &dyn Fn(u32) -> Vec3) -> Option<Appearance> {
        match &self.blocks {
            Blocks::Bvh(own) => own.appearance(colour_of),
            Blocks::Patch(_) => None,
            #[cfg(any(test, feature = "brute"))]
            Blocks::Brute(_) => None,
        }
    }

    /// Returns the local part that covers most of each child of the root, and half the area of the child's box. `None`
    /// as for [`Tree::appearance`].
    pub fn root_parts(&self) -> Option<[Option<(u32, f32)>; 8]> {
        match &self.blocks {
            Blocks::Bvh(own) => own.root_parts(),
            Blocks::Patch(_) => None,
            #[cfg(any(test, feature = "brute"))]
            Blocks::Brute(_) => None,
        }
    }

    /// Returns the parts in the cell of a hit; `None` if its block has left the snapshot.
    pub fn parts_in_cell(&self, hit: &TriHit) -> Option<CellParts> {
        of_each!(&self.blocks, own => own.parts_in_cell(hit))
    }

    /// True if hits have parameters of the surface that was hit.
    pub fn has_parameters(&self) -> bool {
        matches!(self.blocks, Blocks::Patch(_))
    }

    /// Returns the face that a hit lies on, and its parameters there: those of the middle of a stand-in. `hit.u` and
    /// `hit.v` are the weights of a triangle's corners. `None` for triangles that are no surfaces, for stand-ins of
    /// several faces, and if a block has left the snapshot.
    pub fn parameters(&self, hit: &TriHit) -> Option<InFace> {
        match &self.blocks {
            Blocks::Patch(own) => own.parameters(hit),
            _ => None,
        }
    }

    /// Returns the point of a hit on a triangle in the tree's frame, with derivatives by its parameters, or the block
    /// that is needed for it; `None` for stand-ins, and if a malformed file has no such triangle. The parameters are
    /// those of [`Tree::parameters`], or else the weights of the triangle's second and third corner.
    pub fn shading_point(&self, hit: &TriHit) -> Result<Option<ShadingPoint>, BlockId> {
        if hit.stand_in().is_some() {
            return Ok(None);
        }
        if let Blocks::Patch(own) = &self.blocks {
            return own.shading_point(hit);
        }
        let corners = self.triangle(hit).ok_or(self.block_of(hit))?.vertices.map(Vec3::as_dvec3);
        let normals = self.normals(hit)?.map(|normals| normals.map(Vec3::as_dvec3));
        let weights = [hit.u, hit.v].map(f64::from);
        let parameters = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        Ok(Some(ShadingPoint::of_triangle(&corners, normals.as_ref(), &parameters, weights)))
    }

    /// Returns the block that the stand-in of a hit replaces, if that block is missing.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        of_each!(&self.blocks, own => own.wanted(hit))
    }

    /// Visits all triangles of a block of triangles. Fails with the block if it is not in memory.
    pub fn triangles_of(&self, block: BlockId, visit: &mut dyn FnMut(&TriHit, &Triangle)) -> Result<(), BlockId> {
        of_each!(&self.blocks, own => own.triangles_of(block, visit))
    }

    /// Visits the children or triangles below a place. Fails with the block of the place if that is not in memory.
    /// Counts as a use of the block.
    pub fn expand(&self, place: Place, below: &mut Below) -> Result<(), BlockId> {
        of_each!(&self.blocks, own => own.expand(place, below))
    }

    /// Fills `rows` with the children or triangles below a place; with `parts` also what is known of the parts below
    /// each child. Fails with the block of the place if that is not in memory. Counts as a use of the block.
    #[inline(always)]
    pub fn rows(&self, place: Place, parts: bool, rows: &mut Rows) -> Result<(), BlockId> {
        match &self.blocks {
            Blocks::Bvh(own) => own.rows(place, parts, rows),
            Blocks::Patch(own) => own.rows(place, rows),
            #[cfg(any(test, feature = "brute"))]
            Blocks::Brute(own) => own.rows(place, rows),
        }
    }

    /// Bounds of everything that rays can hit, stand-ins included, in the tree's frame; `None` if the root is not in
    /// memory or the tree is empty. A ray that hits a cell or a leaf also hits the boxes of all its ancestors. The
    /// bounds of the triangles would be too small, because cells are rounded outward.
    pub fn around_hits(&self) -> Option<Bounds> {
        let mut all = Bounds::EMPTY;
        let mut below = Below { child: &mut |_, bounds, _| all = all.union(*bounds), triangle: &mut |_, _| {} };
        self.expand(self.root()?, &mut below).ok()?;
        Some(all)
    }
}

impl Blocks<'_> {
    /// Decides between hits on triangles at equal distance: true if `hit` has the lower primitive id. Of references to
    /// the same primitive, which a split divides, that in the lower place counts. Fails with a block that is needed for
    /// the ids.
    pub(super) fn precedes(&self, hit: &TriHit, best: &TriHit) -> Result<bool, BlockId> {
        match (of_each!(self, own => own.prim(hit)), of_each!(self, own => own.prim(best))) {
            (Ok(a), Ok(b)) => Ok((a, hit.place()) < (b, best.place())),
            (a, b) => Ok((a?, hit.place()) < (b?, best.place())),
        }
    }
}

impl Rooted for Blocks<'_> {
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

impl Rooted for Tree<'_> {
    #[inline(always)]
    fn root(&self) -> Option<Place> {
        self.blocks.root()
    }
    #[inline(always)]
    fn max_coord(&self) -> f32 {
        self.blocks.max_coord()
    }
    #[inline(always)]
    fn isa(&self) -> Isa {
        self.blocks.isa()
    }
}
