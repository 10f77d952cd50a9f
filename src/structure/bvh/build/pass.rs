//! How many of the rays that enter a cell's region, its box inside of its slabs, pass what it holds.
//!
//! Lines through the region, uniform over all of them, are asked of the triangles below. (So cells as large as may be are right as well
//! as small ones: nothing is made of what was found for their pieces.) Two things are beside the cell:
//!
//! - A cell of a closed wall must let nothing through, however ragged the piece of the wall in it. Of the lines that pass it most find
//!   other surface within an eighth of its diagonal: 0.8 to 1 of them in a closed room and a Mandelbulb, 0.1 to 0.5 among wires, less
//!   than 0.1 among leaf cards. It is asked of some cells of each small subtree together, and where it is so all of these are
//!   **walls**: of most of a scan no more is worked out than that.
//! - A line that passes a piece of a wire beside its end finds the next piece. As cells that overlap mostly decide alike about a ray
//!   (`trace::pass`), the next one would let it pass too. So a part of these lines counts as stopped: [`BESIDE`].
//!
//! The same lines for all cells, turned by where the cell is: what is off by chance in one cell is not in the next. Nothing depends on
//! the number of threads.
//!
//! Cells over several chunks (`join`) let nothing pass.

use super::TreeInput;
use super::par::Par;
use super::refs::Ref;
use super::tree::{Inner, Piece, Sub};
use crate::lod::{Slabs, stop_bits};
use crate::math::Bounds;
use crate::structure::bvh::layout::{Node, WIDTH};
use glam::Vec3;
use std::collections::HashMap;
use std::f32::consts::TAU;

/// A subtree of at most so many references is looked at as a whole first.
const SMALL: u64 = 256;
/// So many of its cells, with so many lines each. (Twice as many lines: builds of scans take a sixth longer.)
const PROBES: [usize; 2] = [8, 4];
/// Its cells are walls if so many of the lines that pass one find other surface near it.
const FOUND: f32 = 0.7;
/// How near, as a part of the cell's diagonal.
const NEAR: f32 = 0.125;
/// How many of the lines that pass a cell, and find other surface near it, count as stopped. (Coverage of wires in two views, PoE 0.5 to
/// 10, 128 lines: with none 0.91 to 0.98 of the exact, with half 0.96 to 1.01, with all 1.02 to 1.05. Leaf cards hardly care.)
const BESIDE: f32 = 0.4;
/// Lines through a cell of a small subtree, and through a larger one. (With half of these 1.03 to 1.08 of the coverage of wires is seen,
/// for short ways are seldom found and weigh much; with four times as many 0.95 to 1.01, and more of the lines beside must count as
/// stopped. Lines that all weigh the same, from a block's sides: wires that all stand are 0.90 to 1.00 then, for an upright cell stops
/// more rays from the side than on the mean over all directions.)
const LINES: [usize; 2] = [32, 128];
/// By how much regions are larger than stored, as a part of the diagonal: flat ones have no lines.
const GIVE: f32 = 1.0 / 512.0;

/// What lines meet.
struct Scene<'a> {
    pieces: &'a [Piece],
    input: TreeInput<'a>,
    refs: &'a [Ref],
}

/// A cell that is asked about.
#[derive(Clone, Copy)]
struct Cell<'a> {
    bounds: Bounds,
    slabs: Slabs<f32>,
    sub: &'a Sub,
}

/// Works out how many rays all cells below `pieces` stop.
pub fn mark(pieces: &mut [Piece], input: TreeInput, refs: &[Ref], par: &Par) {
    let scene = Scene { pieces, input, refs };
    let (mut small, mut nodes) = (Vec::new(), 0);
    pieces.iter().for_each(|p| gather_small(&p.sub, 0, &mut nodes, &mut small));
    let mut codes = par.map(small.len(), |i| scene.of_small(small[i].0));
    agree(&small, &mut codes);
    let mut large = Vec::new();
    let mut next = codes.iter();
    pieces.iter().for_each(|p| {
        scene.gather_large(&p.sub, &mut next, &mut large);
    });
    let of_large = par.map(large.len(), |i| large[i].map_or(0, |cell| scene.code(&cell, LINES[1])));
    let (mut of_small, mut of_large) = (codes.into_iter(), of_large.into_iter());
    for piece in pieces {
        if let Sub::Inner(inner) = &mut piece.sub {
            apply(inner, &mut of_small, &mut of_large);
        }
    }
}

/// The largest subtrees of at most [`SMALL`] references, in their order, each with the number of the node that it hangs in.
fn gather_small<'a>(sub: &'a Sub, parent: usize, nodes: &mut usize, out: &mut Vec<(&'a Inner, usize)>) {
    if let Sub::Inner(inner) = sub {
        if is_small(inner) {
            out.push((inner, parent));
        } else {
            *nodes += 1;
            let here = *nodes;
            inner.children.iter().for_each(|(_, c)| gather_small(c, here, nodes, out));
        }
    }
}

/// Of small subtrees that hang in one node all are walls if most are: a small piece of a wall, at a corner of it, may look otherwise.
fn agree(small: &[(&Inner, usize)], codes: &mut [Vec<u8>]) {
    let mut cells: HashMap<usize, (usize, usize)> = HashMap::new();
    for ((inner, parent), codes) in small.iter().zip(codes.iter()) {
        let sums = cells.entry(*parent).or_default();
        let count = count(inner);
        *sums = (sums.0 + count, sums.1 + if codes.is_empty() { count } else { 0 });
    }
    for ((_, parent), codes) in small.iter().zip(codes) {
        let (all, of_walls) = cells[parent];
        if 4 * of_walls >= 3 * all {
            codes.clear();
        }
    }
}

/// Cells below.
fn count(inner: &Inner) -> usize {
    inner.children.iter().map(|(_, sub)| 1 + if let Sub::Inner(below) = sub { count(below) } else { 0 }).sum()
}

fn is_small(inner: &Inner) -> bool {
    let mut left = SMALL;
    has_at_most(inner, &mut left)
}

fn has_at_most(inner: &Inner, left: &mut u64) -> bool {
    inner.children.iter().all(|(_, sub)| match sub {
        Sub::Leaf { count, .. } if u64::from(*count) <= *left => {
            *left -= u64::from(*count);
            true
        }
        Sub::Inner(inner) => has_at_most(inner, left),
        _ => false,
    })
}

fn cells(inner: &Inner) -> impl Iterator<Item = Cell<'_>> {
    let all = inner.children.iter().enumerate();
    all.map(|(slot, (_, sub))| Cell { bounds: inner.node.stored_box(slot), slabs: inner.node.stored_slabs(slot), sub })
}

/// Of all cells below, in their order.
fn all_cells<'a>(inner: &'a Inner, out: &mut Vec<Cell<'a>>) {
    for cell in cells(inner) {
        out.push(cell);
        if let Sub::Inner(below) = cell.sub {
            all_cells(below, out);
        }
    }
}

impl Scene<'_> {
    /// The codes of all cells of a small subtree, in their order; none if all are walls.
    fn of_small(&self, inner: &Inner) -> Vec<u8> {
        let mut all = Vec::new();
        all_cells(inner, &mut all);
        let is_wall = self.are_walls(all.iter().step_by((all.len() / PROBES[0]).max(1)), PROBES[1]);
        // By chance not, perhaps: the more is looked at.
        if is_wall || self.are_walls(all.iter(), LINES[0] / 4) {
            return Vec::new();
        }
        all.iter().map(|cell| self.code(cell, LINES[0])).collect()
    }

    /// Whether cells are walls, by so many lines each.
    fn are_walls<'a>(&self, cells: impl Iterator<Item = &'a Cell<'a>>, lines: usize) -> bool {
        let (mut passed, mut found) = (0.0, 0.0);
        for cell in cells {
            let [_, pass, find] = self.ask(cell, lines);
            (passed, found) = (passed + pass, found + find);
        }
        found >= FOUND * passed
    }

    /// The cells above small subtrees, in their order; nothing for those of whose cells a quarter or more are walls. How many cells
    /// are below, and how many of these are walls.
    fn gather_large<'a>(&self, sub: &'a Sub, small: &mut std::slice::Iter<Vec<u8>>, out: &mut Vec<Option<Cell<'a>>>) -> [usize; 2] {
        let Sub::Inner(inner) = sub else { return [1, 1] };
        if is_small(inner) {
            let cells = count(inner);
            return [cells, small.next().map_or(cells, |codes| if codes.is_empty() { cells } else { 0 })];
        }
        let mut sums = [0; 2];
        for cell in cells(inner) {
            let at = out.len();
            out.push(None);
            let [all, of_walls] = self.gather_large(cell.sub, small, out);
            if 4 * of_walls < all {
                out[at] = Some(cell);
            }
            sums = [sums[0] + all, sums[1] + of_walls];
        }
        sums
    }

    /// The stop code of a cell, see [`stop_bits`].
    fn code(&self, cell: &Cell, lines: usize) -> u8 {
        let [all, passed, found] = self.ask(cell, lines);
        if all == 0.0 {
            return 0;
        }
        let stops = 1.0 - (passed - BESIDE * found) / all;
        // The greatest stops all, as no code does.
        (stops.max(0.0).sqrt() * 63.0).round().max(1.0) as u8 % 63
    }

    /// Of the lines through a cell's region, some looked at, how many there are (in some unit), how many of these pass what it holds, and
    /// how many of those find other surface near it.
    fn ask(&self, cell: &Cell, lines: usize) -> [f32; 3] {
        let mut sums = [0.0; 3];
        let region = Region::of(cell);
        for i in 0..lines {
            let Some((line, way)) = region.line(i) else { continue };
            // Points are the more often on a line, the longer its way.
            let weight = 1.0 / (way[1] - way[0]);
            sums[0] += weight;
            if self.meets(cell.sub, &line, way) {
                continue;
            }
            sums[1] += weight;
            let near = [way[0] - region.near, way[1] + region.near];
            if self.pieces.iter().any(|p| line.crosses(&p.cell, near) && self.meets(&p.sub, &line, near)) {
                sums[2] += weight;
            }
        }
        sums
    }

    /// Whether a line meets a triangle below on its way.
    fn meets(&self, sub: &Sub, line: &Line, way: [f32; 2]) -> bool {
        match sub {
            Sub::Leaf { first, count, .. } => {
                let refs = &self.refs[*first as usize..(*first + *count) as usize];
                refs.iter().any(|r| line.meets(&self.input.triangles[r.triangle()], way))
            }
            Sub::Inner(inner) => {
                let mut met = line.boxes(&inner.node, way);
                while met != 0 {
                    let slot = met.trailing_zeros() as usize;
                    met &= met - 1;
                    if inner.children.get(slot).is_some_and(|(_, sub)| self.meets(sub, line, way)) {
                        return true;
                    }
                }
                false
            }
            Sub::Placed(_) => false,
        }
    }
}

/// Hands codes to cells, in the order in which they were gathered.
fn apply(inner: &mut Inner, small: &mut std::vec::IntoIter<Vec<u8>>, large: &mut std::vec::IntoIter<u8>) {
    if is_small(inner) {
        apply_all(inner, &mut small.next().unwrap_or_default().into_iter());
        return;
    }
    for slot in 0..inner.children.len() {
        set(inner, slot, large.next().unwrap_or(0));
        if let Sub::Inner(below) = &mut inner.children[slot].1 {
            apply(below, small, large);
        }
    }
}

fn apply_all(inner: &mut Inner, codes: &mut std::vec::IntoIter<u8>) {
    for slot in 0..inner.children.len() {
        let Some(code) = codes.next() else { return };
        set(inner, slot, code);
        if let Sub::Inner(below) = &mut inner.children[slot].1 {
            apply_all(below, codes);
        }
    }
}

fn set(inner: &mut Inner, slot: usize, code: u8) {
    if code > 0 {
        inner.children[slot].0.words[0] |= stop_bits(code);
        inner.node.may_pass(slot);
    }
}

/// A cell's region, and a block around it along its slabs' axes.
struct Region {
    bounds: Bounds,
    slabs: Slabs<f32>,
    /// Unit: across the slabs, and along both.
    axes: [Vec3; 3],
    /// The block's ends along these.
    low: Vec3,
    high: Vec3,
    near: f32,
    seed: u32,
}

impl Region {
    fn of(cell: &Cell) -> Self {
        let diagonal = cell.bounds.extent().length();
        let give = (diagonal * GIVE).max(f32::MIN_POSITIVE);
        let bounds = Bounds { min: cell.bounds.min - give, max: cell.bounds.max + give };
        let mut slabs = cell.slabs;
        for slab in &mut slabs {
            (slab.low, slab.high) = (slab.low - give, slab.high + give);
        }
        let lengths = slabs.map(|s| Vec3::from(s.axis).length());
        let across = Vec3::from(slabs[0].axis) / lengths[0];
        let second = Vec3::from(slabs[1].axis) / lengths[1];
        let axes = [across, second, across.cross(second)];
        let (middle, half) = (bounds.center(), bounds.extent() * 0.5);
        let (mut low, mut high) = (Vec3::ZERO, Vec3::ZERO);
        for k in 0..3 {
            let (at, reach) = (middle.dot(axes[k]), half.dot(axes[k].abs()));
            (low[k], high[k]) = (at - reach, at + reach);
            if k < 2 {
                (low[k], high[k]) = (low[k].max(slabs[k].low / lengths[k]), high[k].min(slabs[k].high / lengths[k]));
            }
        }
        let words = [bounds.min, bounds.max].map(|v| v.to_array().map(f32::to_bits));
        let seed = words.as_flattened().iter().fold(0x9e37_79b9, |h: u32, w| (h ^ w).wrapping_mul(0x85eb_ca6b).rotate_left(13));
        Self { bounds, slabs, axes, low, high, near: diagonal * NEAR, seed }
    }

    /// Five numbers from 0 to 1, spread evenly over all `i`: powers of the generalised golden ratio (Roberts, "The Unreasonable
    /// Effectiveness of Quasirandom Sequences", 2018), turned by where the cell is.
    fn numbers(&self, i: usize) -> [f32; 5] {
        const STEPS: [f64; 5] = [0.855_669_5, 0.732_170_3, 0.626_495_8, 0.536_073_4, 0.458_701_6];
        let mut turn = self.seed;
        STEPS.map(|step| {
            turn = (turn ^ turn >> 15).wrapping_mul(0x2c1b_3c6d);
            turn = (turn ^ turn >> 12).wrapping_mul(0x297a_2d39);
            ((f64::from(turn) / 4_294_967_296.0 + step * (i + 1) as f64).fract() as f32).min(1.0)
        })
    }

    /// A line through point `i` of those spread evenly over the block, any way, and its way through the region; nothing if the point is
    /// outside.
    fn line(&self, i: usize) -> Option<(Line, [f32; 2])> {
        let [x, y, z, height, angle] = self.numbers(i);
        let at = self.low + (self.high - self.low) * Vec3::new(x, y, z);
        let org = self.axes[0] * at.x + self.axes[1] * at.y + self.axes[2] * at.z;
        if !(org.cmpge(self.bounds.min).all() && org.cmple(self.bounds.max).all()) {
            return None;
        }
        let height = height * 2.0 - 1.0;
        let across = (1.0 - height * height).max(0.0).sqrt();
        let line = Line::new(org, Vec3::new(across * (TAU * angle).cos(), across * (TAU * angle).sin(), height));
        let mut way = line.through(&self.bounds);
        for slab in &self.slabs {
            let axis = Vec3::from(slab.axis);
            let (from, along) = (org.dot(axis), 1.0 / line.dir.dot(axis));
            let (a, b) = ((slab.low - from) * along, (slab.high - from) * along);
            way = [way[0].max(a.min(b)), way[1].min(a.max(b))];
        }
        (way[1] > way[0]).then_some((line, way))
    }
}

/// A line through a point, in both directions.
struct Line {
    org: Vec3,
    dir: Vec3,
    inv: Vec3,
}

impl Line {
    fn new(org: Vec3, dir: Vec3) -> Self {
        let inv = dir.abs().max(Vec3::splat(1e-12)).copysign(dir).recip();
        Self { org, dir, inv }
    }

    fn through(&self, b: &Bounds) -> [f32; 2] {
        let (a, b) = ((b.min - self.org) * self.inv, (b.max - self.org) * self.inv);
        [a.min(b).max_element(), a.max(b).min_element()]
    }

    fn crosses(&self, b: &Bounds, way: [f32; 2]) -> bool {
        let [enter, leave] = self.through(b);
        enter.max(way[0]) <= leave.min(way[1])
    }

    /// The children of a node whose boxes it crosses.
    fn boxes(&self, node: &Node, way: [f32; 2]) -> u32 {
        let (mut enter, mut leave) = ([way[0]; WIDTH], [way[1]; WIDTH]);
        for axis in 0..3 {
            let step = node.step(axis) * self.inv[axis];
            let from = (node.origin[axis] - self.org[axis]) * self.inv[axis];
            for slot in 0..WIDTH {
                let a = f32::from(node.planes[axis][slot]) * step + from;
                let b = f32::from(node.planes[axis + 3][slot]) * step + from;
                enter[slot] = enter[slot].max(a.min(b));
                leave[slot] = leave[slot].min(a.max(b));
            }
        }
        let mut met = 0;
        for slot in 0..WIDTH {
            // Flat boxes are met to rounding only.
            let give = (enter[slot].abs() + leave[slot].abs()) * 1e-5;
            met |= u32::from(enter[slot] <= leave[slot] + give) << slot;
        }
        met & u32::from(node.valid)
    }

    /// Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997.
    fn meets(&self, [a, b, c]: &[Vec3; 3], way: [f32; 2]) -> bool {
        let (ab, ac) = (*b - *a, *c - *a);
        let p = self.dir.cross(ac);
        let inv = 1.0 / ab.dot(p);
        let from = self.org - *a;
        let u = from.dot(p) * inv;
        let q = from.cross(ab);
        let (v, t) = (self.dir.dot(q) * inv, ac.dot(q) * inv);
        u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= way[0] && t <= way[1]
    }
}
