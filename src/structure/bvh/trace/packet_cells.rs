//! Stand-ins for packets: one cell at a time is tested against all rays that reach it.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::TreeView;
use super::coverage::{CoverageTest, may_transmit};
use super::kernel::{Here, Together};
use super::oriented_slabs::{self, Origin};
use super::packet::{PacketWalk, VECTORS};
use super::packet_prepare::Common;
use super::packet_visit::{self, Boxes};
use super::single;
use super::stand_in::{self, ConeRay, Met, Verdict};
use crate::geom::watertight::LaneHits;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Node;
use crate::structure::packet_boxes::way;
use crate::structure::packet_triangles::keep_better;
use crate::structure::ray::{SLACK, abs};

/// Returns the children that may be small enough to stand in. For a packet, `area` is the area along the least
/// directions and `[a, b]` the greatest widths. Otherwise both are those of one ray.
#[inline(always)]
pub(super) fn likely<S: Simd>(s: S, area: S::F8, leave: S::F8, [a, b]: [f32; 2]) -> u32 {
    stand_in::may_stand(area, s.splat8(a) + s.splat8(b) * leave, s.splat8(stand_in::MARGIN))
}

/// Stores the data of the stand-in test in `out`, for cells between planes as stored.
#[inline(always)]
pub(super) fn cells<S: Simd>(
    s: S,
    near: [S::F8; 3],
    far: [S::F8; 3],
    faces: [S::F8; 3],
    common: &Common,
    out: &mut Boxes,
) {
    for axis in 0..3 {
        out.faces[axis] = (faces[axis] * s.splat8(common.sign[axis])).to_array();
        if !common.one_origin {
            out.stored[axis] = [near[axis].to_array(), far[axis].to_array()];
        }
    }
}

/// Returns the distances at which a vector of rays enters and leaves the cell in `slot`.
#[inline(always)]
fn cross<S: Simd>(
    s: S,
    boxes: &Boxes,
    slot: usize,
    common: &Common,
    max_coord: f32,
    walk: &PacketWalk,
    h: usize,
) -> [S::F16; 2] {
    let (rays, zero) = (&walk.rays, s.splat16(0.0));
    let (mut first, mut last, mut inv) = ([zero; 3], [zero; 3], [zero; 3]);
    for axis in 0..3 {
        inv[axis] = s.load16(&rays.inv[axis][h]);
        let planes = if common.one_origin { &boxes.planes[axis] } else { &boxes.stored[axis] };
        (first[axis], last[axis]) = (s.splat16(planes[0][slot & 7]), s.splat16(planes[1][slot & 7]));
        if !common.one_origin {
            let org = s.load16(&rays.org[axis][h]);
            let slack = abs(zero, org).max(s.splat16(max_coord)) * s.splat16(SLACK * common.sign[axis]);
            (first[axis], last[axis]) = (first[axis] - slack - org, last[axis] + slack - org);
        }
    }
    stand_in::cross(first, last, inv)
}

/// Evaluates the stand-in test of the cell in `slot` for a vector of rays, given where they enter and leave it.
#[inline(always)]
fn meet<S: Simd>(s: S, boxes: &Boxes, slot: usize, crossing: [S::F16; 2], walk: &PacketWalk, h: usize) -> Met<S::F16> {
    let (rays, zero) = (&walk.rays, s.splat16(0.0));
    let (mut dir, mut faces) = ([zero; 3], [zero; 3]);
    for axis in 0..3 {
        (dir[axis], faces[axis]) = (s.load16(&rays.dir[axis][h]), s.splat16(boxes.faces[axis][slot & 7]));
    }
    let (t_min, a, b) = (s.load16(&rays.t_min[h]), s.load16(&rays.cone[0][h]), s.load16(&rays.cone[1][h]));
    stand_in::meet(crossing, faces, &ConeRay { dir, t_min, a, b })
}

/// Clips the intervals of a vector of rays in the cell in `slot` to its oriented slabs.
#[inline(always)]
fn within<S: Simd>(
    s: S,
    tree: Together,
    here: Here,
    slot: usize,
    boxes: &mut Boxes,
    walk: &PacketWalk,
    (h, way): (usize, [S::F16; 2]),
) -> [S::F16; 2] {
    let (max_coord, common) = (tree.view.max_coord, tree.common);
    let (rays, zero) = (&walk.rays, s.splat16(0.0));
    let mut dir = [zero; 3];
    for axis in 0..3 {
        dir[axis] = s.load16(&rays.dir[axis][h]);
    }
    let mut slabs = boxes.slabs(s, here.node(), common, max_coord).one(s, slot);
    if !common.one_origin {
        let mut org = [zero; 3];
        for axis in 0..3 {
            org[axis] = s.load16(&rays.org[axis][h]);
        }
        slabs = Origin::new(org, s.splat16(max_coord), zero).see(&slabs);
    }
    oriented_slabs::within(dir, &slabs, way, s.splat16(1.0))
}

/// Returns those of `rays` that cross the child in `slot` inside its oriented slabs.
#[inline(always)]
pub(super) fn inside<S: Simd>(
    s: S,
    tree: Together,
    here: Here,
    slot: usize,
    boxes: &mut Boxes,
    walk: &PacketWalk,
    rays: u32,
) -> u32 {
    let planes = boxes.planes_of(slot);
    let mut left = 0;
    for h in 0..VECTORS {
        let lanes = rays >> (16 * h) & 0xffff;
        if lanes != 0 {
            let way = way(s, &planes, tree.common.one_origin, walk, h, s.splat16(f32::INFINITY));
            let [enter, leave] = within(s, tree, here, slot, boxes, walk, (h, way));
            left |= (lanes & enter.le(leave).bits()) << (16 * h);
        }
    }
    left
}

/// Lets the cell in `slot` stand in for those of `rays` for which it is small enough. Returns the other rays that hit
/// its box.
#[inline(always)]
pub(super) fn stand_in<S: Simd, const ANY: bool>(
    s: S,
    tree: Together,
    here: Here,
    slot: usize,
    boxes: &mut Boxes,
    rays: u32,
    walk: &mut PacketWalk,
) -> u32 {
    let (Together { view, filter, common, .. }, Here { block, id, index: node }) = (tree, here);
    let zero = s.splat16(0.0);
    let mut crossings = [[zero; 2]; VECTORS];
    let mut left = 0;
    for h in 0..VECTORS {
        crossings[h] = cross(s, boxes, slot, common, view.max_coord, walk, h);
        let [enter, leave] = crossings[h];
        let met = enter.max(s.load16(&walk.rays.t_min[h])).le(leave.min(s.load16(&walk.hits.t[h])));
        left |= met.bits() << (16 * h);
    }
    left &= rays;
    if left == 0 {
        return 0;
    }
    for h in 0..VECTORS {
        let lanes = left >> (16 * h) & 0xffff;
        if lanes == 0 {
            continue;
        }
        let met = meet(s, boxes, slot, crossings[h], walk, h);
        let small = met.small & lanes;
        if small == 0 {
            continue;
        }
        match stand_in::judge(view, here, slot, filter) {
            Verdict::Descend => continue,
            Verdict::Skip => {}
            Verdict::Stand => {
                let tri = stand_in::lod_code(node, slot);
                let way = within(s, tree, here, slot, boxes, walk, (h, [met.enter, crossings[h][1]]));
                let mut hits = entered(s, way, walk, h, small);
                if hits != 0 && may_transmit(block, node, slot) {
                    hits = stopped(CoverageTest::of(block, node, slot), &way[0].to_array(), walk, h, hits);
                }
                if hits != 0 {
                    offer::<S, ANY>(s, view, walk, (h, hits), way[0], (id, tri));
                }
            }
        }
        left &= !(small << (16 * h));
    }
    left
}

/// Returns those of the rays `lanes` of vector `h` that enter the region of a stand-in before their hits, and records
/// where they do.
#[inline(always)]
fn entered<S: Simd>(s: S, [enter, leave]: [S::F16; 2], walk: &mut PacketWalk, h: usize, lanes: u32) -> u32 {
    let entered = lanes & enter.le(leave.min(s.load16(&walk.hits.t[h]))).bits();
    let first = s.load16(&walk.first_cell[h]);
    walk.first_cell[h] = enter.min(first).select(s.mask16(entered), first).to_array();
    entered
}

/// Returns those of the rays `hits` of vector `h` that the cell stops. The rays enter the cell's region at `enter`.
#[inline(never)]
fn stopped(coverage: Option<CoverageTest>, enter: &[f32; 16], walk: &PacketWalk, h: usize, hits: u32) -> u32 {
    let Some(coverage) = coverage else { return hits };
    let (mut left, mut stopped) = (hits, hits);
    while left != 0 {
        let lane = left.trailing_zeros() as usize & 15;
        left &= left - 1;
        if coverage.transmits(&packet_visit::entry_ray(&walk.rays, 16 * h + lane), enter[lane]) {
            stopped &= !(1 << lane);
        }
    }
    stopped
}

/// Returns all cells of a node.
#[inline(always)]
fn all_cells<S: Simd>(s: S, node: &Node, common: &Common) -> Boxes {
    let mut out = Boxes::NONE;
    let [near, far] = single::stored_planes(s, node, common.near);
    for axis in 0..3 {
        let (slack, org) = (s.splat8(common.slack[axis]), s.splat8(common.org_near[axis]));
        out.planes[axis] = [(near[axis] - slack - org).to_array(), (far[axis] + slack - org).to_array()];
        out.stored[axis] = [near[axis].to_array(), far[axis].to_array()];
    }
    out
}

/// Offers the cell in a node's slot, below which a block is missing, to `rays`. An any-hit ray that begins inside the
/// cell is not offered the cell: the content is unknown.
#[inline(always)]
pub(super) fn for_missing<S: Simd, const ANY: bool>(
    s: S,
    tree: Together,
    here: Here,
    slot: usize,
    rays: u32,
    walk: &mut PacketWalk,
) {
    let (Together { view, filter, common, .. }, Here { id, index: node, .. }) = (tree, here);
    if stand_in::judge(view, here, slot, filter) == Verdict::Skip {
        return;
    }
    let boxes = &mut all_cells(s, here.node(), common);
    for h in 0..VECTORS {
        let lanes = rays >> (16 * h) & 0xffff;
        if lanes == 0 {
            continue;
        }
        let crossing = cross(s, boxes, slot, common, view.max_coord, walk, h);
        let met = meet(s, boxes, slot, crossing, walk, h);
        let way = within(s, tree, here, slot, boxes, walk, (h, [met.enter, crossing[1]]));
        let outside = entered(s, way, walk, h, met.outside & lanes);
        let lanes = lanes & met.enter.le(s.load16(&walk.hits.t[h])).bits();
        let tri = stand_in::missing_code(node, slot, false);
        if outside != 0 {
            offer::<S, ANY>(s, view, walk, (h, outside), way[0], (id, tri));
        }
        let inside = met.meets & lanes & !met.outside;
        if !ANY && inside != 0 {
            let tri = stand_in::missing_code(node, slot, true);
            offer::<S, ANY>(s, view, walk, (h, inside), met.enter, (id, tri));
        }
    }
}

/// Keeps a stand-in for those of `rays` for which it is better. `rays` are lanes of vector `h` that have no nearer hit.
#[inline(always)]
fn offer<S: Simd, const ANY: bool>(
    s: S,
    view: &TreeView,
    walk: &mut PacketWalk,
    (h, rays): (usize, u32),
    t: S::F16,
    place: (u32, u32),
) {
    let zero = s.splat16(0.0);
    let found = LaneHits { hits: rays, t, u: zero, v: zero };
    // A tie with a stand-in needs no block: positions in the tree decide.
    let _ = keep_better::<S, ANY>(s, view, walk, h, &found, place);
    if ANY {
        walk.waiting &= !(rays << (16 * h));
    }
}
