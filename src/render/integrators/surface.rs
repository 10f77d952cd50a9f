//! A surface that a camera ray has hit, and the rays that leave it towards lights.

use super::direct::{Direct, LEAVE, is_at_origin};
use super::first::Layer;
use super::material::Material;
use super::smooth::Smooth;
use crate::lod::Facing;
use crate::math::{Cone, Ray};
use crate::query::answers::{WorldNormal, meet};
use crate::query::stand_in::{self, Look};
use crate::query::{HitKind, NONE};
use crate::render::wants::Wants;
use crate::scene::Light;
use crate::scene::light::LightKind;
use crate::scene::walk::{Found, Need};
use crate::structure::Triangle;
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

impl Direct<'_> {
    /// Returns the surface of a hit; `None` if it goes through the ray's origin (see [`AT_EYE`]). If `seen` is given,
    /// stores the requested data of the first surface in it. `ahead`: distance from the eye at which the ray begins.
    #[inline(never)]
    pub(super) fn surface(
        &self,
        ray: &Ray,
        ahead: f64,
        found: &Found,
        seen: Option<&mut Layer>,
        wants: &mut Wants,
    ) -> Result<Option<Surface>, Need> {
        if let Some(look) = stand_in::look(&self.view, ray, found) {
            return self.stand_in(ray, ahead, found, &look, seen, wants).map(Some);
        }
        let placed = &self.view.scene.placement.placed[found.placed as usize];
        let need = |block| Need { model: placed.model, block };
        let (triangle, part) = self.view.triangle(found)?;
        if ahead == 0.0 && is_at_origin(placed, &triangle, ray) {
            return Ok(None);
        }
        let tree = self.view.tree(found.placed);
        let normal = WorldNormal::new(placed, &triangle.vertices).facing(ray.dir);
        let uv = [found.tri.u, found.tri.v];
        let mut lacks = false;
        let normals = match tree.normals(&found.tri) {
            Ok(normals) => normals,
            Err(block) => {
                lacks = true;
                self.later(need(block), wants).map(|()| None)?
            }
        };
        let own = || match tree.colours(&found.tri) {
            Ok(colours) => Ok(colours.and_then(|colours| self.mixed(colours, uv))),
            Err(block) => {
                lacks = true;
                self.later(need(block), wants).map(|()| None)
            }
        };
        let material = self.material(found.placed, part, own)?;
        let smooth = normals.map(|normals| Smooth::new(placed, &triangle, &normals, uv, normal));
        let shading = smooth.as_ref().map_or(normal, |smooth| smooth.normal(ray.dir));
        if let Some(seen) = seen {
            // The place is exact, but the light is not yet.
            seen.kind = if lacks { HitKind::Missing } else { HitKind::Exact };
            (seen.normal, seen.shading_normal) = (normal.into(), shading.into());
            if self.asks.precise {
                self.measure(ray, ahead, found, &triangle, seen);
            }
            if self.asks.ids {
                (seen.part, seen.instance) = self.ids(found.placed, part);
            }
            if self.asks.prims {
                seen.prim = match tree.prim(&found.tri) {
                    Ok(prim) => prim.map_or(NONE, u64::from),
                    Err(block) => self.later(need(block), wants).map(|()| NONE)?,
                };
            }
        }
        let leave = placed.extent() * LEAVE;
        let position = ray.origin + ray.dir.as_dvec3() * found.t;
        let width = width_at(ray, found.t);
        // Adjacent stand-ins of the same surface protrude from it. (Áfra 2012, section 6.2, begins rays behind them, in
        // the open. Here the near range is tested against triangles, so that rays skip no wall. Under pressure it is
        // not, because that would need more blocks when fewer fit.)
        let near = if self.is_pressed { 0.0 } else { f64::from(width * DIAGONAL) };
        let seen_from = if self.is_pressed { back(ray, found.t, normal, BESIDE * f64::from(width)) } else { position };
        let raised = if self.casts() { smooth.map_or(seen_from, |smooth| smooth.raised(seen_from)) } else { seen_from };
        let from = raised + normal.as_dvec3() * leave;
        let facing = Facing::flat(shading);
        Ok(Some(Surface { position, normal: shading, facing, material, from, next: found.t + leave, width, near }))
    }

    /// Computes depth and error of a triangle's hit in double precision.
    #[inline(never)]
    fn measure(&self, ray: &Ray, ahead: f64, found: &Found, triangle: &Triangle, seen: &mut Layer) {
        let placed = &self.view.scene.placement.placed[found.placed as usize];
        let meeting = meet(placed, &triangle.vertices, ray, found.t);
        seen.depth = self.depth(ray, meeting.t + ahead);
        seen.error = meeting.error(placed, ray);
        seen.error_px = (f64::from(seen.error) / self.rays.pixel_width(meeting.t + ahead)) as f32;
    }

    /// Returns the surface of a stand-in. Its shadow rays begin on the camera ray, above the stand-in's cell and above
    /// adjacent cells if the surface continues evenly. (Áfra 2012, section 6.2, begins them a cell's diagonal towards
    /// the light, which may be behind a nearer wall.)
    #[inline(never)]
    fn stand_in(
        &self,
        ray: &Ray,
        ahead: f64,
        found: &Found,
        look: &Look,
        seen: Option<&mut Layer>,
        wants: &mut Wants,
    ) -> Result<Surface, Need> {
        let scene = self.view.scene;
        let placed = &scene.placement.placed[found.placed as usize];
        let along = ray.dir.as_dvec3() * look.t;
        let wanted = self.view.wanted(found);
        if wanted.is_some() || seen.is_some() {
            let error = look.error();
            let error_px = self.in_pixels(error, look.t + ahead);
            if let Some(need) = wanted {
                wants.add(need, error_px.min(1e6));
            }
            if let Some(seen) = seen {
                seen.kind = if look.is_missing() { HitKind::Missing } else { HitKind::Lod };
                (seen.normal, seen.shading_normal) = (look.normal().into(), look.normal().into());
                (seen.error, seen.error_px) = (error, error_px);
                seen.depth = self.depth(ray, look.t + ahead);
                if self.asks.ids {
                    (seen.part, seen.instance) = self.ids(found.placed, look.part());
                }
            }
        }
        let mut material = self.material(found.placed, look.part(), || Ok(None))?;
        if let Some(colour) = look.colour().filter(|_| !self.recoloured(found.placed, look.part())) {
            material.colour = colour;
        }
        let (position, width) = (ray.origin + along, width_at(ray, look.t));
        // `above` is needed only if lights cast shadows, `leave` only if the ray continues.
        let extent = placed.extent() * LEAVE;
        let above = if self.casts() { look.above() } else { 0.0 };
        let from =
            back(ray, look.t, look.normal(), above + BESIDE * f64::from(width)) + look.normal().as_dvec3() * extent;
        let next = if material.opacity < 1.0 { look.leave() } else { look.t } + extent;
        Ok(Surface { position, normal: look.normal(), facing: look.facing(), material, from, next, width, near: 0.0 })
    }
}
