//! The first steps of a stream's rays. Sixteen consecutive rays mostly begin near each other, so they visit the same
//! nodes at first, regardless of their directions. Such nodes are tested once for all of them, with a ray in each lane.
//! An entry that few of them hit goes on the stacks of these rays, and their walks continue from there as single walks.
//!
//! Stacks are filled in order of distance from the origin of the first ray, the farthest first; the nearest entry is
//! visited first.
#![allow(clippy::needless_range_loop)] // axes and slots index several arrays at once

use super::ahead::ask_for;
use super::coverage::{CoverageTest, may_transmit};
use super::hit::TriHit;
use super::kernel::Here;
use super::oriented_slabs::{self, Eight, Origin, area_shares};
use super::single::{self, stored_planes};
use super::stand_in::{self, ConeRay, Met, Verdict};
use super::stream::{BOTTOM, DEPTH, LANES, StreamRun};
use super::stream_step as step;
use crate::lod::OrientedSlabs;
use crate::math::STREAM;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::{Block, Child, Node, WIDTH};
use crate::structure::ray::{SLACK, abs};
use crate::structure::rays16::Prepared;
use crate::structure::stream::GROUP;

/// Least number of rays for which testing a node for all of them at once pays off. (6 to 12 are as good at some pixels
/// of error, 12 is best where nothing stands in and models are large.)
const FEWEST: u32 = 10;

/// Capacity of a group's list of entries.
const ROOM: usize = 40;

/// Entries of a stack that are left to walks: eight levels of which all children are hit.
const FOR_WALKS: usize = 64;

/// An entry that some of the rays hit.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Entry {
    /// Distance at which each ray enters it.
    enter: [f32; GROUP],
    rays: u32,
    block: u32,
    child: u32,
}

/// A group of rays that begins. Reusable.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(super) struct Group {
    pub rays: Prepared,
    /// Lane of each ray.
    pub lanes: [u8; GROUP],
    /// Rays that still have to visit anything.
    pub left: u32,
    /// Entries to be processed, the nearest first, and their number. Processing starts at the end.
    todo: [Entry; ROOM],
    count: usize,
    /// Number of entries on the longest stack.
    deepest: usize,
}

impl Group {
    pub const NONE: Self = Self {
        rays: Prepared::NONE,
        lanes: [0; GROUP],
        left: 0,
        todo: [Entry { enter: [0.0; GROUP], rays: 0, block: 0, child: 0 }; ROOM],
        count: 0,
        deepest: 0,
    };

    #[inline(always)]
    pub fn lane(&self, ray: usize) -> usize {
        usize::from(self.lanes[ray & (GROUP - 1)]) & (LANES - 1)
    }
}

/// Pushes the entries that each ray of a group hits on its stack, which is empty. Any-hit rays that find a hit are
/// removed from `group.left`.
#[inline(always)]
pub(super) fn start<S: Simd, const ANY: bool, const LOD: bool>(s: S, run: &mut StreamRun, group: &mut Group) {
    let view = run.view;
    let [t_min, _] = group.rays.interval();
    group.todo[0] = Entry { enter: *t_min, rays: group.left, block: view.root_block, child: view.root };
    (group.count, group.deepest) = (1, BOTTOM);
    // Scratch space for one node after the other.
    let mut boxes = Boxes::NONE;
    while group.count > 0 {
        group.count -= 1;
        let mut entry = group.todo[group.count.min(ROOM - 1)];
        entry.rays &= group.left;
        // All remaining entries may go on the stack of one ray, and eight more with each node. The walk that follows
        // needs room too.
        let is_roomy = group.count + WIDTH <= ROOM && group.deepest + group.count + WIDTH + FOR_WALKS < DEPTH;
        if is_roomy && entry.rays.count_ones() >= FEWEST {
            if let Child::External(at) = Child::from_bits(entry.child)
                && let Some(next) = follow(run, &entry, at)
            {
                (entry.block, entry.child) = next;
            }
            if let Child::Node(index) = Child::from_bits(entry.child)
                && let Some(words) = view.words(entry.block)
            {
                let here = Here { block: Block::new(words), id: entry.block, index };
                expand::<S, ANY, LOD>(s, run, group, &entry, here, &mut boxes);
                continue;
            }
        }
        hand_over(run, group, &entry);
    }
}

/// Returns the target of a reference to another block, if that block is in memory.
#[inline(always)]
fn follow(run: &mut StreamRun, entry: &Entry, at: usize) -> Option<(u32, u32)> {
    let view = run.view;
    let (next, below) = Block::new(view.words(entry.block)?).external(at);
    let _ = view.visit(next)?;
    run.counters.blocks += 1;
    Some((next, below))
}

/// Pushes an entry on the stacks of its rays.
#[inline(always)]
fn hand_over(run: &mut StreamRun, group: &mut Group, entry: &Entry) {
    let mut rays = entry.rays;
    while rays != 0 {
        let ray = rays.trailing_zeros() as usize & (GROUP - 1);
        rays &= rays - 1;
        let lane = group.lane(ray);
        let (stack, top) = (&mut run.stacks[lane], usize::from(run.top[lane]).min(DEPTH - 1));
        (stack.t[top], stack.child[top], stack.block[top]) = (entry.enter[ray], entry.child, entry.block);
        run.top[lane] = (top + 1) as u8;
        group.deepest = group.deepest.max(top + 1);
    }
}

/// Tests the children of a node and appends them to the entries to be processed. `boxes` is scratch space.
#[inline(always)]
fn expand<'a, S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    run: &mut StreamRun<'a>,
    group: &mut Group,
    entry: &Entry,
    here: Here<'a>,
    boxes: &mut Boxes,
) {
    run.counters.nodes += 1;
    let (node, block) = (here.node(), here.block);
    cross::<S, LOD>(s, node, &group.rays, entry.rays, boxes);
    if LOD {
        stand_ins::<S, ANY>(s, run, group, here, boxes);
    } else if run.slab_heuristic.asks() {
        slabs(s, run, group, node, entry.rays.count_ones(), boxes);
    }
    let mut any = 0;
    for slot in 0..WIDTH {
        boxes.met[slot] &= group.left;
        any |= u32::from(boxes.met[slot] != 0) << slot;
    }
    let order = far_first(s, node, group.rays.begins_at(entry.rays.trailing_zeros() as usize), any);
    // The nearest child is processed last.
    for i in (0..any.count_ones() as usize).rev() {
        let slot = order[i & 7] as usize & 7;
        let child = u32::from(node.child[slot]);
        if !Child::is_leaf(child) {
            ask_for(run.is_large, block, child);
        }
        let next = &mut group.todo[group.count.min(ROOM - 1)];
        (next.enter, next.rays, next.block, next.child) = (boxes.enter[slot], boxes.met[slot], entry.block, child);
        group.count += 1;
    }
}

/// The children of a node: the rays that hit each child, those of them for which it may be small enough to stand in,
/// and the distances at which they enter it.
struct Boxes {
    met: [u32; WIDTH],
    likely: [u32; WIDTH],
    enter: [[f32; GROUP]; WIDTH],
    /// Distances at which rays leave it; set only if no cell can stand in.
    leave: [[f32; GROUP]; WIDTH],
    /// Areas of faces, as they count in the stand-in test.
    faces: [[f32; WIDTH]; 3],
}

impl Boxes {
    const NONE: Self = Self {
        met: [0; WIDTH],
        likely: [0; WIDTH],
        enter: [[0.0; GROUP]; WIDTH],
        leave: [[0.0; GROUP]; WIDTH],
        faces: [[0.0; WIDTH]; 3],
    };
}

/// Tests the boxes of a node's children, with the same slack as for a single ray (see [`super::PreparedRay::new`]).
#[inline(always)]
fn cross<S: Simd, const LOD: bool>(s: S, node: &Node, rays: &Prepared, asked: u32, out: &mut Boxes) {
    let zero = s.splat16(0.0);
    let (mut slope, mut near_off, mut far_off) = ([zero; 3], [zero; 3], [zero; 3]);
    let mut planes = [[0.0; WIDTH]; 6];
    for axis in 0..3 {
        let (inv, origin, [near, far]) = (s.load16(rays.inv(axis)), s.splat16(node.origin[axis]), rays.off(axis));
        slope[axis] = s.splat16(node.step(axis)) * inv;
        near_off[axis] = origin.mul_add(inv, s.load16(near));
        far_off[axis] = origin.mul_add(inv, s.load16(far));
        planes[axis] = s.bytes8(&node.planes[axis]).to_array();
        planes[axis + 3] = s.bytes8(&node.planes[axis + 3]).to_array();
    }
    if LOD {
        out.faces = faces(s, node);
    }
    let [t_min, t_max] = rays.interval();
    (out.met, out.likely) = ([0; WIDTH], [0; WIDTH]);
    for slot in 0..WIDTH {
        if node.valid >> slot & 1 == 0 {
            continue;
        }
        let (mut enter, mut leave) = (s.load16(t_min), s.load16(t_max));
        for axis in 0..3 {
            let positive = s.mask16(rays.positive(axis));
            let (low, high) = (s.splat16(planes[axis][slot]), s.splat16(planes[axis + 3][slot]));
            enter = low.select(positive, high).mul_add(slope[axis], near_off[axis]).max(enter);
            leave = high.select(positive, low).mul_add(slope[axis], far_off[axis]).min(leave);
        }
        out.met[slot] = enter.le(leave).bits() & asked;
        out.enter[slot] = enter.to_array();
        if LOD {
            let [a, b] = rays.cone();
            let area = stand_in::area(
                [s.splat16(out.faces[0][slot]), s.splat16(out.faces[1][slot]), s.splat16(out.faces[2][slot])],
                [s.load16(rays.size(0)), s.load16(rays.size(1)), s.load16(rays.size(2))],
            );
            let width = leave.mul_add(s.load16(b), s.load16(a));
            out.likely[slot] = stand_in::may_stand(area, width, s.splat16(stand_in::MARGIN)) & out.met[slot];
        } else {
            out.leave[slot] = leave.to_array();
        }
    }
}

/// Returns the slots of `any`, the farthest from `org` first. The remaining elements are undefined.
#[inline(always)]
fn far_first<S: Simd>(s: S, node: &Node, org: [f32; 3], any: u32) -> [u32; WIDTH] {
    let (step, zero) = (s.powers8(node.exponents()), s.splat8(0.0));
    let mut square = zero;
    for axis in 0..3 {
        let from = s.splat8(node.origin[axis] - org[axis]);
        let low = s.bytes8(&node.planes[axis]).mul_add(step[axis], from);
        let high = s.bytes8(&node.planes[axis + 3]).mul_add(step[axis], from);
        let gap = low.max(zero - high).max(zero);
        square = gap.mul_add(gap, square);
    }
    let (mut ignored, mut order) = ([0.0; WIDTH], [0; WIDTH]);
    s.far_first(square, any, &[0, 1, 2, 3, 4, 5, 6, 7], &mut ignored, &mut order);
    order
}

/// Returns the areas of the faces of a node's cells, as they count in the stand-in test.
#[inline(always)]
fn faces<S: Simd>(s: S, node: &Node) -> [[f32; WIDTH]; 3] {
    let [low, high] = stored_planes(s, node, [0, 1, 2]);
    let [x, y, z] = stand_in::counted(stand_in::faces(low, high, s.splat8(0.0)), area_shares(s, node));
    [x.to_array(), y.to_array(), z.to_array()]
}

/// Removes from `boxes` the rays that hit the box of a child but miss its oriented slabs.
#[inline(always)]
fn slabs<S: Simd>(s: S, run: &mut StreamRun, group: &Group, node: &Node, rays: u32, boxes: &mut Boxes) {
    let (slabs, cells) = (Eight::of(s, node), Cells::of(s, &group.rays, run.view.max_coord));
    let mut beside = 0;
    for slot in 0..WIDTH {
        if boxes.met[slot] != 0 {
            let [enter, leave] =
                cells.within(s, &slabs.one(s, slot), [s.load16(&boxes.enter[slot]), s.load16(&boxes.leave[slot])]);
            let crosses = enter.le(leave).bits();
            beside += (boxes.met[slot] & !crosses).count_ones();
            boxes.met[slot] &= crosses;
        }
    }
    run.slab_heuristic.saw_by(beside, rays);
}

/// Greatest distance of the origins of a group along an axis, as a fraction of the tree's greatest coordinate, at which
/// children that are far from one origin count as far from all. (With a 64th: 3 % slower on the bunny, where
/// consecutive rays begin about that far apart. Rays of scattered origins visit a quarter more leaves out of order.)
const NEAR: f32 = 1.0 / 16.0;

/// True if the origins of `rays` of a group are near each other: then their stacks are sorted.
#[inline(always)]
pub(super) fn are_near<S: Simd>(s: S, group: &Group, rays: u32, max_coord: f32) -> bool {
    let first = group.rays.begins_at(rays.trailing_zeros() as usize);
    (0..3).all(|axis| {
        let org = s.load16(group.rays.org(axis)).select(s.mask16(rays), s.splat16(first[axis]));
        org.greatest() - org.least() <= max_coord * NEAR
    })
}

/// Sorts the stack of a lane, the farthest entry first.
#[inline(always)]
pub(super) fn sort(run: &mut StreamRun, lane: usize) {
    let (stack, top) = (&mut run.stacks[lane], usize::from(run.top[lane]).min(DEPTH));
    for end in BOTTOM + 1..top {
        let (t, child, block) = (stack.t[end], stack.child[end], stack.block[end]);
        let mut at = end;
        while at > BOTTOM && stack.t[at - 1] < t {
            (stack.t[at], stack.child[at], stack.block[at]) =
                (stack.t[at - 1], stack.child[at - 1], stack.block[at - 1]);
            at -= 1;
        }
        (stack.t[at], stack.child[at], stack.block[at]) = (t, child, block);
    }
}

/// Offers rays the cells that may stand in for them. Removes the rays that need no further visit from `boxes`. Results
/// are identical to the bit to those of a single ray (`single.rs`).
#[inline(always)]
fn stand_ins<S: Simd, const ANY: bool>(s: S, run: &mut StreamRun, group: &mut Group, here: Here, boxes: &mut Boxes) {
    if boxes.likely.iter().all(|rays| *rays == 0) {
        return;
    }
    let node = here.node();
    let [low, high] = stored_planes(s, node, [0, 1, 2]);
    let (low, high) = (
        [low[0].to_array(), low[1].to_array(), low[2].to_array()],
        [high[0].to_array(), high[1].to_array(), high[2].to_array()],
    );
    let mut slabs: Option<Eight> = None;
    let cells = Cells::of(s, &group.rays, run.view.max_coord);
    for slot in 0..WIDTH {
        if boxes.likely[slot] == 0 {
            continue;
        }
        let planes = [[low[0][slot], low[1][slot], low[2][slot]], [high[0][slot], high[1][slot], high[2][slot]]];
        let crossing = cells.cross(s, planes);
        let cell = cells.meet(s, crossing, [boxes.faces[0][slot], boxes.faces[1][slot], boxes.faces[2][slot]]);
        let small = cell.small & boxes.likely[slot] & group.left;
        if small == 0 {
            continue;
        }
        match stand_in::judge(run.view, here, slot, run.filter) {
            Verdict::Descend => continue,
            Verdict::Skip => {}
            Verdict::Stand => {
                let slabs = slabs.get_or_insert_with(|| Eight::of(s, node));
                let [enter, leave] = cells.within(s, &slabs.one(s, slot), [cell.enter, crossing[1]]);
                let crosses = small & enter.le(leave).bits();
                offer::<ANY>(run, group, here, slot, crosses, &enter.to_array());
            }
        }
        boxes.met[slot] &= !small;
    }
}

/// Rays for the stand-in test.
struct Cells<L> {
    org: [L; 3],
    /// Slack of planes, signed like the directions.
    slack: [L; 3],
    dir: [L; 3],
    inv: [L; 3],
    positive: [u32; 3],
    ray: ConeRay<L>,
    max_coord: L,
}

impl<L: Lanes<GROUP>> Cells<L> {
    #[inline(always)]
    fn of<S: Simd<F16 = L>>(s: S, rays: &Prepared, max_coord: f32) -> Self {
        let (zero, max_coord) = (s.splat16(0.0), s.splat16(max_coord));
        let ([t_min, _], [a, b]) = (rays.interval(), rays.cone());
        let size = [s.load16(rays.size(0)), s.load16(rays.size(1)), s.load16(rays.size(2))];
        let mut cells = Self {
            org: [s.load16(rays.org(0)), s.load16(rays.org(1)), s.load16(rays.org(2))],
            slack: [zero; 3],
            dir: [zero; 3],
            inv: [s.load16(rays.inv(0)), s.load16(rays.inv(1)), s.load16(rays.inv(2))],
            positive: [rays.positive(0), rays.positive(1), rays.positive(2)],
            ray: ConeRay { dir: size, t_min: s.load16(t_min), a: s.load16(a), b: s.load16(b) },
            max_coord,
        };
        for axis in 0..3 {
            let positive = s.mask16(cells.positive[axis]);
            let slack = abs(zero, cells.org[axis]).max(max_coord) * s.splat16(SLACK);
            cells.slack[axis] = slack.select(positive, zero - slack);
            cells.dir[axis] = size[axis].select(positive, zero - size[axis]);
        }
        cells
    }

    /// Returns the distances at which the rays enter and leave a cell, given its low and high planes as stored.
    #[inline(always)]
    fn cross<S: Simd<F16 = L>>(&self, s: S, [low, high]: [[f32; 3]; 2]) -> [L; 2] {
        let zero = s.splat16(0.0);
        let (mut near, mut far) = ([zero; 3], [zero; 3]);
        for axis in 0..3 {
            let positive = s.mask16(self.positive[axis]);
            let (low, high) = (s.splat16(low[axis]), s.splat16(high[axis]));
            near[axis] = low.select(positive, high) - self.slack[axis] - self.org[axis];
            far[axis] = high.select(positive, low) + self.slack[axis] - self.org[axis];
        }
        stand_in::cross(near, far, self.inv)
    }

    /// Evaluates the stand-in test of a cell, given where the rays enter and leave it. `faces` are the areas as they
    /// count.
    #[inline(always)]
    fn meet<S: Simd<F16 = L>>(&self, s: S, crossing: [L; 2], faces: [f32; 3]) -> Met<L> {
        stand_in::meet(crossing, [s.splat16(faces[0]), s.splat16(faces[1]), s.splat16(faces[2])], &self.ray)
    }

    /// Clips the intervals of the rays in a cell to its oriented slabs.
    #[inline(always)]
    fn within<S: Simd<F16 = L>>(&self, s: S, slabs: &OrientedSlabs<L>, way: [L; 2]) -> [L; 2] {
        let from = Origin::new(self.org, self.max_coord, s.splat16(0.0));
        oriented_slabs::within(self.dir, &from.see(slabs), way, s.splat16(1.0))
    }
}

/// Offers a cell to the rays in `crosses`, which enter its region at `t`.
#[inline(always)]
fn offer<const ANY: bool>(
    run: &mut StreamRun,
    group: &mut Group,
    here: Here,
    slot: usize,
    mut crosses: u32,
    t: &[f32; GROUP],
) {
    let Here { block, id, index } = here;
    let is_asked = crosses != 0 && may_transmit(block, index, slot);
    let coverage = if is_asked { CoverageTest::of(block, index, slot) } else { None };
    let tri = stand_in::lod_code(index, slot);
    while crosses != 0 {
        let i = crosses.trailing_zeros() as usize & (GROUP - 1);
        crosses &= crosses - 1;
        let (lane, t) = (group.lane(i), t[i]);
        let ray = usize::from(run.ray[lane]) & (STREAM - 1);
        run.first_cell[ray] = run.first_cell[ray].min(t);
        if coverage.as_ref().is_some_and(|it| it.transmits(&step::entry_ray(&run.prepared[lane]), t)) {
            continue;
        }
        let Some(best) = run.hits.get_mut(ray) else { continue };
        if single::offer(best, TriHit { t, u: 0.0, v: 0.0, block: id, tri }) {
            run.prepared[lane].set_best(t);
            if ANY {
                group.left &= !(1 << i);
            }
        }
    }
}
