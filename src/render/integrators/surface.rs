//! A surface that a ray of the eye has found, and the rays that leave it for lights.

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
    /// Where rays that leave it begin.
    pub from: DVec3,
    /// Where the ray that sees it goes on behind it.
    pub next: f64,
    /// The ray's width here, pixels of error included: rays that leave it begin as wide.
    pub width: f32,
    /// Up to here from it, rays that leave it look for nothing but triangles.
    pub near: f64,
}

/// How much higher than what it stands for a stand-in's rays begin, as a part of the ray's width: the tops of those
/// beside it are not quite where its own is. (Without, lit planes have up to 1.5 % of false shadow; from a tenth on,
/// none; up to four tenths no light gets into a closed box.)
pub(super) const BESIDE: f64 = 0.125;
/// To gain height a ray is followed back by no more than this many times of it.
const FARTHEST_BACK: f64 = 4.0;
/// The diagonal of a cube that may stand in for a ray of so much width.
pub(super) const DIAGONAL: f32 = 1.732_050_8;

/// A light as a point of a surface sees it.
pub(super) struct Aim {
    /// Unit.
    pub to_light: Vec3,
    /// On a surface that faces it.
    pub irradiance: Vec3,
    pub shadow: Ray,
}

/// `None` where the light does not reach at all, or is a headlight. The shadow ray's `t_min` is [`Surface::near`].
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
            // Where it begins is nearer to the light by a cell, or behind it.
            let way = point - from;
            let t_max = way.length() * (1.0 - 1e-6);
            let shadow =
                Ray { t_min: surface.near.min(t_max), t_max, cone, ..Ray::new(from, way.try_normalize()?.as_vec3()) };
            Some(Aim { to_light, irradiance, shadow })
        }
    }
}

/// Where a ray came by that is as high as `above` the surface of this normal that it sees at `t`: nothing is between
/// the two, so that what begins there is behind no wall.
pub(super) fn back(ray: &Ray, t: f64, normal: Vec3, above: f64) -> DVec3 {
    let dir = ray.dir.as_dvec3();
    let length = dir.length();
    let facing = f64::from(-normal.dot(ray.dir)) / length;
    let by = above / (facing.max(1.0 / FARTHEST_BACK) * length);
    ray.origin + dir * (t - by).max(ray.t_min)
}

/// A ray's width at distance `t`.
pub(super) fn width_at(ray: &Ray, t: f64) -> f32 {
    ray.cone.a + ray.cone.b * t as f32
}
