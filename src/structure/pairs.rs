//! Walks through pairs of trees: the pairs of triangles whose boxes are within a distance of each other. Clash and
//! clearance queries use them. They open places, so trees may be of any structure.
//!
//! Both trees are placed in a common frame by an affine map in double precision. Corners are placed once, and every
//! box holds the placed corners below it: boxes are rounded outward, by the rounding of the map included.
//!
//! A walk descends by places of the first tree: all places of the second tree that one of them is compared with follow
//! one another. So each place of the first tree is opened once, and those of the second tree are opened again and again
//! while they are in the cache. Pairs of places whose parts are not compared are left out.

use super::opened::Cache;
pub use super::opened::{Opened, PairFrame, PairSide};
use super::place::{Place, Rooted};
use super::rows::COLUMNS;
pub use super::rows::PartsBelow;
use super::tree::Tree;
use crate::base::ids::BlockId;
use crate::geom::{Sifted, sift};
use crate::math::bits;
use crate::simd::{Op, Simd, dispatch};
use std::ops::AddAssign;

/// Two places, one of each tree, whose boxes are near each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Entry {
    a: Place,
    b: Place,
    /// True if the place of each tree is a leaf.
    is_leaf: [bool; 2],
}

/// Numbers of steps of walks.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct PairCounters {
    /// Pairs of places.
    pub places: u64,
    /// Pairs of triangles whose boxes are near each other, in leaves that have parts that are compared.
    pub triangles: u64,
}

impl AddAssign for PairCounters {
    fn add_assign(&mut self, other: Self) {
        self.places += other.places;
        self.triangles += other.triangles;
    }
}

/// Working memory of walks through one pair of trees, of one thread. It must be [cleared](PairWalk::clear) when the
/// trees, their frames or their snapshots change.
#[derive(Default)]
pub struct PairWalk {
    a: Opened,
    /// Nodes and leaves: neither displaces the other.
    b: [Cache; 2],
    stack: Vec<Entry>,
    /// The rest of the entries of one place of the first tree.
    group: Vec<Entry>,
    /// The pairs below, by child of the place of the first tree.
    below: [Vec<Entry>; COLUMNS],
    /// Steps so far.
    pub counters: PairCounters,
}

impl PairWalk {
    /// Forgets the opened places.
    pub fn clear(&mut self) {
        self.a.clear();
        self.b.iter_mut().for_each(Cache::clear);
    }
}

/// The rest of a walk. It can stop at missing blocks and continue later.
#[derive(Debug, Default, Clone)]
pub struct PairDescent {
    left: Vec<Entry>,
    /// True if both trees are one tree in one place: each pair of its places occurs once, in one order.
    is_self: bool,
}

/// A triangle of a leaf, and up to eight triangles of another leaf whose boxes are near it.
#[derive(Clone, Copy)]
pub struct Near<'a> {
    /// The leaf of the first tree, and the index of the triangle.
    pub a: (&'a Opened, usize),
    /// The leaf of the second tree.
    pub b: &'a Opened,
    /// Its triangles (bit `i`: triangle `i`).
    pub mask: u32,
}

/// Chooses and takes pairs of triangles, see [`PairDescent::go_on`].
pub trait PairVisit {
    /// True if [`PairVisit::may_want`] leaves out anything. It needs the parts below places.
    fn selects(&self) -> bool {
        false
    }
    /// True if triangles below two places, one of each tree, may be compared.
    fn may_want(&mut self, _a: &PartsBelow, _b: &PartsBelow) -> bool {
        true
    }
    /// Returns the triangles of the mask that are compared with the first one.
    fn wanted(&mut self, near: &Near) -> u32;
    /// Takes the triangles of the mask, and the relations that rounded arithmetic could decide. Returns false to end
    /// the walk.
    fn take(&mut self, near: &Near, sifted: Sifted) -> bool;
}

impl PairDescent {
    /// A walk through both trees; with `is_self` they are one tree in one place.
    pub fn new(a: &Tree, b: &Tree, is_self: bool) -> Self {
        let root = |(a, b)| Entry { a, b, is_leaf: [false; 2] };
        Self { left: a.root().zip(b.root()).map(root).into_iter().collect(), is_self }
    }

    /// Bytes of memory in addition to the walk itself.
    pub fn bytes(&self) -> u64 {
        (self.left.capacity() * size_of::<Entry>()) as u64
    }

    /// True if nothing is left.
    pub fn is_done(&self) -> bool {
        self.left.is_empty()
    }

    /// Returns the blocks of both trees that each remaining pair of places needs.
    pub fn needs(&self) -> impl Iterator<Item = [BlockId; 2]> {
        self.left.iter().map(|entry| [BlockId(entry.a.block), BlockId(entry.b.block)])
    }

    /// Divides the rest into at most `count` walks.
    pub fn split(self, count: usize) -> Vec<Self> {
        let each = self.left.len().div_ceil(count.max(1)).max(1);
        self.left.chunks(each).map(|left| Self { left: left.to_vec(), is_self: self.is_self }).collect()
    }

    /// Replaces pairs of places by those below them until there are at least `count`, as far as blocks are in memory.
    /// Pairs of leaves stay.
    pub fn widen(&mut self, sides: [&PairSide; 2], count: usize, walk: &mut PairWalk, visit: &mut dyn PairVisit) {
        let mut is_wider = true;
        while is_wider && self.left.len() < count {
            is_wider = false;
            for entry in std::mem::take(&mut self.left) {
                let before = self.left.len();
                let is_open = entry.is_leaf != [true; 2] && walk.a.open(sides[0], entry.a, visit.selects()).is_ok();
                if !is_open || walk.step(sides[1], &entry, self.is_self, visit).is_err() {
                    self.left.push(entry);
                    continue;
                }
                self.left.append(&mut walk.group);
                walk.below.iter_mut().for_each(|below| self.left.append(below));
                is_wider |= self.left.len() > before;
            }
        }
    }

    /// Visits pairs of triangles whose boxes are near each other, as far as blocks are in memory. A pair of triangles
    /// that spatial splits put into several leaves is visited several times. In a walk through one tree, a triangle in
    /// several leaves is also paired with itself.
    pub fn go_on(&mut self, sides: [&PairSide; 2], walk: &mut PairWalk, visit: &mut dyn PairVisit) {
        walk.stack.clear();
        walk.stack.extend(self.left.drain(..).rev());
        while let Some(&Entry { a, .. }) = walk.stack.last() {
            let first = walk.stack.iter().rposition(|entry| entry.a != a).map_or(0, |at| at + 1);
            if walk.a.open(sides[0], a, visit.selects()).is_err() {
                self.left.extend(walk.stack.drain(first..).rev());
                continue;
            }
            walk.group.clear();
            walk.group.extend(walk.stack.drain(first..));
            while let Some(entry) = walk.group.pop() {
                match walk.step(sides[1], &entry, self.is_self, visit) {
                    Ok(true) => {}
                    Ok(false) => {
                        walk.below.iter_mut().for_each(Vec::clear);
                        return self.left.clear();
                    }
                    Err(_) => self.left.push(entry),
                }
            }
            // The last is visited first; reversed, the first child is.
            let PairWalk { stack, below, .. } = walk;
            below.iter_mut().rev().for_each(|below| stack.extend(below.drain(..).rev()));
        }
    }
}

impl PairWalk {
    /// Compares what is in the place of the second tree of an entry with what is in that of the first, which is open.
    /// Puts the pairs of places below it in `below` or, if they are of the same place of the first tree, in `group`; or
    /// visits its pairs of triangles, and returns false if `visit` did. Fails with a block that is not in memory.
    fn step(
        &mut self,
        side: &PairSide,
        entry: &Entry,
        is_self: bool,
        visit: &mut dyn PairVisit,
    ) -> Result<bool, BlockId> {
        let Self { a, b, group, below, counters, .. } = self;
        let b = b[usize::from(entry.is_leaf[1])].open(side, entry.b, visit.selects())?;
        counters.places += 1;
        let is_same = is_self && entry.a == entry.b;
        Ok(dispatch(side.tree.isa(), Meet { a, b, entry, is_same, group, below, counters, visit }))
    }
}

/// Compares all that is in two opened places.
struct Meet<'a> {
    a: &'a mut Opened,
    b: &'a mut Opened,
    entry: &'a Entry,
    /// True if both are one place of one tree.
    is_same: bool,
    group: &'a mut Vec<Entry>,
    below: &'a mut [Vec<Entry>; COLUMNS],
    counters: &'a mut PairCounters,
    visit: &'a mut dyn PairVisit,
}

impl Op for Meet<'_> {
    type Out = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { a, b, entry, is_same, group, below, counters, visit } = self;
        if [a.rows.is_leaf, b.rows.is_leaf] != entry.is_leaf {
            // Only in a deliberately malformed file.
            return true;
        }
        let selects = visit.selects();
        match entry.is_leaf {
            [true, true] => return leaves(s, [a, b], is_same, counters, visit),
            [true, false] => {
                // The group is taken from its end.
                let first = group.len();
                for i in bits(b.boxes.overlaps(s, &a.all)) {
                    let is_leaf = [true, b.rows.is_leaf_below(i)];
                    group.push(Entry { a: entry.a, b: b.rows.places[i], is_leaf });
                }
                group[first..].reverse();
            }
            [false, true] => {
                for i in bits(a.boxes.overlaps(s, &b.all)) {
                    let is_leaf = [a.rows.is_leaf_below(i), true];
                    below[i].push(Entry { a: a.rows.places[i], b: entry.b, is_leaf });
                }
            }
            [false, false] => {
                for i in bits(a.rows.mask) {
                    let met = b.boxes.overlaps(s, &a.boxes.get(i)) & from(if is_same { i } else { 0 });
                    for j in bits(met) {
                        if !selects || visit.may_want(&a.rows.below[i], &b.rows.below[j]) {
                            let is_leaf = [a.rows.is_leaf_below(i), b.rows.is_leaf_below(j)];
                            below[i].push(Entry { a: a.rows.places[i], b: b.rows.places[j], is_leaf });
                        }
                    }
                }
            }
        }
        true
    }
}

/// Visits the pairs of triangles of two leaves; returns false if `visit` did.
#[inline(always)]
fn leaves<S: Simd>(
    s: S,
    [a, b]: [&mut Opened; 2],
    is_same: bool,
    counters: &mut PairCounters,
    visit: &mut dyn PairVisit,
) -> bool {
    if a.triangles.is_empty() || b.triangles.is_empty() {
        return true;
    }
    // What holds for one pair of two parts holds for all.
    let are_alike = a.is_of_one_part() && b.is_of_one_part();
    if are_alike && visit.wanted(&Near { a: (a, 0), b, mask: 1 }) == 0 {
        return true;
    }
    for i in bits(a.boxes.overlaps(s, &b.all)) {
        let met = b.boxes.overlaps(s, &a.boxes.get(i)) & from(if is_same { i + 1 } else { 0 });
        if met == 0 {
            continue;
        }
        counters.triangles += u64::from(met.count_ones());
        let mask = if are_alike { met } else { visit.wanted(&Near { a: (a, i), b, mask: met }) };
        if mask != 0 {
            a.prepare_ones();
            b.prepare_lot();
            let sifted = sift(s, &a.ones[i], &b.lot[0], mask);
            if !visit.take(&Near { a: (a, i), b, mask }, sifted) {
                return false;
            }
        }
    }
    true
}

/// The columns from an index on.
#[inline(always)]
fn from(index: usize) -> u32 {
    u32::MAX << index
}
