//! Which rays pass a cell that stands in: as many as pass what it holds.
//!
//! Where a ray enters the cell's region says so, by a hash over a grid an eighth to a quarter as wide as the cell is
//! long: fixed to the object, so that nothing swims; and cells that overlap, which mostly hold parts of the same thing,
//! mostly decide alike, so that it is not covered by each of them anew. (On a grid as wide as the cell what is seen of
//! a few cells is a matter of chance: wires at PoE 10 had 0.87 to 1.13 of their coverage.) Only cells whose level is
//! low (`lod::TRANSMITTING_LEVEL`) in nodes of which the block's header says so are asked: the voxel is looked at for
//! that.
//!
//! One ray at a time, in the same steps by all walks: they see the same to the bit.

use crate::lod::TRANSMITTING_LEVEL;
use crate::structure::bvh::layout::Block;

/// A ray, as all walks have it to the bit.
#[derive(Clone, Copy)]
pub(super) struct EntryRay {
    pub org: [f32; 3],
    /// Signed.
    pub dir: [f32; 3],
}

impl EntryRay {
    /// Whether it passes the cell in `slot` of a node, whose region it enters at `t`.
    #[inline(always)]
    pub fn is_transmitted(&self, block: Block, node: usize, slot: usize, t: f32) -> bool {
        may_transmit(block, node, slot)
            && CoverageTest::of(block, node, slot).is_some_and(|coverage| coverage.transmits(self, t))
    }
}

/// Whether a voxel is to be looked at for rays that pass its cell. (By the level alone most of a scan's larger cells
/// are, which let none pass: that is two more cache lines.)
#[inline(always)]
pub(super) fn may_transmit(block: Block, node: usize, slot: usize) -> bool {
    block.node(node).level(slot) <= TRANSMITTING_LEVEL && block.may_transmit(node)
}

/// A cell that some rays pass.
pub(super) struct CoverageTest {
    /// How many of 4096 rays it stops.
    stopped: u32,
    /// The exponent of the cells of its grid, as a number of single precision has it.
    exponent: u32,
}

impl CoverageTest {
    /// The cell in `slot` of a node; `None` if it stops all.
    #[inline(never)]
    pub fn of(block: Block, node: usize, slot: usize) -> Option<Self> {
        let stopped = block.voxel(node, slot).stopped();
        let cell = block.node(node).stored_box(slot).extent();
        // The greatest power of two that is no more than a quarter of it: its reciprocal is one too.
        let exponent = (cell.max_element().to_bits() >> 23).clamp(3, 253) - 2;
        (stopped > 0).then_some(Self { stopped, exponent })
    }

    /// By a ray that enters its region at `t`.
    #[inline(always)]
    pub fn transmits(&self, ray: &EntryRay, t: f32) -> bool {
        let per_size = f32::from_bits((254 - self.exponent) << 23);
        let mut hash = self.exponent;
        for axis in 0..3 {
            let at = (ray.org[axis] + ray.dir[axis] * t) * per_size;
            hash = mix(hash ^ (at.floor() as i32 as u32));
        }
        hash >> 20 >= self.stopped
    }
}

/// Ellis, "Hash Function Prospector", 2018: "lowbias32".
fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}
