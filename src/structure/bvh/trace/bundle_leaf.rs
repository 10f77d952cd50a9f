//! Bundles at leaves: the triangles' outlines are taken once, and each packet tests what lies across its halves.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::bundle::{BUNDLE, Bundle, BundleEntry};
use super::packet::{PacketEntry, PacketWalk, VECTORS, at_mut};
use super::packet_leaf::{Corners, all_triangles, corners, keep_better, leaf_ray_by_ray, triangle};
use super::packet_prepare::Shared;
use super::packet_visit::{farthest, meet};
use super::{PartFilter, TreeView};
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::{Block, Leaf};

/// Corners nearer than this, along the greatest axis, have no outline.
const NEAREST: f32 = 1e-28;
/// By this much, of itself and of 1, outlines are wider than they are: far more than quotients and shears are rounded by.
const GIVE: f32 = 1e-6;

/// Least and greatest shear of eight triangles, along two axes.
struct Outline<F> {
    least: [F; 2],
    greatest: [F; 2],
}

/// That of a leaf's triangles. A triangle beside the shears of some rays has its corners on one side of each of them, sheared as
/// the triangle test does it.
#[inline(always)]
fn outline<S: Simd>(s: S, corners: &Corners, shared: &Shared) -> Outline<S::F8> {
    let (lowest, highest) = (s.splat8(f32::NEG_INFINITY), s.splat8(f32::INFINITY));
    let (mut least, mut greatest) = ([highest; 2], [lowest; 2]);
    let mut ahead = highest;
    for corner in corners {
        let z = s.load8(&corner[2]);
        ahead = (z * s.splat8(shared.sign[shared.k[2]])).min(ahead);
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

/// The triangles that are not beside the rays of half `h` of a packet.
#[inline(always)]
fn across<S: Simd>(s: S, outline: &Outline<S::F8>, shared: &Shared, h: usize) -> u32 {
    let half = &shared.shears[h];
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
    let corners = corners(s, &leaf, &class.shared);
    let outline = outline(s, &corners, &class.shared);
    let all = all_triangles(leaf.triangles);
    counters.leaves += 1;
    let mut left = entry.packets;
    while left != 0 {
        let p = left.trailing_zeros() as usize & (BUNDLE - 1);
        left &= left - 1;
        let walk = &mut packets[p];
        let mut triangles = [0; VECTORS];
        for h in 0..VECTORS {
            triangles[h] = across(s, &outline, &walk.shared, h) & all;
        }
        if triangles == [0; VECTORS] {
            continue;
        }
        let rays = meet(s, &entry.planes, true, walk) & walk.waiting;
        if rays == 0 {
            continue;
        }
        let own = PacketEntry { t: entry.t, rays, block: entry.block, child: entry.child };
        packet(s, view, filter, walk, own, &class.shared, block, &leaf, at, &corners, triangles);
        *at_mut(&mut class.far, p) = farthest(s, &walk.hits.t);
    }
}

/// Tests some triangles of a leaf, other ones for each half, against a packet; if a block is missing for that, leaves it to the packet.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
fn packet<S: Simd>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    entry: PacketEntry,
    shared: &Shared,
    block: Block,
    leaf: &Leaf,
    at: usize,
    corners: &Corners,
    triangles: [u32; VECTORS],
) {
    let (mut tests, mut all) = (0, 0);
    for h in 0..VECTORS {
        if entry.rays >> (16 * h) & 0xffff != 0 {
            tests += triangles[h].count_ones();
            all |= triangles[h];
        }
    }
    if entry.rays.count_ones() < tests {
        let _ = leaf_ray_by_ray::<S, false>(s, view, filter, walk, entry, shared, block, at, corners);
        return;
    }
    walk.counters.triangles += u64::from(all.count_ones());
    for h in 0..VECTORS {
        let rays = entry.rays >> (16 * h) & 0xffff;
        if rays == 0 {
            continue;
        }
        let mut left = triangles[h];
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            let found = triangle::<S, true>(s, corners, i, shared.k, walk, h);
            let hits = found.hits & rays;
            if hits == 0 || filter.is_some_and(|f| f.hides(block.part(leaf.part_of(i)))) {
                continue;
            }
            let tri = (at as u32) << 3 | i as u32;
            if keep_better::<S, false>(s, view, walk, h, hits, &found, entry.block, tri).is_err() {
                walk.stack.push(entry);
                return;
            }
        }
    }
}
