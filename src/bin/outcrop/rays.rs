//! The rays that `outcrop bench` traces: pixel rays, shadow rays and bounced rays.

use crate::common::Failure;
use glam::{DVec3, Vec3};
use outcrop::math::{Cone, Ray};
use outcrop::query::{Hit, HitKind, QueryOptions, Want};
use outcrop::scene::{Camera, SceneState};
use std::f64::consts::TAU;

/// Edge of the square tiles of pixels that determine the order of rays. Two neighbouring tiles form a packet of 32.
const TILE: u32 = 4;

/// Kind of rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// Through pixel centres, closest hit
    Primary,
    /// From visible points to a sun, any hit
    Shadow,
    /// From visible points into the hemisphere above the surface (cosine-weighted), closest hit
    Bounce,
}

impl Kind {
    /// Returns the name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Primary => "primary",
            Kind::Shadow => "shadow",
            Kind::Bounce => "bounce",
        }
    }

    /// Returns the rays of this kind for a picture of `size` by `camera`.
    pub fn rays(self, scene: &SceneState, camera: &Camera, size: (u32, u32)) -> Result<Vec<Ray>, Failure> {
        let mut primary = primary(camera, size)?;
        primary.iter_mut().for_each(|ray| ray.cone = Cone::ZERO);
        if self == Kind::Primary {
            return Ok(primary);
        }
        let mut hits = vec![Hit::MISS; primary.len()];
        let want = Want::POSITION | Want::NORMAL;
        scene.closest(&primary, QueryOptions { coherent: true, want, ..QueryOptions::default() }, &mut hits)?;
        let sun = Vec3::new(0.35, 0.45, 0.82).normalize();
        let seen = hits.iter().enumerate().filter(|(_, h)| h.kind != HitKind::Miss);
        Ok(seen
            .map(|(i, hit)| {
                let dir = if self == Kind::Shadow { sun } else { over(hit.normal, i as u64) };
                Ray::new(above(hit), dir)
            })
            .collect())
    }
}

/// Returns a point just above the surface at a hit.
fn above(hit: &Hit) -> DVec3 {
    let size = hit.position.abs().max_element().max(hit.t.abs());
    hit.position + hit.normal.as_dvec3() * (size * 1e-6)
}

/// Returns rays through the pixel centres; the cone of each has the width of its pixel.
pub fn primary(camera: &Camera, (width, height): (u32, u32)) -> Result<Vec<Ray>, Failure> {
    let pixels = camera.prepare(width, height)?;
    let mut rays = Vec::with_capacity(width as usize * height as usize);
    for (y, x) in tiles(height).flat_map(|y| tiles(width).map(move |x| (y, x))) {
        for row in y..(y + TILE).min(height) {
            for column in x..(x + TILE).min(width) {
                rays.push(pixels.ray(f64::from(column) + 0.5, f64::from(row) + 0.5));
            }
        }
    }
    Ok(rays)
}

fn tiles(length: u32) -> impl Iterator<Item = u32> {
    (0..length).step_by(TILE as usize)
}

/// Returns a cosine-weighted direction above the surface with this normal, determined by `number`.
fn over(normal: Vec3, number: u64) -> Vec3 {
    let unit = |salt: u64| {
        // SplitMix64.
        let mut x = (number * 2 + salt).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    let (r, (s, c)) = (unit(0).sqrt(), (TAU * unit(1)).sin_cos());
    let (u, v) = normal.any_orthonormal_pair();
    let up = (1.0 - r * r).max(0.0).sqrt();
    (u * (r * c) as f32 + v * (r * s) as f32 + normal * up as f32).normalize_or(normal)
}
