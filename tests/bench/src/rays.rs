//! The rays that all sides trace. Origins are rounded to single precision, which is all that peers take.

use crate::data::{RayKind, TILE};
use crate::failure::Failure;
use glam::{DVec3, Vec3};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Camera, SceneState};
use std::f64::consts::TAU;

/// Diffuse rays a pixel that a picture would have. They share the hemisphere: each stands for 2 pi / n steradians (Áfra
/// 2012, section 6.2, after Pantaleoni 2010).
const DIFFUSE: f32 = 64.0;

/// Rays and how they are asked.
pub struct Batch {
    pub kind: RayKind,
    /// With the footprint of one pixel of error.
    pub rays: Vec<Ray>,
}

impl Batch {
    /// The rays of a view of `scene`, all of which is in memory. Secondary rays start where exact primary rays end.
    pub fn new(kind: RayKind, scene: &SceneState, camera: &Camera, size: (u32, u32)) -> Result<Self, Failure> {
        let primary = primary(camera, size)?;
        if kind == RayKind::Primary {
            return Ok(Self { kind, rays: primary });
        }
        let mut hits = vec![Hit::MISS; primary.len()];
        let exact: Vec<Ray> = widened(&primary, 0.0);
        let options = QueryOptions { coherent: true, want: Want::POSITION | Want::NORMAL, ..QueryOptions::default() };
        scene.closest(&exact, options, &mut hits)?;
        let light = light(camera);
        let seen = primary.iter().zip(&hits).enumerate().filter(|(_, (_, hit))| hit.kind != HitKind::Miss);
        let rays = seen.map(|(i, (ray, hit))| {
            let width = ray.cone.a + ray.cone.b * hit.t as f32;
            match kind {
                RayKind::Shadow => to_light(hit, width, light),
                _ => bounced(hit, width, i as u64),
            }
        });
        Ok(Self { kind, rays: rays.collect() })
    }

    /// Rays to a sun from where primary rays hit; as wide as their pixels all along.
    pub fn to_sun(primary: &[Ray], hits: &[Hit], sun: Vec3) -> Self {
        let seen = primary.iter().zip(hits).filter(|(_, hit)| hit.kind != HitKind::Miss);
        let rays = seen.map(|(ray, hit)| {
            let cone = Cone { a: ray.cone.a + ray.cone.b * hit.t as f32, b: 0.0 };
            Ray { cone, ..Ray::new(above(hit), sun) }
        });
        Self { kind: RayKind::Shadow, rays: rays.collect() }
    }

    /// Whether any hit will do.
    pub fn is_any(&self) -> bool {
        self.kind == RayKind::Shadow
    }

    /// Whether neighbours are alike.
    pub fn is_coherent(&self) -> bool {
        self.kind != RayKind::Bounce
    }

    /// The rays at so many pixels of error. Secondary ones begin beyond the diagonal of a cube that may stand in where
    /// they start, as the paper lets them (Áfra 2012, section 6.2): else they would meet their own surface.
    pub fn at(&self, poe: f32) -> Vec<Ray> {
        let mut rays = widened(&self.rays, poe);
        if self.kind != RayKind::Primary {
            rays.iter_mut().for_each(|ray| ray.t_min = f64::from(ray.cone.a * 3f32.sqrt()).min(ray.t_max));
        }
        rays
    }
}

/// Rays whose stand-ins may cover so many pixels: a pixel's width times the root of that.
fn widened(rays: &[Ray], poe: f32) -> Vec<Ray> {
    let wide = poe.sqrt();
    rays.iter().map(|ray| Ray { cone: Cone { a: ray.cone.a * wide, b: ray.cone.b * wide }, ..*ray }).collect()
}

/// Through the middles of pixels, in blocks of 4 x 4, each as wide as its pixel.
fn primary(camera: &Camera, (width, height): (u32, u32)) -> Result<Vec<Ray>, Failure> {
    let pixels = camera.prepare(width, height)?;
    let tiles = |length: u32| (0..length).step_by(TILE as usize);
    let corners = tiles(height).flat_map(|y| tiles(width).map(move |x| (x, y)));
    let pixel = |(x, y): (u32, u32)| (0..TILE * TILE).map(move |i| (x + i % TILE, y + i / TILE));
    let ray = |(x, y): (u32, u32)| {
        let ray = pixels.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        Ray { origin: single(ray.origin), ..ray }
    };
    Ok(corners.flat_map(pixel).map(ray).collect())
}

/// As peers have it.
fn single(v: DVec3) -> DVec3 {
    v.as_vec3().as_dvec3()
}

/// Above the eye and to its left, half as far away as what is looked at.
fn light(camera: &Camera) -> DVec3 {
    let (Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. }) = *camera;
    let way = at - eye;
    let right = way.cross(up).normalize_or(DVec3::X);
    eye + (right.cross(way).normalize_or(DVec3::Z) * 0.8 - right * 0.6) * (0.5 * way.length())
}

/// Just above what was hit: a few roundings of the largest number around.
fn above(hit: &Hit) -> DVec3 {
    let size = hit.position.abs().max_element().max(hit.t);
    single(hit.position + hit.normal.as_dvec3() * (size * 1e-5))
}

/// A shadow ray is as wide as its pixel all along, as those of frames are.
fn to_light(hit: &Hit, width: f32, light: DVec3) -> Ray {
    let from = above(hit);
    let way = light - from;
    let t_max = f64::from((0.999 * way.length()) as f32);
    let dir = way.as_vec3().normalize_or(Vec3::Z);
    Ray { t_max, cone: Cone { a: width, b: 0.0 }, ..Ray::new(from, dir) }
}

/// A diffuse ray begins as wide as its pixel, and opens to its share of the hemisphere.
fn bounced(hit: &Hit, width: f32, number: u64) -> Ray {
    let cone = Cone { a: width, b: (std::f32::consts::TAU / DIFFUSE).sqrt() };
    Ray { cone, ..Ray::new(above(hit), over(hit.normal, number)) }
}

/// A direction over the surface with this normal, cosine-weighted, by number.
fn over(normal: Vec3, number: u64) -> Vec3 {
    let mut rng = crate::common::rng::Rng::new(number);
    let (r, (s, c)) = (rng.unit().sqrt(), (TAU * rng.unit()).sin_cos());
    let (u, v) = normal.any_orthonormal_pair();
    let up = (1.0 - r * r).max(0.0).sqrt();
    (u * (r * c) as f32 + v * (r * s) as f32 + normal * up as f32).normalize_or(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_go_in_blocks_of_sixteen() {
        let camera = Camera::Perspective { eye: DVec3::ZERO, at: DVec3::X, up: DVec3::Z, fov_y_degrees: 40.0 };
        let rays = primary(&camera, (8, 8)).expect("rays");
        let pixels = camera.prepare(8, 8).expect("a camera");
        let middle = |x: f64, y: f64| pixels.ray(x + 0.5, y + 0.5).dir;
        assert_eq!(rays.len(), 64);
        assert_eq!([rays[0].dir, rays[3].dir, rays[4].dir], [middle(0.0, 0.0), middle(3.0, 0.0), middle(0.0, 1.0)]);
        assert_eq!([rays[16].dir, rays[32].dir], [middle(4.0, 0.0), middle(0.0, 4.0)]);
    }

    #[test]
    fn bounces_are_over_their_surface() {
        let normal = Vec3::new(0.6, 0.0, -0.8);
        let dirs: Vec<Vec3> = (0..1000).map(|i| over(normal, i)).collect();
        assert!(dirs.iter().all(|d| d.dot(normal) >= 0.0 && (d.length() - 1.0).abs() < 1e-5));
        // The mean cosine of a cosine-weighted hemisphere is 2/3.
        let mean = dirs.iter().map(|d| d.dot(normal)).sum::<f32>() / 1000.0;
        assert!((mean - 2.0 / 3.0).abs() < 0.03, "{mean}");
    }
}
