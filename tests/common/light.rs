//! The oracle's light: coverage, ambient occlusion and direct light over any [`Oracle`], in double precision.
//!
//! Radiance follows the convention of [`outcrop::Light`]: factors of pi are left out, so that a white matt surface that
//! faces a light of irradiance 1 has the value 1. Surfaces are matt (Lambert), two-sided and opaque.

use super::brute::{Oracle, Ray64, Tri};
use super::samples::{Estimate, Samples};
use super::view::View;
use glam::DVec3;
use outcrop::scene::{Light, LightKind};
use std::f64::consts::TAU;

/// A point on a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    pub position: DVec3,
    /// Unit, on the side that is seen.
    pub normal: DVec3,
    /// Unit, to where it is seen from.
    pub to_eye: DVec3,
    pub prim: u32,
}

/// Triangles, and how light reaches them.
pub struct Lighting<'a> {
    oracle: &'a dyn Oracle,
    /// How far above its surface a ray starts.
    leave: f64,
}

impl<'a> Lighting<'a> {
    pub fn new(oracle: &'a dyn Oracle) -> Self {
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in oracle.tris().iter().flatten() {
            (least, most) = (least.min(*corner), most.max(*corner));
        }
        // Far above what rounding moves a hit by (2^-53 of coordinates, a few times), far below anything that is seen.
        let reach = least.abs().max(most.abs()).max_element();
        Self {
            oracle,
            leave: if reach.is_finite() { 1e-10 * (most - least).max_element() + 1e-13 * reach } else { 0.0 },
        }
    }

    /// What a ray (unit) hits first.
    pub fn surface(&self, ray: &Ray64) -> Option<Surface> {
        let hit = self.oracle.closest(ray)?;
        let normal = normal(&self.oracle.tris()[hit.prim as usize]);
        let normal = if normal.dot(ray.dir) > 0.0 { -normal } else { normal };
        Some(Surface { position: ray.at(hit.t), normal, to_eye: -ray.dir, prim: hit.prim })
    }

    /// The share of a pixel's area that anything covers: the mean of V over it, where V is 1 if the ray hits, else 0.
    pub fn coverage(&self, view: &View, x: u32, y: u32, samples: &Samples) -> Estimate {
        let [coverage] = over_pixel(view, x, y, samples, |ray| [f64::from(u8::from(self.oracle.any(&ray)))]);
        coverage
    }

    /// How open the sky above a point is: 1 less ambient occlusion,
    ///
    /// ```text
    /// (1 / pi) integral over the hemisphere of V(w) (n . w) dw
    /// ```
    ///
    /// where V is 0 if something is hit within `reach` (which may be infinite), else 1. The samples are distributed as
    /// the cosine (a disc's points, raised to the hemisphere: Malley's method), which leaves the mean of V.
    pub fn openness(&self, at: &Surface, reach: f64, samples: &Samples, key: u64) -> Estimate {
        let (side, up) = at.normal.any_orthonormal_pair();
        let org = at.position + at.normal * self.leave;
        let [openness] = samples.estimate(key, |[u, v]| {
            let (radius, angle) = (u.sqrt(), TAU * v);
            let dir = side * (radius * angle.cos()) + up * (radius * angle.sin()) + at.normal * (1.0 - u).sqrt();
            [f64::from(u8::from(!self.oracle.any(&Ray64 { t_max: reach, ..Ray64::new(org, dir) })))]
        });
        openness
    }

    /// The light that arrives at a point, as [`outcrop::Light`] defines it: of each light that nothing shades
    ///
    /// ```text
    /// colour * intensity * max(0, n . l)          headlight, directional
    /// colour * intensity * max(0, n . l) / d^2    point
    /// ```
    pub fn irradiance(&self, at: &Surface, lights: &[Light]) -> DVec3 {
        lights.iter().map(|light| self.of_light(at, light)).sum()
    }

    fn of_light(&self, at: &Surface, light: &Light) -> DVec3 {
        let org = at.position + at.normal * self.leave;
        // To the light, how far (a headlight is where the eye is: nothing lies between), and what is left of it there.
        let (way, distance, falloff) = match light.kind {
            LightKind::Headlight => (at.to_eye, 0.0, 1.0),
            LightKind::Directional(along) => (-along.normalize(), f64::INFINITY, 1.0),
            LightKind::Point(position) => {
                let way = position - org;
                (way.normalize(), way.length(), 1.0 / (position - at.position).length_squared())
            }
        };
        let cosine = at.normal.dot(way).max(0.0);
        let shadow = Ray64 { t_max: distance - self.leave, ..Ray64::new(org, way) };
        if cosine == 0.0 || light.shadows && self.oracle.any(&shadow) {
            return DVec3::ZERO;
        }
        let [r, g, b] = light.colour.map(f64::from);
        DVec3::new(r, g, b) * (f64::from(light.intensity) * cosine * falloff)
    }

    /// The mean over a pixel's area of what is seen: of a surface its colour (`colour` of a primitive, linear) times
    /// the [`Lighting::irradiance`], else `background`.
    pub fn radiance(
        &self,
        view: &View,
        [x, y]: [u32; 2],
        lights: &[Light],
        colour: &dyn Fn(u32) -> DVec3,
        background: DVec3,
        samples: &Samples,
    ) -> [Estimate; 3] {
        over_pixel(view, x, y, samples, |ray| {
            let surface = self.surface(&ray);
            surface.map_or(background, |at| colour(at.prim) * self.irradiance(&at, lights)).to_array()
        })
    }
}

/// The means of `of` over the rays through a pixel.
fn over_pixel<const N: usize>(
    view: &View,
    x: u32,
    y: u32,
    samples: &Samples,
    of: impl Fn(Ray64) -> [f64; N],
) -> [Estimate; N] {
    let key = u64::from(y) << 32 | u64::from(x);
    samples.estimate(key, |[u, v]| of(view.ray(f64::from(x) + u, f64::from(y) + v)))
}

/// A triangle's unit normal.
fn normal(tri: &Tri) -> DVec3 {
    (tri[1] - tri[0]).cross(tri[2] - tri[0]).normalize_or_zero()
}
