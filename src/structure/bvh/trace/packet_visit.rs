//! The kernel of packets. A node's boxes are tested against all rays at once, by intervals of their origins and
//! reciprocal directions. Boxes that are hit are also tested ray by ray, sixteen rays in a vector, if they belong to
//! leaves or are narrower than the packet. At nodes that few rays reach, the rays are tested one after the other
//! (`packet_few.rs`). Rays that cannot be traversed as one packet are traversed as single rays (`single.rs`).
//!
//! Closest-hit walks visit the nearest child first. Any-hit walks visit older entries of the stack first, which
//! alternates between parts of the tree: memory that is prefetched for one part has arrived when its turn comes.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::ahead;
use super::coverage::EntryRay;
use super::hit::Outcome;
use super::kernel::{Here, Seen, Together};
use super::oriented_slabs::{self, Eight, Origin};
use super::packet::{PacketEntry, PacketRays, PacketWalk, at, at_mut};
use super::packet_cells;
use super::packet_few;
use super::packet_leaf::leaf;
use super::packet_prepare::Common;
use super::single::{self, Alone, RayLanes};
use super::stand_in;
use super::walk::{Entry, push_sorted};
use super::{PartFilter, PreparedRay, TreeView};
use crate::base::ids::BlockId;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, Child, Node};
use crate::structure::packet_boxes::{cross, farthest, meet, reaching};
use crate::structure::packet_triangles::keep;

impl TreeView<'_> {
    /// See [`crate::structure::Tree::closest_together`].
    pub fn closest_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        run::<false>(self, filter, walk)
    }

    /// See [`crate::structure::Tree::any_together`].
    pub fn any_together(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        run::<true>(self, filter, walk)
    }
}

/// Continues `walk` until it ends or a block is missing.
fn run<const ANY: bool>(view: &TreeView, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
    if is_exact(view, walk) {
        dispatch(view.isa, Packet::<ANY, false> { view, filter, walk })
    } else {
        dispatch(view.isa, Packet::<ANY, true> { view, filter, walk })
    }
}

/// True if no cell can stand in.
pub(super) fn is_exact(view: &TreeView, walk: &PacketWalk) -> bool {
    !view.accept_missing && walk.is_exact()
}

/// Kernel of packets. `LOD`: cells may stand in.
struct Packet<'a, 'v, const ANY: bool, const LOD: bool> {
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    walk: &'a mut PacketWalk,
}

impl<const ANY: bool, const LOD: bool> Op for Packet<'_, '_, ANY, LOD> {
    type Out = Outcome;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Outcome {
        let Self { view, filter, walk } = self;
        let mut boxes = Boxes::NONE;
        let outcome = visit::<S, ANY, LOD>(s, view, filter, walk, &mut boxes);
        if outcome == Outcome::Done {
            walk.waiting = 0;
        }
        outcome
    }
}

/// Visits the entries on the stack. `boxes` is scratch space for one node after the other: creating it takes as long as
/// filling it.
#[inline(always)]
pub(super) fn visit<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    view: &TreeView,
    filter: Option<&PartFilter>,
    walk: &mut PacketWalk,
    boxes: &mut Boxes,
) -> Outcome {
    let common = walk.common;
    let tree = Together { view, filter, common: &common, is_large: ahead::is_large(view.snapshot) };
    let goes_alone = !walk.together || PartFilter::is_by_ray(filter);
    let mut far = farthest(s, &walk.hits.t);
    while let Some(mut entry) = walk.stack.pop() {
        if entry.t > far {
            continue;
        }
        entry.rays &= walk.waiting & reaching(s, entry.t, &walk.hits.t);
        if entry.rays == 0 {
            continue;
        }
        let Some(words) = view.visit(entry.block) else {
            walk.stack.push(entry);
            return Outcome::Pending(BlockId(entry.block));
        };
        let mut block = Block::new(words);
        while entry.rays != 0 {
            if goes_alone {
                let outcome = each_alone::<S, ANY, LOD>(s, tree, walk, entry);
                if outcome != Outcome::Done {
                    return outcome;
                }
                far = farthest(s, &walk.hits.t);
                break;
            }
            match Child::from_bits(entry.child) {
                Child::Node(index) => {
                    walk.counters.nodes += 1;
                    let (bottom, here) = (walk.stack.len(), Here { block, id: entry.block, index });
                    let is_few = entry.rays.count_ones() <= packet_few::FEW;
                    if is_few {
                        packet_few::planes::<S, LOD>(s, here.node(), &common, boxes);
                    } else {
                        intervals::<S, LOD>(s, here.node(), &common, far, boxes);
                    }
                    let nearest = nearest_child::<S, ANY, LOD>(s, tree, here, is_few, boxes, entry, walk);
                    if LOD && (boxes.small != 0 || view.accept_missing) {
                        far = farthest(s, &walk.hits.t);
                    }
                    let Some(nearest) = nearest else { break };
                    let is_elsewhere = nearest.block != entry.block;
                    walk.counters.blocks += u64::from(is_elsewhere && !Child::is_leaf(nearest.child));
                    if ANY && bottom > 0 {
                        // The memory of `nearest` was prefetched just now, that of an older entry longer ago. It does
                        // not matter which hit is found.
                        let older = std::mem::replace(&mut walk.stack[bottom - 1], nearest);
                        walk.stack.push(older);
                        break;
                    }
                    if is_elsewhere {
                        let Some(words) = view.visit(nearest.block) else {
                            // The missing block is a leaf block: references to other blocks are followed only if those
                            // are in memory.
                            walk.stack.push(nearest);
                            return Outcome::Pending(BlockId(nearest.block));
                        };
                        block = Block::new(words);
                    }
                    entry = nearest;
                }
                Child::Leaf(at) => {
                    walk.counters.leaves += 1;
                    walk.counters.leaf_lines += block.leaf(at).lines(at) as u64;
                    let outcome = leaf::<S, ANY>(s, tree, walk, entry, block, at);
                    if outcome != Outcome::Done {
                        return outcome;
                    }
                    far = farthest(s, &walk.hits.t);
                    break;
                }
                Child::External(at) => {
                    walk.counters.blocks += 1;
                    let (next, below) = block.external(at);
                    let Some(words) = view.visit(next) else {
                        if LOD && view.accept_missing {
                            let (index, slot) = block.place_of_external(at);
                            let here = Here { block, id: entry.block, index };
                            packet_cells::for_missing::<S, ANY>(s, tree, here, slot, entry.rays, walk);
                            far = farthest(s, &walk.hits.t);
                            break;
                        }
                        (entry.block, entry.child) = (next, below);
                        walk.stack.push(entry);
                        return Outcome::Pending(BlockId(next));
                    };
                    (entry.block, entry.child) = (next, below);
                    block = Block::new(words);
                }
                Child::Member(at) => {
                    // Cells of the same node may stand in before it.
                    let rays = entry.rays & walk.waiting & reaching(s, entry.t, &walk.hits.t);
                    if rays == 0 {
                        break;
                    }
                    walk.at_member = rays;
                    return Outcome::Member(block.member(at));
                }
            }
        }
    }
    Outcome::Done
}

/// Lets each ray of `entry` visit it as a single ray.
#[inline(always)]
fn each_alone<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    tree: Together,
    walk: &mut PacketWalk,
    entry: PacketEntry,
) -> Outcome {
    let Together { view, filter, .. } = tree;
    let mut rays = entry.rays;
    while rays != 0 {
        let i = rays.trailing_zeros() as usize;
        let ray = RayLanes::new(s, PreparedRay::new(&walk.rays.one(i), view.max_coord));
        let mut best = walk.best(i);
        let stack = &mut walk.alone.stack;
        stack.clear();
        stack.push(Entry { t: entry.t, block: entry.block, child: entry.child });
        let (first_cell, counters) = (at_mut(&mut walk.first_cell, i), &mut walk.alone.counters);
        let alone = Alone { stack, best: &mut best, first_cell, counters };
        let outcome = single::visit::<S, ANY, LOD>(s, Seen { view, filter }, &ray, alone);
        keep(walk, i, &best);
        if outcome != Outcome::Done {
            walk.at_member = 1 << i;
            // The other rays visit this entry later; this ray continues with its remaining entries.
            walk.stack.push(PacketEntry { rays: rays & (rays - 1), ..entry });
            let left = walk.alone.stack.iter();
            let left = left.map(|e| PacketEntry { t: e.t, rays: 1 << i, block: e.block, child: e.child });
            walk.stack.extend(left);
            return outcome;
        }
        if ANY && best.is_hit() {
            walk.waiting &= !(1 << i);
        }
        rays &= rays - 1;
    }
    Outcome::Done
}

/// Returns ray `i` for the coverage test.
#[inline(always)]
pub(super) fn entry_ray(rays: &PacketRays, i: usize) -> EntryRay {
    let (org, dir) = (&rays.org, &rays.dir);
    EntryRay {
        org: [at(&org[0], i), at(&org[1], i), at(&org[2], i)],
        dir: [at(&dir[0], i), at(&dir[1], i), at(&dir[2], i)],
    }
}

/// Pushes all of the children that any ray hits but the nearest; returns the nearest.
#[inline(always)]
fn nearest_child<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    tree: Together,
    here: Here,
    is_few: bool,
    boxes: &mut Boxes,
    entry: PacketEntry,
    walk: &mut PacketWalk,
) -> Option<PacketEntry> {
    let Together { view, common, is_large, .. } = tree;
    let (node, block) = (here.node(), here.block);
    // Leaves for which oriented slabs are tested.
    let is_asked = !LOD && walk.slab_heuristic.asks();
    let asked = if is_asked { stand_in::leaves(node) } else { 0 };
    let few =
        if is_few { packet_few::each::<S, ANY, LOD>(s, tree, here, boxes, entry.rays, asked, walk) } else { [0; 8] };
    let mut mask = boxes.met;
    let leaves = asked & mask;
    let mut beside = 0;
    let bottom = walk.stack.len();
    let mut nearest: Option<PacketEntry> = None;
    while mask != 0 {
        let slot = mask.trailing_zeros() as usize & 7;
        mask &= mask - 1;
        let child = u32::from(node.child[slot]);
        // Rays of one origin are tested one by one only at leaves and at boxes narrower than the packet. At wider nodes
        // this costs more than it saves (without it, packets reach 0.48 instead of 0.44 of the speed of Embree's on the
        // bunny). Intervals of many origins are too wide to do without it.
        let mut rays = if is_few {
            few[slot]
        } else if LOD && boxes.small >> slot & 1 == 1 {
            packet_cells::stand_in::<S, ANY>(s, tree, here, slot, boxes, entry.rays, walk)
        } else if !common.one_origin || boxes.narrow >> slot & 1 == 1 || Child::is_end(child) {
            meet(s, &boxes.planes_of(slot), common.one_origin, walk) & entry.rays
        } else {
            entry.rays
        };
        if !is_few && rays != 0 && leaves >> slot & 1 == 1 {
            rays = packet_cells::inside(s, tree, here, slot, boxes, walk, rays);
            beside += u32::from(rays == 0);
        }
        if rays == 0 {
            continue;
        }
        let (id, child, is_there) = ahead::follow(is_large, view, block, entry.block, child);
        if LOD && view.accept_missing && !is_there {
            packet_cells::for_missing::<S, ANY>(s, tree, here, slot, rays, walk);
            continue;
        }
        let mut next = PacketEntry { t: boxes.enter[slot], rays, block: id, child };
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
    if leaves != 0 && !is_few {
        walk.slab_heuristic.saw(beside);
    }
    nearest
}

/// Near and far planes of eight boxes for each axis, relative to the origin if the rays share one.
pub(super) type Planes = [[[f32; 8]; 2]; 3];

/// The eight children of a node, tested against all rays of a packet.
pub(super) struct Boxes {
    /// Children that rays between the extremes may hit; where few rays come, children that some ray hits.
    pub met: u32,
    /// Children that are narrower than the packet; not computed where few rays come.
    pub narrow: u32,
    /// Of `met`, children that may be small enough to stand in for some ray; where few rays come, children that are so
    /// for some ray.
    pub small: u32,
    /// Lower bounds of the distances at which rays enter them.
    pub enter: [f32; 8],
    /// Planes, moved outward by [`Common::slack`].
    pub planes: Planes,
    /// Set only if `small` is not 0 or few rays come: the planes as stored, if the rays do not share an origin; and the
    /// areas of faces as they count in the stand-in test, signed like the directions.
    pub stored: Planes,
    pub faces: [[f32; 8]; 3],
    /// Oriented slabs of the children, if computed: relative to the shared origin, or as stored if the rays do not
    /// share one.
    slabs: Eight,
    pub has_slabs: bool,
}

impl Boxes {
    pub const NONE: Self = {
        let none = [[[0.0; 8]; 2]; 3];
        let faces = [[0.0; 8]; 3];
        let slabs = Eight::NONE;
        Self {
            met: 0,
            narrow: 0,
            small: 0,
            enter: [0.0; 8],
            planes: none,
            stored: none,
            faces,
            slabs,
            has_slabs: false,
        }
    };

    /// Returns the oriented slabs of the node's children, computed at the first call.
    #[inline(always)]
    pub fn slabs<S: Simd>(&mut self, s: S, node: &Node, common: &Common, max_coord: f32) -> &Eight {
        if !self.has_slabs {
            let mut slabs = oriented_slabs::of_node(s, node);
            if common.one_origin {
                let [x, y, z] = common.org_near;
                slabs = Origin::new([s.splat8(x), s.splat8(y), s.splat8(z)], s.splat8(max_coord), s.splat8(0.0))
                    .see(&slabs);
            }
            self.slabs.set(&slabs);
            self.has_slabs = true;
        }
        &self.slabs
    }

    /// Returns the near and the far plane of the box in `slot` for each axis.
    #[inline(always)]
    pub fn planes_of(&self, slot: usize) -> [[f32; 2]; 3] {
        let ([x, y, z], slot) = (&self.planes, slot & 7);
        [[x[0][slot], x[1][slot]], [y[0][slot], y[1][slot]], [z[0][slot], z[1][slot]]]
    }
}

/// Tests all children against all rays at once. Stores the result in `out`.
#[inline(always)]
pub(super) fn intervals<S: Simd, const LOD: bool>(s: S, node: &Node, common: &Common, far: f32, out: &mut Boxes) {
    let [[first, last], [from, to]] = planes(s, node, common, out);
    let [enter, leave] = cross(s, from, to, common, far);
    out.met = enter.le(leave).bits() & u32::from(node.valid);
    out.enter = enter.to_array();
    let faces = stand_in::faces(first, last, s.splat8(0.0));
    let dir = [s.splat8(common.dir_min[0]), s.splat8(common.dir_min[1]), s.splat8(common.dir_min[2])];
    let area = stand_in::area(faces, dir);
    out.narrow = area.le(leave * leave * s.splat8(common.spread_area)).bits();
    out.has_slabs = false;
    if LOD {
        let share = oriented_slabs::area_shares(s, node);
        out.small = packet_cells::likely(s, area * share, leave, common.cone_max) & out.met;
        if out.small != 0 {
            packet_cells::cells(s, first, last, stand_in::counted(faces, share), common, out);
        }
    }
}

/// Stores the planes of a node's children in `out`. Returns them as stored, and moved outward and relative to the
/// extremes of the origins.
#[inline(always)]
pub(super) fn planes<S: Simd>(s: S, node: &Node, common: &Common, out: &mut Boxes) -> [[[S::F8; 3]; 2]; 2] {
    let step = s.powers8(node.exponents());
    let zero = s.splat8(0.0);
    let (mut first, mut last) = ([zero; 3], [zero; 3]);
    let (mut from, mut to) = ([zero; 3], [zero; 3]);
    for axis in 0..3 {
        let (near, far) = single::planes(node, common.near[axis]);
        let origin = s.splat8(node.origin[axis]);
        first[axis] = s.bytes8(near).mul_add(step[axis], origin);
        last[axis] = s.bytes8(far).mul_add(step[axis], origin);
        let slack = s.splat8(common.slack[axis]);
        let (near, far) = (first[axis] - slack, last[axis] + slack);
        (from[axis], to[axis]) = (near - s.splat8(common.org_near[axis]), far - s.splat8(common.org_far[axis]));
        let planes = if common.one_origin { [from[axis], to[axis]] } else { [near, far] };
        out.planes[axis] = [planes[0].to_array(), planes[1].to_array()];
    }
    [[first, last], [from, to]]
}
