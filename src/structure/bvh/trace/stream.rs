//! Many single rays at once: walks go on side by side in phases, each one loop over all that are at the same
//! kind of step. A phase has few branches that could be guessed wrong, and while one walk waits for memory or for a
//! result, the next ones are already under way. Rays begin sixteen at a time (`stream_start.rs`).
//!
//! Hits are those of the walks one by one (`single.rs`): order of visits does not change them.

use super::ahead;
use super::hit::{Counters, TriHit};
use super::rays16::{GROUP, OneRay};
use super::slab_heuristic::SlabHeuristic;
use super::stream_start::{self as start, Group};
use super::stream_step as step;
use super::{PartFilter, TreeView};
use crate::math::STREAM;
use crate::simd::{Op, Simd, dispatch};
use crate::structure::bvh::layout::{Block, KIND_SHIFT};
use crate::structure::stream::{Rays16, Stream, boxed};

/// Walks side by side.
pub(super) const LANES: usize = 64;
/// Entries at the bottom of a stack that are never taken off: reading eight from there is always possible.
pub(super) const BOTTOM: usize = 8;
/// Entries of a stack: three arrays of them are an odd number of cache lines, so that stacks do not compete for the
/// same places of the cache.
pub(super) const DEPTH: usize = 112;
/// Walks waiting at leaves that make a phase for them.
const LEAVES: usize = LANES * 3 / 8;

/// What a walk has still to visit. A walk that needs more room goes on alone, from its beginning.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(super) struct Stack {
    pub t: [f32; DEPTH],
    pub child: [u32; DEPTH],
    pub block: [u32; DEPTH],
}

/// A child reference of no kind: the bottom of a stack.
pub(super) const NOTHING: u32 = 3 << KIND_SHIFT;

/// What this structure's walks need beside the rays of a stream. Reusable.
#[derive(Debug)]
pub(in crate::structure) struct StreamLanes {
    group: Box<Group>,
    pub(super) stacks: Box<[Stack; LANES]>,
    /// As each call begins.
    slab_heuristic: SlabHeuristic,
}

impl StreamLanes {
    /// For any number of rays.
    pub fn new() -> Self {
        let mut stack = Stack { t: [0.0; DEPTH], child: [NOTHING; DEPTH], block: [0; DEPTH] };
        stack.t[..BOTTOM].fill(f32::NEG_INFINITY);
        Self { group: Box::new(Group::NONE), stacks: boxed(stack), slab_heuristic: SlabHeuristic::OFF }
    }

    /// For rays of queries: slabs of cells may spare visits.
    pub fn of_queries() -> Self {
        Self { slab_heuristic: SlabHeuristic::ALONE, ..Self::new() }
    }
}

/// Whether no cell can stand in for any of the first rays.
fn is_exact(view: &TreeView, stream: &Stream, count: usize) -> bool {
    !view.accept_missing && stream.rays[..count.div_ceil(GROUP).min(STREAM / GROUP)].iter().all(Rays16::is_exact)
}

impl TreeView<'_> {
    /// Finds the closest hits of the first of the rays that `stream` has taken over: what [`TreeView::closest`] finds,
    /// at less cost a ray. `hits`: as many as rays, [`STREAM`] at most. Those in [`Stream::unfinished`] have no answer.
    pub fn closest_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        if is_exact(self, stream, hits.len()) {
            dispatch(self.isa, Run::<false, false> { view: self, filter, stream, hits });
        } else {
            dispatch(self.isa, Run::<false, true> { view: self, filter, stream, hits });
        }
    }

    /// Finds whether each ray hits anything; otherwise like [`TreeView::closest_each`]. Which hit is not said.
    pub fn any_each(&self, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
        if is_exact(self, stream, hits.len()) {
            dispatch(self.isa, Run::<true, false> { view: self, filter, stream, hits });
        } else {
            dispatch(self.isa, Run::<true, true> { view: self, filter, stream, hits });
        }
    }
}

/// `LOD`: cells may stand in.
struct Run<'a, 'v, const ANY: bool, const LOD: bool> {
    view: &'a TreeView<'v>,
    filter: Option<&'a PartFilter<'a>>,
    stream: &'a mut Stream,
    hits: &'a mut [TriHit],
}

/// Lanes in a row; how many is kept beside, by the kinds below where there are several rows.
pub(super) type Row = [u8; LANES];

/// Walks at nodes.
pub(super) const NODES: usize = 0;
/// Walks at leaves.
pub(super) const AT_LEAVES: usize = 1;
/// Walks at references to other blocks.
pub(super) const EXTERNALS: usize = 2;
/// Free lanes.
pub(super) const ENDED: usize = 3;
/// Lanes in rows by kind, eight bits of a word each for how many they are: the word stays in a register, and putting
/// a lane into the row of its kind takes no branch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts(u32);

impl Counts {
    /// Of a kind.
    #[inline(always)]
    pub fn of(self, kind: usize) -> usize {
        (self.0 >> (8 * kind) & 0xff) as usize
    }

    /// Whether all rows but one are empty.
    #[inline(always)]
    pub fn only(self, kind: usize) -> bool {
        self.0 & !(0xff << (8 * kind)) == 0
    }

    /// Empties a row; returns how many there were.
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

    /// Takes the last lane off a row that has one.
    #[inline(always)]
    pub fn pop(&mut self, rows: &[Row; 4], kind: usize) -> usize {
        self.0 -= 1 << (8 * kind);
        lane(&rows[kind & 3], self.of(kind))
    }
}

/// Puts a lane where its child reference says (the kinds above are those of
/// [`crate::structure::bvh::layout::Child`]).
#[inline(always)]
pub(super) fn push(rows: &mut [Row; 4], counts: &mut Counts, child: u32, lane: usize) {
    counts.push(rows, (child >> KIND_SHIFT & 3) as usize, lane);
}

/// Lane `i` of a row.
#[inline(always)]
pub(super) fn lane(row: &Row, i: usize) -> usize {
    usize::from(row[i & (LANES - 1)]) & (LANES - 1)
}

/// What a phase leaves for the next, lane by lane. Not made anew for each: that would cost as much as a phase.
pub(super) struct Scratch {
    /// Where the children are entered and left, whatever is nearer, and which are met.
    pub enter: [[f32; 8]; LANES],
    pub leave: [[f32; 8]; LANES],
    pub hits: [u32; LANES],
    /// Those that may stand in, from the ninth bit on those of which slabs are met too; and where cells are entered.
    /// (These are left where `leave` says.)
    pub small: [u32; LANES],
    pub at: [[f32; 8]; LANES],
}

/// What the lanes hold.
pub(super) struct StreamRun<'a> {
    pub view: &'a TreeView<'a>,
    pub filter: Option<&'a PartFilter<'a>>,
    pub stacks: &'a mut [Stack; LANES],
    pub hits: &'a mut [TriHit],
    pub unfinished: &'a mut Vec<u32>,
    pub transmitted: &'a mut [f32; STREAM],
    pub rows: [Row; 4],
    pub scratch: Scratch,
    /// The ray.
    pub ray: [u16; LANES],
    /// Entries of the stack.
    pub top: [u8; LANES],
    /// It, prepared.
    pub prepared: [OneRay; LANES],
    /// The reference that it is at, and its block.
    pub child: [u32; LANES],
    pub block_id: [u32; LANES],
    pub block: [Block<'a>; LANES],
    /// Of the walks at leaves, those that are in the leaves' blocks.
    pub entered: usize,
    pub slab_heuristic: SlabHeuristic,
    pub counters: Counters,
    /// The tree is larger than what caches near a core hold: memory is asked for ahead.
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
        stream.transmitted.fill(f32::INFINITY);
        for (rays, hits) in stream.rays.iter().zip(hits.chunks_mut(GROUP)) {
            hits.iter_mut().zip(&rays.t_max).for_each(|(hit, &t_max)| *hit = TriHit::none(t_max));
        }
        let mut run = StreamRun {
            view,
            filter,
            stacks: &mut stream.bvh.stacks,
            hits,
            unfinished: &mut stream.unfinished,
            transmitted: &mut stream.transmitted,
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

/// Rays that have not begun.
struct Beginning<'a, 'b> {
    groups: &'b [Rays16],
    next: usize,
    /// For one after the other.
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
            // Stand-ins for missing blocks, and hits that are tested by themselves, are for each ray alone.
            let is_together = self.root.is_some() && !run.view.accept_missing && !PartFilter::is_by_ray(run.filter);
            if is_together {
                start::start::<S, ANY, LOD>(s, run, self.group);
            }
            counts = self.go::<S, ANY>(s, run, counts, rays, is_together);
        }
        counts
    }

    /// Takes the next group to lanes.
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

    /// Puts the lanes of `rays` of the group where they begin: at what is on their stacks, or at the root.
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
