//! The distance of two sets of parts: the two points that are nearest to each other.

mod quest;
mod walk;

use super::among::Among;
use super::batch::Policy;
use super::hit::NONE;
use super::part_set::PartSet;
use super::sweep::sweep;
use crate::base::error::{Error, Result};
use crate::scene::SceneState;
use crate::structure::{Descent, Place};
use glam::DVec3;

/// A search for the distance of two sets.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceOptions {
    /// Parts that have one of the points.
    pub a: PartSet,
    /// Parts that have the other; `None`: the other parts of `a`.
    pub b: Option<PartSet>,
    /// Distance in world units beyond which nothing is sought; it may be infinite.
    pub max_distance: f64,
}

impl Default for DistanceOptions {
    fn default() -> Self {
        Self { a: PartSet::all(), b: None, max_distance: f64::INFINITY }
    }
}

impl DistanceOptions {
    /// Fails with `BadArgument` if a set is empty, or the greatest distance is negative or NaN.
    pub fn check(&self) -> Result<()> {
        if self.max_distance.is_nan() || self.max_distance < 0.0 {
            let given = self.max_distance;
            return Err(Error::BadArgument(format!("the greatest distance is {given}; it must not be negative")));
        }
        if self.a.is_empty() || self.b.as_ref().is_some_and(PartSet::is_empty) {
            return Err(Error::bad_argument("a set of parts is empty"));
        }
        Ok(())
    }
}

/// The distance of two sets. Of two points the first is in the first set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetDistance {
    /// Distance in world units; 0 if triangles have a common point, which exact signs decide.
    pub distance: f64,
    /// Bound of the error of `distance`: of rounding, and of stored positions. 0 if the distance is 0.
    pub error: f64,
    /// The points in world space.
    pub points: [DVec3; 2],
    /// The caller's ids of the instances.
    pub instances: [u64; 2],
    /// The caller's ids of the parts.
    pub parts: [u64; 2],
    /// The indices of the triangles in the inputs of their models' builds.
    pub prims: [u64; 2],
}

impl SceneState {
    /// Finds the distance between the visible parts of two sets, and the two nearest points; `None` if it is greater
    /// than the greatest distance, or if there are no two parts.
    ///
    /// The distance is that of surfaces: a part inside of another has a distance from it. A part is not compared with
    /// itself, even if it is in both sets; parts of one instance are compared with each other. Of several pairs of
    /// points at the same distance the answer has one, which does not depend on threads, on the blocks in memory, or
    /// on the order of the sets.
    ///
    /// Blocks; may read the disk. Thread-safe. Fails with `BadArgument` as [`DistanceOptions::check`], and for ids
    /// that the scene lacks; with the error of a disk read.
    pub fn distance(&self, options: &DistanceOptions) -> Result<Option<SetDistance>> {
        options.check()?;
        let is_self = options.b.is_none();
        let b = options.b.as_ref().unwrap_or(&options.a);
        // The walk has the lesser set first, whatever the order is.
        let is_turned = *b < options.a;
        let a = Among::new(self, &options.a, "the first set", true)?;
        let b = Among::new(self, b, "the second set", true)?;
        let sets = if is_turned { [&b, &a] } else { [&a, &b] };
        let squared = options.max_distance * options.max_distance;
        let Some(best) = quest::search(self, sets, is_self, squared)? else { return Ok(None) };
        let prims = self.prims_of(best.sides.map(|side| (side.placed, side.prim_at)))?;
        let ids = best.sides.map(|side| {
            let placed = self.placed(side.placed);
            let part = self.models[placed.model as usize].parts().id(side.part as usize);
            (self.instance_id(placed.instance), part.unwrap_or(NONE))
        });
        // Of one set, that part comes first whose instance was added first, or that comes first in its model.
        let [x, y] = best.sides.map(|side| (side.instance, side.part));
        let is_turned = if is_self { y < x } else { is_turned };
        let turn = |i: usize| if is_turned { 1 - i } else { i };
        Ok(Some(SetDistance {
            distance: best.squared.sqrt(),
            error: best.error,
            points: [0, 1].map(|i| best.points[turn(i)]),
            instances: [0, 1].map(|i| ids[turn(i)].0),
            parts: [0, 1].map(|i| ids[turn(i)].1),
            prims: [0, 1].map(|i| prims[turn(i)]),
        }))
    }

    /// Reads the primitive ids at places of placed trees.
    fn prims_of(&self, places: [(u64, Place); 2]) -> Result<[u64; 2]> {
        let found = sweep(self, &places.map(|it| it.0), Policy::Exact, &|view, visit, left, prim: &mut u64| {
            // Nothing of the tree is visited.
            *left = Descent::default();
            let (placed, place) = places[visit];
            match view.tree(placed).prim_at(place) {
                Ok(found) => {
                    *prim = found.map_or(NONE, u64::from);
                    Vec::new()
                }
                Err(block) => vec![block],
            }
        })?;
        Ok([found[0], found[1]])
    }
}
