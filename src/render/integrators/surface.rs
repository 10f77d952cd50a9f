//! A surface that a camera ray has hit, and the rays that leave it towards lights.

use super::material::Material;
use crate::lod::Facing;
use crate::math::{Cone, Ray};
use crate::scene::Light;
use crate::scene::light::LightKind;
use glam::{DVec3, Vec3};

/// A surface that was hit.
pub(super) struct Surface {
    pub position: DVec3,
    pub normal: Vec3,
    pub facing: Facing,
    pub material: Material,
    /// Origin of the rays that leave the surface.
    pub from: DVec3,
    /// `t` at which the camera ray continues behind the surface.
    pub next: f64,
    /// Width of the camera ray at the hit, pixels of error included. Rays that leave the surface begin with this width.
    pub width: f32,
    /// Distance from `from` up to which rays that leave the surface test only triangles, no stand-ins.
    pub near: f64,
}

/// Height at which a stand-in's rays begin above the surface that it replaces, as a fraction of the ray's width. The
/// tops of adjacent stand-ins are not at exactly the same height. (With 0, lit planes have up to 1.5 % of false shadow;
/// from 0.1 on, none. Up to 0.4, no light enters a closed box.)
pub(super) const BESIDE: f64 = 0.125;
/// Longest way back along a ray to gain height, as a multiple of that height.
const FARTHEST_BACK: f64 = 4.0;
/// Diagonal of a cube that may stand in for a ray of width 1.
pub(super) const DIAGONAL: f32 = 1.732_050_8;

/// A light as seen from a point of a surface.
pub(super) struct Aim {
    /// Unit vector.
    pub to_light: Vec3,
    /// Irradiance on a surface that faces the light.
    pub irradiance: Vec3,
    pub shadow: Ray,
}

/// Returns the direction, the irradiance and the shadow ray of a light on a surface; `None` if the light does not reach
/// the surface at all, or is a headlight. The shadow ray's `t_min` is [`Surface::near`].
pub(super) fn aim(light: &Light, surface: &Surface) -> Option<Aim> {
    let strength = Vec3::from(light.colour) * light.intensity;
    let from = surface.from;
    let cone = Cone { a: surface.width, b: 0.0 };
    match light.kind {
        LightKind::Headlight => None,
        LightKind::Directional(dir) => {
            let to_light = -dir.try_normalize()?.as_vec3();
            Some(Aim {
                to_light,
                irradiance: strength,
                shadow: Ray { cone, t_min: surface.near, ..Ray::new(from, to_light) },
            })
        }
        LightKind::Point(point) => {
            let way = point - surface.position;
            let to_light = way.try_normalize()?.as_vec3();
            let irradiance = strength * (1.0 / way.length_squared()).min(1e30) as f32;
            // The origin of the shadow ray is up to a cell nearer to the light than the surface, or even behind the
            // light.
            let way = point - from;
            let t_max = way.length() * (1.0 - 1e-6);
            let shadow =
                Ray { t_min: surface.near.min(t_max), t_max, cone, ..Ray::new(from, way.try_normalize()?.as_vec3()) };
            Some(Aim { to_light, irradiance, shadow })
        }
    }
}

/// Returns the point on the ray at height `above` over the surface with this normal that it sees at `t`. Nothing lies
/// between this point and the surface, so an origin there is behind no wall. [`FARTHEST_BACK`] and `t_min` limit the
/// way.
pub(super) fn back(ray: &Ray, t: f64, normal: Vec3, above: f64) -> DVec3 {
    let dir = ray.dir.as_dvec3();
    let length = dir.length();
    let facing = f64::from(-normal.dot(ray.dir)) / length;
    let by = above / (facing.max(1.0 / FARTHEST_BACK) * length);
    ray.origin + dir * (t - by).max(ray.t_min)
}

/// Returns the width of a ray at distance `t`.
pub(super) fn width_at(ray: &Ray, t: f64) -> f32 {
    ray.cone.a + ray.cone.b * t as f32
}
