//! Leaves of packets: eight triangles are tested against one ray after the other, or sixteen rays against one triangle
//! after the other, whichever takes fewer tests.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::TreeView;
use super::hit::{Outcome, TriHit};
use super::kernel::Together;
use super::packet::{PacketEntry, PacketHits, PacketWalk, VECTORS, at};
use super::packet_prepare::Common;
use super::packet_visit::keep;
use super::single::{is_better, nearest};
use super::tables::tables;
use crate::base::ids::BlockId;
use crate::geom::watertight::{LaneHits, intersect, shear};
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Block;
use crate::structure::bvh::leaf::Leaf;

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

/// Corners of eight triangles: by corner, then by axis in the order of [`Common::k`].
pub(super) type Corners = [[[f32; 8]; 3]; 3];

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

/// Returns the triangles that lie outside the packet: for all rays, their sheared corners are on one side of the
/// origin. The sheared corner for a ray between the extremes of the shear lies between the results for the extremes.
/// Rounding does not change this, because rounded differences and products are monotonic. So the triangle test would
/// accept none of these triangles.
#[inline(always)]
fn beside<S: Simd>(s: S, corners: &Corners, common: &Common) -> u32 {
    let zero = s.splat8(0.0);
    let mut beside = 0;
    for axis in 0..2 {
        let (least, greatest) = (s.splat8(common.shear_min[axis]), s.splat8(common.shear_max[axis]));
        let mut all_low = s.splat8(f32::INFINITY);
        let mut all_high = s.splat8(f32::NEG_INFINITY);
        for corner in corners {
            let (along, z) = (s.load8(&corner[axis]), s.load8(&corner[2]));
            let (a, b) = (along - least * z, along - greatest * z);
            all_low = a.min(b).min(all_low);
            all_high = a.max(b).max(all_high);
        }
        // A comparison with NaN, the result of an overflow, is false: such a triangle is kept.
        beside |= zero.le(all_low).bits() & !zero.eq(all_low).bits();
        beside |= all_high.le(zero).bits() & !zero.eq(all_high).bits();
    }
    beside
}

/// Tests triangle `i` against the rays of a vector. `MOVED`: corners are relative to the origin.
#[inline(always)]
fn triangle<S: Simd, const MOVED: bool>(
    s: S,
    corners: &Corners,
    i: usize,
    k: [usize; 3],
    walk: &PacketWalk,
    h: usize,
) -> LaneHits<S::F16> {
    let rays = &walk.rays;
    let skew = [s.load16(&rays.shear[0][h]), s.load16(&rays.shear[1][h]), s.load16(&rays.shear[2][h])];
    let mut moved = [skew; 3];
    for axis in 0..3 {
        for c in 0..3 {
            let corner = s.splat16(corners[c][axis][i & 7]);
            moved[c][axis] = if MOVED { corner } else { corner - s.load16(&rays.org[k[axis]][h]) };
        }
    }
    let [a, b, c] = moved;
    let moved = [shear(a, skew), shear(b, skew), shear(c, skew)];
    intersect::<16, _>(0xffff, moved, s.splat16(0.0), s.load16(&rays.t_min[h]), s.load16(&walk.hits.t[h]))
}

/// Keeps the hits that are better than those that their rays have, like [`is_better`]. All lanes are handled at once,
/// except for ties.
#[inline(always)]
pub(super) fn keep_better<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    walk: &mut PacketWalk,
    h: usize,
    found: &LaneHits<S::F16>,
    (block, tri): (u32, u32),
) -> Result<(), BlockId> {
    let hits = found.hits;
    let some = walk.hits.some >> (16 * h) & 0xffff;
    let t = s.load16(&walk.hits.t[h]);
    let mut better = hits;
    // No lane of `hits` is farther than its best hit: the triangle test excluded those.
    let equal = t.eq(found.t).bits() & hits & some;
    if !ANY && equal != 0 {
        better = untie(view, walk, h, [better, equal], found.t.to_array(), (block, tri))?;
    }
    let mask = s.mask16(better);
    let PacketHits { some, t, u, v, block: blocks, tri: tris } = &mut walk.hits;
    *some |= better << (16 * h);
    put(s, mask, &mut t[h], found.t);
    put(s, mask, &mut u[h], found.u);
    put(s, mask, &mut v[h], found.v);
    put(s, mask, &mut blocks[h], s.splat16(f32::from_bits(block)));
    put(s, mask, &mut tris[h], s.splat16(f32::from_bits(tri)));
    Ok(())
}

#[inline(always)]
fn put<S: Simd>(s: S, mask: <S::F16 as Lanes<16>>::Mask, row: &mut [f32; 16], v: S::F16) {
    *row = v.select(mask, s.load16(row)).to_array();
}

/// Returns the lanes `better`, without the lanes of `equal` that keep their best hit.
#[cold]
#[inline(never)]
fn untie(
    view: &TreeView,
    walk: &mut PacketWalk,
    h: usize,
    [mut better, equal]: [u32; 2],
    t: [f32; 16],
    (block, tri): (u32, u32),
) -> Result<u32, BlockId> {
    for lane in (0..16).filter(|lane| equal >> lane & 1 == 1) {
        let best = walk.best(16 * h + lane);
        let hit = TriHit { t: t[lane], u: 0.0, v: 0.0, block, tri };
        if !is_better(view, &hit, &best, &mut walk.counters)? {
            better &= !(1 << lane);
        }
    }
    Ok(better)
}
