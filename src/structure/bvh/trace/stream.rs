//! Streams: many single rays, with walks that proceed side by side in phases. Each phase is one loop over all walks
//! that are at the same kind of step. A phase has few branches that could be mispredicted, and while one walk waits for
//! memory or for a result, the next ones are already in progress. Rays begin sixteen at a time (`stream_start.rs`).
//!
//! Hits are those of single walks (`single.rs`): the order of visits does not change them.

use super::ahead;
use super::hit::{Counters, TriHit};
use super::slab_heuristic::SlabHeuristic;
use super::stream_start::{self as start, Group};
use super::stream_step as step;
use super::{PartFilter, TreeView};
use crate::math::STREAM;
use crate::simd::{Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, KIND_SHIFT};
use crate::structure::rays16::OneRay;
use crate::structure::stream::{GROUP, Rays16, Stream, boxed};

/// Number of walks side by side.
pub(super) const LANES: usize = 64;
/// Number of entries at the bottom of a stack that are never removed, so that eight entries can always be read from the
/// top.
pub(super) const BOTTOM: usize = 8;
/// Number of entries of a stack. Its three arrays take an odd number of cache lines, so that stacks do not compete for
/// the same sets of the cache.
pub(super) const DEPTH: usize = 112;
/// Number of walks waiting at leaves from which on a leaf phase runs.
const LEAVES: usize = LANES * 3 / 8;

/// Entries that a walk still has to visit. A walk that needs more room is restarted as a single ray.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(in crate::structure) struct Stack {
    pub t: [f32; DEPTH],
    pub child: [u32; DEPTH],
    pub block: [u32; DEPTH],
}

/// A child reference of no kind: the bottom of a stack.
pub(super) const NOTHING: u32 = 3 << KIND_SHIFT;

/// State of this structure's walks of a stream, besides the rays. Reusable.
#[derive(Debug)]
pub(in crate::structure) struct StreamLanes {
    group: Box<Group>,
    pub(in crate::structure) stacks: Box<[Stack; LANES]>,
    /// State of the heuristic at the start of each call.
    slab_heuristic: SlabHeuristic,
}

impl StreamLanes {
    /// Creates the state for any number of rays.
    pub fn new() -> Self {
        let mut stack = Stack { t: [0.0; DEPTH], child: [NOTHING; DEPTH], block: [0; DEPTH] };
        stack.t[..BOTTOM].fill(f32::NEG_INFINITY);
        Self { group: Box::new(Group::NONE), stacks: boxed(stack), slab_heuristic: SlabHeuristic::OFF }
    }

    /// Creates the state for rays of queries: tests of oriented slabs may save visits.
    pub fn of_queries() -> Self {
        Self { slab_heuristic: SlabHeuristic::ALONE, ..Self::new() }
    }
}

/// True if no cell can stand in for any of the first rays.
fn is_exact(view: &TreeView, stream: &Stream, count: usize) -> bool {
    !view.accept_missing && stream.groups(count).iter().all(Rays16::is_exact)
}

/// Leaves all rays unfinished: a walk that comes to members ends and goes on, which a stream cannot.
fn leave_all(stream: &mut Stream, hits: &mut [TriHit]) {
    let count = hits.len().min(STREAM);
    stream.first_cell.fill(f32::INFINITY);
    stream.unfinished.clear();
    stream.unfinished.extend(0..count as u32);
    (0..count).for_each(|i| hits[i] = TriHit::none(stream.ray(i).t_max));
}

impl TreeView<'_> {
    /// Finds the closest hits of the first of the rays that `stream` holds: those that [`TreeView::closest`] finds, at
    /// a lower cost per ray. `hits` has an element for each ray, at most [`STREAM`]. Rays in [`Stream::unfinished`]
    /// have no result.
    pub fn closest_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        if self.has_members {
            leave_all(stream, hits);
        } else if is_exact(self, stream, hits.len()) {
            dispatch(self.isa, Run::<false, false> { view: self, filter, stream, hits });
        } else {
            dispatch(self.isa, Run::<false, true> { view: self, filter, stream, hits });
        }
    }

    /// Finds out whether each ray hits anything; otherwise like [`TreeView::closest_each`]. It is undefined which hit
    /// is returned.
    pub fn any_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        if self.has_members {
            leave_all(stream, hits);
        } else if is_exact(self, stream, hits.len()) {
            dispatch(self.isa, Run::<true, false> { view: self, filter, stream, hits });
        } else {
            dispatch(self.isa, Run::<true, true> { view: self, filter, stream, hits });
        }
    }
}

/// Kernel of streams. `LOD`: cells may stand in.
struct Run<'a, 'v, const ANY: bool, const LOD: bool> {
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    stream: &'a mut Stream,
    hits: &'a mut [TriHit],
}

/// A row of lanes. Its length is stored elsewhere: in [`Counts`] for rows by kind.
pub(super) type Row = [u8; LANES];

/// Row of walks at nodes.
pub(super) const NODES: usize = 0;
/// Row of walks at leaves.
pub(super) const AT_LEAVES: usize = 1;
/// Row of walks at references to other blocks.
pub(super) const EXTERNALS: usize = 2;
/// Row of free lanes.
pub(super) const ENDED: usize = 3;
/// Lengths of the rows of the four kinds, eight bits of a word each. The word stays in a register, and appending a lane
/// to the row of its kind takes no branch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts(u32);

impl Counts {
    /// Returns the length of the row of `kind`.
    #[inline(always)]
    pub fn of(self, kind: usize) -> usize {
        (self.0 >> (8 * kind) & 0xff) as usize
    }

    /// True if all rows but that of `kind` are empty.
    #[inline(always)]
    pub fn only(self, kind: usize) -> bool {
        self.0 & !(0xff << (8 * kind)) == 0
    }

    /// Empties the row of `kind`; returns its former length.
    #[inline(always)]
    pub fn take(&mut self, kind: usize) -> usize {
        let count = self.of(kind);
        self.0 &= !(0xff << (8 * kind));
        count
    }

    /// Appends `lane` to the row of `kind`, 0 to 3.
    #[inline(always)]
    pub fn push(&mut self, rows: &mut [Row; 4], kind: usize, lane: usize) {
        rows[kind & 3][self.of(kind) & (LANES - 1)] = lane as u8;
        self.0 += 1 << (8 * kind);
    }

    /// Removes the last lane from a row that is not empty, and returns it.
    #[inline(always)]
    pub fn pop(&mut self, rows: &[Row; 4], kind: usize) -> usize {
        self.0 -= 1 << (8 * kind);
        lane(&rows[kind & 3], self.of(kind))
    }
}

/// Appends a lane to the row of its child reference (the kinds above are those of
/// [`crate::structure::bvh::layout::Child`]).
#[inline(always)]
pub(super) fn push(rows: &mut [Row; 4], counts: &mut Counts, child: u32, lane: usize) {
    counts.push(rows, (child >> KIND_SHIFT & 3) as usize, lane);
}

/// Returns lane `i` of a row.
#[inline(always)]
pub(super) fn lane(row: &Row, i: usize) -> usize {
    usize::from(row[i & (LANES - 1)]) & (LANES - 1)
}

/// Results that one phase leaves for the next, lane by lane. They are not created for each phase: that would cost as
/// much as the phase.
pub(super) struct Scratch {
    /// Distances at which the ray enters and leaves the children, regardless of the best hit, and the children that it
    /// hits.
    pub enter: [[f32; 8]; LANES],
    pub leave: [[f32; 8]; LANES],
    pub hits: [u32; LANES],
    /// Children that may stand in; from bit 8 on, those with oriented slabs that the ray crosses too. `at` holds the
    /// distances at which the ray enters cells. (`leave` then holds those at which it leaves them.)
    pub small: [u32; LANES],
    pub at: [[f32; 8]; LANES],
}

/// The state of all lanes.
pub(super) struct StreamRun<'a> {
    pub view: &'a TreeView<'a>,
    pub filter: Option<&'a PartFilter<'a>>,
    pub stacks: &'a mut [Stack; LANES],
    pub hits: &'a mut [TriHit],
    pub unfinished: &'a mut Vec<u32>,
    pub first_cell: &'a mut [f32; STREAM],
    pub rows: [Row; 4],
    pub scratch: Scratch,
    /// Number of the ray.
    pub ray: [u16; LANES],
    /// Number of entries on the stack.
    pub top: [u8; LANES],
    /// The prepared ray.
    pub prepared: [OneRay; LANES],
    /// Child reference that the walk is at, and the block of that reference.
    pub child: [u32; LANES],
    pub block_id: [u32; LANES],
    pub block: [Block<'a>; LANES],
    /// Number of walks at leaves that have already moved to the leaf blocks.
    pub entered: usize,
    pub slab_heuristic: SlabHeuristic,
    pub counters: Counters,
    /// True if the tree is larger than the caches near a core, so that memory is prefetched.
    pub is_large: bool,
}

impl<const ANY: bool, const LOD: bool> Op for Run<'_, '_, ANY, LOD> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { view, filter, stream, hits } = self;
        let count = hits.len().min(STREAM);
        let hits = &mut hits[..count];
        stream.unfinished.clear();
        stream.first_cell.fill(f32::INFINITY);
        for (rays, hits) in stream.rays.iter().zip(hits.chunks_mut(GROUP)) {
            hits.iter_mut().zip(&rays.t_max).for_each(|(hit, &t_max)| *hit = TriHit::none(t_max));
        }
        let mut run = StreamRun {
            view,
            filter,
            stacks: &mut stream.bvh.stacks,
            hits,
            unfinished: &mut stream.unfinished,
            first_cell: &mut stream.first_cell,
            rows: [[0; LANES]; 4],
            scratch: Scratch {
                enter: [[0.0; 8]; LANES],
                leave: [[0.0; 8]; LANES],
                hits: [0; LANES],
                small: [0; LANES],
                at: [[0.0; 8]; LANES],
            },
            ray: [0; LANES],
            top: [0; LANES],
            prepared: [OneRay::NONE; LANES],
            child: [0; LANES],
            block_id: [0; LANES],
            block: [Block::new(&[]); LANES],
            entered: 0,
            slab_heuristic: stream.bvh.slab_heuristic,
            counters: stream.counters,
            is_large: ahead::is_large(view.snapshot),
        };
        let root = view.visit(view.root_block).map(Block::new);
        let mut counts = Counts::default();
        for lane in 0..LANES {
            push(&mut run.rows, &mut counts, NOTHING, lane);
        }
        let mut beginning =
            Beginning { groups: &stream.rays[..count.div_ceil(GROUP)], next: 0, group: &mut stream.bvh.group, root };
        loop {
            counts = beginning.fill::<S, ANY, LOD>(s, &mut run, counts);
            if counts.of(EXTERNALS) > 0 {
                counts = step::externals(&mut run, counts);
            }
            if counts.of(NODES) > 0 {
                counts = step::nodes::<S, ANY, LOD>(s, &mut run, counts);
            }
            step::enter_leaves(&mut run, counts);
            let waiting = counts.of(AT_LEAVES);
            if waiting >= LEAVES || waiting > 0 && counts.of(NODES) == 0 {
                counts = step::leaves::<S, ANY>(s, &mut run, counts);
            } else if counts.only(ENDED) && beginning.next == beginning.groups.len() {
                break;
            }
        }
        stream.counters = run.counters;
    }
}

/// Groups of rays that have not begun.
struct Beginning<'a, 'b> {
    groups: &'b [Rays16],
    next: usize,
    /// Scratch space for one group after the other.
    group: &'b mut Group,
    root: Option<Block<'a>>,
}

impl<'a> Beginning<'a, '_> {
    /// Gives free lanes to groups that have not begun.
    #[inline(always)]
    fn fill<S: Simd, const ANY: bool, const LOD: bool>(
        &mut self,
        s: S,
        run: &mut StreamRun<'a>,
        mut counts: Counts,
    ) -> Counts {
        while self.next < self.groups.len() && counts.of(ENDED) >= GROUP {
            counts = self.take(s, run, counts);
            let rays = self.group.left;
            // Stand-ins for missing blocks, and hits that need individual tests, are handled ray by ray.
            let is_together = self.root.is_some() && !run.view.accept_missing && !PartFilter::is_by_ray(run.filter);
            if is_together {
                start::start::<S, ANY, LOD>(s, run, self.group);
            }
            counts = self.go::<S, ANY>(s, run, counts, rays, is_together);
        }
        counts
    }

    /// Prepares the next group and gives lanes to its rays.
    #[inline(always)]
    fn take<S: Simd>(&mut self, s: S, run: &mut StreamRun<'a>, mut counts: Counts) -> Counts {
        let (first, group) = (self.next * GROUP, &mut *self.group);
        let valid = self.groups[self.next].prepare(s, run.view.max_coord, &mut group.rays);
        self.next += 1;
        let there = (1u32 << (run.hits.len() - first).min(GROUP)) - 1;
        group.left = if run.view.is_empty() { 0 } else { valid & there };
        let mut each = [OneRay::NONE; GROUP];
        group.rays.each(s, &mut each);
        let mut rays = group.left;
        while rays != 0 {
            let i = rays.trailing_zeros() as usize & (GROUP - 1);
            rays &= rays - 1;
            let lane = counts.pop(&run.rows, ENDED);
            group.lanes[i] = lane as u8;
            (run.ray[lane], run.prepared[lane], run.top[lane]) = ((first + i) as u16, each[i], BOTTOM as u8);
        }
        counts
    }

    /// Starts the lanes of `rays` of the group: at the top of their stacks, or at the root.
    #[inline(always)]
    fn go<S: Simd, const ANY: bool>(
        &mut self,
        s: S,
        run: &mut StreamRun<'a>,
        mut counts: Counts,
        mut rays: u32,
        is_together: bool,
    ) -> Counts {
        let is_sorted = ANY || start::are_near(s, self.group, rays, run.view.max_coord);
        while rays != 0 {
            let i = rays.trailing_zeros() as usize & (GROUP - 1);
            rays &= rays - 1;
            let lane = self.group.lane(i);
            match self.root {
                _ if self.group.left >> i & 1 == 0 => push(&mut run.rows, &mut counts, NOTHING, lane),
                _ if is_together => {
                    if !is_sorted {
                        start::sort(run, lane);
                    }
                    step::pop(s, run, &mut counts, lane);
                }
                Some(root) => {
                    (run.block[lane], run.block_id[lane], run.child[lane]) = (root, run.view.root_block, run.view.root);
                    push(&mut run.rows, &mut counts, run.view.root, lane);
                }
                None => step::leave(run, &mut counts, lane),
            }
        }
        counts
    }
}
