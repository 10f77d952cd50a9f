//! Leaves of bundles: the outlines of the triangles are computed once. For each of its vectors of rays, a packet then
//! tests the triangles with outlines that overlap the shears of these rays.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::bundle::{Bundle, BundleEntry};
use super::kernel::Together;
use super::packet::{PacketEntry, VECTORS, at_mut};
use super::packet_leaf::{AtLeaf, all_triangles, corners, test};
use super::packet_prepare::Common;
use super::{PartFilter, TreeView};
use crate::math::BUNDLE;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Block;
use crate::structure::packet_boxes::{farthest, meet};
use crate::structure::packet_triangles::Corners;

/// Triangles with a corner nearer than this, along the axis of the greatest direction component, have an unbounded
/// outline.
const NEAREST: f32 = 1e-28;
/// Distance by which outlines are enlarged, as a fraction of their magnitude or of 1, whichever is greater: far more
/// than the rounding errors of quotients and shears.
const GIVE: f32 = 1e-6;

/// Least and greatest shear of the corners of eight triangles, along two axes.
struct Outline<F> {
    least: [F; 2],
    greatest: [F; 2],
}

/// Returns the outline of a leaf's triangles. If the outline of a triangle does not overlap the shears of some rays,
/// then its corners, sheared as the triangle test does it, lie on one side of each of these rays.
#[inline(always)]
fn outline<S: Simd>(s: S, corners: &Corners, common: &Common) -> Outline<S::F8> {
    let (lowest, highest) = (s.splat8(f32::NEG_INFINITY), s.splat8(f32::INFINITY));
    let (mut least, mut greatest) = ([highest; 2], [lowest; 2]);
    let mut ahead = highest;
    for corner in corners {
        let z = s.load8(&corner[2]);
        ahead = (z * s.splat8(common.sign[common.k[2]])).min(ahead);
        for axis in 0..2 {
            let shear = s.load8(&corner[axis]).div(z);
            (least[axis], greatest[axis]) = (shear.min(least[axis]), shear.max(greatest[axis]));
        }
    }
    let is_ahead = s.splat8(NEAREST).le(ahead);
    let zero = s.splat8(0.0);
    for axis in 0..2 {
        let size = (zero - least[axis]).max(greatest[axis]).max(s.splat8(1.0));
        let give = size * s.splat8(GIVE);
        least[axis] = (least[axis] - give).select(is_ahead, lowest);
        greatest[axis] = (greatest[axis] + give).select(is_ahead, highest);
    }
    Outline { least, greatest }
}

/// Returns the triangles that the rays of vector `h` of a packet may hit.
#[inline(always)]
fn across<S: Simd>(s: S, outline: &Outline<S::F8>, common: &Common, h: usize) -> u32 {
    let half = &common.shears[h];
    let mut across = u32::MAX;
    for axis in 0..2 {
        across &= s.splat8(half[axis][0]).le(outline.greatest[axis]).bits();
        across &= outline.least[axis].le(s.splat8(half[axis][1])).bits();
    }
    across
}

/// Tests the triangles of a leaf against the rays of all packets of `entry`.
#[inline(always)]
pub(super) fn leaf<S: Simd>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    bundle: &mut Bundle,
    entry: &BundleEntry,
    block: Block,
    at: usize,
) {
    let Bundle { packets, class, counters, .. } = bundle;
    let leaf = block.leaf(at);
    let corners = corners(s, &leaf, &class.common);
    let here = AtLeaf { block, leaf, at, corners: &corners };
    let outline = outline(s, &corners, &class.common);
    let all = all_triangles(leaf.triangles);
    counters.leaves += 1;
    counters.leaf_lines += leaf.lines(at) as u64;
    let mut left = entry.packets;
    while left != 0 {
        let p = left.trailing_zeros() as usize & (BUNDLE - 1);
        left &= left - 1;
        let walk = &mut packets[p];
        let mut triangles = [0; VECTORS];
        for h in 0..VECTORS {
            triangles[h] = across(s, &outline, &walk.common, h) & all;
        }
        if triangles == [0; VECTORS] {
            continue;
        }
        let rays = meet(s, &entry.planes, true, walk) & walk.waiting;
        if rays == 0 {
            continue;
        }
        let own = PacketEntry { t: entry.t, rays, block: entry.block, child: entry.child };
        // An entry that needs a missing block stays on the packet's stack.
        let tree = Together { view, filter, common: &class.common, is_large: false };
        let _ = test::<S, false>(s, tree, walk, own, &here, triangles);
        *at_mut(&mut class.far, p) = farthest(s, &walk.hits.t);
    }
}
