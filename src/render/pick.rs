//! The hit at a pixel, by the same rules as the picture's.

use super::integrators::direct::{LEAVE, is_at_origin};
use crate::base::error::Result;
use crate::math::{Cone, Ray};
use crate::query::{Hit, HitKind, Policy, QueryOptions, Want};
use crate::scene::SceneState;
use crate::scene::camera::PixelRays;
use crate::scene::walk::{SceneView, SceneWalk, Snapshots, Step};
use glam::DVec2;
use std::collections::HashSet;

/// Greatest number of surfaces through the eye that a pick passes.
const MOST_AT_EYE: usize = 1 << 10;

/// Returns the exact hit of a pixel's ray, which begins at the distance `ahead` from the eye. As in pictures, surfaces
/// whose plane goes through the eye are not hit. Blocks; may read the disk.
pub fn pick(scene: &SceneState, ray: &Ray, ahead: f64) -> Result<Hit> {
    let mut ray = Ray { cone: Cone::ZERO, ..*ray };
    let want = Want::ALL | Want::SHADING_NORMAL;
    let options = QueryOptions { coherent: false, want, policy: Policy::Exact };
    let mut hit = [Hit::MISS];
    for _ in 0..MOST_AT_EYE {
        scene.closest(&[ray], options, &mut hit)?;
        if ahead != 0.0 || hit[0].kind != HitKind::Exact {
            break;
        }
        match behind_eye(scene, &ray) {
            Some(t_min) if t_min > ray.t_min => ray.t_min = t_min,
            _ => break,
        }
    }
    Ok(Hit { t: hit[0].t + ahead, t_free: hit[0].t_free + ahead, ..hit[0] })
}

/// Where the picture's ray goes on, if the surface that it hits goes through its origin. `None` if it does not, or if
/// its blocks, which were just read, are gone again.
fn behind_eye(scene: &SceneState, ray: &Ray) -> Option<f64> {
    let snapshots = Snapshots::take(scene);
    let view = SceneView::new(scene, &snapshots, scene.context().residency().now());
    let mut walk = SceneWalk::default();
    walk.begin(&view, ray);
    if view.trace::<false>(ray, &mut walk) != Step::Done {
        return None;
    }
    let found = walk.best();
    if !found.is_hit() {
        return None;
    }
    let (triangle, _) = view.triangle(&found).ok()?;
    let placed = scene.placed(found.placed());
    is_at_origin(&placed, &triangle.vertices, ray.origin).then(|| found.t + placed.extent() * LEAVE)
}
/// Greatest radius of [`pick_near`], in pixels.
pub const MOST_RADIUS: f64 = 32.0;
/// Rays for each pixel besides the one through its centre.
const MORE: u32 = 6;
/// A part is thin if it covers a smaller share of the picture around it.
const THIN: f64 = 0.2;

/// A ray within a pick's surroundings.
struct Sample {
    /// Place in the picture, relative to the centre of the picked pixel.
    at: DVec2,
    ray: Ray,
    ahead: f64,
    hit: Hit,
}

impl Sample {
    /// The instance and the part that it shows; `None` for a miss.
    fn part(&self) -> Option<(u64, u64)> {
        (self.hit.kind != HitKind::Miss).then_some((self.hit.instance, self.hit.part))
    }
}

/// Returns the hit at a pixel or, if there is a thin part within `radius` pixels of its centre, a hit of that. See
/// [`super::Frame::pick_near`].
pub fn pick_near(
    scene: &SceneState,
    rays: &PixelRays,
    size: (u32, u32),
    pixel: (u32, u32),
    radius: f64,
) -> Result<Hit> {
    // A part is measured within the radius of its own sample, so the surroundings have twice the radius.
    let mut samples = around(scene, rays, size, pixel, 2.0 * radius);
    let traced: Vec<Ray> = samples.iter().map(|s| Ray { cone: Cone::ZERO, ..s.ray }).collect();
    let mut hits = vec![Hit::MISS; traced.len()];
    let want = Want::PART | Want::INSTANCE;
    scene.closest(&traced, QueryOptions { coherent: true, want, policy: Policy::Exact }, &mut hits)?;
    samples.iter_mut().zip(hits).for_each(|(sample, hit)| sample.hit = hit);
    let chosen = &samples[choose(&samples, radius)];
    pick(scene, &chosen.ray, chosen.ahead)
}

/// The rays around a pixel that are in the picture: first the one through its centre.
fn around(scene: &SceneState, rays: &PixelRays, size: (u32, u32), pixel: (u32, u32), radius: f64) -> Vec<Sample> {
    // Multiples of the golden ratio are spread evenly: along each row the samples differ in height, along each column
    // they differ across, so that wires of a tenth of a pixel do not pass between them.
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let bounds = scene.bounds_of_hits();
    let centre = DVec2::new(f64::from(pixel.0) + 0.5, f64::from(pixel.1) + 0.5);
    let reach = radius.ceil() as u32;
    let range = |at: u32, end: u32| at.saturating_sub(reach)..at.saturating_add(reach + 1).min(end);
    let sample = |place: DVec2| {
        let (ray, ahead) = rays.ray_from(place.x, place.y, &bounds);
        Sample { at: place - centre, ray, ahead, hit: Hit::MISS }
    };
    let mut samples = vec![sample(centre)];
    let side = f64::from(2 * reach + 1);
    for y in range(pixel.1, size.1) {
        for x in range(pixel.0, size.0) {
            for i in 0..=MORE {
                let (row, column) = (f64::from(y) * side + f64::from(x), f64::from(x) * side + f64::from(y));
                let number = |index: f64| index * f64::from(MORE) + f64::from(i);
                let offset = match i {
                    MORE => DVec2::splat(0.5),
                    _ => DVec2::new((number(column) * GOLDEN).fract(), (number(row) * GOLDEN).fract()),
                };
                let place = DVec2::new(f64::from(x), f64::from(y)) + offset;
                if place.distance(centre) <= radius && place != centre {
                    samples.push(sample(place));
                }
            }
        }
    }
    samples
}

/// Returns the index of the chosen sample; the first one is that of the pixel itself.
fn choose(samples: &[Sample], radius: f64) -> usize {
    let mut order: Vec<usize> = (0..samples.len()).filter(|&i| samples[i].at.length() <= radius).collect();
    let distance = |i: &usize| (samples[*i].at.length(), samples[*i].hit.t + samples[*i].ahead);
    order.sort_by(|a, b| {
        let (a, b) = (distance(a), distance(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut seen = HashSet::new();
    // The nearest sample of each part comes first.
    let nearest: Vec<usize> =
        order.into_iter().filter(|&i| samples[i].part().is_some_and(|part| seen.insert(part))).collect();
    let is_thin = |&i: &usize| {
        let near = samples.iter().filter(|s| s.at.distance(samples[i].at) <= radius);
        let (all, own) = near
            .fold((0.0, 0.0), |(all, own), s| (all + 1.0, own + f64::from(u8::from(s.part() == samples[i].part()))));
        own < THIN * all
    };
    let thin = nearest.iter().copied().find(is_thin);
    let is_miss = samples[0].part().is_none();
    thin.or(nearest.first().copied().filter(|_| is_miss)).unwrap_or(0)
}
