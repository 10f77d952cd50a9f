//! From triangles to blocks: references, binned SAH, wide nodes, leaves, clusters.
//!
//! A mesh is built in one or more **chunks**, each in memory: a [`Chunk`] gives its fine and leaf blocks and a [`Top`],
//! the [`Crown`] over all tops gives the coarse blocks. Passes: `refs` (one box a triangle), `sah` and `spatial`
//! (where to split the set, or space), `tree` (wide nodes), `small` and `collapse` (those of small subtrees, and leaves),
//! `cluster` (which nodes share a block), `join` (one tree of several), `encode` (trace form).
//! The result depends on the input and the options only, never on the number of threads.

mod chop;
#[cfg(test)]
mod clip;
mod cluster;
mod collapse;
mod encode;
mod join;
mod leaf;
mod lines;
mod partition;
mod pass;
mod quantise;
mod refs;
mod sah;
mod small;
mod spatial;
mod sweep;
mod tree;

pub use cluster::Plan;
pub use encode::TreeBlock;
pub use spatial::splits_pay;

use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::{Bounds, srgb};
use crate::simd::Isa;
use crate::structure::bvh::layout::Child;
use crate::structure::par::Par;
use glam::Vec3;
use tree::{Inner, Piece, Place, Sub};

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
    fn colour(&self, triangle: usize) -> (Vec3, bool) {
        match self.colours.get(triangle) {
            Some([r, g, b, a]) if *a > 0 => (Vec3::from([*r, *g, *b].map(|c| srgb::decode(f32::from(c) / 255.0))), true),
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
    /// Half the area of the box of the whole mesh, if this is a part of it: what overlaps little as part of that is not split.
    /// (By the box of the part, as if it were all, an airliner in three chunks had 9.1 million references instead of 7.6.)
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
    fn add_below(&mut self, below: Self) {
        self.depth = self.depth.max(below.depth);
        self.nodes += below.nodes;
        self.leaves += below.leaves;
        self.references += below.references;
    }
}

/// The tree over some of a mesh's triangles, or all: fine and leaf blocks, ready to be encoded one by one.
pub struct Chunk<'a> {
    input: TreeInput<'a>,
    refs: Vec<refs::Ref>,
    plans: Vec<Plan>,
}

/// What is above the fine blocks of a chunk. It needs nothing of the chunk any more.
pub struct Top {
    /// The root, or its children.
    pieces: Vec<Piece>,
    units: Vec<cluster::Home>,
    fine_blocks: u32,
    /// Of all pieces.
    counts: Counts,
}

/// What [`Chunk::build`] makes.
pub struct BuiltChunk<'a> {
    /// Its blocks.
    pub chunk: Chunk<'a>,
    /// What is above them; none if the chunk is the whole mesh and fits one block, which is all there is of
    /// the tree then.
    pub top: Option<Top>,
    /// Bounds of all triangles.
    pub bounds: Bounds,
    /// Counts.
    pub counts: Counts,
}

impl<'a> Chunk<'a> {
    /// Builds the tree of `input`, which must not be empty and, with `is_whole`, is all of the mesh.
    ///
    /// Fails only with [`crate::Error::Cancelled`].
    pub fn build(
        input: TreeInput<'a>,
        options: &TreeOptions,
        is_whole: bool,
        par: &Par,
        cancel: &Cancel,
    ) -> Result<BuiltChunk<'a>> {
        let mut refs = refs::make(input.triangles, options.split_budget, par);
        cancel.check()?;
        let tree::Built { children, bounds, counts } = tree::build(input, &mut refs, options.mesh_half_area, par, cancel)?;
        let done = |plans, top, refs| BuiltChunk { chunk: Chunk { input, refs, plans }, top, bounds, counts };
        let mut pieces = children;
        let mut below = Counts { depth: counts.depth - 1, nodes: counts.nodes - 1, ..counts };
        // The tops of several chunks take the roots' children. A root that stays, or is fine, is made here.
        if is_whole || pieces.iter().any(|p| matches!(p.sub, Sub::Leaf { .. })) {
            let mut root = [Inner::over(pieces, Place::Above)];
            pass::mark(&mut root, input, &refs, Isa::best(), par, cancel)?;
            let [Piece { cell, voxel, content, sub, place }] = root;
            let sub = match sub {
                Sub::Inner(root) if is_whole => match cluster::whole(root, input, &refs) {
                    Ok(plan) => return Ok(done(vec![plan], None, refs)),
                    Err(root) => Sub::Inner(root),
                },
                sub => sub,
            };
            pieces = vec![Piece { cell, voxel, content, sub, place }];
            below = counts;
        } else {
            pass::mark(&mut pieces, input, &refs, Isa::best(), par, cancel)?;
        }
        let (plans, units) = cluster::fine(pieces.iter_mut().map(|p| &mut p.sub), input, &refs, par);
        let top = Top { pieces, units, fine_blocks: plans.len() as u32, counts: below };
        Ok(done(plans, Some(top), refs))
    }

    /// Takes the plans of its blocks, in their order, for [`Chunk::encode`].
    pub fn take_plans(&mut self) -> Vec<Plan> {
        std::mem::take(&mut self.plans)
    }

    /// The trace form of a block; that of its leaf block, unless it is all of the tree. Its plan goes: to give back what that holds of the tree takes
    /// a while, which all threads share then.
    pub fn encode(&self, plan: Plan) -> (TreeBlock, Option<TreeBlock>) {
        encode::encode(&plan, 0, self.input, &self.refs)
    }
}

/// The coarse blocks of a tree.
pub struct Crown {
    plans: Vec<Plan>,
    /// Of the whole tree.
    pub counts: Counts,
}

impl Crown {
    /// Over the chunks of a mesh, at least one, whose fine blocks follow one another in this order.
    pub fn over(tops: Vec<Top>) -> Result<Self> {
        let join::Joined { root, units, counts } = join::join(tops)?;
        Ok(Self { plans: cluster::coarse(root, &units), counts })
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.plans.len()
    }

    /// The trace form of block `index`; `first_block` is the id of the tree's block 0.
    pub fn encode(&self, index: usize, first_block: u32) -> TreeBlock {
        let nothing = TreeInput { triangles: &[], parts: &[], prims: &[], colours: &[], part_colours: &[] };
        encode::encode(&self.plans[index], first_block, nothing, &[]).0
    }
}

/// Child reference to the root of a tree inside its block 0.
pub fn root() -> u32 {
    Child::Node(0).to_bits().into()
}
