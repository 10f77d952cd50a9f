//! The phases of a stream.
//!
//! In large models, walks prefetch the nodes and the leaves that they go to. Leaves are in another block and are
//! prefetched again there, but telling them apart here costs more.

use super::ahead::{ask, ask_for};
use super::coverage::EntryRay;
use super::hit::{Counters, TriHit};
use super::kernel::{Here, Seen};
use super::oriented_slabs::area_shares;
use super::single::{self, CellLanes, CellRay, LeafRay, MetCells, is_better, triangles};
use super::stand_in;
use super::stream::{AT_LEAVES, BOTTOM, Counts, DEPTH, EXTERNALS, LANES, NODES, NOTHING, Row, StreamRun, lane, push};
use crate::math::Cone;
use crate::math::STREAM;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::{Block, Child, INDEX_MASK, Node};
use crate::structure::rays16::OneRay;
use bytemuck::bytes_of;
use std::mem::offset_of;

/// Moves a lane to `child` of a block. If the block is not in memory, the lane's ray is left unfinished.
#[inline(always)]
fn enter(run: &mut StreamRun, counts: &mut Counts, lane: usize, block: u32, child: u32) {
    match run.view.visit(block) {
        Some(words) => {
            run.block[lane] = Block::new(words);
            (run.block_id[lane], run.child[lane]) = (block, child);
            ask_for(run.is_large, run.block[lane], child);
            push(&mut run.rows, counts, child, lane);
        }
        None => leave(run, counts, lane),
    }
}

/// Frees a lane; its ray is left unfinished, to be traced as a single ray.
#[inline(always)]
pub(super) fn leave(run: &mut StreamRun, counts: &mut Counts, lane: usize) {
    run.unfinished.push(u32::from(run.ray[lane]));
    push(&mut run.rows, counts, NOTHING, lane);
}

/// Follows references to other blocks.
#[inline(always)]
pub(super) fn externals(run: &mut StreamRun, mut counts: Counts) -> Counts {
    let (row, count) = (run.rows[EXTERNALS], counts.take(EXTERNALS));
    run.counters.blocks += count as u64;
    // The first loop finds all targets before the second one waits for their memory.
    for i in 0..count {
        let lane = lane(&row, i);
        let (block, child) = run.block[lane].external((run.child[lane] & INDEX_MASK) as usize);
        (run.block_id[lane], run.child[lane]) = (block, child);
    }
    for i in 0..count {
        let lane = lane(&row, i);
        enter(run, &mut counts, lane, run.block_id[lane], run.child[lane]);
    }
    counts
}

/// Rows of lanes, by the number of children that they hit.
const NONE: usize = 0;
const ONE: usize = 1;
const SEVERAL: usize = 2;
/// Row of lanes for which stand-ins or oriented slabs must be tested first.
const ASKED: usize = 3;

/// Returns the row of lanes that hit the children `met`.
#[inline(always)]
fn class(met: u32) -> usize {
    usize::from(met != 0) + usize::from(met & met.wrapping_sub(1) != 0)
}

/// Tests the children of the nodes that walks are at, and moves each walk on. A walk goes to the nearest child that it
/// hits, and the other children go on its stack. A walk that hits none goes to the top of its stack.
#[inline(always)]
pub(super) fn nodes<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    run: &mut StreamRun,
    mut counts: Counts,
) -> Counts {
    let (row, count) = (run.rows[NODES], counts.take(NODES));
    run.counters.nodes += count as u64;
    // Rows of lanes, by the number of children hit.
    let (mut by_met, mut met_counts) = ([[0; LANES]; 4], Counts::default());
    let asks = !LOD && run.slab_heuristic.asks();
    let slack = s.splat8(run.view.max_coord * EXTENT_SLACK);
    // Short loops let the CPU work on several lanes at once.
    for i in 0..count {
        let lane = lane(&row, i);
        let (node, ray) = (node_of(run, lane), &run.prepared[lane]);
        let crossed = boxes(s, node, ray);
        let met = crossed.met;
        run.scratch.enter[lane] = crossed.enter.to_array();
        run.scratch.hits[lane] = met;
        let mut is_asked = asks && met != 0;
        if LOD {
            let likely = met & likely(s, node, ray, &crossed, slack);
            run.scratch.small[lane] = likely;
            is_asked = likely != 0 || run.view.accept_missing && met != 0;
        }
        if asks {
            run.scratch.leave[lane] = crossed.leave.to_array();
        }
        met_counts.push(&mut by_met, if is_asked { ASKED } else { class(met) }, lane);
    }
    let (asked, asked_count) = (by_met[ASKED], met_counts.take(ASKED));
    if asked_count > 0 {
        if LOD {
            stand_ins::<S, ANY>(s, run, &asked, asked_count);
        } else {
            slabs(s, run, &asked, asked_count);
        }
    }
    for i in 0..asked_count {
        let lane = lane(&asked, i);
        met_counts.push(&mut by_met, class(run.scratch.hits[lane]), lane);
    }
    for i in 0..met_counts.of(SEVERAL) {
        let lane = lane(&by_met[SEVERAL], i);
        let node = node_of(run, lane);
        let top = usize::from(run.top[lane]);
        if top > DEPTH - 8 {
            leave(run, &mut counts, lane);
            continue;
        }
        let (t, child, block) = room(&mut run.stacks[lane], top);
        let hits = run.scratch.hits[lane];
        s.far_first(s.load8(&run.scratch.enter[lane]), hits, &node.child, t, child);
        *block = [run.block_id[lane]; 8];
        let others = hits.count_ones() as usize - 1;
        let nearest = child[others & 7];
        run.top[lane] = (top + others) as u8;
        run.child[lane] = nearest;
        ask_for(run.is_large, run.block[lane], nearest);
        push(&mut run.rows, &mut counts, nearest, lane);
    }
    for i in 0..met_counts.of(ONE) {
        let lane = lane(&by_met[ONE], i);
        let node = node_of(run, lane);
        let child = u32::from(node.child[(run.scratch.hits[lane].trailing_zeros() & 7) as usize]);
        run.child[lane] = child;
        ask_for(run.is_large, run.block[lane], child);
        push(&mut run.rows, &mut counts, child, lane);
    }
    // Most lanes that hit no child have an empty stack. These go to the row of free lanes; row 0 of `rows` collects the
    // others.
    let mut left = Counts::default();
    let mut rows = [[0; LANES]; 4];
    for i in 0..met_counts.of(NONE) {
        let lane = lane(&by_met[NONE], i);
        left.push(&mut rows, usize::from(usize::from(run.top[lane]) == BOTTOM), lane);
    }
    for i in 0..left.of(1) {
        push(&mut run.rows, &mut counts, NOTHING, lane(&rows[1], i));
    }
    for i in 0..left.of(0) {
        pop(s, run, &mut counts, lane(&rows[0], i));
    }
    counts
}

/// Returns the eight entries from `top` on, which is at most `DEPTH - 8`.
#[inline(always)]
fn room(stack: &mut super::stream::Stack, top: usize) -> (&mut [f32; 8], &mut [u32; 8], &mut [u32; 8]) {
    let top = top.min(DEPTH - 8);
    let t = stack.t[top..].first_chunk_mut::<8>();
    let child = stack.child[top..].first_chunk_mut::<8>();
    match (t, child, stack.block[top..].first_chunk_mut::<8>()) {
        (Some(t), Some(child), Some(block)) => (t, child, block),
        _ => unreachable!(),
    }
}

/// Pops the uppermost entry of a lane's stack that is not beyond the best hit, and moves the lane there.
#[inline(always)]
pub(super) fn pop<S: Simd>(s: S, run: &mut StreamRun, counts: &mut Counts, lane: usize) {
    let (child, block) = take(s, run, lane);
    go(run, counts, lane, child, block);
}

/// Pops the uppermost entry of a lane's stack that is not beyond the best hit. Returns its child reference and its
/// block.
#[inline(always)]
fn take<S: Simd>(s: S, run: &mut StreamRun, lane: usize) -> (u32, u32) {
    let stack = &run.stacks[lane];
    let best = s.splat8(run.prepared[lane].best());
    let mut top = usize::from(run.top[lane]).clamp(BOTTOM, DEPTH);
    // Not `<`: an equal distance may be a tie that a lower primitive id wins. The bottom entries always qualify.
    let mut near = eight_below(s, stack, top).le(best).bits();
    while near == 0 && top > 2 * BOTTOM {
        top -= 8;
        near = eight_below(s, stack, top).le(best).bits();
    }
    if near == 0 {
        // The loop tested all entries above the bottom, eight at a time: only the bottom is left.
        (top, near) = (BOTTOM, 0x80);
    }
    let above = 7 - (near | 1).ilog2() as usize;
    let at = (top - 1 - above) & 127;
    run.top[lane] = at as u8;
    (stack.child[at.min(DEPTH - 1)], stack.block[at.min(DEPTH - 1)])
}

/// Moves a lane to an entry from its stack.
#[inline(always)]
fn go(run: &mut StreamRun, counts: &mut Counts, lane: usize, child: u32, block: u32) {
    // Room for the eight children of the next node, and for the eight entries that are written in any case.
    if usize::from(run.top[lane]) + 16 >= DEPTH {
        return leave(run, counts, lane);
    }
    // The block was visited when this entry was pushed.
    if let Some(words) = run.view.words(block) {
        run.block[lane] = Block::new(words);
    }
    (run.block_id[lane], run.child[lane]) = (block, child);
    ask_for(run.is_large, run.block[lane], child);
    push(&mut run.rows, counts, child, lane);
}

#[inline(always)]
fn eight_below<S: Simd>(s: S, stack: &super::stream::Stack, top: usize) -> S::F8 {
    match stack.t[top - 8..].first_chunk::<8>() {
        Some(eight) => s.load8(eight),
        None => unreachable!(),
    }
}

/// Result of the test of a ray against the boxes of a node's children.
struct Crossed<S: Simd> {
    /// Children that the ray hits before its best hit.
    met: u32,
    enter: S::F8,
    /// Distance at which the ray leaves each box; not limited by the best hit.
    leave: S::F8,
    /// Length of the ray between the planes of each axis.
    across: [S::F8; 3],
}

#[inline(always)]
fn boxes<S: Simd>(s: S, node: &Node, ray: &OneRay) -> Crossed<S> {
    let bytes = bytes_of(node);
    let [near_off, far_off, slope] = s.slabs(node.head(), ray.inv(), ray.off());
    let mut enter = s.splat8(ray.t_min());
    let mut leave = s.splat8(f32::INFINITY);
    let mut across = slope;
    let planes = ray.planes();
    for axis in 0..3 {
        let near = s.bytes8(eight(bytes, row_at(planes[axis])));
        let far = s.bytes8(eight(bytes, row_at(planes[axis + 4])));
        enter = near.mul_add(slope[axis], near_off[axis]).max(enter);
        leave = far.mul_add(slope[axis], far_off[axis]).min(leave);
        across[axis] = (far - near) * slope[axis];
    }
    let met = enter.le(leave.min(s.splat8(ray.best()))).bits() & u32::from(node.valid);
    Crossed { met, enter, leave, across }
}

/// Amount by which extents of cells are reduced, as a fraction of the tree's greatest coordinate. Each of the two
/// planes of an extent is rounded to `2^-24` of that, and so is their difference. ([`stand_in::MARGIN`] covers the
/// rounding here, which is relative to the extent.)
const EXTENT_SLACK: f32 = 4.0 / 16_777_216.0;

/// Returns the children of a node that may be small enough to stand in, and perhaps others. The test estimates extents
/// from the intervals of the ray in the boxes.
#[inline(always)]
fn likely<S: Simd>(s: S, node: &Node, ray: &OneRay, crossed: &Crossed<S>, slack: S::F8) -> u32 {
    let [a, b, dir @ ..] = *ray.cone();
    let (zero, most) = (s.splat8(0.0), s.splat8(4.0 / EXTENT_SLACK));
    // The length between two planes, times |dir| along the axis, is the cell's extent. NaN counts as 0, and infinity as
    // the greatest possible extent: both are on the safe side.
    let x = (crossed.across[0] * s.splat8(dir[0]) - slack).max(zero).min(slack * most);
    let y = (crossed.across[1] * s.splat8(dir[1]) - slack).max(zero).min(slack * most);
    let z = (crossed.across[2] * s.splat8(dir[2]) - slack).max(zero).min(slack * most);
    let area = y * z * s.splat8(dir[0]) + z * x * s.splat8(dir[1]) + x * y * s.splat8(dir[2]);
    let width = crossed.leave.min(s.splat8(ray.best())).mul_add(s.splat8(b), s.splat8(a));
    stand_in::may_stand(area * area_shares(s, node), width, s.splat8(stand_in::MARGIN))
}

/// Returns a lane's ray for the stand-in test.
#[inline(always)]
fn cell_lanes<S: Simd>(s: S, ray: &OneRay, max_coord: f32) -> CellLanes<S> {
    let [a, b, x, y, z, org @ ..] = *ray.cone();
    let (inv, planes) = (ray.inv(), ray.planes());
    let near = [usize::from(planes[0]), usize::from(planes[1]), usize::from(planes[2])];
    let ray =
        CellRay { org, inv: [inv[0], inv[1], inv[2]], dir: [x, y, z], near, t_min: ray.t_min(), cone: Cone { a, b } };
    CellLanes::of(s, ray, max_coord)
}

/// Tests the oriented slabs of the nodes that some lanes are at, where no cell can stand in. A child with slabs that
/// the ray misses is removed from its hits.
#[inline(always)]
fn slabs<S: Simd>(s: S, run: &mut StreamRun, row: &Row, count: usize) {
    for i in 0..count {
        let lane = lane(row, i);
        let cells = cell_lanes(s, &run.prepared[lane], run.view.max_coord);
        let way = [s.load8(&run.scratch.enter[lane]), s.load8(&run.scratch.leave[lane])];
        let [enter, leave] = cells.within(s, node_of(run, lane), way);
        let (met, crosses) = (run.scratch.hits[lane], enter.le(leave).bits());
        run.slab_heuristic.saw((met & !crosses).count_ones());
        run.scratch.hits[lane] = met & crosses;
    }
}

/// Offers some lanes those cells of their nodes that may stand in. Each loop handles fewer lanes than the one before.
/// (The slabs of other cells are not tested. Stand-ins below them may reach out of a node's slabs. And where a spatial
/// split puts a triangle into several leaves, the cell of one leaf may stand in and transmit the ray, which then hits
/// the triangle in the other leaf.)
#[inline(always)]
fn stand_ins<S: Simd, const ANY: bool>(s: S, run: &mut StreamRun, row: &Row, count: usize) {
    let (mut rows, mut counts) = ([[0; LANES]; 4], Counts::default());
    for i in 0..count {
        let lane = lane(row, i);
        let cells = cell_lanes(s, &run.prepared[lane], run.view.max_coord);
        let (small, [enter, leave]) = cells.small(&cells.cells(s, node_of(run, lane)), run.scratch.small[lane]);
        run.scratch.small[lane] = small;
        (run.scratch.at[lane], run.scratch.leave[lane]) = (enter.to_array(), leave.to_array());
        counts.push(&mut rows, usize::from(small != 0), lane);
    }
    for i in 0..counts.of(1) {
        let lane = lane(&rows[1], i);
        let cells = cell_lanes(s, &run.prepared[lane], run.view.max_coord);
        let way = [s.load8(&run.scratch.at[lane]), s.load8(&run.scratch.leave[lane])];
        let [enter, leave] = cells.within(s, node_of(run, lane), way);
        run.scratch.small[lane] |= enter.le(leave).bits() << 8;
        run.scratch.at[lane] = enter.to_array();
    }
    for i in 0..counts.of(1) {
        offer::<ANY>(run, lane(&rows[1], i));
    }
    if run.view.accept_missing {
        missing_leaves::<S, ANY>(s, run, row, count);
    }
}

/// Returns the node that a lane is at.
#[inline(always)]
fn node_of<'a>(run: &StreamRun<'a>, lane: usize) -> &'a Node {
    run.block[lane].node((run.child[lane] & INDEX_MASK) as usize)
}

/// Returns a lane's ray for the coverage test.
#[inline(always)]
pub(super) fn entry_ray(ray: &OneRay) -> EntryRay {
    let [_, _, x, y, z, org @ ..] = *ray.cone();
    let inv = ray.inv();
    EntryRay { org, dir: [x.copysign(inv[0]), y.copysign(inv[1]), z.copysign(inv[2])] }
}

/// Offers a lane the cells of its node that may stand in. If an any-hit ray gets one, nothing is left to visit.
#[inline(always)]
fn offer<const ANY: bool>(run: &mut StreamRun, lane: usize) {
    let ray = usize::from(run.ray[lane]) & (STREAM - 1);
    let ray_at_cell = entry_ray(&run.prepared[lane]);
    let node = (run.child[lane] & INDEX_MASK) as usize;
    let Some(best) = run.hits.get_mut(ray) else { return };
    let before = (best.t, best.tri, best.block);
    let (block, id, both) = (run.block[lane], run.block_id[lane], run.scratch.small[lane]);
    let (t, first_cell) = (&run.scratch.at[lane], &mut run.first_cell[ray]);
    let here = Here { block, id, index: node };
    let met = MetCells { small: both & 0xff, crosses: both >> 8, t };
    let settled =
        single::offers(Seen { view: run.view, filter: run.filter }, here, met, &ray_at_cell, best, first_cell);
    run.scratch.hits[lane] &= !settled;
    if (best.t, best.tri, best.block) != before {
        found::<ANY>(run, lane);
    }
}

/// Updates the state of a lane that has a stand-in as its new best hit.
#[inline(always)]
fn found<const ANY: bool>(run: &mut StreamRun, lane: usize) {
    let t = run.hits[usize::from(run.ray[lane])].t;
    run.prepared[lane].set_best(t);
    if ANY {
        run.top[lane] = BOTTOM as u8;
        run.scratch.hits[lane] = 0;
    }
}

/// Offers lanes the cells of missing leaves, in place of these.
#[inline(always)]
fn missing_leaves<S: Simd, const ANY: bool>(s: S, run: &mut StreamRun, row: &Row, count: usize) {
    for i in 0..count {
        let lane = lane(row, i);
        let (block, id, left) = (run.block[lane], run.block_id[lane], run.scratch.hits[lane]);
        if left == 0 || !run.view.lacks_leaves(id) {
            continue;
        }
        let cells = cell_lanes(s, &run.prepared[lane], run.view.max_coord);
        let node = (run.child[lane] & INDEX_MASK) as usize;
        let ray = usize::from(run.ray[lane]) & (STREAM - 1);
        let Some(best) = run.hits.get_mut(ray) else { continue };
        let before = (best.t, best.tri, best.block);
        let here = Here { block, id, index: node };
        let (tree, out) = (Seen { view: run.view, filter: run.filter }, (&mut *best, &mut run.first_cell[ray]));
        run.scratch.hits[lane] = single::for_missing_leaves::<S, ANY>(s, tree, here, left, &cells, out);
        if (best.t, best.tri, best.block) != before {
            found::<ANY>(run, lane);
        }
    }
}

/// Returns the byte of a node at which a row of planes begins.
#[inline(always)]
fn row_at(row: u8) -> usize {
    offset_of!(Node, planes) + 8 * usize::from(row)
}

#[inline(always)]
fn eight(bytes: &[u8], at: usize) -> &[u8; 8] {
    let at = at & 63;
    match bytes[at..at + 8].first_chunk::<8>() {
        Some(eight) => eight,
        None => unreachable!(),
    }
}

/// Tests the triangles of the leaves that walks wait at.
#[inline(always)]
pub(super) fn leaves<S: Simd, const ANY: bool>(s: S, run: &mut StreamRun, mut counts: Counts) -> Counts {
    let (row, count) = (run.rows[AT_LEAVES], counts.take(AT_LEAVES));
    run.entered = 0;
    for i in 0..count {
        leaves_of::<S, ANY>(s, run, &mut counts, lane(&row, i));
    }
    counts
}

/// Tests the leaf that one walk waits at, and others of the same block that are next on its stack. (The leaves of a
/// node are mostly hit by the same rays, and are neighbours in memory.)
#[inline(always)]
fn leaves_of<S: Simd, const ANY: bool>(s: S, run: &mut StreamRun, counts: &mut Counts, lane: usize) {
    let (block, id) = (run.block[lane], run.block_id[lane]);
    if block.words().is_empty() {
        return leave(run, counts, lane);
    }
    let ray = leaf_ray(s, &run.prepared[lane]);
    let (mut child, mut top) = (run.child[lane], run.top[lane]);
    loop {
        // The next leaf is prefetched while this one is tested.
        let (mut next, mut below) = take(s, run, lane);
        let is_here = Child::is_leaf(next) && below + run.view.leaves_at == id;
        if is_here {
            ask(block, next);
        }
        let at = (child & INDEX_MASK) as usize;
        let leaf = block.leaf(at);
        run.counters.leaves += 1;
        run.counters.leaf_lines += leaf.lines(at) as u64;
        run.counters.triangles += leaf.triangles as u64;
        if let Some((slot, t, u, v)) = triangles(s, block, leaf, &ray, run.filter, run.prepared[lane].best()) {
            let hit = TriHit { t, u, v, block: id, tri: (at as u32) << 3 | slot };
            if !keep(run, lane, &hit) {
                return leave(run, counts, lane);
            }
            if ANY {
                return push(&mut run.rows, counts, NOTHING, lane);
            }
            // The entry may be beyond the new hit.
            run.top[lane] = top;
            (next, below) = take(s, run, lane);
        }
        if !Child::is_leaf(next) || below + run.view.leaves_at != id {
            return go(run, counts, lane, next, below);
        }
        (child, top) = (next, run.top[lane]);
    }
}

/// Moves lanes that have reached leaves since the last call from the blocks of their nodes to the leaf blocks. If the
/// leaf block is not in memory, the lane gets an empty block.
#[inline(always)]
pub(super) fn enter_leaves(run: &mut StreamRun, counts: Counts) {
    let count = counts.of(AT_LEAVES);
    for i in run.entered..count {
        let lane = lane(&run.rows[AT_LEAVES], i);
        let id = run.block_id[lane] + run.view.leaves_at;
        (run.block[lane], run.block_id[lane]) = (Block::new(run.view.visit(id).unwrap_or(&[])), id);
        // Walks wait for others here. Meanwhile data moves into the caches near the core, so small models gain too.
        ask(run.block[lane], run.child[lane]);
    }
    run.entered = count;
}

#[inline(always)]
fn leaf_ray<S: Simd>(s: S, ray: &OneRay) -> LeafRay<S> {
    let (k, org, shear) = ray.shear();
    LeafRay {
        org: [s.splat8(org[0]), s.splat8(org[1]), s.splat8(org[2])],
        shear: [s.splat8(shear[0]), s.splat8(shear[1]), s.splat8(shear[2])],
        t_min: s.splat8(ray.t_min()),
        k,
    }
}

/// Keeps a hit if it is better than the lane's best. Returns false if a block that decides a tie is not in memory.
#[inline(always)]
fn keep(run: &mut StreamRun, lane: usize, hit: &TriHit) -> bool {
    let ray = run.ray[lane];
    let Some(best) = run.hits.get_mut(usize::from(ray)) else { return false };
    // Local counters, not those of the state: a value that is passed to a call by address cannot stay in registers.
    let mut counters = Counters::default();
    let is_better = is_better(run.view, hit, best, &mut counters);
    run.counters.ties += counters.ties;
    match is_better {
        Ok(true) => {
            *best = *hit;
            run.prepared[lane].set_best(hit.t);
            true
        }
        Ok(false) => true,
        Err(_) => false,
    }
}
