//! The hit at a pixel, by the same rules as the picture's.

use super::integrators::direct::{LEAVE, is_at_origin};
use crate::base::error::Result;
use crate::math::{Cone, Ray};
use crate::query::{Hit, HitKind, Policy, QueryOptions, Want};
use crate::scene::SceneState;
use crate::scene::walk::{SceneView, SceneWalk, Snapshots, Step};

/// Greatest number of surfaces through the eye that a pick passes.
const MOST_AT_EYE: usize = 1 << 10;

/// Returns the exact hit of a pixel's ray, which begins at the distance `ahead` from the eye. As in pictures, surfaces
/// whose plane goes through the eye are not hit. Blocks; may read the disk.
pub fn pick(scene: &SceneState, ray: &Ray, ahead: f64) -> Result<Hit> {
    let mut ray = Ray { cone: Cone::ZERO, ..*ray };
    let options = QueryOptions { coherent: false, want: Want::ALL, policy: Policy::Exact };
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
    let placed = &scene.placement.placed[found.placed as usize];
    is_at_origin(placed, &triangle, ray).then(|| found.t + placed.extent() * LEAVE)
}
