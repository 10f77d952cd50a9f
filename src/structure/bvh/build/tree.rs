//! Wide nodes: the binary splits of the heuristic, taken up to eight at a time.

use super::leaf::LeafShape;
use super::par::Par;
use super::refs::Ref;
use super::sah::{self, Extents};
use super::{TreeInput, cluster::UnitId};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::math::Bounds;
use crate::structure::bvh::layout::{MAX_TRIANGLES, NODE_WORDS, WIDTH};

/// A node not yet in a block.
pub enum Sub {
    /// A leaf: a range of the references.
    Leaf {
        /// First reference.
        first: u32,
        /// References.
        count: u32,
        /// Words in the trace form.
        words: u32,
    },
    /// An inner node.
    Inner(Box<Inner>),
    /// Already in a block further down.
    Placed(UnitId),
}

/// An inner node with its children.
pub struct Inner {
    /// Each child with its box.
    pub children: Vec<(Bounds, Sub)>,
    /// Words of all that hangs below, itself included.
    pub words: u32,
}

impl Sub {
    /// Words that it takes in its block, with all that hangs below.
    pub fn words(&self) -> u32 {
        match self {
            Sub::Leaf { words, .. } => *words,
            Sub::Inner(inner) => inner.words,
            Sub::Placed(_) => 2,
        }
    }
}

impl Inner {
    /// Brings `words` up to date after a change below.
    pub fn measure(&mut self) {
        self.words = NODE_WORDS as u32 + self.children.iter().map(|(_, c)| c.words()).sum::<u32>();
    }
}

/// Counts of a tree.
#[derive(Debug, Clone, Copy, Default)]
pub struct Stats {
    /// Nodes on the longest way down.
    pub depth: u32,
    /// Inner nodes.
    pub nodes: u64,
    /// Leaves.
    pub leaves: u64,
}

/// What [`build`] returns.
pub struct Built {
    /// An inner node, always.
    pub root: Box<Inner>,
    /// Of everything.
    pub bounds: Bounds,
    /// Counts.
    pub stats: Stats,
}

/// Below this depth the heuristic gives way to halving, which bounds the depth.
const DEEP: u32 = 32;
/// Ranges larger than this are given to other threads.
const TASK: usize = 4096;

/// Relative costs: entering a leaf, and each of its triangles.
const LEAF_COST: f32 = 0.6;
const TRIANGLE_COST: f32 = 0.12;

struct Builder<'a> {
    input: TreeInput<'a>,
    par: &'a Par,
    cancel: &'a Cancel,
}

/// A range on its way to becoming a child.
struct Range<'r> {
    refs: &'r mut [Ref],
    first: usize,
    extents: Extents,
    /// The heuristic says that it should stay whole, and it may.
    whole: bool,
}

/// Builds the tree over `refs`, which are reordered: leaves are ranges of them.
pub fn build(input: TreeInput, refs: &mut [Ref], par: &Par, cancel: &Cancel) -> Result<Built> {
    let builder = Builder { input, par, cancel };
    let extents = Extents::of(refs, par);
    let bounds = extents.bounds();
    let whole = Range { refs, first: 0, extents, whole: false };
    let (root, stats) = builder.inner(whole, 1)?;
    Ok(Built { root, bounds, stats })
}

impl Builder<'_> {
    fn inner(&self, range: Range, depth: u32) -> Result<(Box<Inner>, Stats)> {
        self.cancel.check()?;
        let count = range.refs.len();
        let ranges = self.split_up(range, depth);
        let finish = |r: Range| self.child(r, depth + 1);
        let done: Vec<_> = if count > TASK && self.par.threads > 1 {
            self.par.map_items(ranges, finish)
        } else {
            ranges.into_iter().map(finish).collect()
        };
        let mut inner = Box::new(Inner { children: Vec::with_capacity(done.len()), words: 0 });
        let mut stats = Stats { depth: 0, nodes: 1, leaves: 0 };
        for child in done {
            let (bounds, sub, below) = child?;
            inner.children.push((bounds, sub));
            stats.depth = stats.depth.max(below.depth);
            stats.nodes += below.nodes;
            stats.leaves += below.leaves;
        }
        stats.depth += 1;
        inner.measure();
        Ok((inner, stats))
    }

    fn child(&self, range: Range, depth: u32) -> Result<(Bounds, Sub, Stats)> {
        let bounds = range.extents.bounds();
        if range.refs.len() <= MAX_TRIANGLES {
            let shape = LeafShape::of(range.refs, self.input);
            if shape.fits() {
                let (first, count) = (range.first as u32, range.refs.len() as u32);
                let sub = Sub::Leaf { first, count, words: shape.words() as u32 };
                return Ok((bounds, sub, Stats { depth: 1, nodes: 0, leaves: 1 }));
            }
        }
        let (inner, stats) = self.inner(range, depth)?;
        Ok((bounds, Sub::Inner(inner), stats))
    }

    /// Splits a range into up to eight, the one of the largest box first.
    fn split_up<'r>(&self, range: Range<'r>, depth: u32) -> Vec<Range<'r>> {
        let mut ranges = Vec::with_capacity(WIDTH);
        ranges.push(range);
        while ranges.len() < WIDTH {
            let area = |r: &Range| r.extents.bounds().half_area();
            let open = (0..ranges.len()).filter(|&i| !ranges[i].whole && ranges[i].refs.len() > 1);
            // The first of the largest: `max_by` would take the last.
            let Some(at) = open.reduce(|a, b| if area(&ranges[b]) > area(&ranges[a]) { b } else { a }) else {
                break;
            };
            let parent = ranges.swap_remove(at);
            match self.halve(parent, depth) {
                Ok([left, right]) => ranges.extend([left, right]),
                Err(whole) => ranges.push(whole),
            }
        }
        ranges.sort_by_key(|r| r.first);
        ranges
    }

    /// Splits a range in two, or returns it as a leaf.
    fn halve<'r>(&self, range: Range<'r>, depth: u32) -> std::result::Result<[Range<'r>; 2], Range<'r>> {
        let Range { refs, first, extents, .. } = range;
        let split = if depth < DEEP { sah::find(refs, &extents, self.par) } else { None };
        if refs.len() <= MAX_TRIANGLES && LeafShape::of(refs, self.input).fits() {
            let area = extents.bounds().half_area();
            let stay = area * (LEAF_COST + TRIANGLE_COST * refs.len() as f32);
            let pays = |s: &sah::Split| {
                let sides = s.side_areas * LEAF_COST + TRIANGLE_COST * s.cost;
                sides < stay
            };
            if !split.as_ref().is_some_and(pays) {
                return Err(Range { refs, first, extents, whole: true });
            }
        }
        let middle = match &split {
            Some(split) => sah::partition(refs, split),
            None => sah::partition_median(refs, &extents),
        };
        let (left, right) = refs.split_at_mut(middle);
        let (a, b) = (Extents::of(left, self.par), Extents::of(right, self.par));
        Ok([
            Range { refs: left, first, extents: a, whole: false },
            Range { refs: right, first: first + middle, extents: b, whole: false },
        ])
    }
}
