//! Packets and triangles: tests of sixteen rays against a triangle, and the best hits of rays.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::hit::{Counters, TriHit};
use super::packet::{PacketHits, PacketWalk, at_mut};
use super::packet_prepare::Common;
use crate::base::ids::BlockId;
use crate::geom::watertight::{LaneHits, intersect, shear};
use crate::simd::{Lanes, Mask, Simd};

/// Decides between hits.
pub(in crate::structure) trait Ties {
    /// Returns true if `hit` beats `best`: it is nearer, or as near with a lower primitive id. Fails with the id of a
    /// block that is needed to compare primitive ids.
    fn is_better(&self, hit: &TriHit, best: &TriHit, counters: &mut Counters) -> Result<bool, BlockId>;
}

/// Corners of eight triangles: by corner, then by axis in the order of [`Common::k`].
pub(in crate::structure) type Corners = [[[f32; 8]; 3]; 3];

/// Returns the triangles that lie outside the packet: for all rays, their sheared corners are on one side of the
/// origin. The sheared corner for a ray between the extremes of the shear lies between the results for the extremes.
/// Rounding does not change this, because rounded differences and products are monotonic. So the triangle test would
/// accept none of these triangles.
#[inline(always)]
pub(in crate::structure) fn beside<S: Simd>(s: S, corners: &Corners, common: &Common) -> u32 {
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
pub(in crate::structure) fn triangle<S: Simd, const MOVED: bool>(
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

/// Keeps the hits that are better than those that their rays have, like [`Ties::is_better`]. All lanes are handled at
/// once, except for ties.
#[inline(always)]
pub(in crate::structure) fn keep_better<S: Simd, const ANY: bool>(
    s: S,
    ties: &impl Ties,
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
        better = untie(ties, walk, h, [better, equal], found.t.to_array(), (block, tri))?;
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
    ties: &impl Ties,
    walk: &mut PacketWalk,
    h: usize,
    [mut better, equal]: [u32; 2],
    t: [f32; 16],
    (block, tri): (u32, u32),
) -> Result<u32, BlockId> {
    for lane in (0..16).filter(|lane| equal >> lane & 1 == 1) {
        let best = walk.best(16 * h + lane);
        let hit = TriHit { t: t[lane], u: 0.0, v: 0.0, block, tri };
        if !ties.is_better(&hit, &best, &mut walk.counters)? {
            better &= !(1 << lane);
        }
    }
    Ok(better)
}

/// Keeps the best hit of ray `i`.
#[inline(always)]
pub(in crate::structure) fn keep(walk: &mut PacketWalk, i: usize, best: &TriHit) {
    let h = &mut walk.hits;
    (*at_mut(&mut h.t, i), *at_mut(&mut h.u, i), *at_mut(&mut h.v, i)) = (best.t, best.u, best.v);
    *at_mut(&mut h.block, i) = f32::from_bits(best.block);
    *at_mut(&mut h.tri, i) = f32::from_bits(best.tri);
    h.some |= u32::from(best.is_hit()) << i;
}
