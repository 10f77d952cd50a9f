//! Questions to closed parts, answered by [crossings](super::crossings): which parts hold a point, and how thick a part
//! is at a hit.

use super::batch::{Policy, Rays};
use super::crossings::Met;
use super::hit::{Hit, HitKind, NONE};
use crate::base::error::Result;
use crate::base::memory::room;
use crate::geom::Side;
use crate::math::{DBounds, Ray};
use crate::scene::SceneState;
use crate::scene::through::Entrances;
use glam::{DVec3, Vec3};
use std::cmp::Ordering;

/// The relation of a part to a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Holds {
    /// The part is closed, and the point is inside.
    Inside = 1,
    /// The part is not closed, and the point is within its bounds: nothing says whether it is inside.
    Undecided = 2,
}

/// A part at a point. The members have the order of the C struct.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(C)]
pub struct PartAt {
    /// The caller's id of the instance.
    pub instance: u64,
    /// The caller's id of the part.
    pub part: u64,
    /// How many times the surface surrounds the point: 1 in a solid whose triangles face outward, -1 if they face
    /// inward. 1 if the surface is closed, but does not face one way; 0 if it is not closed.
    pub winding: i32,
    /// The relation of the part to the point.
    pub holds: Holds,
}

/// Takes the parts around the point with this index: instance, part, winding number.
type TakeAround<'a> = &'a mut dyn FnMut(usize, &[(u64, u32, i32)]);

/// The direction of the rays that decide, an arbitrary one of length 1.
const DIR: Vec3 = Vec3::new(0.36, 0.48, 0.8);

/// Distance in front of a hit from which rays into the part begin, as a fraction of its coordinates.
const BEFORE: f64 = 1e-9;

impl SceneState {
    /// Finds the visible parts that hold each point, by instance in the order added, then by part in the file's order.
    /// Calls `take` in the caller's thread for each point, in order.
    ///
    /// A ray from the point decides. A part that is closed and faces one way holds the point if the ray leaves the part
    /// more often than it enters it, or less often. A part that is closed without facing one way holds the point if the
    /// ray crosses it an odd number of times. For a part that is not closed the answer is [`Holds::Undecided`] if the
    /// point is within its bounds. A point nearer to a surface than rounding may be counted on either side. No part
    /// holds a point that is not finite.
    ///
    /// Blocks; may read the disk. Thread-safe. Fails like [`SceneState::crossings`].
    pub fn parts_at(&self, points: &[DVec3], take: &mut dyn FnMut(usize, &[PartAt])) -> Result<()> {
        let mut parts = Vec::new();
        self.parts_around(points, &mut |index, all| {
            parts.clear();
            parts.extend(all.iter().map(|&(instance, part, winding)| self.part_at(instance, part, winding)));
            take(index, &parts);
        })
    }

    /// [`SceneState::parts_at`], with the indices of instances and parts, and with winding numbers: 0 for
    /// [`Holds::Undecided`].
    pub(super) fn parts_around(&self, points: &[DVec3], take: TakeAround) -> Result<()> {
        let rays = Each(points, |&point: &DVec3| Ray::new(point, DIR));
        let (mut entrances, mut all) = (Entrances::default(), Vec::new());
        self.crossings_of_parts(&rays, Policy::Exact, &mut |index, met, _| {
            all.clear();
            self.closed_around(met, &mut all);
            self.open_around(points[index], &mut entrances, &mut all);
            all.sort_unstable_by_key(|&(instance, part, _)| (instance, part));
            take(index, &all);
        })
    }

    /// Returns, for each hit, the distance in world units from its point straight into the part (against its normal) to
    /// the opposite side of the same part and instance: infinity if there is none, or if the hit is a miss.
    ///
    /// The hit needs its position, normal, part and instance. The opposite side is the first triangle behind the hit
    /// that faces the other way than the triangle that was hit: parts of the part inside of it do not count.
    ///
    /// Blocks; may read the disk. Thread-safe. Fails like [`SceneState::crossings`].
    pub fn thickness(&self, hits: &[Hit]) -> Result<Vec<f64>> {
        let rays = Each(hits, |hit: &Hit| inward(hit).map_or(Ray::NONE, |(ray, _)| ray));
        let mut all = room(hits.len(), "thicknesses")?;
        all.resize(hits.len(), f64::INFINITY);
        self.crossings_of_parts(&rays, Policy::Exact, &mut |index, met, _| {
            if let Some((_, before)) = inward(&hits[index]) {
                all[index] = behind(&hits[index], before, met);
            }
        })?;
        Ok(all)
    }

    /// Adds the closed parts that hold the origin of a ray with these crossings: instance, part and winding number.
    fn closed_around(&self, met: &[Met], all: &mut Vec<(u64, u32, i32)>) {
        let mut each: Vec<(u64, u32, Side)> = met.iter().map(|met| self.part_of(met)).collect();
        each.sort_unstable();
        for of_part in each.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (instance, part, _) = of_part[0];
            let model = self.model_of_instance(instance);
            let Some(info) = model.parts().get(part as usize) else { continue };
            let leaves = of_part.iter().filter(|it| it.2 == Side::Back).count() as i32;
            let count = of_part.len() as i32;
            let winding = match (info.is_oriented, info.is_closed) {
                (true, _) => 2 * leaves - count,
                (false, true) => count % 2,
                (false, false) => 0,
            };
            if winding != 0 {
                all.push((instance, part, winding));
            }
        }
    }

    fn part_of(&self, met: &Met) -> (u64, u32, Side) {
        (self.ids_of(met.placed).instance, met.part, met.crossing.side)
    }

    /// Adds the visible parts around a point that are not closed.
    fn open_around(&self, point: DVec3, entrances: &mut Entrances, all: &mut Vec<(u64, u32, i32)>) {
        // A ray of length 0 enters the trees around its origin.
        let ray = Ray { t_max: 0.0, ..Ray::new(point, DIR) };
        entrances.begin(self, &ray);
        let closed = all.len();
        while let Some(placed) = entrances.next(self, &ray) {
            let placed = self.placed(placed);
            let instance = self.state_of(placed.instance);
            let model = &self.models[placed.model as usize];
            let local = self.world_from_model(placed.instance).inverse().transform_point3(point);
            for part in placed.first_part..placed.first_part.saturating_add(model.local_parts(placed.tree)) {
                let Some(info) = model.parts().get(part as usize) else { break };
                let is_around = !info.is_closed && info.triangles > 0 && holds(&info.bounds, local);
                if is_around && !instance.parts.looks.hides(part) {
                    all.push((placed.instance, part, 0));
                }
            }
        }
        // Several trees may have triangles of a part.
        all[closed..].sort_unstable();
        all.dedup();
    }

    fn part_at(&self, instance: u64, part: u32, winding: i32) -> PartAt {
        let id = self.model_of_instance(instance).parts().id(part as usize).unwrap_or(NONE);
        let holds = if winding == 0 { Holds::Undecided } else { Holds::Inside };
        PartAt { instance: self.instance_id(instance), part: id, winding, holds }
    }
}

/// The rays that a function makes of the elements of a slice.
struct Each<'a, T, F>(&'a [T], F);

impl<T: Sync, F: Fn(&T) -> Ray + Sync> Rays for Each<'_, T, F> {
    fn count(&self) -> usize {
        self.0.len()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        out.iter_mut().zip(&self.0[first..]).for_each(|(ray, it)| *ray = (self.1)(it));
    }
}

/// True if a box holds a point, with a tolerance for rounding.
fn holds(bounds: &DBounds, point: DVec3) -> bool {
    let by = bounds.extent().max_element() * BEFORE;
    (bounds.min - by).cmple(point).all() && (bounds.max + by).cmpge(point).all()
}

/// A ray from slightly before a hit straight into the part, and its distance to the hit. `None` for a miss.
fn inward(hit: &Hit) -> Option<(Ray, f64)> {
    if hit.kind == HitKind::Miss {
        return None;
    }
    let size = hit.position.abs().max_element().max(f64::MIN_POSITIVE);
    let before = (size * BEFORE).max(2.0 * f64::from(hit.error));
    let normal = hit.normal.as_dvec3();
    Some((Ray::new(hit.position + normal * before, -hit.normal), before))
}

/// The distance from a hit to the opposite side of its part, given the crossings of its [inward] ray.
fn behind(hit: &Hit, before: f64, met: &[Met]) -> f64 {
    let length = f64::from(hit.normal.length());
    let own = || met.iter().map(|met| &met.crossing).filter(|c| (c.instance, c.part) == (hit.instance, hit.part));
    // The triangle that was hit, or else the crossing nearest to the hit. At its edges the ray may pass it by.
    let is_same = |prim: u64| hit.prim != NONE && prim == hit.prim;
    let off = |t: f64| (t - before).abs();
    let first = own().min_by(|a, b| {
        (!is_same(a.prim), off(a.t)).partial_cmp(&(!is_same(b.prim), off(b.t))).unwrap_or(Ordering::Equal)
    });
    let first = first.filter(|c| is_same(c.prim) || off(c.t) <= before);
    let (begin, side) = first.map_or((before, Side::Front), |c| (c.t, c.side));
    own().find(|c| c.t > begin && c.side != side).map_or(f64::INFINITY, |c| (c.t - begin) * length)
}
