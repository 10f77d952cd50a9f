//! Calls for one or two rays, answered in the caller's thread. Hosts make such calls from many threads at once. After a
//! thread's first call this path allocates no heap memory. Of the memory that threads share it writes only the
//! last-used stamps of blocks, each once after a pass. (In scenes of more than seven models the snapshots are
//! reference-counted: `arc_swap` gives each thread only eight uncounted loads.) The batch path takes over if a ray
//! lacks a block or needs a second walk.

use super::answers::{Seen, answer_one_in, missed};
use super::batch::{Hits, Rays};
use super::beyond::is_early;
use super::chunk::Task;
use super::hit::Hit;
use crate::base::error::Result;
use crate::math::Ray;
use crate::scene::SceneState;
use crate::scene::walk::{SceneView, SceneWalk, Snapshots};
use std::cell::Cell;

/// The most rays of such a call: three single walks take longer than one packet.
pub(super) const ALONE: usize = 2;

/// Memory that a thread keeps from call to call, without any content.
#[derive(Default)]
struct Kept {
    walk: SceneWalk,
    snapshots: Snapshots,
    seen: Seen<1>,
}

thread_local! {
    static KEPT: Cell<Option<Box<Kept>>> = const { Cell::new(None) };
}

/// Answers up to [`ALONE`] rays: calls `put` with the index and the hit of each. Returns false if the batch path must
/// answer them; some may have been put then.
#[inline]
pub(super) fn answer(scene: &SceneState, task: Task, rays: &[Ray], mut put: impl FnMut(usize, &Hit)) -> Result<bool> {
    scene.context().pool().here(|| {
        // The thread-local is gone while the thread ends.
        let kept = KEPT.try_with(Cell::take).ok().flatten();
        let mut kept = kept.unwrap_or_else(|| Box::new(Kept::default()));
        let Kept { walk, snapshots, seen } = &mut *kept;
        snapshots.lend(scene);
        // A new stamp would be written to every block that the rays visit.
        let stamp = scene.context().residency().now();
        let view = task.view(scene, snapshots, stamp);
        let is_done = rays.iter().enumerate().all(|(i, ray)| {
            let ray = Ray { cone: ray.cone.or_zero(), ..*ray };
            let mut hit = Hit::MISS;
            let is_done = one(&view, task, &ray, (walk, seen), &mut hit);
            if is_done {
                put(i, &hit);
            }
            is_done
        });
        snapshots.clear();
        let _ = KEPT.try_with(|place| place.set(Some(kept)));
        Ok(is_done)
    })
}

/// [`answer`] from any source of rays to any taker of hits.
pub(super) fn answer_from(scene: &SceneState, task: Task, rays: &dyn Rays, hits: &dyn Hits) -> Result<bool> {
    let count = rays.count().min(ALONE);
    let (mut two, mut answers) = ([Ray::NONE; ALONE], [Hit::MISS; ALONE]);
    rays.read(0, &mut two[..count]);
    let is_done = answer(scene, task, &two[..count], |i, hit| answers[i] = *hit)?;
    if is_done {
        hits.write(0, &answers[..count]);
    }
    Ok(is_done)
}

/// Answers one ray; returns false if a block is missing or the ray needs a second walk.
fn one(view: &SceneView, task: Task, ray: &Ray, (walk, seen): (&mut SceneWalk, &mut Seen<1>), hit: &mut Hit) -> bool {
    let found = if task.any { view.trace_at_once::<true>(ray, walk) } else { view.trace_at_once::<false>(ray, walk) };
    let Some(found) = found else { return false };
    if is_early(view, ray, &found) {
        return false;
    }
    if !found.is_hit() {
        *hit = missed(view, ray, &found, task.want);
        return true;
    }
    matches!(answer_one_in(seen, view, ray, &found, task.want, hit), Ok(true))
}
