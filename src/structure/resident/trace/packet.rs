//! Packets: a node's boxes are tested against all rays at once, and those that are hit also ray by ray, sixteen rays in
//! a vector, if they are leaves or narrower than the packet, as in `bvh::trace`. Where few rays come they go on singly.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::Both;
use super::leaf::{row, visible};
use super::single::{self, RayLanes};
use crate::base::ids::BlockId;
use crate::geom::watertight::{LaneHits, intersect, shear};
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::filter::PartFilter;
use crate::structure::hit::{Counters, TriHit};
use crate::structure::packet::{PacketEntry, PacketWalk, VECTORS, at};
use crate::structure::packet_boxes::{area, cross, faces, farthest, meet, reaching};
use crate::structure::packet_prepare::Common;
use crate::structure::packet_triangles::{Corners, Ties, beside, keep, keep_better, triangle};
use crate::structure::place::Rooted;
use crate::structure::prepared::PreparedRay;
use crate::structure::resident::layout::{LEAF, Leaf, Node};
use crate::structure::walk::push_sorted;

/// Number of rays below which they go on one after the other.
const FEW: u32 = 3;

/// Traces the rays of a packet that has just begun. Returns the rays without a result.
pub(super) fn run<const ANY: bool>(tree: Both, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> u32 {
    dispatch(tree.blocks.isa(), Packet::<ANY> { tree, filter, walk })
}

struct Packet<'a, const ANY: bool> {
    tree: Both<'a>,
    filter: Option<&'a PartFilter<'a>>,
    walk: &'a mut PacketWalk,
}

impl<const ANY: bool> Op for Packet<'_, ANY> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> u32 {
        let Self { tree, filter, walk } = self;
        let rays = walk.waiting;
        walk.stack.clear();
        if rays == 0 {
            return 0;
        }
        let mut lost = 0;
        if walk.together {
            walk.stack.push(PacketEntry { t: 0.0, rays, block: 0, child: 0 });
            visit::<S, ANY>(s, tree, filter, walk, &mut lost);
        } else {
            alone::<S, ANY>(s, tree, filter, walk, (rays, 0), &mut lost);
        }
        walk.waiting = 0;
        lost
    }
}

impl Ties for Both<'_> {
    #[inline(always)]
    fn is_better(&self, hit: &TriHit, best: &TriHit, counters: &mut Counters) -> Result<bool, BlockId> {
        let _ = counters;
        Both::is_better(self, hit, best).ok_or(BlockId(hit.block))
    }
}

/// Visits the entries on the stack. Rays that lack a block for a tie are added to `lost`.
#[inline(always)]
fn visit<S: Simd, const ANY: bool>(
    s: S,
    tree: Both,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    lost: &mut u32,
) {
    let (form, common) = (tree.form, walk.common);
    let nodes = &form.nodes[..];
    let mut far = farthest(s, &walk.hits.t);
    while let Some(mut entry) = walk.stack.pop() {
        if entry.t > far {
            continue;
        }
        entry.rays &= walk.waiting & reaching(s, entry.t, &walk.hits.t);
        while entry.rays != 0 {
            if entry.rays.count_ones() < FEW {
                alone::<S, ANY>(s, tree, filter, walk, (entry.rays, entry.child), lost);
                far = farthest(s, &walk.hits.t);
                break;
            }
            if entry.child & LEAF != 0 {
                walk.counters.leaves += 1;
                let leaf = form.leaf(entry.child);
                test::<S, ANY>(s, tree, filter, walk, (entry.rays, &leaf), &common, lost);
                far = farthest(s, &walk.hits.t);
                break;
            }
            walk.counters.nodes += 1;
            match nearest_child(s, &nodes[entry.child as usize], &common, far, entry.rays, walk) {
                Some(nearest) => entry = nearest,
                None => break,
            }
        }
    }
}

/// Pushes all of the children that any ray hits but the nearest; returns the nearest.
#[inline(always)]
fn nearest_child<S: Simd>(
    s: S,
    node: &Node,
    common: &Common,
    far: f32,
    rays: u32,
    walk: &mut PacketWalk,
) -> Option<PacketEntry> {
    let zero = s.splat8(0.0);
    let (mut first, mut last, mut from, mut to) = ([zero; 3], [zero; 3], [zero; 3], [zero; 3]);
    let mut planes = [[[0.0f32; 8]; 2]; 3];
    for axis in 0..3 {
        let near = common.near[axis];
        let opposite = if near < 3 { near + 3 } else { near - 3 };
        (first[axis], last[axis]) = (s.load8(&node.planes[near]), s.load8(&node.planes[opposite]));
        let slack = s.splat8(common.slack[axis]);
        let (near, far) = (first[axis] - slack, last[axis] + slack);
        (from[axis], to[axis]) = (near - s.splat8(common.org_near[axis]), far - s.splat8(common.org_far[axis]));
        let seen = if common.one_origin { [from[axis], to[axis]] } else { [near, far] };
        planes[axis] = [seen[0].to_array(), seen[1].to_array()];
    }
    let [enter, leave] = cross(s, from, to, common, far);
    let mut mask = enter.le(leave).bits() & node.valid;
    if mask == 0 {
        return None;
    }
    let dir = [s.splat8(common.dir_min[0]), s.splat8(common.dir_min[1]), s.splat8(common.dir_min[2])];
    let area = area(faces(first, last, zero), dir);
    let narrow = area.le(leave * leave * s.splat8(common.spread_area)).bits();
    let enter = enter.to_array();
    let bottom = walk.stack.len();
    let mut nearest: Option<PacketEntry> = None;
    while mask != 0 {
        let slot = mask.trailing_zeros() as usize & 7;
        mask &= mask - 1;
        let child = node.child[slot];
        // Rays of one origin are tested one by one only at leaves and at boxes narrower than the packet: elsewhere it
        // costs more than it saves.
        let mut rays = rays;
        if !common.one_origin || narrow >> slot & 1 == 1 || child & LEAF != 0 {
            let [x, y, z] = &planes;
            let planes = [[x[0][slot], x[1][slot]], [y[0][slot], y[1][slot]], [z[0][slot], z[1][slot]]];
            rays &= meet(s, &planes, common.one_origin, walk);
        }
        if rays == 0 {
            continue;
        }
        let mut next = PacketEntry { t: enter[slot], rays, block: 0, child };
        let Some(first) = nearest else {
            nearest = Some(next);
            continue;
        };
        if next.t < first.t {
            nearest = Some(next);
            next = first;
        }
        push_sorted(&mut walk.stack, bottom, next);
    }
    nearest
}

/// Lets rays go on from a link one after the other.
#[inline(always)]
fn alone<S: Simd, const ANY: bool>(
    s: S,
    tree: Both,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    (mut rays, link): (u32, u32),
    lost: &mut u32,
) {
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        rays &= rays - 1;
        let ray = RayLanes::new(s, &PreparedRay::new(&walk.rays.one(i), tree.form.max_coord));
        let best = walk.best(i);
        let links = walk.alone.links.get_or_insert_default();
        match single::visit::<S, ANY>(s, tree, filter, &ray, (link, links), best) {
            Some((best, counts)) => {
                keep(walk, i, &best);
                single::count(&mut walk.alone.counters, counts);
                if ANY && best.is_hit() {
                    walk.waiting &= !(1 << i);
                }
            }
            None => lose(walk, lost, 1 << i),
        }
    }
}

/// Ends rays without a result.
#[cold]
fn lose(walk: &mut PacketWalk, lost: &mut u32, rays: u32) {
    *lost |= rays;
    walk.waiting &= !rays;
}

/// Tests the triangles of a leaf: eight against one ray after the other, or one after the other against sixteen rays,
/// whichever takes fewer tests.
#[inline(always)]
fn test<S: Simd, const ANY: bool>(
    s: S,
    tree: Both,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    (rays, leaf): (u32, &Leaf),
    common: &Common,
    lost: &mut u32,
) {
    let corners = corners(s, leaf, common);
    let mut left = (1u32 << leaf.triangles) - 1;
    if common.one_origin {
        left &= !beside(s, &corners, common);
    }
    if let Some(filter) = filter {
        left = visible(tree.form, leaf, filter, left);
    }
    let vectors = u32::from(rays & 0xffff != 0) + u32::from(rays >> 16 != 0);
    if rays.count_ones() < left.count_ones() * vectors {
        return ray_by_ray::<S, ANY>(s, tree, walk, (rays, leaf), (left, &corners), common, lost);
    }
    walk.counters.triangles += u64::from(left.count_ones());
    while left != 0 {
        let i = left.trailing_zeros() as usize;
        left &= left - 1;
        for h in 0..VECTORS {
            // An any-hit ray may already have a hit in this leaf.
            let rays = (rays & walk.waiting) >> (16 * h) & 0xffff;
            if rays == 0 {
                continue;
            }
            let found = if common.one_origin {
                triangle::<S, true>(s, &corners, i, common.k, walk, h)
            } else {
                triangle::<S, false>(s, &corners, i, common.k, walk, h)
            };
            let hits = found.hits & rays;
            if hits == 0 {
                continue;
            }
            let hit = leaf.hit(i as u32, 0.0, 0.0, 0.0);
            let found = LaneHits { hits, ..found };
            if keep_better::<S, ANY>(s, &tree, walk, h, &found, (hit.block, hit.tri)).is_err() {
                lose(walk, lost, hits << (16 * h));
            } else if ANY {
                walk.waiting &= !(hits << (16 * h));
            }
        }
    }
}

/// Tests eight triangles at a time against one ray after the other.
#[inline(always)]
fn ray_by_ray<S: Simd, const ANY: bool>(
    s: S,
    tree: Both,
    walk: &mut PacketWalk,
    (mut rays, leaf): (u32, &Leaf),
    (left, corners): (u32, &Corners),
    common: &Common,
    lost: &mut u32,
) {
    let (k, zero) = (common.k, s.splat8(0.0));
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        rays &= rays - 1;
        let r = &walk.rays;
        let skew = [s.splat8(at(&r.shear[0], i)), s.splat8(at(&r.shear[1], i)), s.splat8(at(&r.shear[2], i))];
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
        let (t_min, t_max) = (s.splat8(at(&r.t_min, i)), s.splat8(at(&walk.hits.t, i)));
        let found = intersect::<8, _>(left, sheared, zero, t_min, t_max);
        let Some((lane, t, u, v)) = super::leaf::least(&found, found.hits) else { continue };
        let hit = leaf.hit(lane, t, u, v);
        match tree.is_better(&hit, &walk.best(i)) {
            Some(true) => keep(walk, i, &hit),
            Some(false) => {}
            None => lose(walk, lost, 1 << i),
        }
        if ANY {
            walk.waiting &= !(1 << i);
        }
    }
}

/// Returns the corners of a leaf's triangles, relative to the rays' origin if they share one. Lanes past the last
/// triangle are undefined.
#[inline(always)]
fn corners<S: Simd>(s: S, leaf: &Leaf, common: &Common) -> Corners {
    let mut all = [[[0.0; 8]; 3]; 3];
    for axis in 0..3 {
        let k = common.k[axis];
        let org = s.splat8(if common.one_origin { common.org_near[k] } else { 0.0 });
        for c in 0..3 {
            all[c][axis] = (row(s, leaf, 3 * c + k) - org).to_array();
        }
    }
    all
}
