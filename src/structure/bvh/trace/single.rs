//! Traversal of single rays: eight boxes or triangles at a time.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::coverage::EntryRay;
use super::hit::{Outcome, TriHit};
use super::kernel::{Here, Seen};
use super::oriented_slabs::{Origin, area_shares, of_node, within};
use super::stand_in::{self, ConeRay, Verdict};
use super::tables::sheared_corners;
use super::walk::{Entry, Walk, push_sorted};
use super::{Counters, PartFilter, PreparedRay, TreeView, Triangle};
use crate::base::ids::BlockId;
use crate::geom::watertight::{Sheared, intersect};
use crate::math::Cone;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, Child, Node};
use crate::structure::bvh::leaf::Leaf;
use crate::structure::ray;

/// Continues `walk` until it ends or a block is missing.
pub(super) fn run<const ANY: bool>(view: &TreeView, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
    if walk.ray.cone == Cone::ZERO && !view.accept_missing {
        dispatch(view.isa, Single::<ANY, false> { view, filter, walk })
    } else {
        dispatch(view.isa, Single::<ANY, true> { view, filter, walk })
    }
}

/// Kernel of single rays. `LOD`: cells may stand in.
struct Single<'a, 'v, const ANY: bool, const LOD: bool> {
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    walk: &'a mut Walk,
}

impl<const ANY: bool, const LOD: bool> Op for Single<'_, '_, ANY, LOD> {
    type Out = Outcome;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Outcome {
        let Self { view, filter, walk } = self;
        if walk.stack.is_empty() {
            return Outcome::Done;
        }
        let ray = RayLanes::new(s, PreparedRay::new(&walk.ray, view.max_coord));
        let Walk { stack, best, first_cell, counters, .. } = walk;
        visit::<S, ANY, LOD>(s, Seen { view, filter }, &ray, Alone { stack, best, first_cell, counters })
    }
}

/// A ray for the triangle test, in all lanes.
pub(super) struct LeafRay<S: Simd> {
    /// Origin, in the axis order `k`.
    pub org: [S::F8; 3],
    pub shear: [S::F8; 3],
    pub t_min: S::F8,
    /// Axis order, see [`crate::geom::Shear`].
    pub k: [usize; 3],
}

/// A ray, and its data for box and triangle tests in all lanes.
pub(super) struct RayLanes<S: Simd> {
    ray: PreparedRay,
    leaf: LeafRay<S>,
    inv: [S::F8; 3],
    minus_off_near: [S::F8; 3],
    minus_off_far: [S::F8; 3],
}

impl<S: Simd> RayLanes<S> {
    #[inline(always)]
    pub(super) fn new(s: S, ray: PreparedRay) -> Self {
        let k = ray.shear.k;
        Self {
            ray,
            leaf: LeafRay {
                org: splat3(s, [ray.org[k[0]], ray.org[k[1]], ray.org[k[2]]]),
                shear: splat3(s, ray.shear.s),
                t_min: s.splat8(ray.t_min),
                k,
            },
            inv: splat3(s, ray.inv),
            minus_off_near: splat3(s, [-ray.off_near[0], -ray.off_near[1], -ray.off_near[2]]),
            minus_off_far: splat3(s, [-ray.off_far[0], -ray.off_far[1], -ray.off_far[2]]),
        }
    }
}

#[inline(always)]
fn splat3<S: Simd>(s: S, v: [f32; 3]) -> [S::F8; 3] {
    [s.splat8(v[0]), s.splat8(v[1]), s.splat8(v[2])]
}

/// The state of a single ray.
pub(super) struct Alone<'a> {
    /// Entries still to be visited, the nearest last.
    pub stack: &'a mut Vec<Entry>,
    pub best: &'a mut TriHit,
    /// Distance at which the ray first entered a stand-in.
    pub first_cell: &'a mut f32,
    pub counters: &'a mut Counters,
}

/// Visits the entries on the stack, nearest first.
#[inline(always)]
pub(super) fn visit<S: Simd, const ANY: bool, const LOD: bool>(
    s: S,
    tree: Seen,
    lanes: &RayLanes<S>,
    walk: Alone,
) -> Outcome {
    let Seen { view, filter } = tree;
    let Alone { stack, best, first_cell, counters } = walk;
    let mut block_id = u32::MAX;
    let mut block = Block::new(&[]);
    let cells = if LOD { Some(CellLanes::new(s, &lanes.ray, view.max_coord)) } else { None };
    while let Some(entry) = stack.pop() {
        // Not `>=`: an entry at an equal distance may hold a tie that a lower primitive id wins.
        if entry.t > best.t {
            continue;
        }
        if entry.block != block_id {
            let Some(words) = view.visit(entry.block) else {
                stack.push(entry);
                return Outcome::Pending(BlockId(entry.block));
            };
            (block_id, block) = (entry.block, Block::new(words));
        }
        let (mut child, mut enter) = (entry.child, entry.t);
        loop {
            match Child::from_bits(child) {
                Child::Node(index) => {
                    counters.nodes += 1;
                    let here = Here { block, id: block_id, index };
                    let node = here.node();
                    let (mut mask, t, leave) = boxes(s, node, lanes, best.t);
                    if let Some(cells) = &cells {
                        mask = stand_ins(s, tree, here, (mask, leave), cells, best, first_cell);
                        if view.accept_missing && mask != 0 && view.lacks_leaves(block_id) {
                            mask = for_missing_leaves::<S, ANY>(s, tree, here, mask, cells, (best, first_cell));
                        }
                        if ANY && best.is_hit() {
                            stack.clear();
                            return Outcome::Done;
                        }
                    }
                    let Some(nearest) = push_far_to_near(mask, &t, node, view, block_id, stack) else { break };
                    if nearest.block != block_id {
                        let Some(words) = view.visit(nearest.block) else {
                            stack.push(nearest);
                            return Outcome::Pending(BlockId(nearest.block));
                        };
                        (block_id, block) = (nearest.block, Block::new(words));
                    }
                    (child, enter) = (nearest.child, nearest.t);
                }
                Child::Leaf(at) => {
                    counters.leaves += 1;
                    let leaf = block.leaf(at);
                    counters.leaf_lines += leaf.lines(at) as u64;
                    counters.triangles += leaf.triangles as u64;
                    let found = triangles(s, block, leaf, &lanes.leaf, filter, best.t);
                    if let Some((lane, t, u, v)) = found {
                        let hit = TriHit { t, u, v, block: block_id, tri: (at as u32) << 3 | lane };
                        match is_better(view, &hit, best, counters) {
                            Ok(true) => *best = hit,
                            Ok(false) => {}
                            Err(missing) => {
                                stack.push(Entry { t, block: block_id, child });
                                return Outcome::Pending(missing);
                            }
                        }
                        if ANY {
                            stack.clear();
                            return Outcome::Done;
                        }
                    }
                    break;
                }
                Child::External(at) => {
                    counters.blocks += 1;
                    let (next, below) = block.external(at);
                    let Some(words) = view.visit(next) else {
                        if let Some(cells) = cells.as_ref().filter(|_| view.accept_missing) {
                            let (index, slot) = block.place_of_external(at);
                            let here = Here { block, id: block_id, index };
                            stand_in_for_missing::<S, ANY>(s, tree, here, slot, cells, (best, first_cell));
                            if ANY && best.is_hit() {
                                stack.clear();
                                return Outcome::Done;
                            }
                            break;
                        }
                        stack.push(Entry { t: entry.t, block: next, child: below });
                        return Outcome::Pending(BlockId(next));
                    };
                    (block_id, block, child) = (next, Block::new(words), below);
                }
                // A cell of the same node may stand in before it.
                Child::Member(_) if enter > best.t => break,
                Child::Member(at) => return Outcome::Member(block.member(at)),
            }
        }
    }
    Outcome::Done
}

/// Returns true if `hit` beats `best`: it is nearer, or as near with a lower primitive id. Fails with the id of a block
/// that is needed to compare primitive ids.
#[inline(always)]
pub(super) fn is_better(
    view: &TreeView,
    hit: &TriHit,
    best: &TriHit,
    counters: &mut Counters,
) -> Result<bool, BlockId> {
    if hit.t < best.t || !best.is_hit() {
        return Ok(true);
    }
    if hit.t > best.t || (hit.block, hit.tri) == (best.block, best.tri) {
        return Ok(false);
    }
    tie(view, hit, best, counters)
}

#[cold]
#[inline(never)]
fn tie(view: &TreeView, hit: &TriHit, best: &TriHit, counters: &mut Counters) -> Result<bool, BlockId> {
    if let Some(answer) = hit.untie(best) {
        return Ok(answer);
    }
    counters.ties += 1;
    match (view.prim(hit), view.prim(best)) {
        (Ok(a), Ok(b)) => Ok((a, hit.place()) < (b, best.place())),
        _ if view.ties_by_place => Ok((hit.block, hit.tri) < (best.block, best.tri)),
        (a, b) => Ok((a?, hit.place()) < (b?, best.place())),
    }
}

/// Returns the children with boxes that the ray hits before `t_max`, and the distances at which it enters and leaves
/// these.
#[inline(always)]
fn boxes<S: Simd>(s: S, node: &Node, lanes: &RayLanes<S>, t_max: f32) -> (u32, [f32; 8], S::F8) {
    let step = s.powers8(node.exponents());
    let mut enter = lanes.leaf.t_min;
    let mut leave = s.splat8(t_max);
    for axis in 0..3 {
        let slope = step[axis] * lanes.inv[axis];
        let origin = s.splat8(node.origin[axis]);
        let (near, far) = planes(node, lanes.ray.near[axis]);
        let near = s.bytes8(near).mul_add(slope, origin.mul_add(lanes.inv[axis], lanes.minus_off_near[axis]));
        let far = s.bytes8(far).mul_add(slope, origin.mul_add(lanes.inv[axis], lanes.minus_off_far[axis]));
        // In this order of operands a NaN (infinity times zero) leaves the interval unchanged.
        enter = near.max(enter);
        leave = far.min(leave);
    }
    (enter.le(leave).bits() & u32::from(node.valid), enter.to_array(), leave)
}

/// A ray for the stand-in test, in all lanes.
pub(super) struct CellLanes<S: Simd> {
    ray: ConeRay<S::F8>,
    inv: [S::F8; 3],
    org: [S::F8; 3],
    slack: [S::F8; 3],
    near: [usize; 3],
    pub(super) one: EntryRay,
    max_coord: f32,
}

/// The fields of [`PreparedRay`] that the stand-in test needs.
pub(super) struct CellRay {
    pub org: [f32; 3],
    pub inv: [f32; 3],
    pub dir: [f32; 3],
    pub near: [usize; 3],
    pub t_min: f32,
    pub cone: Cone,
}

impl<S: Simd> CellLanes<S> {
    #[inline(always)]
    fn new(s: S, ray: &PreparedRay, max_coord: f32) -> Self {
        let (org, dir) = (ray.org.to_array(), ray.dir.to_array());
        Self::of(s, CellRay { org, inv: ray.inv, dir, near: ray.near, t_min: ray.t_min, cone: ray.cone }, max_coord)
    }

    /// Prepares a ray for a tree with coordinates of at most `max_coord` in magnitude.
    #[inline(always)]
    pub(super) fn of(s: S, ray: CellRay, max_coord: f32) -> Self {
        let CellRay { org, inv, dir, near, t_min, cone } = ray;
        let (mut slack, mut signed) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            slack[axis] = ray::slack(org[axis], inv[axis], max_coord);
            signed[axis] = dir[axis].copysign(inv[axis]);
        }
        let (t_min, a, b) = (s.splat8(t_min), s.splat8(cone.a), s.splat8(cone.b));
        let ray = ConeRay { dir: splat3(s, dir), t_min, a, b };
        let one = EntryRay { org, dir: signed };
        Self { ray, inv: splat3(s, inv), org: splat3(s, org), slack: splat3(s, slack), near, one, max_coord }
    }

    /// Returns the distances at which the ray enters and leaves cells between planes as stored.
    #[inline(always)]
    fn cross(&self, mut near: [S::F8; 3], mut far: [S::F8; 3]) -> [S::F8; 2] {
        for axis in 0..3 {
            near[axis] = near[axis] - self.slack[axis] - self.org[axis];
            far[axis] = far[axis] + self.slack[axis] - self.org[axis];
        }
        stand_in::cross(near, far, self.inv)
    }

    /// Clips the intervals of the ray in a node's cells to the oriented slabs of the cells.
    #[inline(always)]
    pub(super) fn within(&self, s: S, node: &Node, way: [S::F8; 2]) -> [S::F8; 2] {
        let from = Origin::new(self.org, s.splat8(self.max_coord), s.splat8(0.0));
        within(splat3(s, self.one.dir), &from.see(&of_node(s, node)), way, s.splat8(1.0))
    }
}

/// Returns the planes of eight cells as stored: near planes, then far planes.
#[inline(always)]
pub(super) fn stored_planes<S: Simd>(s: S, node: &Node, near: [usize; 3]) -> [[S::F8; 3]; 2] {
    let step = s.powers8(node.exponents());
    let zero = s.splat8(0.0);
    let mut out = [[zero; 3]; 2];
    for axis in 0..3 {
        let origin = s.splat8(node.origin[axis]);
        let (first, last) = planes(node, near[axis]);
        // Products with powers of two are exact: there is one rounding, fused or not.
        out[0][axis] = s.bytes8(first).mul_add(step[axis], origin);
        out[1][axis] = s.bytes8(last).mul_add(step[axis], origin);
    }
    out
}

/// Cells of a node, prepared for the stand-in test.
pub(super) struct Cells<S: Simd> {
    planes: [[S::F8; 3]; 2],
    faces: [S::F8; 3],
}

impl<S: Simd> CellLanes<S> {
    /// Returns the cells of a node's children, and those in `mask` that may be small enough to stand in. `leave` is
    /// where the ray leaves their boxes, or farther.
    #[inline(always)]
    pub(super) fn likely(&self, s: S, node: &Node, mask: u32, leave: S::F8) -> (Cells<S>, u32) {
        let cells = self.cells(s, node);
        let width = self.ray.a + self.ray.b * leave;
        let likely =
            stand_in::may_stand(stand_in::area(cells.faces, self.ray.dir), width, s.splat8(stand_in::MARGIN)) & mask;
        (cells, likely)
    }

    /// Returns the cells of a node's children.
    #[inline(always)]
    pub(super) fn cells(&self, s: S, node: &Node) -> Cells<S> {
        let planes = stored_planes(s, node, self.near);
        let faces = stand_in::faces(planes[0], planes[1], s.splat8(0.0));
        Cells { planes, faces: stand_in::counted(faces, area_shares(s, node)) }
    }

    /// Returns those of the cells in `likely` that may stand in, and where the ray enters and leaves all cells of the
    /// node.
    #[inline(always)]
    pub(super) fn small(&self, cells: &Cells<S>, likely: u32) -> (u32, [S::F8; 2]) {
        let crossing = self.cross(cells.planes[0], cells.planes[1]);
        let met = stand_in::meet(crossing, cells.faces, &self.ray);
        (met.small & likely, [met.enter, crossing[1]])
    }
}

/// Returns those of the children in `mask` that are still to be visited. Cells that stand in are offered to `best`
/// instead. `leave` is where the ray leaves the boxes, or farther.
#[inline(always)]
fn stand_ins<S: Simd>(
    s: S,
    tree: Seen,
    here: Here,
    (mask, leave): (u32, S::F8),
    cells: &CellLanes<S>,
    best: &mut TriHit,
    first_cell: &mut f32,
) -> u32 {
    let (these, likely) = cells.likely(s, here.node(), mask, leave);
    if likely == 0 {
        return mask;
    }
    let (small, way) = cells.small(&these, likely);
    if small == 0 {
        return mask;
    }
    let [enter, leave] = cells.within(s, here.node(), way);
    let met = MetCells { small, crosses: enter.le(leave).bits(), t: &enter.to_array() };
    mask & !offers(tree, here, met, &cells.one, best, first_cell)
}

/// Cells of a node that are small enough to stand in for a ray.
pub(super) struct MetCells<'a> {
    pub small: u32,
    /// Cells that the ray enters inside their oriented slabs, and the distances at which it does.
    pub crosses: u32,
    pub t: &'a [f32; 8],
}

/// Offers cells of a node to `best`. Returns the cells that need no further visit. Lowers `first_cell` to the distances
/// at which the ray enters stand-ins.
#[inline(always)]
pub(super) fn offers(
    tree: Seen,
    here: Here,
    met: MetCells,
    ray: &EntryRay,
    best: &mut TriHit,
    first_cell: &mut f32,
) -> u32 {
    let (Seen { view, filter }, Here { block, id, index }) = (tree, here);
    let MetCells { mut small, crosses, t } = met;
    let mut settled = 0;
    while small != 0 {
        let slot = small.trailing_zeros() as usize & 7;
        small &= small - 1;
        match stand_in::judge(view, here, slot, filter) {
            Verdict::Descend => continue,
            Verdict::Stand if filter.is_some_and(|filter| filter.descends(t[slot])) => continue,
            Verdict::Skip => {}
            Verdict::Stand if crosses >> slot & 1 == 0 => {}
            Verdict::Stand => {
                *first_cell = first_cell.min(t[slot]);
                if !ray.is_transmitted(block, index, slot, t[slot]) {
                    let tri = stand_in::lod_code(index, slot);
                    let _ = offer(best, TriHit { t: t[slot], u: 0.0, v: 0.0, block: id, tri });
                }
            }
        }
        settled |= 1 << slot;
    }
    settled
}

/// Keeps a stand-in if it is better than `best`; returns true if it is.
#[inline(always)]
pub(super) fn offer(best: &mut TriHit, hit: TriHit) -> bool {
    let is_better = hit.t < best.t || hit.t == best.t && (!best.is_hit() || hit.untie(best) == Some(true));
    if is_better {
        *best = hit;
    }
    is_better
}

/// Offers the cells of those children in `mask` that are leaves to `best`: their block is missing. Returns the other
/// children.
#[inline(always)]
pub(super) fn for_missing_leaves<S: Simd, const ANY: bool>(
    s: S,
    tree: Seen,
    here: Here,
    mask: u32,
    cells: &CellLanes<S>,
    (best, first_cell): (&mut TriHit, &mut f32),
) -> u32 {
    let leaves = stand_in::leaves(here.node());
    let mut missing = mask & leaves;
    while missing != 0 {
        let slot = missing.trailing_zeros() as usize;
        missing &= missing - 1;
        stand_in_for_missing::<S, ANY>(s, tree, here, slot, cells, (best, first_cell));
    }
    mask & !leaves
}

/// Offers the cell in a node's slot, below which a block is missing, to `best`. An any-hit ray that begins inside the
/// cell is not offered the cell: the content is unknown.
#[inline(always)]
fn stand_in_for_missing<S: Simd, const ANY: bool>(
    s: S,
    tree: Seen,
    here: Here,
    slot: usize,
    cells: &CellLanes<S>,
    (best, first_cell): (&mut TriHit, &mut f32),
) {
    let (Seen { view, filter }, Here { id, index: node, .. }) = (tree, here);
    let [near, far] = stored_planes(s, here.node(), cells.near);
    let crossing = cells.cross(near, far);
    let met = stand_in::meet(crossing, near, &cells.ray);
    let is_inside = met.outside >> slot & 1 == 0;
    let skip = stand_in::judge(view, here, slot, filter) == Verdict::Skip;
    if met.meets >> slot & 1 == 0 || skip || ANY && is_inside {
        return;
    }
    let tri = stand_in::missing_code(node, slot, is_inside);
    let [enter, leave] = cells.within(s, here.node(), [met.enter, crossing[1]]);
    if !is_inside && enter.le(leave).bits() >> slot & 1 == 0 {
        return;
    }
    let t = (if is_inside { met.enter } else { enter }).to_array()[slot & 7];
    *first_cell = if is_inside { *first_cell } else { first_cell.min(t) };
    if filter.is_some_and(|filter| filter.is_beyond(t)) {
        return;
    }
    let _ = offer(best, TriHit { t, u: 0.0, v: 0.0, block: id, tri });
}

/// Returns the row of planes that the ray reaches first, and the opposite row.
#[inline(always)]
pub(super) fn planes(node: &Node, near: usize) -> (&[u8; 8], &[u8; 8]) {
    // `near` is an axis, or an axis plus 3.
    let far = if near < 3 { near + 3 } else { near - 3 };
    (&node.planes[near], &node.planes[far])
}

/// Pushes all of the children in `mask` but the nearest, farthest first; returns the nearest.
#[inline(always)]
fn push_far_to_near(
    mut mask: u32,
    t: &[f32; 8],
    node: &Node,
    view: &TreeView,
    block: u32,
    stack: &mut Vec<Entry>,
) -> Option<Entry> {
    if mask == 0 {
        return None;
    }
    let mut nearest = entry(mask.trailing_zeros(), t, node, view, block);
    mask &= mask - 1;
    let bottom = stack.len();
    while mask != 0 {
        let mut next = entry(mask.trailing_zeros(), t, node, view, block);
        mask &= mask - 1;
        if next.t < nearest.t {
            std::mem::swap(&mut next, &mut nearest);
        }
        push_sorted(stack, bottom, next);
    }
    Some(nearest)
}

#[inline(always)]
fn entry(slot: u32, t: &[f32; 8], node: &Node, view: &TreeView, block: u32) -> Entry {
    // The mask keeps a slot below eight; `& 7` removes the bounds check.
    let slot = slot as usize & 7;
    let child = u32::from(node.child[slot]);
    Entry { t: t[slot], block: view.home_of(block, child), child }
}

/// Returns the nearest hit in a leaf: lane, distance and weights. Of equal distances the lowest lane wins, which has
/// the lowest primitive id.
#[inline(always)]
pub(super) fn triangles<S: Simd>(
    s: S,
    block: Block,
    leaf: Leaf,
    lanes: &LeafRay<S>,
    filter: Option<&PartFilter>,
    t_max: f32,
) -> Option<(u32, f32, f32, f32)> {
    nearest(s, block, leaf, sheared_corners(s, &leaf, lanes), lanes.t_min, filter, t_max)
}

/// Like [`triangles`], for triangles with corners that are sheared already.
#[inline(always)]
pub(super) fn nearest<S: Simd>(
    s: S,
    block: Block,
    leaf: Leaf,
    corners: [Sheared<S::F8>; 3],
    t_min: S::F8,
    filter: Option<&PartFilter>,
    t_max: f32,
) -> Option<(u32, f32, f32, f32)> {
    let found = intersect::<8, _>((1 << leaf.triangles) - 1, corners, s.splat8(0.0), t_min, s.splat8(t_max));
    let mut hits = found.hits;
    if hits == 0 {
        return None;
    }
    let t = found.t.to_array();
    if let Some(filter) = filter {
        for i in 0..leaf.triangles {
            let part = || block.part(leaf.part_of(i));
            let is_rejected = hits >> i & 1 == 1
                && filter.rejects(part, || Triangle { vertices: leaf.triangle(i), part: part() }, t[i]);
            hits &= !(u32::from(is_rejected) << i);
        }
    }
    if hits == 0 {
        return None;
    }
    let mut lane = hits.trailing_zeros() as usize;
    hits &= hits - 1;
    while hits != 0 {
        let next = hits.trailing_zeros() as usize;
        hits &= hits - 1;
        if t[next] < t[lane] {
            lane = next;
        }
    }
    Some((lane as u32, t[lane], found.u.to_array()[lane], found.v.to_array()[lane]))
}
