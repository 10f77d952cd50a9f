//! Normals with which hits are shaded: interpolated between the corners of the triangle.

use crate::scene::placed::Placed;
use glam::Vec3;

/// Weights of a triangle's corners, from those of the second and third.
#[inline(always)]
pub(crate) fn weights([u, v]: [f32; 2]) -> [f32; 3] {
    [1.0 - u - v, u, v]
}

/// Returns the unit shading normal in the world, on the side of `facing`, the unit geometric normal that faces the ray.
/// `normals`: those of the corners in the tree's frame.
#[inline]
pub(crate) fn shading_normal(placed: &Placed, normals: &[Vec3; 3], uv: [f32; 2], facing: Vec3) -> Vec3 {
    let [a, b, c] = weights(uv);
    let mixed = normals[0] * a + normals[1] * b + normals[2] * c;
    // Corners whose normals are opposite have no mean.
    let unit = world_unit(placed, mixed).unwrap_or(facing);
    if unit.dot(facing) < 0.0 { -unit } else { unit }
}

/// Returns the unit vector of a normal of the tree's frame in the world.
#[inline]
pub(crate) fn world_unit(placed: &Placed, normal: Vec3) -> Option<Vec3> {
    if placed.only_shifted().is_some() {
        return normal.try_normalize();
    }
    placed.world_normal(normal.as_dvec3()).try_normalize().map(|n| n.as_vec3())
}
