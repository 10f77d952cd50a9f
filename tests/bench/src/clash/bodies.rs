//! The bodies of a scene as peers take them: pairs of triangles of two bodies are sought.

use crate::common::scenes;
use glam::{DAffine3, DVec3, Vec3};
use outcrop::math::Bounds;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};
use std::collections::BTreeMap;

/// A pair of triangles, by their indices over all bodies; the lesser one first.
pub type Pair = [u32; 2];

/// Some of a scene's triangles, where they are placed.
#[derive(Default)]
pub struct Body {
    /// Corners as exact arithmetic takes them.
    pub corners: Vec<[DVec3; 3]>,
    /// Index over all bodies of each triangle.
    pub ids: Vec<u32>,
}

pub struct Bodies {
    pub each: Vec<Body>,
    /// Number of triangles of all.
    pub triangles: usize,
}

impl Bodies {
    /// A body for each part of some triangles.
    pub fn of_parts(all: &[[DVec3; 3]], parts: &[u32]) -> Self {
        let mut each: BTreeMap<u32, Body> = BTreeMap::new();
        for ((id, corners), part) in (0..).zip(all).zip(parts) {
            // Builds leave out what has no area: a segment or a point is no surface.
            if scenes::has_area(corners) {
                each.entry(*part).or_default().push(id, *corners);
            }
        }
        Self { each: each.into_values().collect(), triangles: all.len() }
    }

    /// A body for each place of some triangles.
    pub fn of_places(all: &[[DVec3; 3]], places: &[DAffine3]) -> Self {
        let count = all.len();
        let body = |(place, first): (&DAffine3, usize)| {
            let mut body = Body::default();
            for (i, corners) in all.iter().enumerate() {
                if scenes::has_area(corners) {
                    body.push((first + i) as u32, corners.map(|p| place.transform_point3(p)));
                }
            }
            body
        };
        Self {
            each: places.iter().zip((0..).step_by(count.max(1))).map(body).collect(),
            triangles: count * places.len(),
        }
    }

    /// The corners of each triangle, by its index.
    pub fn corners(&self) -> Vec<[DVec3; 3]> {
        let mut all = vec![[DVec3::ZERO; 3]; self.triangles];
        for body in &self.each {
            body.ids.iter().zip(&body.corners).for_each(|(id, corners)| all[*id as usize] = *corners);
        }
        all
    }

    /// The pairs of bodies whose boxes overlap, found by parry3d's tree of boxes. Part of what peers are timed at.
    pub fn near(boxes: &Bvh, out: &mut Vec<[u32; 2]>) {
        out.clear();
        let mut take = |a: u32, b: u32| out.push([a.min(b), a.max(b)]);
        boxes.traverse_bvtt_single_tree::<false>(&mut BvhWorkspace::default(), &mut take);
        out.sort_unstable();
    }

    /// A tree of the boxes of all bodies.
    pub fn tree(&self) -> Bvh {
        let of = |body: &Body| {
            let boxes = body.corners.iter().map(bounds).fold(Bounds::EMPTY, |all, one| all.union(one));
            let [min, max] = [boxes.min, boxes.max].map(|v| Vector::new(v.x, v.y, v.z));
            Aabb::new(min, max)
        };
        Bvh::from_leaves(BvhBuildStrategy::default(), &self.each.iter().map(of).collect::<Vec<_>>())
    }
}

impl Body {
    fn push(&mut self, id: u32, corners: [DVec3; 3]) {
        self.ids.push(id);
        self.corners.push(corners);
    }
}

/// The box of a triangle in single precision, rounded outward.
pub fn bounds([a, b, c]: &[DVec3; 3]) -> Bounds {
    let (low, high) = (a.min(*b).min(*c), a.max(*b).max(*c));
    let below = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    let above = |x: f64| if f64::from(x as f32) < x { (x as f32).next_up() } else { x as f32 };
    Bounds {
        min: Vec3::new(below(low.x), below(low.y), below(low.z)),
        max: Vec3::new(above(high.x), above(high.y), above(high.z)),
    }
}
