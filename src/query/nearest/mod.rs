//! The nearest points of surfaces: for each of many points the distance to the nearest triangle, where it is, and which
//! triangle that is.

mod quest;
mod walk;

use super::among::Among;
use super::batch::Policy;
use super::hit::{HitKind, NONE};
use super::inside::Holds;
use super::part_set::PartSet;
use crate::base::error::{Error, Result};
use crate::scene::SceneState;
use glam::DVec3;
use quest::Points;
use walk::{Best, Entry, Walker};

/// Options of a search for nearest points.
#[derive(Debug, Clone, PartialEq)]
pub struct NearestOptions {
    /// The parts that are searched.
    pub set: PartSet,
    /// Distance in world units beyond which nothing is found; it may be infinite.
    pub max_distance: f64,
    /// The treatment of data that is not in memory.
    pub policy: Policy,
    /// True if each answer says whether a part of the set holds the point. Only with [`Policy::Exact`].
    pub inside: bool,
}

impl Default for NearestOptions {
    fn default() -> Self {
        Self { set: PartSet::all(), max_distance: f64::INFINITY, policy: Policy::Exact, inside: false }
    }
}

impl NearestOptions {
    /// Fails with `BadArgument` if the set is empty, if the greatest distance is negative or NaN, or if the inside is
    /// asked for without reading.
    pub fn check(&self) -> Result<()> {
        if self.max_distance.is_nan() || self.max_distance < 0.0 {
            let given = self.max_distance;
            return Err(Error::BadArgument(format!("the greatest distance is {given}; it must not be negative")));
        }
        if self.set.is_empty() {
            return Err(Error::bad_argument("the set of parts is empty"));
        }
        if self.inside && self.policy == Policy::Now {
            return Err(Error::bad_argument("whether points are inside of parts cannot be answered without reading"));
        }
        Ok(())
    }
}

/// The nearest point of surfaces. The members have the order of the C struct.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct NearestPoint {
    /// Distance in world units; infinity for a miss.
    pub distance: f64,
    /// The exact distance differs from `distance` by no more than this; infinity if only a lower bound is known.
    pub error: f64,
    /// The nearest point in world space; infinity for a miss. The middle of a box around surface if no triangle was
    /// found.
    pub position: DVec3,
    /// The caller's id of the instance.
    pub instance: u64,
    /// The caller's id of the part.
    pub part: u64,
    /// The triangle's index in the input of its model's build.
    pub prim: u64,
    /// [`HitKind::Exact`]; [`HitKind::Miss`] if nothing is within the greatest distance; [`HitKind::Missing`] if data
    /// was not in memory, so that the distance, or only the primitive id, is not exact.
    pub kind: HitKind,
    /// The relation to the point of a part of the set: 0 if none holds it, or if that was not asked for; otherwise the
    /// number of a [`Holds`].
    pub holds: u32,
}

impl NearestPoint {
    /// A miss.
    pub const MISS: Self = Self {
        distance: f64::INFINITY,
        error: 0.0,
        position: DVec3::INFINITY,
        instance: NONE,
        part: NONE,
        prim: NONE,
        kind: HitKind::Miss,
        holds: 0,
    };

    /// Bounds of the exact distance.
    pub fn bounds(&self) -> [f64; 2] {
        if self.kind == HitKind::Miss {
            return [self.distance; 2];
        }
        let least = if self.error.is_finite() { (self.distance - self.error).max(0.0) } else { self.distance };
        [least, self.distance + self.error]
    }
}

impl SceneState {
    /// Finds, for each point, the nearest point of the visible parts of a set.
    ///
    /// Distances are those to the surface, also for points inside of a part. Of triangles at the same distance, that
    /// of the instance added first counts, of one instance that of the part that comes first in the model, and then
    /// that with the least primitive id. Answers with [`Policy::Exact`] do not depend on threads, on the order of the
    /// points or on the blocks in memory. With [`Policy::Now`] the call reads nothing: the exact distance is within
    /// the error of each answer.
    ///
    /// Blocks; may read the disk. Thread-safe. Fails with `BadArgument` if the lengths differ, for a point that is not
    /// finite, and as [`NearestOptions::check`]; with the error of a disk read.
    pub fn nearest(&self, points: &[DVec3], options: &NearestOptions, out: &mut [NearestPoint]) -> Result<()> {
        options.check()?;
        if points.len() != out.len() {
            let (points, room) = (points.len(), out.len());
            return Err(Error::BadArgument(format!("there are {points} points, but room for {room} answers")));
        }
        if let Some(at) = points.iter().position(|point| !point.is_finite()) {
            return Err(Error::BadArgument(format!("point {at} is not finite: {}", points[at])));
        }
        let among = Among::new(self, &options.set, "the set", options.policy == Policy::Exact)?;
        quest::run(&Points { scene: self, among: &among, points, options }, out)?;
        if options.inside {
            self.parts_around(points, &mut |index, parts| {
                let of_set = parts.iter().filter(|&&(instance, part, _)| among.has(instance, part));
                let holds = of_set.map(|&(_, _, winding)| if winding == 0 { Holds::Undecided } else { Holds::Inside });
                out[index].holds = holds.min().map_or(0, |holds| holds as u32);
            })?;
        }
        Ok(())
    }
}

/// The answer of a walk that has ended; `left` lacks blocks.
fn answer(walker: &Walker, scene: &SceneState, p: DVec3, limit: f64, best: &Best, left: &[Entry]) -> NearestPoint {
    let least = walker.least(p, left);
    let of = |tie: &walk::Candidate| {
        let placed = scene.ids_of(tie.placed);
        let (instance, model) = (scene.instance_id(placed.instance), &scene.models[placed.model as usize]);
        let distance = best.squared.sqrt();
        let is_exact = left.is_empty() && tie.prim.is_some();
        NearestPoint {
            distance,
            error: tie.error.max(distance - least),
            position: p + tie.point,
            instance,
            part: model.parts().id(tie.part as usize).unwrap_or(NONE),
            prim: tie.prim.unwrap_or(NONE),
            kind: if is_exact { HitKind::Exact } else { HitKind::Missing },
            holds: 0,
        }
    };
    let found = best.ties.iter().min_by_key(|tie| (tie.prim, tie.placed, tie.prim_at)).map(of);
    if left.is_empty() {
        return found.unwrap_or(NearestPoint::MISS);
    }
    let greatest = best.around.map_or(f64::INFINITY, |(squared, _)| squared.sqrt());
    match (found, best.around) {
        (Some(found), _) if found.distance <= greatest => found,
        // A box whose farthest point is nearer than the triangles that were found.
        (_, Some((_, middle))) => {
            let most = greatest.max(least) * (1.0 + 1e-12) + scene.placement.position_error;
            let least = least.min(limit);
            let distance = (least + most) * 0.5;
            NearestPoint {
                distance,
                error: (most - least) * 0.5 + distance * f64::EPSILON,
                position: p + middle,
                kind: HitKind::Missing,
                ..NearestPoint::MISS
            }
        }
        (_, None) => {
            NearestPoint { distance: least, error: f64::INFINITY, kind: HitKind::Missing, ..NearestPoint::MISS }
        }
    }
}
