//! The interface of bakers: triangles of a mesh in, blocks of a tree out, in chunks that fit memory.

#[cfg(any(test, feature = "brute"))]
use super::brute;
use super::par::Par;
use super::patch;
use super::{Structure, bvh};
use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::lod::Looks;
use crate::math::{Bounds, srgb};
use crate::store::CLASSES;
use glam::{Vec3, Vec4};

/// Triangles of a chunk, relative to the tree's origin. The first three slices have equal lengths.
#[derive(Debug, Clone, Copy)]
pub struct TreeInput<'a> {
    /// Corners; finite. Each triangle has an area above zero.
    pub triangles: &'a [[Vec3; 3]],
    /// Local part of each triangle.
    pub parts: &'a [u32],
    /// Primitive id of each triangle; ascending.
    pub prims: &'a [u32],
    /// sRGB colours of each triangle's corners, or empty. A triangle with alpha 0 has the colour of its part.
    pub colours: &'a [[[u8; 4]; 3]],
    /// Codes of the normals of each triangle's corners (`math::octahedral`), or empty. Codes below 2: the triangle's
    /// own.
    pub normals: &'a [[u32; 3]],
    /// Linear colour and opacity of each local part. Parts beyond the end are grey and opaque.
    pub part_colours: &'a [Vec4],
}

impl TreeInput<'_> {
    /// Returns the linear colour of a triangle, and true if the colour is the triangle's own and not its part's.
    pub(super) fn colour(&self, triangle: usize) -> (Vec3, bool) {
        match self.colours.get(triangle) {
            Some(corners) if corners[0][3] > 0 => {
                let linear = |[r, g, b, _]: [u8; 4]| Vec3::from([r, g, b].map(|c| srgb::decode(f32::from(c) / 255.0)));
                let [a, b, c] = corners.map(linear);
                (if corners[0] == corners[1] && corners[0] == corners[2] { a } else { (a + b + c) / 3.0 }, true)
            }
            _ => (self.part_colour(self.parts[triangle]), false),
        }
    }

    /// True if the triangles belong to several parts.
    pub(super) fn has_several_parts(&self) -> bool {
        self.parts.windows(2).any(|pair| pair[0] != pair[1])
    }

    /// Returns the linear colour of a local part.
    pub(super) fn part_colour(&self, part: u32) -> Vec3 {
        self.part_colours.get(part as usize).map_or(GREY, |colour| colour.truncate())
    }

    /// True if a local part is opaque.
    pub(super) fn is_opaque(&self, part: u32) -> bool {
        self.part_colours.get(part as usize).is_none_or(|colour| colour.w >= 1.0)
    }
}

/// Linear colour of parts without a colour.
const GREY: Vec3 = Vec3::splat(0.6);

/// Options of a build.
#[derive(Debug, Clone, Copy)]
pub struct TreeOptions {
    /// References that spatial splits may add, as a share of the triangles; 0 for no splits.
    pub split_budget: f32,
    /// Half the surface area of the box of the whole mesh. Spatial splits are considered only where the children's
    /// boxes overlap by a certain share of it, so the chunks of a mesh are split as sparingly as the whole mesh.
    /// (Measured against the chunk's own box, an airliner in three chunks had 9.1 million references instead of 7.6.)
    pub mesh_half_area: f32,
    /// Proxies; `None` for none. A structure without proxies ignores them.
    pub proxies: Option<ProxyOptions>,
}

/// Options of proxies.
#[derive(Debug, Clone, Copy)]
pub struct ProxyOptions {
    /// Number of lines into each subtree, > 0.
    pub rays: u32,
    /// Fewest triangles of a subtree with a proxy; 0: chosen so that all proxies take about 0.3 bytes for each
    /// triangle.
    pub triangles: u32,
    /// Number of the chunk's first proxy.
    pub first: u32,
}

/// The proxy of a subtree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BakedProxy {
    /// The looks.
    pub looks: Looks,
    /// Surface area of its triangles; finite, > 0.
    pub area: f32,
}

/// Counts of a tree or of a part of a tree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Nodes on the longest path from the root, leaves included.
    pub depth: u32,
    /// Inner nodes.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
    /// References to triangles in all leaves. Spatial splits repeat triangles, so this may exceed the number of
    /// triangles.
    pub references: u64,
}

impl Counts {
    /// Adds the counts of a subtree. The depth becomes the depth of the deepest subtree.
    pub fn add_below(&mut self, below: Self) {
        self.depth = self.depth.max(below.depth);
        self.nodes += below.nodes;
        self.leaves += below.leaves;
        self.references += below.references;
    }
}

/// An encoded block, before it is written to the file.
#[derive(Debug, Default)]
pub struct BakedBlock {
    /// The block in file form.
    pub payload: Vec<u8>,
    /// Size of the trace form in bytes.
    pub trace_bytes: u32,
    /// Primitive id of each triangle of the block.
    pub prims: Vec<u32>,
    /// Colours of the corners of each triangle of the block; empty if the input has no colours.
    pub colours: Vec<[[u8; 4]; 3]>,
    /// Trace form of the block's normals; empty if each is that of its triangle.
    pub normals: Vec<u32>,
    /// Local parts of the triangles in the block and in the other blocks of its plan, ascending. Empty if unknown.
    pub parts: Vec<u32>,
    /// Blocks of other plans that the block refers to, counted from the first block of the tree.
    pub below: Vec<u32>,
    /// Runs of nodes that show the same proxy: first node, and the number of the proxy among those of all chunks or
    /// `u32::MAX`. Nodes before the first run show none.
    pub proxies: Vec<(u16, u32)>,
}

/// Result of [`Baker::build`].
pub struct BuiltChunk<C, T> {
    /// The chunk, from which blocks are encoded.
    pub chunk: C,
    /// The tree above the chunk's blocks; `None` if the chunk is the whole mesh and fits one block, which then holds
    /// the whole tree.
    pub top: Option<T>,
    /// Bounds of all triangles.
    pub bounds: Bounds,
    /// Counts of the chunk.
    pub counts: Counts,
    /// The proxies, numbered from [`ProxyOptions::first`].
    pub proxies: Vec<BakedProxy>,
}

/// Makes the blocks of a structure.
///
/// A mesh is built in one or more chunks, each of which fits memory. A chunk leaves its top and its blocks, which are
/// encoded plan by plan. All tops are joined to the coarse blocks. In the file the blocks of a tree are ordered by
/// class ([`crate::store::TreeRow::class_blocks`]): first the coarse blocks, which are known last, then the second
/// class of all chunks, and so on. The result depends on the input and the options only, never on the number of
/// threads.
///
/// Opening, prefetch and eviction rely on three more properties. A block refers only to blocks with higher ids. Of the
/// coarse blocks those nearest to the root come first. Each plan gives exactly one block of each class but the first,
/// or the one block of a whole tree.
pub trait Baker {
    /// Number of block classes, at most [`CLASSES`]. The first is the class of coarse blocks.
    const CLASSES: usize;
    /// Most triangles of a leaf; 0 if there is no limit.
    const LEAF_TRIANGLES: u32;
    /// The tree over some or all triangles of a mesh.
    type Chunk<'a>: Sync;
    /// One step of encoding a chunk: it gives a block of each class but the first, or the one block of a whole tree.
    type Plan: Send;
    /// The part of a chunk's tree above its blocks. It does not refer to the chunk.
    type Top;
    /// The coarse blocks of a tree.
    type UpperTree: Sync;

    /// True if spatial splits are worthwhile for these triangles.
    fn splits_pay(triangles: &[[Vec3; 3]]) -> bool;
    /// Builds the tree of `input`, which is not empty. With `is_whole` the input is the whole mesh. Fails only with
    /// [`crate::Error::Cancelled`], or with `BadArgument` for input that the structure cannot hold.
    fn build<'a>(
        input: TreeInput<'a>,
        options: &TreeOptions,
        is_whole: bool,
        par: &Par,
        stretch: &Stretch,
    ) -> Result<BuiltChunk<Self::Chunk<'a>, Self::Top>>;
    /// Takes the plans of a chunk, in order.
    fn take_plans(chunk: &mut Self::Chunk<'_>) -> Vec<Self::Plan>;
    /// Encodes the blocks of a plan: one of each class from the second on, in order, or the one block of a whole tree.
    fn encode(chunk: &Self::Chunk<'_>, plan: Self::Plan) -> Vec<BakedBlock>;
    /// Joins the tops of all chunks of a mesh. There is at least one chunk, and their plans follow one another in this
    /// order.
    fn join(tops: Vec<Self::Top>) -> Result<Self::UpperTree>;
    /// Number of coarse blocks.
    fn coarse_blocks(upper_tree: &Self::UpperTree) -> usize;
    /// Encodes a coarse block; `first_block` is the id of the tree's first block.
    fn encode_coarse(upper_tree: &Self::UpperTree, index: usize, first_block: u32) -> BakedBlock;
    /// Counts of the whole tree.
    fn counts(upper_tree: &Self::UpperTree) -> Counts;
    /// Number of stack entries that a walk needs at most in a tree with `depth` levels
    /// ([`crate::store::TreeRow::max_stack`]).
    fn max_stack(depth: u32) -> u32;
    /// Item in the tree's first block where walks begin.
    fn root() -> u32;
}

/// The bake of surfaces: tiles of a surface in, frames and blocks out. There is one structure with surfaces, so this is
/// no trait.
pub mod surfaces {
    use super::{Structure, patch};
    pub use patch::build::{
        AT_A_TIME, BuiltFrame, Cell, Item, Plan, Plans, Tile, Upper, build, encode, expected, max_stack, pack,
    };
    pub use patch::layout::{CLASSES, MOST_LEVEL, of_morton};

    /// The structure of the trees.
    pub const STRUCTURE: Structure = Structure::Patch;
}

/// Work that is compiled once for the baker of each structure.
pub trait BakeOp {
    /// Result of the work.
    type Out;
    /// Does the work.
    fn run<B: Baker>(self) -> Self::Out;
}

/// Runs `op` with the baker of a structure.
pub fn with_baker<O: BakeOp>(structure: Structure, op: O) -> O::Out {
    fn run<B: Baker, O: BakeOp>(op: O) -> O::Out {
        const { assert!(B::CLASSES <= CLASSES) };
        op.run::<B>()
    }
    match structure {
        // Triangles beside surfaces.
        Structure::Bvh | Structure::Patch => run::<bvh::build::BvhBaker, O>(op),
        #[cfg(any(test, feature = "brute"))]
        Structure::Brute => run::<brute::build::BruteBaker, O>(op),
    }
}
