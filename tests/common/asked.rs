//! Rays around something, and what a scene answers.

use super::rng::Rng;
use glam::DVec3;
use outcrop::math::Ray;
use outcrop::query::{Hit, QueryOptions};
use outcrop::scene::SceneState;

/// From near and far to points within `radius` of `center`; any length of direction.
pub fn rays(count: usize, seed: u64, center: DVec3, radius: f64) -> Vec<Ray> {
    let mut rng = Rng::new(seed);
    (0..count)
        .map(|_| {
            let from = center + rng.direction() * radius * rng.between(0.1, 4.0);
            let to = center + rng.direction() * radius * rng.unit();
            Ray::new(from, (to - from).as_vec3() * rng.between(0.1, 3.0) as f32)
        })
        .collect()
}

/// The closest hits.
pub fn ask(scene: &SceneState, rays: &[Ray], options: QueryOptions) -> Vec<Hit> {
    let mut hits = vec![Hit::MISS; rays.len()];
    scene.closest(rays, options, &mut hits).expect("hits");
    hits
}
