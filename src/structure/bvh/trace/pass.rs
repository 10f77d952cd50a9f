//! Which rays pass a cell that stands in: as many as pass what it holds.
//!
//! Where a ray enters the cell's region says so, by a hash over a grid a quarter as wide as the cell: fixed to the object, so that
//! nothing swims; and cells that overlap, which mostly hold parts of the same thing, mostly decide alike, so that it is not covered by
//! each of them anew. (On a grid as wide as the cell what is seen of a few cells is a matter of chance: wires at PoE 10 had 0.87 to 1.13
//! of their coverage.) Only cells whose level is low are asked (`lod::PASSING`): the voxel is looked at for that.
//!
//! One ray at a time, in the same steps by all walks: they see the same to the bit.

use crate::lod::PASSING;
use crate::structure::bvh::layout::{Block, Node};

/// A ray, as all walks have it to the bit.
#[derive(Clone, Copy)]
pub(super) struct Passing {
    pub org: [f32; 3],
    /// Signed.
    pub dir: [f32; 3],
}

impl Passing {
    /// Whether it passes the cell in `slot` of a node, whose region it enters at `t`.
    #[inline(always)]
    pub fn passes(&self, block: Block, node: usize, slot: usize, t: f32) -> bool {
        block.node(node).level(slot) <= PASSING && self.is_let_through(block, node, slot, t)
    }

    #[inline(never)]
    fn is_let_through(&self, block: Block, node: usize, slot: usize, t: f32) -> bool {
        let stopped = block.voxel(node, slot).stopped();
        stopped > 0 && self.hash(block.node(node), slot, t) >> 20 >= stopped
    }

    fn hash(&self, node: &Node, slot: usize, t: f32) -> u32 {
        let cell = node.stored_box(slot).extent();
        // The greatest power of two that is no more than a quarter of it: its reciprocal is one too.
        let exponent = (cell.max_element().to_bits() >> 23).clamp(3, 253) - 2;
        let per_size = f32::from_bits((254 - exponent) << 23);
        let mut hash = exponent;
        for axis in 0..3 {
            let at = (self.org[axis] + self.dir[axis] * t) * per_size;
            hash = mix(hash ^ (at.floor() as i32 as u32));
        }
        hash
    }
}

/// Ellis, "Hash Function Prospector", 2018: "lowbias32".
fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}
