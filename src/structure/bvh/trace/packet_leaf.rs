//! Leaves of packets: eight triangles are tested against one ray after the other, or sixteen rays against one triangle
//! after the other, whichever takes fewer tests.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::hit::{Outcome, TriHit};
use super::kernel::Together;
use super::packet::{PacketEntry, PacketWalk, VECTORS, at};
use super::packet_prepare::Common;
use super::single::{is_better, nearest};
use super::tables::tables;
use crate::geom::watertight::{LaneHits, shear};
use crate::simd::{Lanes, Simd};
use crate::structure::bvh::layout::Block;
use crate::structure::bvh::leaf::Leaf;
use crate::structure::packet_triangles::{Corners, beside, keep, keep_better, triangle};

/// Tests the triangles of a leaf against the rays of a packet.
#[inline(always)]
pub(super) fn leaf<S: Simd, const ANY: bool>(
    s: S,
    tree: Together,
    walk: &mut PacketWalk,
    entry: PacketEntry,
    block: Block,
    at: usize,
) -> Outcome {
    let (leaf, common) = (block.leaf(at), tree.common);
    let corners = corners(s, &leaf, common);
    let mut left = all_triangles(leaf.triangles);
    if common.one_origin {
        left &= !beside(s, &corners, common);
    }
    test::<S, ANY>(s, tree, walk, entry, &AtLeaf { block, leaf, at, corners: &corners }, [left; VECTORS])
}

/// A leaf that rays are at.
pub(super) struct AtLeaf<'a> {
    pub block: Block<'a>,
    pub leaf: Leaf<'a>,
    /// Index of its first word.
    pub at: usize,
    pub corners: &'a Corners,
}

/// Tests `triangles` of a leaf, given for each vector of rays, against a packet.
#[inline(always)]
pub(super) fn test<S: Simd, const ANY: bool>(
    s: S,
    tree: Together,
    walk: &mut PacketWalk,
    entry: PacketEntry,
    here: &AtLeaf,
    triangles: [u32; VECTORS],
) -> Outcome {
    let (Together { view, filter, common, .. }, &AtLeaf { block, ref leaf, at, corners }) = (tree, here);
    let (mut tests, mut left) = (0, 0);
    for h in 0..VECTORS {
        if entry.rays >> (16 * h) & 0xffff != 0 {
            tests += triangles[h].count_ones();
            left |= triangles[h];
        }
    }
    if entry.rays.count_ones() < tests {
        return leaf_ray_by_ray::<S, ANY>(s, tree, walk, entry, here);
    }
    walk.counters.triangles += u64::from(left.count_ones());
    while left != 0 {
        let i = left.trailing_zeros() as usize;
        left &= left - 1;
        for h in 0..VECTORS {
            // An any-hit ray may already have a hit in this leaf.
            let rays = (entry.rays & walk.waiting) >> (16 * h) & 0xffff;
            if rays == 0 || triangles[h] >> i & 1 == 0 {
                continue;
            }
            let found = if common.one_origin {
                triangle::<S, true>(s, corners, i, common.k, walk, h)
            } else {
                triangle::<S, false>(s, corners, i, common.k, walk, h)
            };
            let hits = found.hits & rays;
            let found = LaneHits { hits, ..found };
            if hits == 0 || filter.is_some_and(|f| f.hides(block.part(leaf.part_of(i)))) {
                continue;
            }
            let tri = (at as u32) << 3 | i as u32;
            if let Err(missing) = keep_better::<S, ANY>(s, view, walk, h, &found, (entry.block, tri)) {
                walk.stack.push(entry);
                return Outcome::Pending(missing);
            }
            if ANY {
                walk.waiting &= !(hits << (16 * h));
            }
        }
    }
    Outcome::Done
}

/// Tests eight triangles at a time against one ray after the other.
#[inline(always)]
fn leaf_ray_by_ray<S: Simd, const ANY: bool>(
    s: S,
    tree: Together,
    walk: &mut PacketWalk,
    entry: PacketEntry,
    here: &AtLeaf,
) -> Outcome {
    let (Together { view, filter, common, .. }, &AtLeaf { block, leaf, at: leaf_at, corners }) = (tree, here);
    let k = common.k;
    let mut rays = entry.rays;
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        let r = &walk.rays;
        let skew = [s.splat8(at(&r.shear[0], i)), s.splat8(at(&r.shear[1], i)), s.splat8(at(&r.shear[2], i))];
        let zero = s.splat8(0.0);
        let mut moved = [[zero; 3]; 3];
        for axis in 0..3 {
            for c in 0..3 {
                let corner = s.load8(&corners[c][axis]);
                moved[c][axis] = if common.one_origin { corner } else { corner - s.splat8(at(&r.org[k[axis]], i)) };
            }
        }
        let [a, b, c] = moved;
        let sheared = [shear(a, skew), shear(b, skew), shear(c, skew)];
        walk.counters.triangles += leaf.triangles as u64;
        if let Some((lane, t, u, v)) =
            nearest(s, block, leaf, sheared, s.splat8(at(&r.t_min, i)), filter, at(&walk.hits.t, i))
        {
            let hit = TriHit { t, u, v, block: entry.block, tri: (leaf_at as u32) << 3 | lane };
            let best = walk.best(i);
            match is_better(view, &hit, &best, &mut walk.counters) {
                Ok(true) => keep(walk, i, &hit),
                Ok(false) => {}
                Err(missing) => {
                    walk.stack.push(PacketEntry { rays, ..entry });
                    return Outcome::Pending(missing);
                }
            }
            if ANY {
                walk.waiting &= !(1 << i);
            }
        }
        rays &= rays - 1;
    }
    Outcome::Done
}

/// Returns the corners of a leaf's triangles, relative to the rays' origin if they share one. Lanes past the last
/// triangle are undefined.
#[inline(always)]
pub(super) fn corners<S: Simd>(s: S, leaf: &Leaf, common: &Common) -> Corners {
    let k = common.k;
    let (mut all, tables) = ([[[0.0; 8]; 3]; 3], tables(s, leaf, k));
    for axis in 0..3 {
        let org = s.splat8(if common.one_origin { common.org_near[k[axis]] } else { 0.0 });
        for c in 0..3 {
            all[c][axis] = (s.lookup16(tables[axis], s.index8(leaf.corners8(c))) - org).to_array();
        }
    }
    all
}

/// Returns a bit for each triangle of a leaf.
#[inline(always)]
pub(super) fn all_triangles(count: usize) -> u32 {
    (1 << count) - 1
}
