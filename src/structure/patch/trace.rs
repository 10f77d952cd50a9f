//! Traces single rays: nodes by their boxes, quadtrees of frames, triangles of grids eight at a time.
//!
//! A hit is the least `(t, primitive id, place)` over all triangles that the watertight test accepts: the test is that
//! of other structures, and the tolerance of boxes exceeds rounding, so hits equal those of the same triangles in
//! another structure to the bit. A cell that stands in is the box of a node's child, or a box of a frame's quadtree;
//! stand-ins stop all rays.

use super::codes::{Planes, Slabs, child, children};
use super::layout::{Block, Child, Frame, Grids, Node, ROOT, grid_of, tree_words, tri_of};
use super::leaf::eight;
use super::ray::{FrameRay, Prepared};
use crate::base::ids::BlockId;
use crate::lod::Coded;
use crate::math::{Bounds, bits, octahedral};
use crate::residency::Snapshot;
use crate::simd::{Isa, Lanes, Op, Simd, dispatch};
use crate::structure::fallback::SingleWalks;
use crate::structure::filter::PartFilter;
use crate::structure::hit::{Outcome, StandIn, TriHit, Triangle};
use crate::structure::place::{Place, Rooted};
use crate::structure::tree::Visit;
use crate::structure::walk::{Entry, Walk, push_sorted};
use glam::Vec3;
use std::sync::atomic::Ordering::Relaxed;

/// One tree of a model in one snapshot.
#[derive(Debug, Clone, Copy)]
pub struct TreeView<'a> {
    /// Snapshot with the blocks in memory.
    pub snapshot: &'a Snapshot,
    /// Block of the root; `None` for an empty tree.
    pub first_block: Option<u32>,
    /// Greatest magnitude of a coordinate of the tree.
    pub max_coord: f32,
    /// Difference between the id of a leaf block and that of its block of frames.
    pub leaves_at: u32,
    /// `None`: surfaces have the colours of their parts.
    pub colours_at: Option<u32>,
    /// Difference between the id of the block with normals and that of its leaf block; `None` if the model has none.
    pub normals_at: Option<u32>,
    /// Instruction set to trace with.
    pub isa: Isa,
    /// Options of walks.
    pub visit: Visit<'a>,
}

impl Rooted for TreeView<'_> {
    fn root(&self) -> Option<Place> {
        self.first_block.map(|block| Place { block, item: 0 })
    }
    fn max_coord(&self) -> f32 {
        self.max_coord
    }
    fn isa(&self) -> Isa {
        self.isa
    }
}

impl SingleWalks for TreeView<'_> {
    fn closest(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        dispatch(self.isa, Single::<false> { view: self, filter, walk })
    }
    fn any(&self, filter: Option<&PartFilter>, walk: &mut Walk) -> Outcome {
        dispatch(self.isa, Single::<true> { view: self, filter, walk })
    }
}

/// Walk of a single ray.
struct Single<'a, 'v, const ANY: bool> {
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    walk: &'a mut Walk,
}

impl<const ANY: bool> Op for Single<'_, '_, ANY> {
    type Out = Outcome;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> Outcome {
        let Self { view, filter, walk } = self;
        let ray = Prepared::new(walk.ray, view.max_coord, filter);
        let mut open = [Open { enter: 0.0, level: 0, number: 0, planes: ROOT }; OPEN];
        let (mut last, mut block) = (u32::MAX, Block(&[]));
        while let Some(entry) = walk.stack.pop() {
            // An entry at the distance of the best hit is visited, because a triangle at an equal distance wins if its
            // primitive id is lower.
            if entry.t > walk.best.t || view.visit.shown.is_some_and(|shown| shown.lacks(entry.block)) {
                continue;
            }
            if entry.block != last {
                let Some(words) = view.visited(entry.block) else {
                    walk.stack.push(entry);
                    return Outcome::Pending(BlockId(entry.block));
                };
                walk.counters.blocks += 1;
                (last, block) = (entry.block, Block(words));
            }
            let frame = match Child::from_bits(entry.child) {
                Child::Frame(at) => block.frame(at).map(|frame| (at, frame)),
                Child::None => {
                    view.node::<S, ANY>(s, &ray, (block, 0), entry.block, walk);
                    None
                }
                Child::Node(index) => {
                    view.node::<S, ANY>(s, &ray, (block, index), entry.block, walk);
                    None
                }
                Child::Block(_) => None,
            };
            if let Some(frame) = frame
                && let Err(missing) =
                    view.frame::<S, ANY>(s, &ray, frame, (entry.block, entry.t), (&mut open, &mut *walk))
            {
                walk.stack.push(entry);
                return Outcome::Pending(missing);
            }
            if ANY && walk.best.is_hit() {
                walk.stack.clear();
            }
        }
        Outcome::Done
    }
}

/// Marks the item of a cell of a frame: first word of the frame above bit 11, index in its quadtree below.
const OF_FRAME: u32 = 1 << 28;
/// First bit of the frame's first word.
const FRAME_AT: u32 = 11;

/// A cell of a tree.
#[derive(Debug, Clone, Copy)]
pub(super) enum Cell {
    /// A child of a node: indices of the node and of the child.
    Child(usize, usize),
    /// A box of the quadtree of a frame: first word of the frame, level and number there.
    Frame(usize, u32, usize),
}

impl Cell {
    /// The item of a hit on it.
    #[inline(always)]
    fn item(self) -> u32 {
        match self {
            Self::Child(node, slot) => (node as u32) << 3 | slot as u32,
            Self::Frame(at, level, number) => OF_FRAME | (at as u32) << FRAME_AT | (tree_words(level) + number) as u32,
        }
    }

    /// The cell of an item.
    pub(super) fn of(item: u32) -> Self {
        if item & OF_FRAME == 0 { Self::Child((item >> 3) as usize, (item & 7) as usize) } else { Self::of_box(item) }
    }

    /// The item of a box of a quadtree among such items only.
    pub(super) fn box_item(self) -> u32 {
        self.item() & !OF_FRAME
    }

    /// The box of a quadtree of [`Cell::box_item`].
    pub(super) fn of_box(item: u32) -> Self {
        let index = (item & ((1 << FRAME_AT) - 1)) as usize;
        let level = (0..5).rev().find(|level| tree_words(*level) <= index).unwrap_or(0);
        Self::Frame(((item & (OF_FRAME - 1)) >> FRAME_AT) as usize, level, index - tree_words(level))
    }
}

/// An open box of a quadtree.
#[derive(Clone, Copy)]
struct Open {
    /// Distance at which the ray enters it.
    enter: f32,
    level: u32,
    number: usize,
    planes: Planes,
}

/// Most open boxes: three of each level below the root, and one more.
const OPEN: usize = 3 * super::layout::MOST_LEVEL as usize + 1;

impl<'a> TreeView<'a> {
    /// Reads the words of a block and sets its last-used stamp. Returns `None` if the block is missing.
    pub(super) fn visited(&self, id: u32) -> Option<&'a [u32]> {
        if self.visit.stop.load(Relaxed) {
            return None;
        }
        self.snapshot.visit(BlockId(id), self.visit.stamp)
    }

    pub(super) fn words(&self, id: u32) -> Option<&'a [u32]> {
        self.snapshot.block(BlockId(id))
    }

    #[inline(always)]
    fn node<S: Simd, const ANY: bool>(
        &self,
        s: S,
        ray: &Prepared,
        (block, index): (Block, usize),
        id: u32,
        walk: &mut Walk,
    ) {
        let Some(node) = block.node(index) else { return };
        walk.counters.nodes += 1;
        let (met, enter) = ray.boxes(s, node.rows(), walk.best.t);
        // Without cells there is nothing to judge.
        let has_cells = ray.is_lod || self.visit.accept_missing;
        if !has_cells {
            push_far_first(s, (met, enter), &node, id, walk);
            return;
        }
        let (bottom, enter) = (walk.stack.len(), enter.to_array());
        for slot in bits(met) {
            let (to, below) = match node.child(slot) {
                Child::None => continue,
                Child::Block(to) => (to, 0),
                own => (id, own.to_bits()),
            };
            // A cell that is a hit shortens the ray.
            if enter[slot] > walk.best.t {
                continue;
            }
            if let Some(voxel) = block.voxel(&node, slot) {
                let bounds = node.bounds(slot);
                let planes = planes_of_bounds(&bounds);
                let parts = Parts { words: voxel.0[3], summary: voxel.0[4] };
                let size = bounds.extent();
                let faces = Vec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
                let area = ray.ray.dir.abs().dot(faces);
                let cell = Judged { cell: Cell::Child(index, slot), block: id, parts };
                let is_missing = to != id && self.visit.accept_missing && self.words(to).is_none();
                if cell.settles::<ANY>(ray, ray.cross(&planes), area, is_missing, walk) {
                    continue;
                }
            }
            push_sorted(&mut walk.stack, bottom, Entry { t: enter[slot], block: to, child: below });
        }
    }

    /// Visits the quadtree of a frame that the ray enters at `from`. Fails with a block that it needs.
    #[inline(always)]
    fn frame<S: Simd, const ANY: bool>(
        &self,
        s: S,
        ray: &Prepared,
        (at, frame): (usize, Frame),
        (id, from): (u32, f32),
        (open, walk): (&mut [Open; OPEN], &mut Walk),
    ) -> Result<(), BlockId> {
        let (part, levels) = (frame.part(), frame.levels());
        if ray.filter.is_some_and(|filter| filter.hides(part)) {
            return Ok(());
        }
        let parts = Parts { words: part, summary: u32::MAX };
        let local = FrameRay::new(s, ray, &frame, from);
        let lacks_grids = self.visit.accept_missing && self.words(id + self.leaves_at).is_none();
        // Without cells there is nothing to judge.
        let has_cells = ray.is_lod || lacks_grids;
        let here = InFrame { ray, local: &local, from, parts, at, block: id, lacks_grids, levels };
        let [enter, leave] = local.one(&ROOT);
        open[0] = Open { enter, level: 0, number: 0, planes: ROOT };
        let is_met = enter <= leave.min(here.end(walk)) && leave + from >= ray.ray.t_min;
        if !is_met || has_cells && here.settles::<ANY>(&open[0], leave, walk) {
            return Ok(());
        }
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let Open { enter, level, number, planes } = open[count];
            if enter > here.end(walk) {
                continue;
            }
            if level == levels {
                self.leaf::<S>(s, ray, (&frame, number), id, walk)?;
                if ANY && walk.best.is_hit() {
                    return Ok(());
                }
                continue;
            }
            walk.counters.nodes += 1;
            let Some(word) = frame.tree.get(tree_words(level) + number) else { continue };
            let slabs = Slabs::of(s, *word, &planes);
            let [enter, leave] = local.four(s, &slabs);
            let bottom = count;
            for i in 0..4 {
                let is_met = enter[i] <= leave[i].min(here.end(walk)) && leave[i] + from >= ray.ray.t_min;
                if !is_met {
                    continue;
                }
                let below = Open { enter: enter[i], level: level + 1, number: 4 * number + i, planes: slabs.child(i) };
                if has_cells && here.settles::<ANY>(&below, leave[i], walk) {
                    if ANY && walk.best.is_hit() {
                        return Ok(());
                    }
                    continue;
                }
                // Sorted, the nearest on top.
                let mut place = count;
                while place > bottom && open[place - 1].enter < below.enter {
                    open[place] = open[place - 1];
                    place -= 1;
                }
                open[place] = below;
                count += 1;
            }
        }
        Ok(())
    }

    /// Tests the triangles of a leaf of a quadtree.
    #[inline(always)]
    fn leaf<S: Simd>(
        &self,
        s: S,
        ray: &Prepared,
        (frame, number): (&Frame, usize),
        id: u32,
        walk: &mut Walk,
    ) -> Result<(), BlockId> {
        let block = id + self.leaves_at;
        let grids = Grids(self.visited(block).ok_or(BlockId(block))?);
        // Only a malformed file has no such grid.
        let Some(grid) = grids.grid(frame.grid()).filter(|grid| grid.level == frame.levels() + 1) else {
            return Ok(());
        };
        walk.counters.leaves += 1;
        walk.counters.triangles += 8;
        let found = eight(s, ray, &grid, number, walk.best.t);
        for i in bits(found.hits) {
            let (t, tri) = (found.t[i], tri_of(frame.grid(), number, i as u32));
            let triangle = || Triangle { vertices: grid.triangle(tri).unwrap_or_default(), part: grid.part() };
            if ray.filter.is_some_and(|filter| filter.rejects(|| grid.part(), triangle, t)) {
                continue;
            }
            let hit = TriHit { t, u: found.u[i], v: found.v[i], block, tri };
            if self.is_better(&hit, walk)? {
                walk.best = hit;
            }
        }
        Ok(())
    }

    /// True if `hit` is better than the best hit so far: it is nearer, or equally near with a lower primitive id.
    fn is_better(&self, hit: &TriHit, walk: &mut Walk) -> Result<bool, BlockId> {
        let best = &walk.best;
        if hit.t != best.t || !best.is_hit() {
            return Ok(hit.t < best.t || !best.is_hit());
        }
        if let Some(answer) = hit.untie(best) {
            return Ok(answer);
        }
        walk.counters.ties += 1;
        match (self.prim(hit), self.prim(best)) {
            (Ok(a), Ok(b)) => Ok((a, hit.place()) < (b, best.place())),
            _ if self.visit.ties_by_place => Ok(hit.place() < best.place()),
            (a, b) => Ok((a?, hit.place()) < (b?, best.place())),
        }
    }

    /// Returns the triangle of a hit; `None` if its block has left the snapshot.
    #[inline]
    pub fn triangle(&self, hit: &TriHit) -> Option<Triangle> {
        let grid = Grids(self.words(hit.block)?).grid(grid_of(hit.tri))?;
        Some(Triangle { vertices: grid.triangle(hit.tri)?, part: grid.part() })
    }

    /// Returns the primitive id of a hit, or the block that is needed for it.
    pub fn prim(&self, hit: &TriHit) -> Result<u32, BlockId> {
        self.prim_at(self.prim_place(hit).ok_or(BlockId(hit.block))?)
    }

    /// See [`crate::structure::Tree::prim_place`]. Grids have their ids themselves; places tell their triangles apart.
    pub fn prim_place(&self, hit: &TriHit) -> Option<Place> {
        Some(Place { block: hit.block, item: hit.tri })
    }

    /// Returns the primitive id at a place, or the block of the place if it is not in memory.
    pub fn prim_at(&self, place: Place) -> Result<u32, BlockId> {
        let words = self.visited(place.block).ok_or(BlockId(place.block))?;
        Ok(Grids(words).grid(grid_of(place.item)).map_or(u32::MAX, |grid| grid.head[1]))
    }

    /// See [`crate::structure::Tree::colours`].
    pub fn colours(&self, _: &TriHit) -> Result<Option<[[u8; 4]; 3]>, BlockId> {
        Ok(None)
    }

    /// See [`crate::structure::Tree::normals`].
    pub fn normals(&self, hit: &TriHit) -> Result<Option<[Vec3; 3]>, BlockId> {
        let words = self.words(hit.block).ok_or(BlockId(hit.block))?;
        let Some(grid) = Grids(words).grid(grid_of(hit.tri)) else { return Ok(None) };
        let (Some([a, b, c]), Some(corners)) = (grid.triangle(hit.tri), grid.corners(hit.tri)) else { return Ok(None) };
        let own = (b - a).cross(c - a).normalize_or(Vec3::Z);
        if let Some(computed) = grid.computed {
            let normal = |at: usize| computed.normal(grid.level, at % grid.side, at / grid.side);
            return Ok(Some(corners.map(|at| normal(at).try_normalize().unwrap_or(own))));
        }
        let Some(at) = self.normals_at else { return Ok(None) };
        let id = BlockId(hit.block + at);
        let codes = self.visited(id.0).ok_or(id)?;
        let normal = |corner: usize| {
            let code = *codes.get(grid.head[3] as usize + corner)?;
            Some(if code < 2 { own } else { octahedral::decode(code) })
        };
        let [a, b, c] = corners.map(normal);
        Ok(a.zip(b).zip(c).map(|((a, b), c)| [a, b, c]))
    }

    /// Returns the node and the slot of a cell that is a child of a node.
    pub(super) fn node_of(&self, block: u32, node: usize) -> Option<(Block<'a>, Node<'a>)> {
        let block = Block(self.words(block)?);
        Some((block, block.node(node)?))
    }
}

/// Pushes the children of a node of block `id` that a ray meets, the nearest last.
#[inline(always)]
fn push_far_first<S: Simd>(s: S, (met, enter): (u32, S::F8), node: &Node, id: u32, walk: &mut Walk) {
    let (mut at, mut children) = ([0.0; 8], [0; 8]);
    s.order8(enter, met, node.references(), &mut at, &mut children);
    for i in 0..met.count_ones() as usize & 15 {
        let (block, child) = match Child::from_bits(children[i & 7]) {
            Child::Block(to) => (to, 0),
            _ => (id, children[i & 7]),
        };
        walk.stack.push(Entry { t: at[i & 7], block, child });
    }
}

/// A ray in a frame.
struct InFrame<'a, S: Simd> {
    ray: &'a Prepared<'a>,
    local: &'a FrameRay<S>,
    /// Distance at which it enters.
    from: f32,
    parts: Parts,
    /// First word of the frame, and its block.
    at: usize,
    block: u32,
    lacks_grids: bool,
    levels: u32,
}

impl<S: Simd> InFrame<'_, S> {
    /// The end of the ray in the distances of the frame, and some roundings.
    #[inline(always)]
    fn end(&self, walk: &Walk) -> f32 {
        (walk.best.t - self.from) + walk.best.t.abs() * 4e-7
    }

    /// See [`Judged::settles`].
    #[inline(always)]
    fn settles<const ANY: bool>(&self, cell: &Open, leave: f32, walk: &mut Walk) -> bool {
        let here = Judged { cell: Cell::Frame(self.at, cell.level, cell.number), block: self.block, parts: self.parts };
        let is_missing = self.lacks_grids && cell.level == self.levels;
        // The content of the cell is in the box of the frame too. So no stand-in is nearer than its frame, and a frame
        // beyond the best hit has none that is better, in whatever order frames are visited.
        let across = [cell.enter.max(0.0) + self.from, leave + self.from];
        here.settles::<ANY>(self.ray, across, self.local.area(&cell.planes), is_missing, walk)
    }
}

/// The parts in a cell.
#[derive(Clone, Copy)]
struct Parts {
    /// Word of the part (`lod::Coded::part`).
    words: u32,
    /// The bits of all parts.
    summary: u32,
}

/// A cell that may stand in.
struct Judged {
    cell: Cell,
    block: u32,
    parts: Parts,
}

impl Judged {
    /// Tests the parts: true if the filter allows the cell, or `None` if everything in it is hidden.
    #[inline(always)]
    fn allowed(&self, filter: Option<&PartFilter>) -> Option<bool> {
        let Some(filter) = filter else { return Some(true) };
        match Coded::part(self.parts.words) {
            (part, is_mixed) if filter.hides(part) => {
                (is_mixed && self.parts.summary & filter.visible_bits != 0).then_some(false)
            }
            _ => Some(true),
        }
    }

    /// Accepts the cell as a stand-in if it is no larger than the ray's footprint and the ray begins outside of it, or
    /// in place of data that is missing. `area` is its area as the ray sees it. True if nothing below remains to
    /// be visited.
    #[inline(always)]
    fn settles<const ANY: bool>(
        &self,
        ray: &Prepared,
        [enter, leave]: [f32; 2],
        area: f32,
        is_missing: bool,
        walk: &mut Walk,
    ) -> bool {
        let (t_min, filter) = (ray.ray.t_min, ray.filter);
        let t = enter.max(t_min);
        let is_met = t <= leave;
        if !is_met {
            return is_missing;
        }
        if ray.is_lod && enter > t_min && ray.covers(t, area) {
            match self.allowed(filter) {
                Some(false) => {}
                Some(true) if filter.is_some_and(|filter| filter.descends(t)) => {}
                Some(true) => {
                    walk.first_cell = walk.first_cell.min(t);
                    let cell = StandIn { item: self.cell.item(), is_missing: false, is_inside: false };
                    self.offer(t, cell, &mut walk.best);
                    return true;
                }
                None => return true,
            }
        }
        if !is_missing {
            return false;
        }
        let is_inside = enter <= t_min;
        let is_beyond = filter.is_some_and(|filter| filter.is_beyond(t));
        // For any-hit queries a cell that the ray begins in is no hit, because nothing is known of its content.
        if self.allowed(filter).is_some() && !(ANY && is_inside) && !is_beyond {
            if !is_inside {
                walk.first_cell = walk.first_cell.min(t);
            }
            self.offer(t, StandIn { item: self.cell.item(), is_missing: true, is_inside }, &mut walk.best);
        }
        true
    }

    /// Stores a stand-in if it is better than the best hit so far.
    #[inline(always)]
    fn offer(&self, t: f32, cell: StandIn, best: &mut TriHit) {
        TriHit { t, u: 0.0, v: 0.0, block: self.block, tri: cell.code() }.offer_to(best);
    }
}

/// The box of a cell of a frame's quadtree, by level and number.
pub(super) fn planes_of(frame: &Frame, level: u32, number: usize) -> Planes {
    let mut planes = ROOT;
    for at in 0..level {
        let above = number >> (2 * (level - at));
        let which = number >> (2 * (level - at - 1)) & 3;
        if let Some(word) = frame.tree.get(tree_words(at) + above) {
            planes = child(&children(*word, &planes), which);
        }
    }
    planes
}

/// The planes of a box.
fn planes_of_bounds(b: &Bounds) -> Planes {
    [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z]
}

#[cfg(test)]
#[path = "trace_tests.rs"]
mod tests;
