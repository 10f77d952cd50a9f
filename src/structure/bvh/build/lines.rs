//! Lines through a cell's region (its box inside its oriented slabs), and their intersection with triangles: eight
//! lines at a time.
//!
//! The lines go through points spread evenly over a box around the region, in any direction. Once each is weighted by
//! one over its length in the region ([`Lines::through`]), they are uniform over all lines that cross the region.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::refs::Ref;
use crate::lod::OrientedSlabs;
use crate::math::Bounds;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::bvh::layout::Node;
use glam::Vec3;
use std::f32::consts::PI;

/// Number of lines of a group.
const GROUP: usize = 8;
/// Greatest number of groups.
const GROUPS: usize = 16;
/// Distance by which regions are enlarged, as a fraction of the cell's size: flat ones would have no lines. (With twice
/// as much, cells of wires stop a tenth too few rays.)
const GIVE: f32 = 1.0 / 1024.0;
/// Length by which the interval of a line exceeds its part in the region, as a fraction of the cell's size, so that no
/// triangle in the region is missed because of rounding.
const ROUNDED: f32 = 1.0 / 512.0;

/// Least length that counts for the weight of a line, as a fraction of the region's thickness. Otherwise a line across
/// a corner outweighs all others. (In the cell of a flat wall, one such line made a tenth of all lines seem to miss the
/// wall.)
const SHORT: f32 = 1.0 / 16.0;

/// The size of a cell is the smaller of its diagonal and this factor times its width: the region within an eighth of a
/// long thin cell's length is mostly far from its sides, where a closed surface continues. (Treelets of a closed ball
/// that is stretched a thousand times along an axis find near surface for 0.07 to 0.6 of their lines by the diagonal,
/// for 0.4 to 1 by this rule, most of them for more than 0.9. Treelets of wires, of which few are as long, find hardly
/// more than before. With a factor of 16 they do, and their cells stop too many rays. The slabs of cells along no axis
/// are stored in steps of a 31st of the cell's extent: they are wider than the content, and gain little.)
const LONG: f32 = 32.0;
/// The size is at least this fraction of the diagonal; below that, rounding matters.
const LEAST: f32 = 1.0 / 16384.0;

pub type Row = [f32; GROUP];

/// The nearest and the farthest of the triangles that each line hits: distance and number.
pub struct Ends([[[(f32, u32); 2]; GROUP]; GROUPS]);

impl Ends {
    /// No hits.
    pub const NONE: Self = Self([[[(f32::INFINITY, u32::MAX), (f32::NEG_INFINITY, u32::MAX)]; GROUP]; GROUPS]);

    /// The numbers of the nearest and farthest triangle of line `i`, if it hits any.
    pub fn of(&self, i: usize) -> Option<[u32; 2]> {
        let [first, last] = self.0[i / GROUP][i % GROUP];
        (first.1 != u32::MAX).then_some([first.1, last.1])
    }
}

/// A set of lines: a bit for each line of each group.
pub type Set = [u8; GROUPS];
/// The empty set.
pub const NONE: Set = [0; GROUPS];

/// Lines through a region.
pub struct Lines {
    groups: usize,
    /// A point on each line, from which its interval is counted.
    org: [[Row; 3]; GROUPS],
    /// Directions, of unit length to some ten thousandths.
    dir: [[Row; 3]; GROUPS],
    /// The interval of each line: a little longer than its part in the region.
    way: [[Row; 2]; GROUPS],
    weight: [Row; GROUPS],
    /// The lines that are valid.
    pub all: Set,
}

/// The region of a cell.
pub struct Region {
    pub bounds: Bounds,
    slabs: OrientedSlabs<f32>,
    /// Unit normal of the first slab.
    across: Vec3,
    /// A box around the region.
    oriented: OrientedBox,
    /// Least length that counts for the weight of a line.
    least: f32,
    /// Size of the cell: its diagonal, or less if it is long, see [`LONG`].
    pub size: f32,
    /// Shifts of the five numbers of all lines.
    turns: [f32; 5],
}

/// One line, and its interval.
pub struct Line<'a> {
    org: Vec3,
    inv: Vec3,
    way: [f32; 2],
    /// Length by which the interval exceeds that in `lines`, at both ends.
    near: f32,
    lines: &'a Lines,
    /// Its position in `lines`.
    group: usize,
    bit: u8,
}

/// A box around a cell's region: along the axes of its slabs, or the cell's box, whichever has less volume.
struct OrientedBox {
    /// Unit vectors.
    axes: [Vec3; 3],
    /// Ends along the axes.
    low: Vec3,
    high: Vec3,
    /// Shortest side of the box along the axes of the slabs.
    thickness: f32,
}

impl OrientedBox {
    fn around(bounds: &Bounds, slabs: &OrientedSlabs<f32>) -> Self {
        let lengths = slabs.map(|s| Vec3::from(s.axis).length());
        let [across, second] = [0, 1].map(|k| Vec3::from(slabs[k].axis) / lengths[k]);
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
        let thickness = (high - low).min_element();
        // For a rod that is not along the axes of the slabs, the cell's box is smaller.
        if bounds.extent().element_product() < (high - low).element_product() {
            return Self { axes: Vec3::AXES, low: bounds.min, high: bounds.max, thickness };
        }
        Self { axes, low, high, thickness }
    }

    /// Returns the middle one of the lengths of its sides.
    fn width(&self) -> f32 {
        let Vec3 { x, y, z } = self.high - self.low;
        x.min(y).max(x.max(y).min(z))
    }
}

impl Region {
    /// Returns the region of a cell, enlarged by `near` times the cell's size.
    pub fn around(bounds: &Bounds, slabs: &OrientedSlabs<f32>, near: f32) -> Self {
        let diagonal = bounds.extent().length();
        let size = diagonal.min(LONG * OrientedBox::around(bounds, slabs).width()).max(diagonal * LEAST);
        let give = (size * (GIVE + near)).max(f32::MIN_POSITIVE);
        let words = [bounds.min, bounds.max].map(|v| v.to_array().map(f32::to_bits));
        let mut turn = words
            .as_flattened()
            .iter()
            .fold(0x9e37_79b9, |h: u32, w| (h ^ w).wrapping_mul(0x85eb_ca6b).rotate_left(13));
        let turns = [(); 5].map(|()| {
            turn = (turn ^ turn >> 15).wrapping_mul(0x2c1b_3c6d);
            turn = (turn ^ turn >> 12).wrapping_mul(0x297a_2d39);
            (turn >> 8) as f32 / (1 << 24) as f32
        });
        let bounds = Bounds { min: bounds.min - give, max: bounds.max + give };
        let mut slabs = *slabs;
        for slab in &mut slabs {
            (slab.low, slab.high) = (slab.low - give, slab.high + give);
        }
        let across = Vec3::from(slabs[0].axis);
        let across = across / across.length();
        let oriented = OrientedBox::around(&bounds, &slabs);
        let least = oriented.thickness * SHORT;
        Self { bounds, slabs, across, oriented, least, size, turns }
    }

    /// True if a box may have points in the region.
    #[inline(always)]
    pub fn may_hold(&self, low: Vec3, high: Vec3) -> bool {
        if low.cmpgt(self.bounds.max).any() || high.cmplt(self.bounds.min).any() {
            return false;
        }
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        self.slabs.iter().all(|slab| {
            let axis = Vec3::from(slab.axis);
            let (at, reach) = (middle.dot(axis), half.dot(axis.abs()));
            at - reach <= slab.high && at + reach >= slab.low
        })
    }

    /// Later lines continue with the numbers after those of all groups.
    pub fn go_on(&mut self) {
        for k in 0..5 {
            let turned = f64::from(self.turns[k]) + STEPS[k] * (GROUPS * GROUP) as f64;
            self.turns[k] = (turned - turned.floor()) as f32;
        }
    }
}

/// Powers of the reciprocal of the generalised golden ratio of five dimensions (Roberts, "The Unreasonable
/// Effectiveness of Quasirandom Sequences", 2018).
const STEPS: [f64; 5] = [0.855_669_5, 0.732_170_3, 0.626_495_8, 0.536_073_4, 0.458_701_6];

/// Five numbers from 0 to 1 for each line, spread evenly: multiples of [`STEPS`] modulo 1.
static SPREAD: [[Row; 5]; GROUPS] = spread();

const fn spread() -> [[Row; 5]; GROUPS] {
    let mut out = [[[0.0; GROUP]; 5]; GROUPS];
    let mut i = 0;
    while i < GROUPS * GROUP * 5 {
        let (line, k) = (i / 5, i % 5);
        let at = STEPS[k] * (line + 1) as f64;
        out[line / GROUP][k][line % GROUP] = (at - at as u32 as f64) as f32;
        i += 1;
    }
    out
}

/// Returns the cosine of an angle of 0 to 1 turns, with an error of at most 0.0002.
#[inline(always)]
fn cos_of_turns(turns: f32) -> f32 {
    let s = (2.0 * turns - 1.0).abs() - 0.5;
    let x = s * s;
    s * (PI + x * (-5.167_713 + x * (2.550_164 + x * -0.599_265)))
}

impl Lines {
    pub fn new() -> Self {
        const ROWS: [Row; 3] = [[0.0; GROUP]; 3];
        Self {
            groups: 0,
            org: [ROWS; GROUPS],
            dir: [ROWS; GROUPS],
            way: [[[0.0; GROUP]; 2]; GROUPS],
            weight: [[0.0; GROUP]; GROUPS],
            all: NONE,
        }
    }

    /// Makes the lines of groups `first` to `end` through `region`.
    #[inline(always)]
    pub fn through<S: Simd>(&mut self, s: S, region: &Region, [first, end]: [usize; 2]) {
        self.groups = (end - first).min(GROUPS);
        self.all = NONE;
        for group in 0..self.groups {
            self.make(s, region, group, &SPREAD[(first + group) % GROUPS]);
        }
    }

    /// Makes the lines of one group. Each step is a loop of its own, so that it is vectorised.
    #[inline(always)]
    fn make<S: Simd>(&mut self, s: S, region: &Region, group: usize, spread: &[Row; 5]) {
        let (org, dir) = (&mut self.org[group], &mut self.dir[group]);
        let (mut at, oriented) = (*spread, &region.oriented);
        for k in 0..5 {
            for i in 0..GROUP {
                let turned = at[k][i] + region.turns[k];
                at[k][i] = if turned >= 1.0 { turned - 1.0 } else { turned };
            }
        }
        for k in 0..3 {
            for i in 0..GROUP {
                at[k][i] = oriented.low[k] + (oriented.high[k] - oriented.low[k]) * at[k][i];
            }
        }
        let axes = &oriented.axes;
        for axis in 0..3 {
            for i in 0..GROUP {
                org[axis][i] = axes[0][axis] * at[0][i] + axes[1][axis] * at[1][i] + axes[2][axis] * at[2][i];
            }
        }
        for i in 0..GROUP {
            let height = at[3][i] * 2.0 - 1.0;
            let across = (1.0 - height * height).max(0.0).sqrt();
            let quarter = if at[4][i] < 0.25 { at[4][i] + 0.75 } else { at[4][i] - 0.25 };
            dir[0][i] = across * cos_of_turns(at[4][i]);
            dir[1][i] = across * cos_of_turns(quarter);
            dir[2][i] = height;
        }
        let [near, far] = self.clip(s, region, group);
        self.weight[group] = s.splat8(1.0).div((far - near).max(s.splat8(region.least))).to_array();
        // A line is valid only if its point is in the region.
        let zero = s.splat8(0.0);
        self.all[group] = (near.le(zero).and(zero.le(far)).bits() & !far.le(near).bits()) as u8;
    }

    /// Clips the lines of a group to the region. Returns the distances at which they enter and leave it, and sets their
    /// intervals.
    #[inline(always)]
    fn clip<S: Simd>(&mut self, s: S, region: &Region, group: usize) -> [S::F8; 2] {
        let (org, dir) = (&self.org[group], &self.dir[group]);
        let (mut near, mut far) = (s.splat8(f32::NEG_INFINITY), s.splat8(f32::INFINITY));
        let mut inv = [0.0; GROUP];
        for axis in 0..3 {
            for i in 0..GROUP {
                inv[i] = 1.0 / dir[axis][i].abs().max(1e-12).copysign(dir[axis][i]);
            }
            let (inv, org) = (s.load8(&inv), s.load8(&org[axis]));
            let (a, b) =
                ((s.splat8(region.bounds.min[axis]) - org) * inv, (s.splat8(region.bounds.max[axis]) - org) * inv);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        for slab in &region.slabs {
            let [x, y, z] = slab.axis;
            let mut from = [0.0; GROUP];
            for i in 0..GROUP {
                let along = dir[0][i] * x + dir[1][i] * y + dir[2][i] * z;
                from[i] = org[0][i] * x + org[1][i] * y + org[2][i] * z;
                inv[i] = 1.0 / along.abs().max(1e-30).copysign(along);
            }
            let (inv, from) = (s.load8(&inv), s.load8(&from));
            let (a, b) = ((s.splat8(slab.low) - from) * inv, (s.splat8(slab.high) - from) * inv);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        let rounded = s.splat8(region.size * ROUNDED);
        self.way[group] = [(near - rounded).to_array(), (far + rounded).to_array()];
        [near, far]
    }

    /// Gives all lines the same weight. (They are then not uniform over the lines that cross the region, but none
    /// outweighs others.)
    pub fn weigh_alike(&mut self) {
        self.weight[..self.groups].fill([1.0; GROUP]);
    }

    /// Keeps the lines that go steeply through the first slab of their region, with at least this cosine to its normal.
    #[inline(always)]
    pub fn keep_steep<S: Simd>(&mut self, s: S, region: &Region, cosine: f32) {
        let Vec3 { x, y, z } = region.across;
        for group in 0..self.groups {
            let dir = &self.dir[group];
            let along =
                s.load8(&dir[0]) * s.splat8(x) + s.load8(&dir[1]) * s.splat8(y) + s.load8(&dir[2]) * s.splat8(z);
            let size = along.max(s.splat8(0.0) - along);
            self.all[group] &= s.splat8(cosine).le(size).bits() as u8;
        }
    }

    /// Returns the total weight of a set.
    #[inline(always)]
    pub fn weight(&self, set: &Set) -> f32 {
        let mut sum = 0.0;
        for group in 0..self.groups {
            for i in 0..GROUP {
                sum += if set[group] >> i & 1 == 1 { self.weight[group][i] } else { 0.0 };
            }
        }
        sum
    }

    /// Removes the lines from `set` that hit a triangle within their intervals. Returns true if any are left.
    #[inline(always)]
    pub fn leave<S: Simd>(&self, s: S, set: &mut Set, triangle: &[Vec3; 3]) -> bool {
        let mut left = 0;
        for group in 0..self.groups {
            if set[group] != 0 {
                set[group] &= !self.met(s, group, 0.0, triangle).0;
                left |= set[group];
            }
        }
        left != 0
    }

    /// Returns the lines of a group that hit a triangle within their intervals, each lengthened by `near` at both ends,
    /// and the distances.
    /// (Möller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997.)
    #[inline(always)]
    fn met<S: Simd>(&self, s: S, group: usize, near: f32, triangle: &[Vec3; 3]) -> (u8, S::F8) {
        let [a, b, c] = triangle;
        let corner = splat3(s, *a);
        let (ab, ac) = (splat3(s, *b - *a), splat3(s, *c - *a));
        let (zero, near) = (s.splat8(0.0), s.splat8(near));
        let (org, dir, way) = (&self.org[group], &self.dir[group], &self.way[group]);
        let dir = [s.load8(&dir[0]), s.load8(&dir[1]), s.load8(&dir[2])];
        let from = [s.load8(&org[0]) - corner[0], s.load8(&org[1]) - corner[1], s.load8(&org[2]) - corner[2]];
        let (p, q) = (cross(dir, ac), cross(from, ab));
        // The test without a division: most triangles are missed.
        let det = dot(ab, p);
        let size = det.max(zero - det);
        let turned = |x: S::F8| (zero - x).select(det.le(zero), x);
        let (u, v) = (turned(dot(from, p)), turned(dot(dir, q)));
        let inside = zero.le(u).and(zero.le(v)).and((u + v).le(size));
        if inside.bits() == 0 {
            return (0, zero);
        }
        let t = dot(ac, q) * s.splat8(1.0).div(det);
        let met = inside.and((s.load8(&way[0]) - near).le(t)).and(t.le(s.load8(&way[1]) + near));
        (met.bits() as u8, t)
    }

    /// Keeps `id` for the lines that hit a triangle before, or beyond, all that they hit so far.
    #[inline(always)]
    pub fn keep_ends<S: Simd>(&self, s: S, triangle: &[Vec3; 3], id: u32, ends: &mut Ends) {
        for group in 0..self.groups {
            let (met, t) = self.met(s, group, 0.0, triangle);
            let mut met = met & self.all[group];
            if met == 0 {
                continue;
            }
            let t = t.to_array();
            while met != 0 {
                let i = met.trailing_zeros() as usize & (GROUP - 1);
                met &= met - 1;
                let [first, last] = &mut ends.0[group][i];
                // The lower number wins at equal distances: the order of triangles does not matter.
                if t[i] < first.0 || t[i] == first.0 && id < first.1 {
                    *first = (t[i], id);
                }
                if t[i] > last.0 || t[i] == last.0 && id < last.1 {
                    *last = (t[i], id);
                }
            }
        }
    }

    /// Returns the direction and the weight of line `i`.
    pub fn direction(&self, i: usize) -> (Vec3, f32) {
        let (group, i) = (i / GROUP, i % GROUP);
        let dir = &self.dir[group];
        (Vec3::new(dir[0][i], dir[1][i], dir[2][i]), self.weight[group][i])
    }

    /// Returns a point on each line of a group, the directions, and the weights.
    #[inline(always)]
    pub fn group(&self, group: usize) -> ([Row; 3], &[Row; 3], &Row) {
        (self.org[group], &self.dir[group], &self.weight[group])
    }

    /// Returns line `i` as a single line, its interval lengthened by `near` at both ends.
    pub fn one(&self, i: usize, near: f32) -> Line<'_> {
        let (group, i) = (i / GROUP, i % GROUP);
        let three = |rows: &[Row; 3]| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        let (org, dir) = (three(&self.org[group]), three(&self.dir[group]));
        let inv = dir.abs().max(Vec3::splat(1e-12)).copysign(dir).recip();
        let way = [self.way[group][0][i] - near, self.way[group][1][i] + near];
        Line { org, inv, way, near, lines: self, group, bit: 1 << i }
    }
}

/// Adds line `i` to a set if `is_in` is true.
pub fn put(set: &mut Set, i: usize, is_in: bool) {
    set[i / GROUP] |= u8::from(is_in) << (i % GROUP);
}

/// Returns the numbers of the lines in a set.
pub fn numbers(set: Set) -> impl Iterator<Item = usize> {
    set.into_iter()
        .enumerate()
        .flat_map(|(group, bits)| (0..GROUP).filter(move |i| bits >> i & 1 == 1).map(move |i| group * GROUP + i))
}

impl Line<'_> {
    /// Returns the children of a node with boxes that the line crosses within its interval.
    #[inline(always)]
    pub fn boxes<S: Simd>(&self, s: S, node: &Node) -> u32 {
        let step = s.powers8(node.exponents());
        let (mut enter, mut leave) = (s.splat8(self.way[0]), s.splat8(self.way[1]));
        for axis in 0..3 {
            let inv = s.splat8(self.inv[axis]);
            let from = s.splat8(node.origin[axis]) - s.splat8(self.org[axis]);
            let a = (s.bytes8(&node.planes[axis]) * step[axis] + from) * inv;
            let b = (s.bytes8(&node.planes[axis + 3]) * step[axis] + from) * inv;
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        // Flat boxes are hit only up to rounding.
        let zero = s.splat8(0.0);
        let sizes = enter.max(zero - enter) + leave.max(zero - leave);
        enter.le(leave + sizes * s.splat8(1e-5)).bits() & u32::from(node.valid)
    }

    /// True if the line crosses a reference's box within its interval.
    #[inline(always)]
    pub fn crosses(&self, r: &Ref) -> bool {
        // `w` of a reference holds a denormal number: less 1, it is safe to multiply (see [`Ref`]).
        let (org, inv) = (self.org.extend(1.0), self.inv.extend(1.0));
        let (a, b) = ((r.low - org) * inv, (r.high - org) * inv);
        let enter = a.min(b).with_w(self.way[0]).max_element();
        let leave = a.max(b).with_w(self.way[1]).min_element();
        enter <= leave + (enter.abs() + leave.abs()) * 1e-5
    }

    /// Returns the distance at which the line hits a triangle within its interval.
    #[inline(always)]
    pub fn distance<S: Simd>(&self, s: S, triangle: &[Vec3; 3]) -> Option<f32> {
        let (met, t) = self.lines.met(s, self.group, self.near, triangle);
        let t = t.to_array()[self.bit.trailing_zeros() as usize & (GROUP - 1)];
        (met & self.bit != 0 && t >= self.way[0] && t <= self.way[1]).then_some(t)
    }

    /// Shortens the interval: it then begins at `t`, or ends there.
    pub fn shorten(&mut self, t: f32, begins: bool) {
        self.way[usize::from(!begins)] = t;
    }

    /// True if the line hits a triangle within its interval.
    #[inline(always)]
    pub fn meets<S: Simd>(&self, s: S, triangle: &[Vec3; 3]) -> bool {
        self.lines.met(s, self.group, self.near, triangle).0 & self.bit != 0
    }
}

#[inline(always)]
fn splat3<S: Simd>(s: S, v: Vec3) -> [S::F8; 3] {
    [s.splat8(v.x), s.splat8(v.y), s.splat8(v.z)]
}

#[inline(always)]
fn dot<V: Lanes<8>>(a: [V; 3], b: [V; 3]) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross<V: Lanes<8>>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
#[path = "lines_tests.rs"]
mod tests;
