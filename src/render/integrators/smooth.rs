//! Smooth surfaces: shading by the normals of the corners, and the shadow rays of coarse facets.

use super::direct::Direct;
use crate::query::answers::{shading_normal, turned_to, weights, world_corners};
use crate::scene::placed::Placed;
use crate::structure::Triangle;
use glam::{DVec3, Vec3};

/// A point of a triangle whose corners have normals.
pub(super) struct Smooth<'a> {
    pub placed: &'a Placed,
    pub triangle: &'a Triangle,
    /// Normals of the corners in the world.
    pub normals: [Vec3; 3],
    /// Weights of the second and third corner.
    pub uv: [f32; 2],
    /// Unit geometric normal that faces the ray.
    pub facing: Vec3,
}

impl<'a> Smooth<'a> {
    /// A point of a triangle; `normals`: those of the corners in the tree's frame.
    pub fn new(placed: &'a Placed, triangle: &'a Triangle, normals: &[Vec3; 3], uv: [f32; 2], facing: Vec3) -> Self {
        Self { placed, triangle, normals: world_corners(placed, normals), uv, facing }
    }
    /// The unit shading normal.
    pub fn normal(&self, dir: Vec3) -> Vec3 {
        let normal = shading_normal(&self.normals, self.uv, self.facing);
        turned_to(normal, -dir.normalize_or_zero())
    }

    /// Returns the point above `position` from which shadow rays begin: on the surface that the planes across the
    /// corners' normals span, where that is above the triangle. From the triangle itself, the shadows of coarse facets
    /// would end in steps. (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, chapter 4.)
    pub fn raised(&self, position: DVec3) -> DVec3 {
        let mut raise = DVec3::ZERO;
        for ((corner, normal), weight) in self.triangle.vertices.iter().zip(&self.normals).zip(weights(self.uv)) {
            let Some(normal) = normal.try_normalize() else { continue };
            let normal = if normal.dot(self.facing) < 0.0 { -normal } else { normal };
            let above = (position - self.placed.world_point(corner.as_dvec3())).dot(normal.as_dvec3());
            raise -= normal.as_dvec3() * (above.min(0.0) * f64::from(weight));
        }
        position + raise
    }
}

impl Direct<'_> {
    /// Returns the linear colour at a point of a triangle, from the sRGB colours of its corners.
    pub(super) fn mixed(&self, colours: [[u8; 4]; 3], uv: [f32; 2]) -> Option<Vec3> {
        let [a, b, c] = colours;
        if a[3] == 0 {
            return None;
        }
        let linear = |colour: [u8; 4]| Vec3::from(self.srgb.linear(colour));
        if a == b && a == c {
            return Some(linear(a));
        }
        let [x, y, z] = weights(uv);
        Some((linear(a) * x + linear(b) * y + linear(c) * z).max(Vec3::ZERO))
    }
}
