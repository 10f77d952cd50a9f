//! Streams: many single rays, with walks that proceed side by side in phases, as in `bvh::trace::stream`. A phase is
//! one loop over all walks at nodes, or at leaves, with few branches that could be mispredicted.

use super::Both;
use super::leaf::{LeafRay, nearest};
use crate::math::STREAM;
use crate::simd::{Lanes, Mask, Op, Simd, dispatch, prefetch};
use crate::structure::bvh::trace::Stack;
use crate::structure::filter::PartFilter;
use crate::structure::hit::{Counters, TriHit};
use crate::structure::place::Rooted;
use crate::structure::rays16::{OneRay, Prepared};
use crate::structure::resident::layout::{LEAF, NOTHING, Node, Resident, UNIT};
use crate::structure::stream::{GROUP, Rays16, Stream};

/// Number of walks side by side.
const LANES: usize = 64;
/// Number of entries of a stack. A walk that needs more is traced as a single ray.
const DEPTH: usize = 112;
/// Number of entries of a stack when a walk begins. The last of them is the end of the walk; the stacks belong to
/// `bvh::trace`, which keeps entries of its own below it.
const BOTTOM: usize = 9;
/// Number of walks at leaves from which on a leaf phase runs.
const LEAVES: usize = LANES * 3 / 8;

pub(super) fn run<const ANY: bool>(tree: Both, filter: Option<&PartFilter>, stream: &mut Stream, hits: &mut [TriHit]) {
    stream.unfinished.clear();
    stream.first_cell.fill(f32::INFINITY);
    dispatch(tree.blocks.isa(), Run::<ANY> { tree, filter, stream, hits });
}

struct Run<'a, const ANY: bool> {
    tree: Both<'a>,
    filter: Option<&'a PartFilter<'a>>,
    stream: &'a mut Stream,
    hits: &'a mut [TriHit],
}

/// A row of lanes.
type Row = [u8; LANES];

/// The state of all lanes.
struct Lot<'a> {
    tree: Both<'a>,
    filter: Option<&'a PartFilter<'a>>,
    stacks: &'a mut [Stack; LANES],
    hits: &'a mut [TriHit],
    unfinished: &'a mut Vec<u32>,
    rays: [OneRay; LANES],
    /// Number of the ray.
    ray: [u16; LANES],
    /// Link that the walk is at.
    link: [u32; LANES],
    /// Number of entries on the stack.
    top: [u8; LANES],
    counters: Counters,
    is_large: bool,
}

/// Rays that have not begun.
struct Beginning<'a> {
    groups: &'a [Rays16],
    next: usize,
    count: usize,
    prepared: Prepared,
    each: [OneRay; GROUP],
    /// Rays of the group that have not begun, and the number of its first ray.
    left: u32,
    first: usize,
}

impl<const ANY: bool> Op for Run<'_, ANY> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { tree, filter, stream, hits } = self;
        let count = hits.len().min(STREAM);
        let hits = &mut hits[..count];
        for (rays, hits) in stream.rays.iter().zip(hits.chunks_mut(GROUP)) {
            hits.iter_mut().zip(&rays.t_max).for_each(|(hit, &t_max)| *hit = TriHit::none(t_max));
        }
        let mut begin = Beginning {
            groups: &stream.rays[..count.div_ceil(GROUP)],
            next: 0,
            count,
            prepared: Prepared::NONE,
            each: [OneRay::NONE; GROUP],
            left: 0,
            first: 0,
        };
        let mut lot = Lot {
            tree,
            filter,
            stacks: &mut stream.bvh.stacks,
            hits,
            unfinished: &mut stream.unfinished,
            rays: [OneRay::NONE; LANES],
            ray: [0; LANES],
            link: [NOTHING; LANES],
            top: [BOTTOM as u8; LANES],
            counters: stream.counters,
            is_large: tree.form.is_large(),
        };
        let (mut nodes, mut leaves): (Row, Row) = ([0; LANES], [0; LANES]);
        let (mut at_nodes, mut at_leaves) = (0, 0);
        for lane in 0..LANES {
            if !begin.next::<S>(s, &mut lot, lane) {
                break;
            }
            nodes[at_nodes] = lane as u8;
            at_nodes += 1;
        }
        while at_nodes + at_leaves > 0 {
            while at_nodes > 0 && at_leaves < LEAVES {
                [at_nodes, at_leaves] = lot.node_phase::<S, ANY>(s, &mut nodes, &mut leaves, [at_nodes, at_leaves]);
            }
            [at_nodes, at_leaves] =
                lot.leaf_phase::<S, ANY>(s, &mut begin, &mut nodes, &mut leaves, [at_nodes, at_leaves]);
        }
        stream.counters = lot.counters;
    }
}

impl Beginning<'_> {
    /// Puts the next ray into a lane, at the root. Returns false if there is none.
    #[inline(always)]
    fn next<S: Simd>(&mut self, s: S, lot: &mut Lot, lane: usize) -> bool {
        while self.left == 0 {
            let Some(group) = self.groups.get(self.next) else { return false };
            self.first = self.next * GROUP;
            self.next += 1;
            let valid = group.prepare(s, lot.tree.form.max_coord, &mut self.prepared);
            self.prepared.each(s, &mut self.each);
            self.left = valid & ((1u32 << (self.count - self.first).min(GROUP)) - 1);
        }
        let i = self.left.trailing_zeros() as usize & (GROUP - 1);
        self.left &= self.left - 1;
        (lot.rays[lane], lot.ray[lane]) = (self.each[i], (self.first + i) as u16);
        (lot.link[lane], lot.top[lane]) = (0, BOTTOM as u8);
        (lot.stacks[lane].t[BOTTOM - 1], lot.stacks[lane].child[BOTTOM - 1]) = (f32::NEG_INFINITY, NOTHING);
        true
    }
}

impl Lot<'_> {
    /// Tests the children of the nodes that walks are at, and moves each walk on: to the nearest child that it hits, or
    /// to the top of its stack.
    #[inline(always)]
    fn node_phase<S: Simd, const ANY: bool>(
        &mut self,
        s: S,
        at_nodes: &mut Row,
        at_leaves: &mut Row,
        [count, mut leaves]: [usize; 2],
    ) -> [usize; 2] {
        let form = self.tree.form;
        let mut nodes = 0;
        self.counters.nodes += count as u64;
        for i in 0..count {
            let lane = usize::from(at_nodes[i & (LANES - 1)]) & (LANES - 1);
            let node = &form.nodes[self.link[lane] as usize];
            let (enter, hits) = boxes(s, node, &self.rays[lane]);
            let top = usize::from(self.top[lane]);
            let stack = &mut self.stacks[lane];
            let (Some(t), Some(child)) = (
                stack.t[top.min(DEPTH - 8)..].first_chunk_mut::<8>(),
                stack.child[top.min(DEPTH - 8)..].first_chunk_mut::<8>(),
            ) else {
                unreachable!()
            };
            if ANY {
                s.pack8(enter, hits, &node.child, t, child);
            } else {
                s.order8(enter, hits, &node.child, t, child);
            }
            // Without a hit the walk takes the entry below.
            let next = top + hits.count_ones() as usize - 1;
            let link = stack.child[next.min(DEPTH - 1)];
            (self.link[lane], self.top[lane]) = (link, next as u8);
            ask(form, self.is_large, link);
            // Both rows are written, and one of them grows: this takes no branch.
            at_nodes[nodes & (LANES - 1)] = lane as u8;
            at_leaves[leaves & (LANES - 1)] = lane as u8;
            let is_leaf = (link >> 31) as usize;
            nodes += 1 - is_leaf;
            leaves += is_leaf;
        }
        [nodes, leaves]
    }

    /// Tests the leaves that walks are at, and moves each walk to the top of its stack. A walk that has ended gives its
    /// lane to the next ray.
    #[inline(always)]
    fn leaf_phase<S: Simd, const ANY: bool>(
        &mut self,
        s: S,
        begin: &mut Beginning,
        at_nodes: &mut Row,
        at_leaves: &mut Row,
        [mut nodes, count]: [usize; 2],
    ) -> [usize; 2] {
        let form = self.tree.form;
        let mut leaves = 0;
        for i in 0..count {
            let lane = usize::from(at_leaves[i & (LANES - 1)]) & (LANES - 1);
            let mut has_ended = self.link[lane] == NOTHING;
            if !has_ended {
                has_ended = self.leaf::<S, ANY>(s, lane);
            }
            if has_ended {
                if begin.next(s, self, lane) {
                    at_nodes[nodes & (LANES - 1)] = lane as u8;
                    nodes += 1;
                }
                continue;
            }
            let top = usize::from(self.top[lane]) - 1;
            let link = self.stacks[lane].child[top.min(DEPTH - 1)];
            (self.link[lane], self.top[lane]) = (link, top as u8);
            ask(form, self.is_large, link);
            at_nodes[nodes & (LANES - 1)] = lane as u8;
            at_leaves[leaves & (LANES - 1)] = lane as u8;
            let is_leaf = (link >> 31) as usize;
            nodes += 1 - is_leaf;
            leaves += is_leaf;
        }
        [nodes, leaves]
    }

    /// Tests the leaf that a walk is at. Returns true if the walk has ended.
    #[inline(always)]
    fn leaf<S: Simd, const ANY: bool>(&mut self, s: S, lane: usize) -> bool {
        let form = self.tree.form;
        let number = usize::from(self.ray[lane]);
        if usize::from(self.top[lane]) > DEPTH - 16 {
            // The next node might need more room than there is.
            self.unfinished.push(number as u32);
            return true;
        }
        let leaf = form.leaf(self.link[lane]);
        self.counters.leaves += 1;
        self.counters.triangles += leaf.triangles as u64;
        let t_max = self.rays[lane].best();
        let ray = leaf_ray(s, &self.rays[lane]);
        let Some((i, t, u, v)) = nearest(s, form, &leaf, &ray, self.filter, t_max) else { return false };
        let hit = leaf.hit(i, t, u, v);
        let Some(best) = self.hits.get_mut(number) else { return true };
        match self.tree.is_better(&hit, best) {
            Some(true) => *best = hit,
            Some(false) => return false,
            None => {
                self.unfinished.push(number as u32);
                return true;
            }
        }
        if ANY {
            return true;
        }
        self.rays[lane].set_best(t);
        self.top[lane] = cull(s, &mut self.stacks[lane], self.top[lane], t);
        false
    }
}

/// Removes the entries of a stack that are beyond `best`. Returns the new top.
#[inline(always)]
fn cull<S: Simd>(s: S, stack: &mut Stack, top: u8, best: f32) -> u8 {
    let (mut from, mut to, top) = (BOTTOM, BOTTOM, usize::from(top));
    let best = s.splat8(best);
    while from < top {
        let (Some(&t), Some(&child)) =
            (stack.t[from.min(DEPTH - 8)..].first_chunk::<8>(), stack.child[from.min(DEPTH - 8)..].first_chunk::<8>())
        else {
            unreachable!()
        };
        let t = s.load8(&t);
        // Not `<`: an equal distance may be a tie that a lower primitive id wins.
        let keep = t.le(best).bits() & (0xff >> (8 - (top - from).min(8)));
        let (Some(t_out), Some(out)) = (
            stack.t[to.min(DEPTH - 8)..].first_chunk_mut::<8>(),
            stack.child[to.min(DEPTH - 8)..].first_chunk_mut::<8>(),
        ) else {
            unreachable!()
        };
        s.pack8(t, keep, &child, t_out, out);
        from += 8;
        to += keep.count_ones() as usize;
    }
    to as u8
}

/// Prefetches a node or leaf of a large form.
#[inline(always)]
fn ask(form: &Resident, is_large: bool, link: u32) {
    if !is_large {
        return;
    }
    if link & LEAF == 0 {
        if let Some(node) = form.nodes.get(link as usize) {
            prefetch(&node.planes[0]);
            prefetch(&node.planes[2]);
            prefetch(&node.planes[4]);
            prefetch(&node.child);
        }
    } else if let Some(words) = form.leaves.get(((link & !LEAF) >> 3) as usize * UNIT..) {
        for line in 0..3 {
            if let Some(word) = words.get(16 * line) {
                prefetch(word);
            }
        }
    }
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

/// Returns the distances at which the ray enters the boxes of a node's children, and the children that it hits before
/// its best hit.
#[inline(always)]
fn boxes<S: Simd>(s: S, node: &Node, ray: &OneRay) -> (S::F8, u32) {
    let mut enter = s.splat8(ray.t_min());
    let mut leave = s.splat8(ray.best());
    let (inv, off, planes) = (ray.inv(), ray.off(), ray.planes());
    for axis in 0..3 {
        let inv = s.splat8(inv[axis]);
        let near = s.load8(&node.planes[usize::from(planes[axis]).min(5)]);
        let far = s.load8(&node.planes[usize::from(planes[axis + 4]).min(5)]);
        enter = near.mul_add(inv, s.splat8(off[axis])).max(enter);
        leave = far.mul_add(inv, s.splat8(off[axis + 4])).min(leave);
    }
    (enter, enter.le(leave).bits() & node.valid)
}
