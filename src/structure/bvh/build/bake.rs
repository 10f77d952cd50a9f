//! Implements the interface of the baker (`structure::bake`) with the chunks, tops and upper trees of this folder.

use super::{Chunk, Plan, Top, TreeBlock, UpperTree, root, splits_pay};
use crate::base::error::Result;
use crate::base::progress::Stretch;
use crate::structure::bake::{BakedBlock, Baker, BuiltChunk, Counts, TreeInput, TreeOptions};
use crate::structure::bvh::codec;
use crate::structure::bvh::layout::{LEAF, MAX_TRIANGLES, WIDTH};
use crate::structure::par::Par;
use glam::Vec3;

/// Bakes the blocks of a `bvh`.
pub struct BvhBaker;

impl Baker for BvhBaker {
    const CLASSES: usize = LEAF + 1;
    const LEAF_TRIANGLES: u32 = MAX_TRIANGLES as u32;
    type Chunk<'a> = Chunk<'a>;
    type Plan = Plan;
    type Top = Top;
    type UpperTree = UpperTree;

    fn splits_pay(triangles: &[[Vec3; 3]]) -> bool {
        splits_pay(triangles)
    }

    fn build<'a>(
        input: TreeInput<'a>,
        options: &TreeOptions,
        is_whole: bool,
        par: &Par,
        stretch: &Stretch,
    ) -> Result<BuiltChunk<Chunk<'a>, Top>> {
        Chunk::build(input, options, is_whole, par, stretch)
    }

    fn take_plans(chunk: &mut Chunk<'_>) -> Vec<Plan> {
        chunk.take_plans()
    }

    fn encode(chunk: &Chunk<'_>, plan: Plan) -> Vec<BakedBlock> {
        let (block, leaves) = chunk.encode(plan);
        let first = baked(block, leaves.as_ref().map(|leaves| &leaves.words[..]));
        std::iter::once(first).chain(leaves.map(|leaves| baked(leaves, None))).collect()
    }

    fn join(tops: Vec<Top>) -> Result<UpperTree> {
        UpperTree::over(tops)
    }

    fn coarse_blocks(upper_tree: &UpperTree) -> usize {
        upper_tree.blocks()
    }

    fn encode_coarse(upper_tree: &UpperTree, index: usize, first_block: u32) -> BakedBlock {
        baked(upper_tree.encode(index, first_block), None)
    }

    fn counts(upper_tree: &UpperTree) -> Counts {
        upper_tree.counts
    }

    fn max_stack(depth: u32) -> u32 {
        (WIDTH as u32 - 1) * depth + 1
    }

    fn root() -> u32 {
        root()
    }
}

/// Encodes a block for the file. `leaves`: the words of its leaf block, if it has one.
fn baked(block: TreeBlock, leaves: Option<&[u32]>) -> BakedBlock {
    let TreeBlock { words, prims, colours, normals, parts, below, proxies } = block;
    let payload = codec::encode_geometry(&words, leaves);
    BakedBlock { payload, trace_bytes: 4 * words.len() as u32, prims, colours, normals, parts, below, proxies }
}
