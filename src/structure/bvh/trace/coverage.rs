//! The coverage test: decides if a stand-in stops a ray, so that a cell stops the same share of rays as its content.
//!
//! The decision is a hash of the point at which the ray enters the cell's region, on a grid with a spacing of an eighth
//! to a quarter of the cell's greatest extent. The grid is fixed to the object, so patterns do not swim. Cells that
//! overlap, and mostly hold parts of the same object, mostly decide alike, so that several cells do not stop more rays
//! than one. (On a grid as wide as the cell, the visible share of a few cells is a matter of chance: wires at PoE 10
//! had 0.87 to 1.13 of their coverage.) The test reads the voxel, so it is made only for cells of a low level
//! (`lod::TRANSMITTING_LEVEL`) in nodes that the block's header marks.
//!
//! All walks test one ray at a time in the same steps, so their results are identical to the bit.

use crate::lod::TRANSMITTING_LEVEL;
use crate::structure::bvh::layout::Block;

/// A ray for the coverage test, the same to the bit in all walks.
#[derive(Clone, Copy)]
pub(super) struct EntryRay {
    pub org: [f32; 3],
    /// Signed direction.
    pub dir: [f32; 3],
}

impl EntryRay {
    /// True if the cell in `slot` of a node transmits the ray, which enters the cell's region at `t`.
    #[inline(always)]
    pub fn is_transmitted(&self, block: Block, node: usize, slot: usize, t: f32) -> bool {
        may_transmit(block, node, slot)
            && CoverageTest::of(block, node, slot).is_some_and(|coverage| coverage.transmits(self, t))
    }
}

/// True if the voxel must be read to decide if the cell transmits a ray. (By the level alone, the voxels of most larger
/// cells of a scan are read, although these transmit nothing: two more cache lines each.)
#[inline(always)]
pub(super) fn may_transmit(block: Block, node: usize, slot: usize) -> bool {
    block.node(node).level(slot) <= TRANSMITTING_LEVEL && block.may_transmit(node)
}

/// A cell that transmits some rays.
pub(super) struct CoverageTest {
    /// Number of rays out of 4096 that the cell stops.
    stopped: u32,
    /// Biased exponent of the width of the grid, as in the bits of a single-precision number.
    exponent: u32,
}

impl CoverageTest {
    /// Returns the test of the cell in `slot` of a node, or `None` if the cell stops all rays.
    #[inline(never)]
    pub fn of(block: Block, node: usize, slot: usize) -> Option<Self> {
        let stopped = block.voxel(node, slot).stopped();
        let cell = block.node(node).stored_box(slot).extent();
        // Exponent of the greatest power of two that is at most a quarter of the extent. The reciprocal is a power of
        // two as well.
        let exponent = (cell.max_element().to_bits() >> 23).clamp(3, 253) - 2;
        (stopped > 0).then_some(Self { stopped, exponent })
    }

    /// True if the cell transmits a ray that enters its region at `t`.
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

/// Mixes the bits of `x` with "lowbias32" (Ellis, "Hash Function Prospector", 2018).
fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}
