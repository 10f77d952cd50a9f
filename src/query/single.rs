//! Calls for one or two rays, answered in the caller's thread. Hosts make such calls from many threads at once. After a
//! thread's first call this path allocates no heap memory. Of the memory that threads share it writes only the
//! last-used stamps of blocks, each once after a pass. (In scenes of more than seven models the snapshots are
//! reference-counted: `arc_swap` gives each thread only eight uncounted loads.) The batch path takes over if a ray
//! lacks a block or needs a second walk.

use super::answers::{Seen, answer_one_in};
use super::batch::{Hits, Rays};
use super::beyond::is_early;
use super::chunk::{Task, trace};
use super::hit::{Hit, Want};
use crate::base::error::Result;
use crate::math::Ray;
use crate::scene::SceneState;
use crate::scene::walk::{SceneView, SceneWalk, Snapshots, Step};
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

/// Answers up to [`ALONE`] rays. Returns false, and writes nothing, if the batch path must answer them.
pub(super) fn answer(scene: &SceneState, task: Task, rays: &dyn Rays, hits: &dyn Hits) -> Result<bool> {
    let count = rays.count().min(ALONE);
    scene.context().pool().here(|| {
        // The thread-local is gone while the thread ends.
        let kept = KEPT.try_with(Cell::take).ok().flatten();
        let mut kept = kept.unwrap_or_else(|| Box::new(Kept::default()));
        let Kept { walk, snapshots, seen } = &mut *kept;
        snapshots.lend(scene);
        // A new stamp would be written to every block that the rays visit.
        let stamp = scene.context().residency().now();
        let view = task.view(scene, snapshots, stamp);
        let (mut two, mut answers) = ([Ray::NONE; ALONE], [Hit::MISS; ALONE]);
        rays.read(0, &mut two[..count]);
        let each = two[..count].iter_mut().zip(&mut answers);
        let is_done = each.fold(true, |is_done, (ray, hit)| {
            ray.cone = ray.cone.or_zero();
            is_done && one(&view, task, ray, (walk, seen), hit)
        });
        snapshots.clear();
        let _ = KEPT.try_with(|place| place.set(Some(kept)));
        if is_done {
            hits.write(0, &answers[..count]);
        }
        Ok(is_done)
    })
}

/// Answers one ray; returns false if a block is missing or the ray needs a second walk.
fn one(view: &SceneView, task: Task, ray: &Ray, (walk, seen): (&mut SceneWalk, &mut Seen<1>), hit: &mut Hit) -> bool {
    walk.begin(view, ray);
    if trace(view, task, ray, walk) != Step::Done {
        return false;
    }
    let found = walk.best();
    if found.has_transmitted() && task.want.has(Want::ERROR) || is_early(view, ray, &found) {
        return false;
    }
    !found.is_hit() || matches!(answer_one_in(seen, view, ray, &found, task.want, hit), Ok(true))
}
