//! Nodes that few rays of a packet reach: all eight children are tested against one ray after the other.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::kernel::{Here, Seen, Together};
use super::oriented_slabs::{self, Origin};
use super::packet::{PacketWalk, at, at_mut};
use super::packet_prepare::Common;
use super::packet_visit::{self, Boxes, entry_ray};
use super::single::MetCells;
use super::stand_in::{self, ConeRay};
use super::{packet_cells, single};
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Node;
use crate::structure::packet_triangles::keep;
use crate::structure::ray::slack;

/// Number of rays up to which this is less work than testing one child after the other against all rays.
pub(super) const FEW: u32 = 4;

/// Stores the data of a node's children that all rays share in `boxes`.
#[inline(always)]
pub(super) fn planes<S: Simd, const LOD: bool>(s: S, node: &Node, common: &Common, boxes: &mut Boxes) {
    let [[first, last], _] = packet_visit::planes(s, node, common, boxes);
    (boxes.met, boxes.small, boxes.has_slabs) = (0, 0, false);
    if LOD {
        let faces = stand_in::faces(first, last, s.splat8(0.0));
        packet_cells::cells(
            s,
            first,
            last,
            stand_in::counted(faces, oriented_slabs::area_shares(s, node)),
            common,
            boxes,
        );
    }
}

/// Returns for each child those of `rays` that still have to visit it: rays that hit its box (of a child in `leaves`,
/// inside its oriented slabs) and for which it does not stand in. `boxes` holds the result of [`planes`]. It receives
/// the children that are hit, their entry distances, and the children that may stand in for some ray.
#[inline(always)]
pub(super) fn each<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    tree: Together,
    here: Here,
    boxes: &mut Boxes,
    mut rays: u32,
    leaves: u32,
    walk: &mut PacketWalk,
) -> [u32; 8] {
    let (mut out, mut all_asked) = ([0; 8], 0u32);
    let mut first = s.splat8(f32::INFINITY);
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        rays &= rays - 1;
        let (mut met, asked, enter) = one::<S, ANY, LOD>(s, tree, here, boxes, leaves, i, walk);
        boxes.met |= met;
        first = enter.min(first);
        all_asked |= asked;
        while met != 0 {
            out[met.trailing_zeros() as usize & 7] |= 1 << i;
            met &= met - 1;
        }
    }
    boxes.enter = first.to_array();
    if all_asked != 0 {
        walk.slab_heuristic.saw((0..8).filter(|slot| all_asked >> slot & 1 == 1 && out[*slot] == 0).count() as u32);
    }
    out
}

/// Returns the children that ray `i` still has to visit, the children in `leaves` for which oriented slabs were tested,
/// and the distances at which the ray enters the boxes.
#[inline(always)]
fn one<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    tree: Together,
    here: Here,
    boxes: &mut Boxes,
    leaves: u32,
    i: usize,
    walk: &mut PacketWalk,
) -> (u32, u32, S::F8) {
    let Together { view, filter, common, .. } = tree;
    let zero = s.splat8(0.0);
    let (mut near, mut far, mut inv, mut org) = ([zero; 3], [zero; 3], [zero; 3], [zero; 3]);
    for axis in 0..3 {
        (near[axis], far[axis]) = (s.load8(&boxes.planes[axis][0]), s.load8(&boxes.planes[axis][1]));
        inv[axis] = s.splat8(at(&walk.rays.inv[axis], i));
        if !common.one_origin {
            org[axis] = s.splat8(at(&walk.rays.org[axis], i));
            (near[axis], far[axis]) = (near[axis] - org[axis], far[axis] - org[axis]);
        }
    }
    let [enter, leave] = stand_in::cross(near, far, inv);
    let t_min = s.splat8(at(&walk.rays.t_min, i));
    let entered = enter.max(t_min);
    let within = leave.min(s.splat8(at(&walk.hits.t, i)));
    let is_met = entered.le(within);
    let mut met = is_met.bits() & u32::from(here.node().valid);
    // The entry distance of a box that the ray misses is infinite.
    let first = entered.select(is_met, s.splat8(f32::INFINITY));
    let (mut dir, mut faces, mut likely) = ([zero; 3], [zero; 3], 0);
    for axis in 0..3 {
        (dir[axis], faces[axis]) = (s.splat8(at(&walk.rays.dir[axis], i)), s.load8(&boxes.faces[axis]));
    }
    let cone = walk.rays.cone(i);
    if LOD {
        likely = met & packet_cells::likely(s, stand_in::area(faces, dir), within, [cone.a, cone.b]);
    }
    if likely == 0 && met & leaves == 0 {
        return (met, 0, first);
    }
    let (mut small, mut way) = (0, [entered, leave]);
    if likely != 0 {
        let mut crossing = [enter, leave];
        if !common.one_origin {
            for axis in 0..3 {
                let slack = s.splat8(slack(at(&walk.rays.org[axis], i), common.sign[axis], view.max_coord));
                near[axis] = s.load8(&boxes.stored[axis][0]) - slack - org[axis];
                far[axis] = s.load8(&boxes.stored[axis][1]) + slack - org[axis];
            }
            crossing = stand_in::cross(near, far, inv);
        }
        let cells = stand_in::meet(crossing, faces, &ConeRay { dir, t_min, a: s.splat8(cone.a), b: s.splat8(cone.b) });
        small = cells.small & likely;
        way = [cells.enter, crossing[1]];
    }
    let leaves = met & leaves & !small;
    if small | leaves == 0 {
        return (met, 0, first);
    }
    boxes.small |= small;
    let mut slabs = boxes.slabs(s, here.node(), common, view.max_coord).all(s);
    if !common.one_origin {
        slabs = Origin::new(org, s.splat8(view.max_coord), zero).see(&slabs);
    }
    let [enter, leave] = oriented_slabs::within(dir, &slabs, way, s.splat8(1.0));
    let crosses = enter.le(leave).bits();
    met &= !leaves | crosses;
    if small == 0 {
        return (met, leaves, first);
    }
    let mut best = walk.best(i);
    let (ray, first_cell) = (entry_ray(&walk.rays, i), at_mut(&mut walk.first_cell, i));
    let cells = MetCells { small, crosses, t: &enter.to_array() };
    let settled = single::offers(Seen { view, filter }, here, cells, &ray, &mut best, first_cell);
    keep(walk, i, &best);
    if ANY && best.is_hit() {
        walk.waiting &= !(1 << i);
        return (0, leaves, first);
    }
    (met & !settled, leaves, first)
}
