//! Walks through pairs of trees: the pairs of triangles whose boxes are within a distance of each other. Clash and
//! clearance queries use them. They open places by the [cursor](super::cursor), so trees may be of any structure.
//!
//! Both trees are placed in a common frame by an affine map in double precision. Corners are placed once, and every
//! box holds the placed corners below it: boxes are rounded outward, by the rounding of the map included.

use super::place::{Place, Rooted};
use super::tree::Tree;
use super::{Below, TriHit};
use crate::base::ids::BlockId;
use crate::geom::{Lot, One, Sifted, sift};
use crate::math::{Bounds, DBounds};
use crate::simd::{Lanes, Mask, Op, Simd, dispatch};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::cell::OnceCell;
use std::ops::AddAssign;

/// Number of boxes that are tested at a time.
const LANES: usize = 8;
/// Number of opened places that are kept for each tree.
const KEPT: usize = 64;

/// A tree, placed in the common frame of a pair.
#[derive(Clone, Copy)]
pub struct PairSide<'a> {
    /// The tree.
    pub tree: Tree<'a>,
    /// The map from the tree's frame to the common frame.
    pub frame: &'a PairFrame,
}

/// A map from a tree's frame to a common frame, and a distance by which boxes grow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairFrame {
    map: DAffine3,
    /// True if the map only moves.
    is_shift: bool,
    grown: f64,
}

impl PairFrame {
    /// A map whose boxes grow by `grown`, which is not negative, on all sides.
    pub fn new(map: DAffine3, grown: f64) -> Self {
        Self { map, is_shift: map.matrix3 == DMat3::IDENTITY, grown }
    }

    /// Places a corner.
    #[inline(always)]
    pub fn corner(&self, v: Vec3) -> DVec3 {
        let v = v.as_dvec3();
        if self.is_shift { v + self.map.translation } else { self.map.matrix3 * v + self.map.translation }
    }

    /// Returns bounds of all placed corners in a box.
    #[inline]
    fn around(&self, b: &Bounds) -> DBounds {
        let local = DBounds { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
        if self.is_shift {
            // Rounding is monotonic.
            return DBounds { min: local.min + self.map.translation, max: local.max + self.map.translation };
        }
        let m = &self.map.matrix3;
        let (middle, half) = ((local.min + local.max) * 0.5, (local.max - local.min) * 0.5);
        let reach = m.abs() * half;
        // Of a few roundings of each term.
        let slack = (m.abs() * (middle.abs() + half) + self.map.translation.abs()) * (8.0 * f64::EPSILON);
        let middle = *m * middle + self.map.translation;
        DBounds { min: middle - reach - slack, max: middle + reach + slack }
    }
}

/// Boxes in single precision, rounded outward. Lanes without a box overlap nothing.
#[derive(Debug, Default, Clone)]
struct Boxes {
    count: usize,
    rows: Vec<[[f32; LANES]; 6]>,
}

impl Boxes {
    fn clear(&mut self) {
        self.count = 0;
        self.rows.clear();
    }

    fn push(&mut self, b: &DBounds, grown: f64) {
        let lane = self.count % LANES;
        if lane == 0 {
            self.rows.push([
                [f32::INFINITY; LANES],
                [f32::INFINITY; LANES],
                [f32::INFINITY; LANES],
                [f32::NEG_INFINITY; LANES],
                [f32::NEG_INFINITY; LANES],
                [f32::NEG_INFINITY; LANES],
            ]);
        }
        let row = self.rows.last_mut().expect("a row was pushed");
        for axis in 0..3 {
            row[axis][lane] = below(b.min[axis] - grown);
            row[axis + 3][lane] = above(b.max[axis] + grown);
        }
        self.count += 1;
    }

    /// The box with this index.
    #[inline(always)]
    fn get(&self, i: usize) -> [f32; 6] {
        self.rows[i / LANES].map(|row| row[i % LANES])
    }

    /// The box around all.
    fn all(&self) -> [f32; 6] {
        let mut all =
            [f32::INFINITY, f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];
        for i in 0..self.count {
            let one = self.get(i);
            for axis in 0..3 {
                all[axis] = all[axis].min(one[axis]);
                all[axis + 3] = all[axis + 3].max(one[axis + 3]);
            }
        }
        all
    }
}

/// The greatest number in single precision that is not above `x`.
fn below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// The least number in single precision that is not below `x`.
fn above(x: f64) -> f32 {
    -below(-x)
}

/// Returns the lanes of a row whose boxes overlap a box. All boxes are closed.
#[inline(always)]
fn overlaps<S: Simd>(s: S, row: &[[f32; LANES]; 6], one: &[f32; 6]) -> u32 {
    let mut mask = s.load8(&row[0]).le(s.splat8(one[3])).and(s.splat8(one[0]).le(s.load8(&row[3])));
    for axis in 1..3 {
        mask = mask.and(s.load8(&row[axis]).le(s.splat8(one[axis + 3])));
        mask = mask.and(s.splat8(one[axis]).le(s.load8(&row[axis + 3])));
    }
    mask.bits()
}

/// The triangles of a leaf, placed.
#[derive(Debug, Default, Clone)]
pub struct PairLeaf {
    /// Where the triangles are in the tree.
    pub hits: Vec<TriHit>,
    /// Their parts, as parts of the tree.
    pub parts: Vec<u32>,
    /// Their corners in the common frame.
    pub triangles: Vec<[DVec3; 3]>,
    boxes: Boxes,
    all: [f32; 6],
    /// The triangles, eight at a time, for the filter.
    lots: OnceCell<Vec<Lot>>,
}

impl PairLeaf {
    /// The lot of the triangles from index `at` on, which is a multiple of eight.
    fn lot(&self, at: usize) -> &Lot {
        let lots = self.lots.get_or_init(|| self.triangles.chunks(LANES).map(Lot::new).collect());
        &lots[at / LANES]
    }
}

/// An opened place: its children, or its triangles.
#[derive(Debug, Default, Clone)]
struct Opened {
    place: Option<Place>,
    children: Vec<(Place, bool)>,
    boxes: Boxes,
    leaf: PairLeaf,
}

/// Opened places of a tree. Each has one slot where it may be.
struct Cache(Vec<Opened>);

impl Default for Cache {
    fn default() -> Self {
        Self(vec![Opened::default(); KEPT])
    }
}

impl Cache {
    /// Opens a place; returns its slot. Fails with its block if that is not in memory.
    fn open(&mut self, side: &PairSide, place: Place) -> Result<usize, BlockId> {
        let mixed = place.block.wrapping_mul(0x9e37_79b9) ^ place.item.wrapping_mul(0x85eb_ca6b);
        let at = (mixed >> 16) as usize % KEPT;
        let slot = &mut self.0[at];
        if slot.place != Some(place) {
            slot.place = None;
            slot.fill(side, place)?;
            slot.place = Some(place);
        }
        Ok(at)
    }
}

impl Opened {
    fn fill(&mut self, side: &PairSide, place: Place) -> Result<(), BlockId> {
        let Self { children, boxes, leaf, .. } = self;
        let (frame, grown) = (side.frame, side.frame.grown);
        children.clear();
        boxes.clear();
        leaf.boxes.clear();
        leaf.hits.clear();
        leaf.parts.clear();
        leaf.triangles.clear();
        leaf.lots.take();
        let mut child = |place, bounds: &Bounds, is_leaf| {
            children.push((place, is_leaf));
            boxes.push(&frame.around(bounds), grown);
        };
        let mut triangle = |hit: &TriHit, triangle: &super::Triangle| {
            let corners = triangle.vertices.map(|v| frame.corner(v));
            let [a, b, c] = corners;
            leaf.boxes.push(&DBounds { min: a.min(b).min(c), max: a.max(b).max(c) }, grown);
            leaf.hits.push(*hit);
            leaf.parts.push(triangle.part);
            leaf.triangles.push(corners);
        };
        side.tree.expand(place, &mut Below { child: &mut child, triangle: &mut triangle })?;
        leaf.all = leaf.boxes.all();
        Ok(())
    }
}

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
    /// Pairs of triangles whose boxes are near each other.
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
    a: Cache,
    b: Cache,
    stack: Vec<Entry>,
    below: Vec<Entry>,
    /// Steps so far.
    pub counters: PairCounters,
}

impl PairWalk {
    /// Forgets the opened places.
    pub fn clear(&mut self) {
        for slot in self.a.0.iter_mut().chain(&mut self.b.0) {
            slot.place = None;
        }
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
    pub a: (&'a PairLeaf, usize),
    /// The leaf of the second tree, and the index that bit 0 of masks means: bit `i` is triangle `index + i`.
    pub b: (&'a PairLeaf, usize),
    /// The triangles.
    pub mask: u32,
}

/// Chooses and takes pairs of triangles, see [`PairDescent::go_on`].
pub trait PairVisit {
    /// Returns the triangles of the mask that are compared with the first one.
    fn wanted(&mut self, near: &Near) -> u32;
    /// Takes the triangles of the mask, and the relations that rounded arithmetic could decide. Returns false to end
    /// the walk.
    fn take(&mut self, near: &Near, sifted: Sifted) -> bool;
}

/// Wants nothing.
struct Nothing;

impl PairVisit for Nothing {
    fn wanted(&mut self, _: &Near) -> u32 {
        0
    }
    fn take(&mut self, _: &Near, _: Sifted) -> bool {
        true
    }
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
    pub fn widen(&mut self, sides: [&PairSide; 2], count: usize, walk: &mut PairWalk) {
        let mut is_wider = true;
        while is_wider && self.left.len() < count {
            is_wider = false;
            for entry in std::mem::take(&mut self.left) {
                let before = self.left.len();
                if entry.is_leaf != [true; 2] && walk.step(sides, &entry, self.is_self, &mut Nothing).is_ok() {
                    self.left.append(&mut walk.below);
                    is_wider |= self.left.len() > before;
                } else {
                    self.left.push(entry);
                }
            }
        }
    }

    /// Visits pairs of triangles whose boxes are near each other, as far as blocks are in memory. A pair of triangles
    /// that spatial splits put into several leaves is visited several times. In a walk through one tree, a triangle in
    /// several leaves is also paired with itself.
    pub fn go_on(&mut self, sides: [&PairSide; 2], walk: &mut PairWalk, visit: &mut dyn PairVisit) {
        walk.stack.clear();
        walk.stack.extend(self.left.drain(..).rev());
        while let Some(entry) = walk.stack.pop() {
            match walk.step(sides, &entry, self.is_self, visit) {
                // The last is visited first; reversed, the first child is.
                Ok(true) => walk.stack.extend(walk.below.drain(..).rev()),
                Ok(false) => return self.left.clear(),
                Err(_) => self.left.push(entry),
            }
        }
    }
}

impl PairWalk {
    /// Opens both places of an entry. Puts the pairs of places below it in `below`, or visits its pairs of triangles;
    /// returns false if `visit` did. Fails with a block that is not in memory.
    fn step(
        &mut self,
        [a, b]: [&PairSide; 2],
        entry: &Entry,
        is_self: bool,
        visit: &mut dyn PairVisit,
    ) -> Result<bool, BlockId> {
        let (at_a, at_b) = (self.a.open(a, entry.a)?, self.b.open(b, entry.b)?);
        let Self { below, counters, .. } = self;
        below.clear();
        counters.places += 1;
        let opened = [&self.a.0[at_a], &self.b.0[at_b]];
        let is_same = is_self && entry.a == entry.b;
        Ok(dispatch(a.tree.isa(), Meet { opened, entry, is_same, below, counters, visit }))
    }
}

/// Compares all that is in two opened places.
struct Meet<'a> {
    opened: [&'a Opened; 2],
    entry: &'a Entry,
    /// True if both are one place of one tree.
    is_same: bool,
    below: &'a mut Vec<Entry>,
    counters: &'a mut PairCounters,
    visit: &'a mut dyn PairVisit,
}

impl Op for Meet<'_> {
    type Out = bool;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> bool {
        let Self { opened: [a, b], entry, is_same, below, counters, visit } = self;
        match entry.is_leaf {
            [true, true] => {
                for i in 0..a.leaf.boxes.count {
                    let (one, from) = (a.leaf.boxes.get(i), if is_same { i + 1 } else { 0 });
                    for (row, at) in b.leaf.boxes.rows.iter().zip((0..).step_by(LANES)) {
                        let met = overlaps(s, row, &one) & beyond(at, from);
                        if met == 0 {
                            continue;
                        }
                        counters.triangles += u64::from(met.count_ones());
                        let near = Near { a: (&a.leaf, i), b: (&b.leaf, at), mask: met };
                        let mask = visit.wanted(&near);
                        if mask != 0 {
                            let sifted = sift(s, &One::new(&a.leaf.triangles[i]), b.leaf.lot(at));
                            if !visit.take(&Near { mask, ..near }, sifted) {
                                return false;
                            }
                        }
                    }
                }
            }
            [true, false] => {
                for (row, at) in b.boxes.rows.iter().zip((0..).step_by(LANES)) {
                    let mut met = overlaps(s, row, &a.leaf.all);
                    while met != 0 {
                        let (place, is_leaf) = b.children[at + met.trailing_zeros() as usize];
                        below.push(Entry { a: entry.a, b: place, is_leaf: [true, is_leaf] });
                        met &= met - 1;
                    }
                }
            }
            [false, true] => {
                for (row, at) in a.boxes.rows.iter().zip((0..).step_by(LANES)) {
                    let mut met = overlaps(s, row, &b.leaf.all);
                    while met != 0 {
                        let (place, is_leaf) = a.children[at + met.trailing_zeros() as usize];
                        below.push(Entry { a: place, b: entry.b, is_leaf: [is_leaf, true] });
                        met &= met - 1;
                    }
                }
            }
            [false, false] => {
                for (i, &(place_a, leaf_a)) in a.children.iter().enumerate() {
                    let (one, from) = (a.boxes.get(i), if is_same { i } else { 0 });
                    for (row, at) in b.boxes.rows.iter().zip((0..).step_by(LANES)) {
                        let mut met = overlaps(s, row, &one) & beyond(at, from);
                        while met != 0 {
                            let (place_b, leaf_b) = b.children[at + met.trailing_zeros() as usize];
                            below.push(Entry { a: place_a, b: place_b, is_leaf: [leaf_a, leaf_b] });
                            met &= met - 1;
                        }
                    }
                }
            }
        }
        true
    }
}

/// The lanes of a row that begins at index `at` whose indices are at least `from`.
#[inline(always)]
fn beyond(at: usize, from: usize) -> u32 {
    u32::MAX.checked_shl(from.saturating_sub(at) as u32).unwrap_or(0)
}
