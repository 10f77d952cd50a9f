//! The walk through pairs of places of two sets, the nearest boxes first: down the trees over placed trees, then down
//! the trees. It ends where blocks are missing, and continues later.
//!
//! Pairs of places have one order, which the geometry alone decides: that of a walk with all blocks in memory and no
//! limit. Of triangles that have a common point the first in this order count, so that the walk can end there.

use super::super::among::Among;
use super::super::frames::Frames;
use crate::geom::triangle_triangle;
use crate::math::{DBounds, bits};
use crate::scene::SceneState;
use crate::scene::frame::Target;
use crate::scene::placed::Placed;
use crate::scene::walk::SceneView;
use crate::structure::nearest::{PointFrame, at_most, greater, lesser, positive, sort_nearest_last, triangle_of};
use crate::structure::{COLUMNS, Lanes, Place, Rooted, Rows, Tree};
use glam::{DAffine3, DVec3};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Where one side of a walk is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum At {
    /// A node of the tree over placed trees.
    Top(Target),
    /// A place of a placed tree, and true if only triangles are below it.
    In(u64, Place, bool),
}

/// A pair of places, and a bound of the squared distance between all that is there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub squared: f64,
    pub at: [At; 2],
    /// Their boxes: in the frame of the pair if both are in placed trees, otherwise in the world.
    bounds: [DBounds; 2],
}

/// A triangle of the nearest two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Side {
    pub placed: u64,
    /// Index of the instance, and of the part in its model.
    pub instance: u64,
    pub part: u32,
    /// The place of its primitive id.
    pub prim_at: Place,
}

/// The nearest two triangles so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nearest {
    pub squared: f64,
    pub error: f64,
    /// World space.
    pub points: [DVec3; 2],
    pub sides: [Side; 2],
}

impl Nearest {
    /// True if this comes before another one: it is nearer, or as near and less in the order of triangles.
    pub fn precedes(&self, other: &Self) -> bool {
        let key = |it: &Self| {
            let mut keys = it.sides.map(|s| (s.instance, s.part, s.placed, s.prim_at));
            keys.sort_unstable();
            keys
        };
        self.squared < other.squared || self.squared == other.squared && key(self) < key(other)
    }
}

/// The children or triangles of a place, in the frame of a pair.
#[derive(Default)]
struct Opened {
    rows: Rows,
    /// Boxes of children or triangles: least and greatest coordinates.
    low: [Lanes; 3],
    high: [Lanes; 3],
    corners: [[Lanes; 3]; 3],
}

impl Opened {
    /// Returns false if the place's block is missing.
    #[inline(always)]
    fn open(&mut self, tree: &Tree, place: Place, frame: &PointFrame) -> bool {
        if tree.rows(place, false, &mut self.rows).is_err() {
            return false;
        }
        if self.rows.is_leaf {
            self.corners = frame.corners(&self.rows);
            let [a, b, c] = &self.corners;
            for axis in 0..3 {
                for lane in 0..COLUMNS {
                    let (x, y, z) = (a[axis][lane], b[axis][lane], c[axis][lane]);
                    self.low[axis][lane] = lesser(lesser(x, y), z);
                    self.high[axis][lane] = greater(greater(x, y), z);
                }
            }
        } else {
            for (axis, [middle, half]) in frame.image(&self.rows.boxes()).iter().enumerate() {
                for lane in 0..COLUMNS {
                    self.low[axis][lane] = middle[lane] - half[lane];
                    self.high[axis][lane] = middle[lane] + half[lane];
                }
            }
        }
        true
    }

    /// Squared distances of all boxes from a box.
    #[inline(always)]
    fn squared_to(&self, b: &DBounds) -> Lanes {
        let mut sum = [0.0; COLUMNS];
        for axis in 0..3 {
            let (low, high) = (b.min[axis], b.max[axis]);
            for (lane, sum) in sum.iter_mut().enumerate() {
                let beyond = positive(greater(self.low[axis][lane] - high, low - self.high[axis][lane]));
                *sum += beyond * beyond;
            }
        }
        sum
    }

    #[inline(always)]
    fn bounds(&self, lane: usize) -> DBounds {
        let at = |rows: &[Lanes; 3]| DVec3::new(rows[0][lane], rows[1][lane], rows[2][lane]);
        DBounds { min: at(&self.low), max: at(&self.high) }
    }
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct Scratch {
    pub stack: Vec<Entry>,
    below: [Opened; 2],
}

/// The placed trees that a walk is in.
struct Pair<'a> {
    placed: [u64; 2],
    trees: [Tree<'a>; 2],
    frames: [PointFrame; 2],
    origin: DVec3,
    /// Distances are exact within this, and those of stored triangles within the other.
    slack: f64,
    rounding: f64,
    is_whole: [bool; 2],
}

/// The rest of a walk, and what it found.
#[derive(Debug, Default)]
pub(super) struct Rest {
    pub left: Vec<Entry>,
    pub best: Option<Nearest>,
    /// True if the last step found a common point.
    meets: bool,
}

impl Rest {
    /// A walk through both sets.
    pub fn new(sets: [&Among; 2]) -> Self {
        let [a, b] = sets.map(|set| (set.root(), *set.around()));
        let root = a.0.zip(b.0).map(|(x, y)| Entry {
            squared: a.1.squared_distance(&b.1),
            at: [At::Top(x), At::Top(y)],
            bounds: [a.1, b.1],
        });
        Self::of(root.into_iter().collect())
    }

    /// A walk through pairs of places, in order.
    pub fn of(left: Vec<Entry>) -> Self {
        Self { left, best: None, meets: false }
    }
}

pub(super) struct Walker<'a> {
    pub view: &'a SceneView<'a>,
    pub sets: [&'a Among<'a>; 2],
    /// Both sets are one: each pair of places occurs once.
    pub is_self: bool,
    /// Squared distance that some walk has found, or the limit, as bits.
    pub bound: &'a AtomicU64,
}

/// The squared distance beyond which there is nothing nearer than `squared`.
#[inline(always)]
fn limit(squared: f64, slack: f64) -> f64 {
    let distance = squared.sqrt() * (1.0 + 1e-12) + slack;
    distance * distance
}

impl<'a> Walker<'a> {
    fn scene(&self) -> &'a SceneState {
        self.view.scene
    }

    /// Goes on with what is left, as far as the blocks in memory allow.
    #[inline(always)]
    pub fn go_on(&self, rest: &mut Rest, scratch: &mut Scratch, is_over: &dyn Fn() -> bool) {
        scratch.stack.clear();
        scratch.stack.extend(rest.left.drain(..).rev());
        let mut pair: Option<Pair> = None;
        while let Some(entry) = scratch.stack.pop() {
            if is_over() {
                break;
            }
            if entry.squared > self.limit_of(&entry, &mut pair) {
                continue;
            }
            let bottom = scratch.stack.len();
            let is_there = match (&pair, entry.at) {
                (Some(pair), [At::In(_, a, a_is_leaf), At::In(_, b, b_is_leaf)]) => {
                    self.open(pair, &entry, [(a, a_is_leaf), (b, b_is_leaf)], rest, scratch)
                }
                _ => {
                    let bottom = scratch.stack.len();
                    self.below_top(&entry, &mut scratch.stack);
                    scratch.stack[bottom..].reverse();
                    continue;
                }
            };
            if !is_there {
                rest.left.push(entry);
                continue;
            }
            if std::mem::take(&mut rest.meets) {
                // What follows in the order does not count, but what is left comes before.
                scratch.stack.clear();
                break;
            }
            // The sort keeps the order of equal ones; the last is visited first.
            scratch.stack[bottom..].reverse();
            sort_nearest_last(&mut scratch.stack[bottom..], |entry| entry.squared);
        }
        let mut left = std::mem::take(&mut rest.left);
        left.retain(|entry| entry.squared <= self.limit_of(entry, &mut pair));
        rest.left = left;
    }

    /// The limit for the boxes of an entry; enters the placed trees of the entry.
    #[inline(always)]
    fn limit_of(&self, entry: &Entry, pair: &mut Option<Pair<'a>>) -> f64 {
        let best = f64::from_bits(self.bound.load(Relaxed));
        match entry.at {
            [At::In(a, ..), At::In(b, ..)] => {
                let placed = [a, b];
                let now = match pair {
                    Some(now) if now.placed == placed => now,
                    other => other.insert(self.enter(placed)),
                };
                limit(best, now.slack)
            }
            _ => {
                let size = entry.bounds.iter().map(|b| b.min.abs().max(b.max.abs()).max_element()).sum::<f64>();
                limit(best, size * 1e-12)
            }
        }
    }

    fn enter(&self, placed: [u64; 2]) -> Pair<'a> {
        let made = placed.map(|index| self.scene().placed(index));
        let of = made.each_ref().map(|p| &**p);
        let origin = Frames::new(of, 0.0).origin;
        let frames = of.map(|p: &Placed| {
            let map = DAffine3 { translation: p.frame().translation - origin, ..p.frame() };
            PointFrame::new(map, DVec3::ZERO, [0.0, 1.0])
        });
        let all = of[0].bounds.union(of[1].bounds);
        let terms = |p: &Placed| (p.frame().translation - origin).abs().max_element() + p.extent();
        let rounded = of.map(terms).iter().sum::<f64>() * (32.0 * f64::EPSILON);
        let slack = rounded + all.extent().length() / (1u64 << 44) as f64;
        let rounding = of.map(|p| p.corner_rounding(0.0) + p.position_error).iter().sum();
        let trees = [0, 1].map(|i| self.sets[i].tree(self.view, placed[i]));
        let is_whole = [0, 1].map(|i| self.sets[i].is_whole(placed[i]));
        Pair { placed, trees, frames, origin, slack, rounding, is_whole }
    }

    /// Opens the greater of two places that are not both in placed trees, or both if they are one. The nearest pair of
    /// places below comes first.
    pub fn below_top(&self, entry: &Entry, out: &mut Vec<Entry>) {
        let bottom = out.len();
        let below = |i: usize| match entry.at[i] {
            At::Top(target) => match target {
                Target::Inner(node) => {
                    let mut children = Vec::new();
                    self.sets[i].children(node, |child, bounds| children.push((At::Top(child), bounds)));
                    children
                }
                Target::Placed(index) => {
                    let root = self.sets[i].enters(index).then(|| self.sets[i].tree(self.view, index).root()).flatten();
                    let bounds = self.scene().placed(index).bounds;
                    root.map(|root| (At::In(index, root, false), bounds)).into_iter().collect()
                }
            },
            at @ At::In(..) => vec![(at, entry.bounds[i])],
        };
        let is_same = self.is_self && entry.at[0] == entry.at[1];
        let is_top = entry.at.map(|at| matches!(at, At::Top(_)));
        let opens_first = is_top[0] && (!is_top[1] || size(&entry.bounds[0]) >= size(&entry.bounds[1]));
        let first = if is_same || opens_first { below(0) } else { vec![(entry.at[0], entry.bounds[0])] };
        let second = if is_same || !opens_first { below(1) } else { vec![(entry.at[1], entry.bounds[1])] };
        for (i, &(a, of_a)) in first.iter().enumerate() {
            for &(b, of_b) in second.iter().skip(if is_same { i } else { 0 }) {
                let squared = of_a.squared_distance(&of_b);
                let mut bounds = [of_a, of_b];
                if let [At::In(x, ..), At::In(y, ..)] = [a, b] {
                    let placed = [x, y].map(|index| self.scene().placed(index));
                    let origin = Frames::new(placed.each_ref().map(|p| &**p), 0.0).origin;
                    bounds = bounds.map(|b| DBounds { min: b.min - origin, max: b.max - origin });
                }
                out.push(Entry { squared, at: [a, b], bounds });
            }
        }
        out[bottom..].sort_by(|a, b| a.squared.total_cmp(&b.squared));
    }

    /// Puts the pairs of places below a pair on the stack, the nearest first. Returns false, with nothing on the stack,
    /// for leaves and if blocks are missing.
    pub fn below(&self, entry: &Entry, scratch: &mut Scratch) -> bool {
        scratch.stack.clear();
        if let [At::In(a, x, x_is_leaf), At::In(b, y, y_is_leaf)] = entry.at {
            let is_there = !(x_is_leaf && y_is_leaf)
                && self.open(
                    &self.enter([a, b]),
                    entry,
                    [(x, x_is_leaf), (y, y_is_leaf)],
                    &mut Rest::default(),
                    scratch,
                );
            scratch.stack.sort_by(|a, b| a.squared.total_cmp(&b.squared));
            is_there
        } else {
            self.below_top(entry, &mut scratch.stack);
            true
        }
    }

    /// Opens the greater of two places, or measures the triangles of both. Returns false if blocks are missing.
    #[inline(always)]
    fn open(
        &self,
        pair: &Pair,
        entry: &Entry,
        places: [(Place, bool); 2],
        rest: &mut Rest,
        scratch: &mut Scratch,
    ) -> bool {
        let [opens_a, opens_b] = opened_sides(self.is_self, entry);
        let Scratch { stack, below: [a, b] } = scratch;
        if opens_a && !a.open(&pair.trees[0], places[0].0, &pair.frames[0]) {
            return false;
        }
        if opens_b && !b.open(&pair.trees[1], places[1].0, &pair.frames[1]) {
            return false;
        }
        match (opens_a, opens_b) {
            (true, true) if places[0].1 && places[1].1 => self.meet(pair, a, b, rest),
            (true, true) => {
                // Both are one place. A root may be a leaf.
                if a.rows.is_leaf {
                    let at = entry.at.map(as_leaf);
                    stack.push(Entry { at, ..*entry });
                    return true;
                }
                for i in bits(a.rows.mask) {
                    let (bounds, at) = (a.bounds(i), child(pair.placed[0], a, i));
                    let squared = b.squared_to(&bounds);
                    for j in bits(b.rows.mask) {
                        let other = child(pair.placed[1], b, j);
                        if is_in_order(&at, &other) {
                            stack.push(Entry { squared: squared[j], at: [at, other], bounds: [bounds, b.bounds(j)] });
                        }
                    }
                }
            }
            (true, false) => Self::descend(entry, 0, pair, a, stack),
            _ => Self::descend(entry, 1, pair, b, stack),
        }
        true
    }

    /// Replaces one side of an entry by what is below it.
    #[inline(always)]
    fn descend(entry: &Entry, side: usize, pair: &Pair, below: &Opened, stack: &mut Vec<Entry>) {
        if below.rows.is_leaf {
            let mut at = entry.at;
            at[side] = as_leaf(at[side]);
            return stack.push(Entry { at, ..*entry });
        }
        let squared = below.squared_to(&entry.bounds[1 - side]);
        for lane in bits(below.rows.mask) {
            let (mut at, mut bounds) = (entry.at, entry.bounds);
            (at[side], bounds[side]) = (child(pair.placed[side], below, lane), below.bounds(lane));
            stack.push(Entry { squared: squared[lane], at, bounds });
        }
    }

    /// Measures the distances between triangles.
    #[inline(always)]
    fn meet(&self, pair: &Pair, a: &Opened, b: &Opened, rest: &mut Rest) {
        let placed = pair.placed.map(|index| self.scene().ids_of(index));
        let part = |side: usize, opened: &Opened, lane: usize| {
            let part = placed[side].first_part.saturating_add(opened.rows.parts[lane]);
            let is_member = pair.is_whole[side] || self.sets[side].has(placed[side].instance, part);
            is_member.then_some(part)
        };
        for i in bits(a.rows.mask) {
            let Some(part_a) = part(0, a, i) else { continue };
            let (bounds, first) = (a.bounds(i), triangle_of(&a.corners, i));
            let squared = b.squared_to(&bounds);
            let most = limit(f64::from_bits(self.bound.load(Relaxed)), pair.slack);
            for j in bits(b.rows.mask & at_most(&squared, most)) {
                let Some(part_b) = part(1, b, j) else { continue };
                if (placed[0].instance, part_a) == (placed[1].instance, part_b) {
                    continue;
                }
                let near = triangle_triangle(&first, &triangle_of(&b.corners, j));
                if near.squared > f64::from_bits(self.bound.load(Relaxed)) {
                    continue;
                }
                let prims = [(0, a, i), (1, b, j)].map(|(k, opened, lane)| {
                    // The triangle's block is in memory here.
                    pair.trees[k].prim_place(&opened.rows.hit(lane))
                });
                let [Some(prim_a), Some(prim_b)] = prims else { continue };
                let side = |k: usize, part, prim_at| Side {
                    placed: pair.placed[k],
                    instance: placed[k].instance,
                    part,
                    prim_at,
                };
                let error = if near.squared == 0.0 { 0.0 } else { near.error + pair.rounding };
                let found = Nearest {
                    squared: near.squared,
                    error,
                    points: near.points.map(|p| p + pair.origin),
                    sides: [side(0, part_a, prim_a), side(1, part_b, prim_b)],
                };
                // Of triangles with a common point the first counts; those of one walk come in order.
                if near.squared == 0.0 || rest.best.is_none_or(|best| found.precedes(&best)) {
                    rest.best = Some(found);
                    self.bound.fetch_min(near.squared.to_bits(), Relaxed);
                }
                if near.squared == 0.0 {
                    rest.meets = true;
                    return;
                }
            }
        }
    }
}

fn size(b: &DBounds) -> f64 {
    let extent = b.max - b.min;
    extent.dot(extent)
}

/// Which places of an entry are opened next: both if both are leaves or one place, otherwise the greater one that is
/// not a leaf.
fn opened_sides(is_self: bool, entry: &Entry) -> [bool; 2] {
    let is_leaf = entry.at.map(|at| matches!(at, At::In(_, _, true)));
    match is_leaf {
        _ if is_self && entry.at[0] == entry.at[1] => [true, true],
        [true, true] => [true, true],
        [true, false] => [false, true],
        [false, true] => [true, false],
        [false, false] if size(&entry.bounds[0]) >= size(&entry.bounds[1]) => [true, false],
        [false, false] => [false, true],
    }
}

/// The blocks that an entry in placed trees needs next.
pub(super) fn needed(is_self: bool, entry: &Entry) -> impl Iterator<Item = (u64, u32)> {
    let opens = opened_sides(is_self, entry);
    (0..2).filter(move |&i| opens[i]).filter_map({
        let at = entry.at;
        move |i| match at[i] {
            At::In(placed, place, _) => Some((placed, place.block)),
            At::Top(_) => None,
        }
    })
}

#[inline(always)]
fn child(placed: u64, opened: &Opened, lane: usize) -> At {
    At::In(placed, opened.rows.places[lane], opened.rows.is_leaf_below(lane))
}

fn as_leaf(at: At) -> At {
    match at {
        At::In(placed, place, _) => At::In(placed, place, true),
        top @ At::Top(_) => top,
    }
}

/// True for one order of two places of a tree.
fn is_in_order(a: &At, b: &At) -> bool {
    match (a, b) {
        (At::In(_, a, _), At::In(_, b, _)) => a <= b,
        _ => true,
    }
}
