//! From triangles to blocks: references, binned SAH, wide nodes, leaves, clusters.
//!
//! Passes: `refs` (one box a triangle), `sah` and `spatial` (where to split the set, or space), `tree` (wide nodes and leaves), `cluster` (which nodes share a block), `encode` (trace form).
//! The result depends on the input and the options only, never on the number of threads.

mod chop;
#[cfg(test)]
mod clip;
mod cluster;
mod encode;
mod leaf;
pub mod par;
mod partition;
mod quantise;
mod refs;
mod sah;
mod spatial;
mod sweep;
mod tree;

pub use cluster::Plan;
pub use encode::TreeBlock;
pub use par::Par;
pub use spatial::splits_pay;

use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::{Bounds, srgb};
use glam::Vec3;
use tree::Stats;

/// The triangles of one tree, around the tree's origin. All three slices are equally long.
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
    /// Linear colour of a triangle.
    fn colour(&self, triangle: usize) -> Vec3 {
        match self.colours.get(triangle) {
            Some([r, g, b, a]) if *a > 0 => Vec3::from([*r, *g, *b].map(|c| srgb::decode(f32::from(c) / 255.0))),
            _ => self.part_colours.get(self.parts[triangle] as usize).copied().unwrap_or(GREY),
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
}

/// A built tree, ready to be encoded block by block.
pub struct Tree<'a> {
    input: TreeInput<'a>,
    refs: Vec<refs::Ref>,
    plans: Vec<Plan>,
    coarse: usize,
    /// Bounds of all triangles.
    pub bounds: Bounds,
    /// Child reference to the root inside block 0.
    pub root: u32,
    /// Nodes on the longest way down, leaves included.
    pub depth: u32,
    /// Inner nodes.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
    references: u64,
}

impl<'a> Tree<'a> {
    /// Builds the tree of `input`, which must not be empty.
    ///
    /// Fails only with [`crate::Error::Cancelled`].
    pub fn build(input: TreeInput<'a>, options: &TreeOptions, par: &Par, cancel: &Cancel) -> Result<Self> {
        let mut refs = refs::make(input.triangles, options.split_budget, par);
        cancel.check()?;
        let built = tree::build(input, &mut refs, par, cancel)?;
        let stats = built.stats;
        let tree::Sub::Inner(root) = built.root.sub else { return Err(crate::Error::Internal("a tree without a root".into())) };
        let cluster::Packed { plans, coarse, root } = cluster::pack(root, input, &refs, par);
        let Stats { depth, nodes, leaves, references } = stats;
        Ok(Self { input, refs, plans, coarse, bounds: built.bounds, root, depth, nodes, leaves, references })
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.plans.len()
    }

    /// How many of them, from block 0 on, are coarse: nodes alone, over all the others. At least 1.
    pub fn coarse_blocks(&self) -> usize {
        self.coarse
    }

    /// References to triangles, over all leaves; more than the triangles where splits repeat them.
    pub fn references(&self) -> u64 {
        self.references
    }

    /// The trace form of block `index`; `first_block` is the id of the tree's block 0.
    pub fn encode(&self, index: usize, first_block: u32) -> TreeBlock {
        encode::encode(&self.plans, index, first_block, self.input, &self.refs)
    }
}
