//! Nodes that few rays of a packet meet: all eight children against one ray after the other.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet::{PacketEntry, PacketWalk, at, at_mut};
use super::packet_prepare::Shared;
use super::packet_visit::{Boxes, keep};
use super::stand_in::{self, ConeRay};
use super::{PartFilter, TreeView, cell_slabs, single};
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Block;

/// Rays up to which this is less work than one child against all rays after the other.
pub(super) const FEW: u32 = 4;

/// The rays of `entry` that each child is still to be visited by: those that meet it, of `leaves` those that do so inside of their
/// slabs, and for which it does not stand in. Rays share their origin.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
pub(super) fn each<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    block: Block,
    index: usize,
    boxes: &mut Boxes,
    shared: &Shared,
    entry: PacketEntry,
    leaves: u32,
    walk: &mut PacketWalk,
) -> [u32; 8] {
    let (mut out, mut all_asked) = ([0; 8], 0u32);
    let mut rays = entry.rays;
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        rays &= rays - 1;
        let (mut met, asked) = one::<S, ANY, LOD>(s, view, filter, block, index, boxes, shared, entry.block, leaves, i, walk);
        all_asked |= asked;
        while met != 0 {
            out[met.trailing_zeros() as usize & 7] |= 1 << i;
            met &= met - 1;
        }
    }
    if all_asked != 0 {
        walk.gauge.saw((0..8).filter(|slot| all_asked >> slot & 1 == 1 && out[*slot] == 0).count() as u32);
    }
    out
}

/// The children that ray `i` has still to visit; and those of `leaves` whose boxes it meets.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one packet's whole state, kept in registers
fn one<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    block: Block,
    index: usize,
    boxes: &mut Boxes,
    shared: &Shared,
    block_id: u32,
    leaves: u32,
    i: usize,
    walk: &mut PacketWalk,
) -> (u32, u32) {
    let zero = s.splat8(0.0);
    let (mut near, mut far, mut inv) = ([zero; 3], [zero; 3], [zero; 3]);
    for axis in 0..3 {
        (near[axis], far[axis]) = (s.load8(&boxes.planes[axis][0]), s.load8(&boxes.planes[axis][1]));
        inv[axis] = s.splat8(at(&walk.rays.inv[axis], i));
    }
    let [enter, leave] = stand_in::cross(near, far, inv);
    let t_min = s.splat8(at(&walk.rays.t_min, i));
    let mut met = enter.max(t_min).le(leave.min(s.splat8(at(&walk.hits.t, i)))).bits() & boxes.met;
    let is_likely = LOD && met & boxes.small != 0;
    if !is_likely && met & leaves == 0 {
        return (met, 0);
    }
    let (mut dir, mut faces) = ([zero; 3], [zero; 3]);
    for axis in 0..3 {
        (dir[axis], faces[axis]) = (s.splat8(at(&walk.rays.dir[axis], i)), s.load8(&boxes.faces[axis]));
    }
    let (mut small, mut way) = (0, [enter.max(t_min), leave]);
    if is_likely {
        let cone = walk.rays.cone(i);
        let cells = stand_in::meet([enter, leave], faces, &ConeRay { dir, t_min, a: s.splat8(cone.a), b: s.splat8(cone.b) });
        small = cells.small & met & boxes.small;
        way[0] = cells.enter;
    }
    let leaves = met & leaves & !small;
    if small | leaves == 0 {
        return (met, 0);
    }
    let slabs = boxes.slabs(s, block.node(index), shared, view.reach).all(s);
    let [enter, leave] = cell_slabs::within(dir, &slabs, way, s.splat8(1.0));
    let crosses = enter.le(leave).bits();
    met &= !leaves | crosses;
    if small == 0 {
        return (met, leaves);
    }
    let mut best = walk.best(i);
    let (passing, passed) = (walk.rays.passing(i), at_mut(&mut walk.passed, i));
    let settled =
        single::offers(view, small, crosses, &enter.to_array(), &passing, block, block_id, index, filter, &mut best, passed);
    keep(walk, i, &best);
    if ANY && best.is_hit() {
        walk.waiting &= !(1 << i);
        return (0, leaves);
    }
    (met & !settled, leaves)
}
