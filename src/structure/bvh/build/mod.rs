//! From triangles to blocks: references, binned SAH, wide nodes, leaves, clusters.
//!
//! A mesh is built in one or more **chunks**, each in memory: a [`Chunk`] gives its fine and leaf blocks and a [`Top`],
//! the [`UpperTree`] over all tops gives the coarse blocks. Passes: `refs` (one box a triangle), `sah` and `spatial`
//! (where to split the set, or space), `tree` (wide nodes), `small` and `collapse` (those of small subtrees, and
//! leaves), `cluster` (which nodes share a block), `join` (one tree of several), `encode` (trace form). The result
//! depends on the input and the options only, never on the number of threads.

mod bake;
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
mod coverage;
mod quantise;
mod refs;
mod sah;
mod small;
mod spatial;
mod sweep;
mod tree;

pub use bake::BvhBaker;
pub use cluster::Plan;
pub use encode::TreeBlock;
pub use spatial::splits_pay;

use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::simd::Isa;
use crate::structure::bake::{BuiltChunk, Counts, TreeInput, TreeOptions};
use crate::structure::bvh::layout::Child;
use crate::structure::par::Par;
use tree::{InnerNode, Piece, Place, Sub};

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
    ) -> Result<BuiltChunk<Chunk<'a>, Top>> {
        let mut refs = refs::make(input.triangles, options.split_budget, par);
        cancel.check()?;
        let tree::Built { children, bounds, counts } =
            tree::build(input, &mut refs, options.mesh_half_area, par, cancel)?;
        let done = |plans, top, refs| BuiltChunk { chunk: Chunk { input, refs, plans }, top, bounds, counts };
        let mut pieces = children;
        let mut below = Counts { depth: counts.depth - 1, nodes: counts.nodes - 1, ..counts };
        // The tops of several chunks take the roots' children. A root that stays, or is fine, is made here.
        if is_whole || pieces.iter().any(|p| matches!(p.sub, Sub::Leaf { .. })) {
            let mut root = [InnerNode::over(pieces, Place::Above)];
            coverage::mark(&mut root, input, &refs, Isa::best(), par, cancel)?;
            let [Piece { cell, voxel, content, sub, place }] = root;
            let sub = match sub {
                Sub::InnerNode(root) if is_whole => match cluster::whole(root, input, &refs) {
                    Ok(plan) => return Ok(done(vec![plan], None, refs)),
                    Err(root) => Sub::InnerNode(root),
                },
                sub => sub,
            };
            pieces = vec![Piece { cell, voxel, content, sub, place }];
            below = counts;
        } else {
            coverage::mark(&mut pieces, input, &refs, Isa::best(), par, cancel)?;
        }
        let (plans, units) = cluster::fine(pieces.iter_mut().map(|p| &mut p.sub), input, &refs, par);
        let top = Top { pieces, units, fine_blocks: plans.len() as u32, counts: below };
        Ok(done(plans, Some(top), refs))
    }

    /// Takes the plans of its blocks, in their order, for [`Chunk::encode`].
    pub fn take_plans(&mut self) -> Vec<Plan> {
        std::mem::take(&mut self.plans)
    }

    /// The trace form of a block; that of its leaf block, unless it is all of the tree. Its plan goes: to give back
    /// what that holds of the tree takes a while, which all threads share then.
    pub fn encode(&self, plan: Plan) -> (TreeBlock, Option<TreeBlock>) {
        encode::encode(&plan, 0, self.input, &self.refs)
    }
}

/// The coarse blocks of a tree.
pub struct UpperTree {
    plans: Vec<Plan>,
    /// Of the whole tree.
    pub counts: Counts,
}

impl UpperTree {
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
