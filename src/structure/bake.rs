//! The contract of the bake wing: triangles of a mesh in, blocks of a tree out, in chunks that fit memory.

#[cfg(any(test, feature = "brute"))]
use super::brute;
use super::par::Par;
use super::{Structure, bvh};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::{Bounds, srgb};
use crate::store::CLASSES;
use glam::Vec3;

/// The triangles of a chunk, around the tree's origin. The first three slices are equally long.
#[derive(Debug, Clone, Copy)]
pub struct TreeInput<'a> {
    /// Corners; finite, of more than zero area.
    pub triangles: &'a [[Vec3; 3]],
    /// Local part of each triangle.
    pub parts: &'a [u32],
    /// Primitive id of each triangle; ascending.
    pub prims: &'a [u32],
    /// sRGB colour of each triangle, or empty. Alpha 0: that of its part.
    pub colours: &'a [[u8; 4]],
    /// Linear colour of each local part; those beyond are grey.
    pub part_colours: &'a [Vec3],
}

impl TreeInput<'_> {
    /// Linear colour of a triangle, and whether it is its own.
    pub(super) fn colour(&self, triangle: usize) -> (Vec3, bool) {
        match self.colours.get(triangle) {
            Some([r, g, b, a]) if *a > 0 => {
                (Vec3::from([*r, *g, *b].map(|c| srgb::decode(f32::from(c) / 255.0))), true)
            }
            _ => (self.part_colours.get(self.parts[triangle] as usize).copied().unwrap_or(GREY), false),
        }
    }
}

/// Of what has no colour.
const GREY: Vec3 = Vec3::splat(0.6);

/// Options of a build.
#[derive(Debug, Clone, Copy)]
pub struct TreeOptions {
    /// References that spatial splits may add, as a share of the triangles; 0 for no splits.
    pub split_budget: f32,
    /// Half the area of the box of the whole mesh, if this is a part of it: what overlaps little as part of that is not
    /// split. (By the box of the part, as if it were all, an airliner in three chunks had 9.1 million references
    /// instead of 7.6.)
    pub mesh_half_area: f32,
}

/// Counts of a tree, or of a part of one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Nodes on the longest way down, leaves included.
    pub depth: u32,
    /// Inner nodes.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
    /// References to triangles, over all leaves; more than the triangles where splits repeat them.
    pub references: u64,
}

impl Counts {
    /// Adds those of what is below a node; the depth is that below.
    pub(super) fn add_below(&mut self, below: Self) {
        self.depth = self.depth.max(below.depth);
        self.nodes += below.nodes;
        self.leaves += below.leaves;
        self.references += below.references;
    }
}

/// A block on its way to the file.
#[derive(Debug, Default)]
pub struct BakedBlock {
    /// The file form.
    pub payload: Vec<u8>,
    /// Bytes of the trace form.
    pub trace_bytes: u32,
    /// Primitive id of each triangle of the block.
    pub prims: Vec<u32>,
    /// Colour of each triangle of the block; empty if the input has none.
    pub colours: Vec<[u8; 4]>,
}

/// The result of [`Baker::build`].
pub struct BuiltChunk<C, T> {
    /// Its blocks.
    pub chunk: C,
    /// The tree above them; `None` if the chunk is the whole mesh and fits one block, which is all of the tree then.
    pub top: Option<T>,
    /// Bounds of all triangles.
    pub bounds: Bounds,
    /// Counts.
    pub counts: Counts,
}

/// What makes the blocks of a structure.
///
/// A mesh is built in one or more chunks, each in memory; of a chunk stay its top and its blocks, which are encoded one
/// plan after the other. All tops are joined to the coarse blocks. In the file the blocks of a tree lie class by class
/// ([`crate::store::TreeRow::class_blocks`]): the coarse ones, which are known last, then the second class of all
/// chunks, and so on. The result depends on the input and the options only, never on the number of threads.
///
/// Opening, reading ahead and making room for blocks rely on three more properties. A block refers to blocks with
/// higher ids only. Of the coarse blocks those nearest to the root come first. Each plan gives exactly one block of
/// each class but the first, or the one block of a whole tree.
pub trait Baker {
    /// Classes of its blocks, [`CLASSES`] at most. The first is that of coarse blocks.
    const CLASSES: usize;
    /// Triangles of a leaf at most; 0 if there is no such limit.
    const LEAF_TRIANGLES: u32;
    /// The tree over some of a mesh's triangles, or all.
    type Chunk<'a>: Sync;
    /// One step of encoding a chunk: a block of each class but the first, or the one block of a whole tree.
    type Plan: Send;
    /// The part of a chunk's tree above its blocks. It needs nothing of the chunk any more.
    type Top;
    /// The coarse blocks of a tree.
    type UpperTree: Sync;

    /// Whether triangles are such that it pays to split them among leaves.
    fn splits_pay(triangles: &[[Vec3; 3]]) -> bool;
    /// Builds the tree of `input`, which is not empty and, with `is_whole`, is all of the mesh. Fails only with
    /// [`crate::Error::Cancelled`], or with `BadArgument` for what the structure cannot hold.
    fn build<'a>(
        input: TreeInput<'a>,
        options: &TreeOptions,
        is_whole: bool,
        par: &Par,
        cancel: &Cancel,
    ) -> Result<BuiltChunk<Self::Chunk<'a>, Self::Top>>;
    /// Takes the plans of a chunk, in their order.
    fn take_plans(chunk: &mut Self::Chunk<'_>) -> Vec<Self::Plan>;
    /// The blocks of a plan: of each class from the second on, in order; or the one block of a whole tree.
    fn encode(chunk: &Self::Chunk<'_>, plan: Self::Plan) -> Vec<BakedBlock>;
    /// Joins the tops of all chunks of a mesh, at least one, whose plans follow one another in this order.
    fn join(tops: Vec<Self::Top>) -> Result<Self::UpperTree>;
    /// Coarse blocks.
    fn coarse_blocks(upper_tree: &Self::UpperTree) -> usize;
    /// A coarse block; `first_block` is the id of the tree's first block.
    fn encode_coarse(upper_tree: &Self::UpperTree, index: usize, first_block: u32) -> BakedBlock;
    /// Counts of the whole tree.
    fn counts(upper_tree: &Self::UpperTree) -> Counts;
    /// Entries of the deepest stack that a walk through a tree of so many levels needs
    /// ([`crate::store::TreeRow::max_stack`]).
    fn max_stack(depth: u32) -> u32;
    /// Where walks begin, in the tree's first block.
    fn root() -> u32;
}

/// Work that is compiled once for each structure's baker.
pub trait BakeOp {
    /// Its result.
    type Out;
    /// The work.
    fn run<B: Baker>(self) -> Self::Out;
}

/// Runs `op` with the baker of a structure.
pub fn with_baker<O: BakeOp>(structure: Structure, op: O) -> O::Out {
    fn run<B: Baker, O: BakeOp>(op: O) -> O::Out {
        const { assert!(B::CLASSES <= CLASSES) };
        op.run::<B>()
    }
    match structure {
        Structure::Bvh => run::<bvh::build::BvhBaker, O>(op),
        #[cfg(any(test, feature = "brute"))]
        Structure::Brute => run::<brute::build::BruteBaker, O>(op),
    }
}
