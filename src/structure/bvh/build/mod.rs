//! Builds blocks from triangles: references, binned SAH, wide nodes, leaves, clusters.
//!
//! A mesh is built in one or more **chunks**, each in memory. A [`Chunk`] yields its fine and leaf blocks and a
//! [`Top`]; the [`UpperTree`] over all tops yields the coarse blocks. Steps: `refs` (one box per triangle), `sah` and
//! `spatial` (where to split the set, or space), `tree` (wide nodes), `small` and `collapse` (wide nodes of small
//! subtrees, and leaves), `coverage` (shares of rays that cells stop), `seen` (what cells show of other parts) or
//! `proxies` (looks of subtrees), `cluster` (assignment of nodes to blocks), `join` (one tree from several), `encode`
//! (trace form). The result depends only on the input and the options, never on the number of threads.

mod bake;
mod chop;
#[cfg(test)]
mod clip;
mod cluster;
mod collapse;
mod edges;
mod encode;
mod join;
mod leaf;
mod lines;
mod member_cells;
pub mod members;
mod partition;
mod proxies;
mod content;
mod coverage;
pub(in crate::structure::bvh) mod quantise;
mod refs;
mod sah;
mod seen;
mod small;
mod spatial;
pub(in crate::structure::bvh) mod stops;
mod sweep;
mod tree;

pub use bake::BvhBaker;
pub use cluster::Plan;
pub use encode::TreeBlock;
pub use spatial::splits_pay;

use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::simd::Isa;
use crate::structure::bake::{BuiltChunk, Counts, TreeInput, TreeOptions};
use crate::structure::bvh::layout::Child;
use crate::structure::par::Par;
use tree::{InnerNode, Piece, Place, Sub};

/// The tree over some or all of a mesh's triangles: fine and leaf blocks, ready to be encoded one by one.
pub struct Chunk<'a> {
    input: TreeInput<'a>,
    refs: Vec<refs::Ref>,
    plans: Vec<Plan>,
}

/// The part of a chunk's tree above its fine blocks. It does not depend on the chunk any more.
pub struct Top {
    /// The root, or its children.
    pieces: Vec<Piece>,
    units: Vec<cluster::Home>,
    fine_blocks: u32,
    /// Counts of all pieces.
    counts: Counts,
}

impl<'a> Chunk<'a> {
    /// Builds the tree of `input`, which must not be empty. With `is_whole` the input is the whole mesh.
    ///
    /// Fails only with [`crate::Error::Cancelled`] and [`crate::Error::NoMemory`].
    pub fn build(
        input: TreeInput<'a>,
        options: &TreeOptions,
        is_whole: bool,
        par: &Par,
        stretch: &Stretch,
    ) -> Result<BuiltChunk<Chunk<'a>, Top>> {
        let mut refs = refs::make(input.triangles, options.split_budget, par)?;
        stretch.check()?;
        let tree = stretch.part(0.0, 0.5, input.triangles.len() as u64);
        let (marks, samples) = match options.proxies {
            Some(_) => (stretch.part(0.5, 0.75, 1), stretch.part(0.75, 1.0, 1)),
            None => (stretch.part(0.5, 0.8, 1), stretch.part(0.8, 1.0, 1)),
        };
        // Either kind of stand-ins shows what is met first.
        let sampled = |pieces: &mut [Piece], refs: &[refs::Ref]| match &options.proxies {
            Some(asked) => proxies::sample(pieces, input, refs, asked, Isa::best(), par, &samples),
            None => seen::sample(pieces, input, refs, Isa::best(), par, &samples).map(|()| Vec::new()),
        };
        let tree::Built { children, bounds, counts } =
            tree::build(input, &mut refs, options.mesh_half_area, par, &tree)?;
        let done = |plans, top, refs, proxies| BuiltChunk {
            chunk: Chunk { input, refs, plans },
            top,
            bounds,
            counts,
            proxies,
        };
        let mut pieces = children;
        let proxies;
        let mut below = Counts { depth: counts.depth - 1, nodes: counts.nodes - 1, ..counts };
        // Tops of several chunks hold the children of the roots. A root is created here if it stays, or has leaves, in
        // which case it is a fine unit.
        if is_whole || pieces.iter().any(|p| matches!(p.sub, Sub::Leaf { .. })) {
            let mut root = [InnerNode::over(pieces, Place::Above)];
            coverage::mark(&mut root, input, &refs, Isa::best(), par, &marks)?;
            proxies = sampled(&mut root, &refs)?;
            let [Piece { cell, voxel, content, sub, place }] = root;
            let sub = match sub {
                Sub::InnerNode(root) if is_whole => match cluster::whole(root, input, &refs) {
                    Ok(plan) => return Ok(done(vec![plan], None, refs, proxies)),
                    Err(root) => Sub::InnerNode(root),
                },
                sub => sub,
            };
            pieces = vec![Piece { cell, voxel, content, sub, place }];
            below = counts;
        } else {
            coverage::mark(&mut pieces, input, &refs, Isa::best(), par, &marks)?;
            proxies = sampled(&mut pieces, &refs)?;
        }
        let (plans, units) = cluster::fine(pieces.iter_mut().map(|p| &mut p.sub), input, &refs, par);
        let top = Top { pieces, units, fine_blocks: plans.len() as u32, counts: below };
        Ok(done(plans, Some(top), refs, proxies))
    }

    /// Takes the plans of the blocks, in order, for [`Chunk::encode`].
    pub fn take_plans(&mut self) -> Vec<Plan> {
        std::mem::take(&mut self.plans)
    }

    /// Encodes a block, and its leaf block unless the block is the whole tree. The function consumes the plan: freeing
    /// its part of the tree takes a while, and this way all threads share that work.
    pub fn encode(&self, plan: Plan) -> (TreeBlock, Option<TreeBlock>) {
        encode::encode(&plan, 0, self.input, &self.refs)
    }
}

/// The coarse blocks of a tree.
pub struct UpperTree {
    plans: Vec<Plan>,
    /// Counts of the whole tree.
    pub counts: Counts,
}

impl UpperTree {
    /// Builds the upper tree over the chunks of a mesh, at least one. Their fine blocks are numbered one after the
    /// other in this order.
    pub fn over(tops: Vec<Top>) -> Result<Self> {
        let join::Joined { root, units, counts } = join::join(tops)?;
        Ok(Self { plans: cluster::coarse(root, &units), counts })
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.plans.len()
    }

    /// Encodes block `index`; `first_block` is the id of the tree's block 0.
    pub fn encode(&self, index: usize, first_block: u32) -> TreeBlock {
        let nothing =
            TreeInput { triangles: &[], parts: &[], prims: &[], colours: &[], normals: &[], part_colours: &[] };
        encode::encode(&self.plans[index], first_block, nothing, &[]).0
    }
}

/// Child reference to the root of a tree inside its block 0.
pub fn root() -> u32 {
    Child::Node(0).to_bits().into()
}
