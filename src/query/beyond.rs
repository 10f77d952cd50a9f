//! Second walks of rays whose first walk does not tell all: what is within a ray's interval, and how far the ray is
//! free.

use super::answers::{answer_one, is_within, meet};
use super::hit::{Hit, Want};
use crate::math::Ray;
use crate::scene::placed::Placed;
use crate::scene::walk::{Ends, Found, Need, SceneView, SceneWalk, Step};
use crate::structure::Triangle;

/// A walk for [`past`].
#[cold]
pub(super) fn begin_past(view: &SceneView, ray: &Ray) -> SceneWalk {
    let mut walk = SceneWalk::default();
    walk.begin(view, ray);
    walk
}

/// Whether a ray passed a cell before it begins: some of the cell's content may be behind the begin, and the walk has
/// not looked at it.
#[inline(always)]
pub(super) fn is_early(view: &SceneView, ray: &Ray, found: &Found) -> bool {
    view.widen_interval && found.transmitted < ray.t_min
}

/// Goes on with the walk of a ray that found, or passed, something outside of its interval, each hit now seen in double
/// precision, and fills `found` and `hit` with the first within (`any`: with any); fails with the block that is needed
/// to go on again. (Rays that begin right at a surface, to peel off layer after layer, or end there.)
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
    *hit = Hit::MISS;
    let judge = Judge { placed: &view.scene.placement.placed, ray };
    let view = SceneView { within: Some(&judge), ..*view };
    let step = if any { view.trace::<true>(ray, walk) } else { view.trace::<false>(ray, walk) };
    if let Step::Pending(need) = step {
        return Err(need);
    }
    *found = walk.best();
    if found.is_hit() {
        let is_within = answer_one(&view, ray, found, want, hit)?;
        debug_assert!(is_within, "{ray:?}: {found:?}");
    }
    Ok(())
}

/// Which hits are within a ray's interval, as [`answer_one`] sees it.
#[derive(Debug)]
struct Judge<'a> {
    placed: &'a [Placed],
    ray: &'a Ray,
}

impl Ends for Judge<'_> {
    fn triangle(&self, placed: u32, triangle: &Triangle, t: f64) -> bool {
        is_within(self.ray, meet(&self.placed[placed as usize], &triangle.vertices, self.ray, t).t)
    }
    fn cell(&self, t: f64) -> bool {
        is_within(self.ray, t)
    }
    fn is_beyond(&self, t: f64) -> bool {
        t > self.ray.t_max
    }
}

/// A walk for [`free`].
#[cold]
pub(super) fn begin_free(view: &SceneView, ray: &Ray) -> SceneWalk {
    let mut walk = SceneWalk::default();
    walk.begin(&solid(view), ray);
    walk
}

/// With stand-ins that no ray passes. What is a little before a ray begins is not to count as the first on it.
fn solid<'a>(view: &SceneView<'a>) -> SceneView<'a> {
    SceneView { opaque_cells: true, widen_interval: false, ..*view }
}

/// Goes on with the walk of a ray that passed stand-ins, now passing none, and takes `t_free` down to where it hits;
/// fails with the block that is needed to go on again.
#[cold]
pub(super) fn free(view: &SceneView, ray: &Ray, walk: &mut SceneWalk, hit: &mut Hit) -> Result<(), Need> {
    let view = solid(view);
    if let Step::Pending(need) = view.trace::<false>(ray, walk) {
        return Err(need);
    }
    let (found, mut first) = (walk.best(), Hit::MISS);
    if found.is_hit() {
        answer_one(&view, ray, &found, Want::ERROR, &mut first)?;
    }
    hit.t_free = hit.t_free.min(first.t_free);
    Ok(())
}
