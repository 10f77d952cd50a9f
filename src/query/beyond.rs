//! Second walks for rays that need more than their first walk: the hit within a ray's exact interval.

use super::answers::{answer_one, is_within, meet, missed};
use super::hit::{Hit, Want};
use crate::math::Ray;
use crate::scene::SceneState;
use crate::scene::walk::{Ends, Found, Need, SceneView, SceneWalk, Step};
use crate::structure::Triangle;
use std::fmt;

/// Begins a walk for [`past`].
#[cold]
pub(super) fn begin_past(view: &SceneView, ray: &Ray) -> SceneWalk {
    let mut walk = SceneWalk::default();
    walk.begin(view, ray);
    walk
}

/// True if the ray entered a stand-in before its `t_min`: the triangles below it were not tested, and some may lie
/// within the interval.
#[inline(always)]
pub(super) fn is_early(view: &SceneView, ray: &Ray, found: &Found) -> bool {
    view.widen_interval && found.first_cell.t < ray.t_min
}

/// Continues the walk of a ray whose first walk found a hit, or entered a stand-in, outside of its interval. This walk
/// tests each hit in double precision, and fills `found` and `hit` with the first hit within the interval, or with any
/// such hit if `any`. Fails with the block that the walk needs to continue. Typical rays begin at a surface, to peel
/// off layer after layer, or end there.
#[cold]
pub(super) fn past(
    view: &SceneView,
    any: bool,
    ray: &Ray,
    walk: &mut SceneWalk,
    want: Want,
    found: &mut Found,
    hit: &mut Hit,
) -> Result<(), Need> {
    let judge = Judge { scene: view.scene, ray };
    let view = SceneView { within: Some(&judge), ..*view };
    let step = if any { view.trace::<true>(ray, walk) } else { view.trace::<false>(ray, walk) };
    if let Step::Pending(need) = step {
        return Err(need);
    }
    *found = walk.best();
    *hit = missed(&view, ray, found, want);
    if found.is_hit() {
        let is_within = answer_one(&view, ray, found, want, hit)?;
        debug_assert!(is_within, "{ray:?}: {found:?}");
    }
    Ok(())
}

/// Accepts the hits within a ray's interval, by the same test as [`answer_one`].
struct Judge<'a> {
    scene: &'a SceneState,
    ray: &'a Ray,
}

impl fmt::Debug for Judge<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.ray.fmt(f)
    }
}

impl Ends for Judge<'_> {
    fn triangle(&self, placed: u64, triangle: &Triangle, t: f64) -> bool {
        is_within(self.ray, meet(&self.scene.placed(placed), &triangle.vertices, self.ray, t).t)
    }
    fn cell(&self, t: f64) -> bool {
        is_within(self.ray, t)
    }
    fn is_beyond(&self, t: f64) -> bool {
        t > self.ray.t_max
    }
}
