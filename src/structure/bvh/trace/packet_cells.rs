//! Stand-ins for packets: one cell at a time against all rays that come to it.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet::{PacketEntry, PacketWalk, VECTORS};
use super::packet_leaf::keep_better;
use super::packet_prepare::Shared;
use super::packet_visit::Planes;
use super::ray::abs;
use super::stand_in::{self, CELL_SLACK, ConeRay, Met, Verdict};
use super::{PartFilter, TreeView};
use crate::geom::watertight::LaneHits;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Block;

/// The children that could stand in for some ray: by the least directions and the greatest widths.
#[inline(always)]
pub(super) fn likely<S: Simd>(s: S, planes: &Planes, leave: S::F8, shared: &Shared) -> u32 {
    let near = [s.load8(&planes[0][0]), s.load8(&planes[1][0]), s.load8(&planes[2][0])];
    let far = [s.load8(&planes[0][1]), s.load8(&planes[1][1]), s.load8(&planes[2][1])];
    let dir = [s.splat8(shared.dir_min[0]), s.splat8(shared.dir_min[1]), s.splat8(shared.dir_min[2])];
    let width = s.splat8(shared.cone_max[0]) + s.splat8(shared.cone_max[1]) * leave;
    // A hundredth more, for where the cell is met is rounded otherwise.
    stand_in::area(near, far, dir, s.splat8(0.0)).le(width * width * s.splat8(1.01)).bits()
}

/// What a vector of rays meets of a cell between planes `near` and `far`.
#[inline(always)]
fn meet<S: Simd>(s: S, near: [f32; 3], far: [f32; 3], reach: f32, walk: &PacketWalk, h: usize) -> Met<S::F16> {
    let (rays, zero) = (&walk.rays, s.splat16(0.0));
    let mut ray = ConeRay {
        org: [zero; 3],
        inv: [zero; 3],
        dir: [zero; 3],
        slack: [zero; 3],
        t_min: s.load16(&rays.t_min[h]),
        a: s.load16(&rays.cone[0][h]),
        b: s.load16(&rays.cone[1][h]),
    };
    let (mut first, mut last) = ([zero; 3], [zero; 3]);
    for axis in 0..3 {
        (ray.org[axis], ray.inv[axis]) = (s.load16(&rays.org[axis][h]), s.load16(&rays.inv[axis][h]));
        ray.dir[axis] = abs(zero, s.load16(&rays.dir[axis][h]));
        let far = abs(zero, ray.org[axis]).max(s.splat16(reach));
        ray.slack[axis] = abs(zero, ray.inv[axis]) * far * s.splat16(CELL_SLACK);
    }
    for axis in 0..3 {
        (first[axis], last[axis]) = (s.splat16(near[axis]), s.splat16(far[axis]));
    }
    stand_in::meet(first, last, &ray, zero, s.splat16(f32::INFINITY))
}

/// Lets the cell in `slot` stand in for those of `rays` for which it is small enough; returns the others.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
pub(super) fn stand_in<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    block: Block,
    node: usize,
    slot: usize,
    planes: &Planes,
    rays: u32,
    block_id: u32,
    walk: &mut PacketWalk,
) -> u32 {
    let near = [planes[0][0][slot & 7], planes[1][0][slot & 7], planes[2][0][slot & 7]];
    let far = [planes[0][1][slot & 7], planes[1][1][slot & 7], planes[2][1][slot & 7]];
    let mut left = rays;
    for h in 0..VECTORS {
        let here = rays >> (16 * h) & 0xffff;
        if here == 0 {
            continue;
        }
        let met = meet(s, near, far, view.reach, walk, h);
        let small = met.small & here;
        if small == 0 {
            continue;
        }
        match stand_in::judge(block, node, slot, filter) {
            Verdict::Descend => return rays,
            Verdict::Skip => {}
            Verdict::Stand => {
                let tri = stand_in::lod_code(node, slot);
                offer::<S, ANY>(s, view, walk, h, small, met.enter, block_id, tri);
            }
        }
        left &= !(small << (16 * h));
    }
    left
}

/// Offers the cell of external reference `index`, whose block is missing, to the rays of `entry`. Where any hit will
/// do, a cell that a ray begins in is none: nothing is known of it.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state
pub(super) fn for_missing<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    block: Block,
    index: usize,
    shared: &Shared,
    entry: PacketEntry,
    walk: &mut PacketWalk,
) {
    let (node, slot) = block.place_of_external(index);
    if stand_in::judge(block, node, slot, filter) == Verdict::Skip {
        return;
    }
    let it = block.node(node);
    let plane = |row: usize| it.stored_plane(row, slot);
    let other = |row: usize| if row < 3 { row + 3 } else { row - 3 };
    let near = [plane(shared.near[0]), plane(shared.near[1]), plane(shared.near[2])];
    let far = [plane(other(shared.near[0])), plane(other(shared.near[1])), plane(other(shared.near[2]))];
    for h in 0..VECTORS {
        let here = entry.rays >> (16 * h) & 0xffff;
        if here == 0 {
            continue;
        }
        let met = meet(s, near, far, view.reach, walk, h);
        let outside = met.outside & here;
        let tri = stand_in::missing_code(node, slot, false);
        offer::<S, ANY>(s, view, walk, h, outside, met.enter, entry.block, tri);
        let inside = met.meets & here & !outside;
        if !ANY && inside != 0 {
            let tri = stand_in::missing_code(node, slot, true);
            offer::<S, ANY>(s, view, walk, h, inside, met.enter, entry.block, tri);
        }
    }
}

/// Keeps a stand-in for those of `rays`, lanes of vector `h`, for which it is better.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
fn offer<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    walk: &mut PacketWalk,
    h: usize,
    rays: u32,
    t: S::F16,
    block: u32,
    tri: u32,
) {
    let hits = rays & t.le(s.load16(&walk.hits.t[h])).bits();
    if hits == 0 {
        return;
    }
    let zero = s.splat16(0.0);
    let found = LaneHits { hits, t, u: zero, v: zero };
    // Between stand-ins nothing can be missing: places decide.
    let _ = keep_better::<S, ANY>(s, view, walk, h, hits, &found, block, tri);
    if ANY {
        walk.waiting &= !(hits << (16 * h));
    }
}
