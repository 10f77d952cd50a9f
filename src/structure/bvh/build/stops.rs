//! The share of lines that a cell stops, from those that its parts stop. A part stops its share of the lines that enter
//! its region, by chance: the parts are objects that lie beside each other.

use super::lines::{Lines, Region, numbers};
use crate::lod::OrientedSlabs;
use crate::math::Bounds;
use crate::simd::Portable;
use glam::{DAffine3, DVec3, Vec3};

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

impl Part {
    /// A part in a box and inside of slabs.
    pub fn new(bounds: Bounds, slabs: OrientedSlabs<f32>, stops: f32) -> Self {
        Self { bounds, slabs, stops, local: None }
    }

    /// The part in another frame, from which `local` leads to its own.
    pub fn placed(self, local: DAffine3) -> Self {
        Self { local: Some(local), ..self }
    }

    /// True if a line enters the part's region.
    fn is_met(&self, org: Vec3, dir: Vec3) -> bool {
        let (mut org, mut dir) = (org.as_dvec3(), dir.as_dvec3());
        if let Some(local) = &self.local {
            (org, dir) = (local.transform_point3(org), local.transform_vector3(dir));
        }
        let inv = dir.recip();
        let (a, b) = ((self.bounds.min.as_dvec3() - org) * inv, (self.bounds.max.as_dvec3() - org) * inv);
        let (mut enter, mut leave) = (a.min(b).max_element(), a.max(b).min_element());
        for slab in &self.slabs {
            let axis = DVec3::from(slab.axis.map(f64::from));
            let (from, inv) = (org.dot(axis), dir.dot(axis).recip());
            let (a, b) = ((f64::from(slab.low) - from) * inv, (f64::from(slab.high) - from) * inv);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        // Flat regions are met only up to rounding.
        enter <= leave + (enter.abs() + leave.abs()) * 1e-6
    }
}

/// Returns the share of the lines through the region of a cell above nodes or members that its parts stop.
pub fn share_of_group(cell: &Bounds, slabs: &OrientedSlabs<f32>, parts: &[Part]) -> f32 {
    let has_only_members = parts.iter().all(|part| part.local.is_some());
    share_stopped(cell, slabs, parts, [ABOVE[usize::from(has_only_members)], 1])
}

/// Returns the share of the lines through the region of a whole tree that its parts stop.
pub fn share_of_tree(cell: &Bounds, slabs: &OrientedSlabs<f32>, parts: &[Part]) -> f32 {
    share_stopped(cell, slabs, parts, OF_TREES)
}

fn share_stopped(cell: &Bounds, slabs: &OrientedSlabs<f32>, parts: &[Part], [groups, rounds]: [usize; 2]) -> f32 {
    let (mut lines, mut region) = (Lines::new(), Region::around(cell, slabs, 0.0));
    let (mut all, mut stopped) = (0.0, 0.0);
    for _ in 0..rounds {
        lines.through(Portable::new(), &region, [0, groups]);
        for i in numbers(lines.all) {
            let ((dir, weight), org) = (lines.direction(i), lines.origin(i));
            let met = parts.iter().filter(|part| part.is_met(org, dir));
            let passes = met.fold(1.0, |passes, part| passes * (1.0 - part.stops));
            all += weight;
            stopped += weight * (1.0 - passes);
        }
        region.go_on();
    }
    // Without lines nothing is known: the cell stops all.
    if all > 0.0 && all < f32::INFINITY { stopped / all } else { 1.0 }
}
