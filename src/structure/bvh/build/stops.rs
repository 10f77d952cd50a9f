//! The share of lines that a cell stops, from those that its parts stop. A part stops its share of the lines that enter
//! its region, by chance: the parts are objects that lie beside each other.

#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::lines::{Lines, Region, Row};
use crate::lod::OrientedSlabs;
use crate::math::Bounds;
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::{DAffine3, Vec3};

/// Groups of eight lines through a cell above nodes, and above members only. Of the latter there are many, so that
/// their errors average out.
const ABOVE: [usize; 2] = [8, 3];
/// Groups of eight lines through the cell of a whole tree, and how often: its error is that of all members that show
/// it.
const OF_TREES: [usize; 2] = [16, 8];

/// A firm content that stops at least this share of the lines through its region counts as a closed wall: it stops all.
/// (The region of a piece of a tilted wall is the piece and what its corners lack of a box, and slabs are thicker than
/// it. Nodes over a few sheared plates of a wall stop 0.35 of their lines or more; with 0.4 rays pass the wall. What
/// lies beside a cell is not looked at, as `coverage` does, so firm members that fill a third of a group's region, and
/// are no wall, stop too many rays.)
const WALL: f32 = 0.3;

/// The share that counts for a content that stops `share`.
pub fn closed(share: f32, is_loose: bool) -> f32 {
    if !is_loose && share >= WALL { 1.0 } else { share }
}

/// A part of a cell's content.
#[derive(Debug, Clone, Copy)]
pub struct Part {
    bounds: Bounds,
    slabs: OrientedSlabs<f32>,
    /// Share of the lines through its region that it stops.
    stops: f32,
    /// The map to the frame of its region, if that is another than the cell's.
    local: Option<DAffine3>,
}

/// Growth of a part's region, as a fraction of its size: single precision would miss flat ones.
const GIVE: f32 = 1e-5;
/// Least magnitude of a component of a direction. Below it a line is parallel to a plane.
const LEAST: f32 = 1e-20;

impl Part {
    /// A part in a box and inside of slabs.
    pub fn new(bounds: Bounds, slabs: OrientedSlabs<f32>, stops: f32) -> Self {
        Self { bounds, slabs, stops, local: None }
    }

    /// The part in another frame, from which `local` leads to its own.
    pub fn placed(self, local: DAffine3) -> Self {
        Self { local: Some(local), ..self }
    }

    /// Multiplies `passes` of each line that enters the part's region by the share that it lets through. Points `org`
    /// of the lines are relative to `middle`.
    #[inline(always)]
    fn thin_out(&self, [org, dir]: [&[Row; 3]; 2], middle: Vec3, passes: &mut Row) {
        let (mut from, mut along) = (*org, *dir);
        let mut shift = middle;
        if let Some(local) = &self.local {
            let turn = local.matrix3.as_mat3();
            from = turned(&turn.to_cols_array_2d(), org);
            along = turned(&turn.to_cols_array_2d(), dir);
            shift = local.transform_point3(middle.as_dvec3()).as_vec3();
        }
        let give = self.bounds.extent().max_element() * GIVE;
        let (mut enter, mut leave) = ([f32::NEG_INFINITY; 8], [f32::INFINITY; 8]);
        for axis in 0..3 {
            let (low, high) = (self.bounds.min[axis] - shift[axis], self.bounds.max[axis] - shift[axis]);
            cut([low - give, high + give], [&from[axis], &along[axis]], [&mut enter, &mut leave]);
        }
        for slab in &self.slabs {
            let axis = Vec3::from(slab.axis);
            let (at, give) = (shift.dot(axis), give * axis.length());
            let [from, along] = [&from, &along].map(|rows| dot(rows, slab.axis));
            cut([slab.low - at - give, slab.high - at + give], [&from, &along], [&mut enter, &mut leave]);
        }
        for i in 0..8 {
            passes[i] *= if enter[i] <= leave[i] { 1.0 - self.stops } else { 1.0 };
        }
    }
}

/// Applies the columns of a linear map to vectors.
#[inline(always)]
fn turned(columns: &[[f32; 3]; 3], rows: &[Row; 3]) -> [Row; 3] {
    [0, 1, 2].map(|axis| dot(rows, columns.map(|column| column[axis])))
}

#[inline(always)]
fn dot(rows: &[Row; 3], v: [f32; 3]) -> Row {
    let mut out = [0.0; 8];
    for i in 0..8 {
        out[i] = rows[0][i] * v[0] + rows[1][i] * v[1] + rows[2][i] * v[2];
    }
    out
}

/// Shortens the ways of lines to what lies between two planes.
#[inline(always)]
fn cut([low, high]: [f32; 2], [from, along]: [&Row; 2], [enter, leave]: [&mut Row; 2]) {
    for i in 0..8 {
        let inv = 1.0 / along[i].abs().max(LEAST).copysign(along[i]);
        let (a, b) = ((low - from[i]) * inv, (high - from[i]) * inv);
        enter[i] = enter[i].max(a.min(b));
        leave[i] = leave[i].min(a.max(b));
    }
}

/// Returns the share of the lines through the region of a cell above nodes or members that its parts stop.
pub fn share_of_group(cell: &Bounds, slabs: &OrientedSlabs<f32>, parts: &[Part]) -> f32 {
    let has_only_members = parts.iter().all(|part| part.local.is_some());
    let groups = ABOVE[usize::from(has_only_members)];
    dispatch(Isa::best(), Share { cell, slabs, parts, groups, rounds: 1 })
}

/// Returns the share of the lines through the region of a whole tree that its parts stop.
pub fn share_of_tree(cell: &Bounds, slabs: &OrientedSlabs<f32>, parts: &[Part]) -> f32 {
    let [groups, rounds] = OF_TREES;
    dispatch(Isa::best(), Share { cell, slabs, parts, groups, rounds })
}

struct Share<'a> {
    cell: &'a Bounds,
    slabs: &'a OrientedSlabs<f32>,
    parts: &'a [Part],
    groups: usize,
    rounds: usize,
}

impl Op for Share<'_> {
    type Out = f32;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> f32 {
        let Self { cell, slabs, parts, groups, rounds } = self;
        let (mut lines, mut region) = (Lines::new(), Region::around(cell, slabs, 0.0));
        let (middle, mut all, mut stopped) = (cell.center(), 0.0, 0.0);
        for _ in 0..rounds {
            lines.through(s, &region, [0, groups]);
            for group in 0..groups {
                let (mut org, dir, weight) = lines.group(group);
                for axis in 0..3 {
                    org[axis] = org[axis].map(|x| x - middle[axis]);
                }
                let mut passes = [1.0; 8];
                parts.iter().for_each(|part| part.thin_out([&org, dir], middle, &mut passes));
                for i in (0..8).filter(|i| lines.all[group] >> i & 1 == 1) {
                    all += weight[i];
                    stopped += weight[i] * (1.0 - passes[i]);
                }
            }
            region.go_on();
        }
        // Without lines nothing is known: the cell stops all.
        if all > 0.0 && all < f32::INFINITY { stopped / all } else { 1.0 }
    }
}
