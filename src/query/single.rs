//! A call for one or two rays, answered in the caller's thread. Hosts ask so from many threads at once: but for a
//! thread's first call it takes no memory of the heap, and it writes nothing that other threads write but the stamps of
//! blocks, once after each pass. (In scenes of more than seven models snapshots are counted: `arc_swap` has eight a
//! thread that are not.) What does not come to an end so is for batches: what lacks a block, and what takes a second
//! walk.

use super::answers::answer_one;
use super::batch::{Hits, Rays};
use super::beyond::is_early;
use super::chunk::{Task, trace};
use super::hit::{Hit, Want};
use crate::base::error::Result;
use crate::math::Ray;
use crate::scene::SceneState;
use crate::scene::walk::{SceneView, SceneWalk, Snapshots, Step};
use std::cell::Cell;

/// Rays of such a call, at most: a packet of three takes less than three walks.
pub(super) const ALONE: usize = 2;

/// What a thread keeps from call to call: room, and nothing else.
struct Kept {
    walk: SceneWalk,
    snapshots: Snapshots,
}

thread_local! {
    static KEPT: Cell<Option<Box<Kept>>> = const { Cell::new(None) };
}

/// Answers up to [`ALONE`] rays; false if they are for a batch: then nothing is written.
pub(super) fn answer(scene: &SceneState, task: Task, rays: &dyn Rays, hits: &dyn Hits) -> Result<bool> {
    let count = rays.count().min(ALONE);
    scene.context().pool().here(|| {
        // A thread that ends has none any more.
        let kept = KEPT.try_with(Cell::take).ok().flatten();
        let mut kept =
            kept.unwrap_or_else(|| Box::new(Kept { walk: SceneWalk::default(), snapshots: Snapshots::none() }));
        let Kept { walk, snapshots } = &mut *kept;
        snapshots.lend(scene);
        // Not a stamp of its own: each block that it visits would be written to.
        let stamp = scene.context().residency().now();
        let view = task.view(scene, snapshots, stamp);
        let (mut two, mut answers) = ([Ray::NONE; ALONE], [Hit::MISS; ALONE]);
        rays.read(0, &mut two[..count]);
        let each = two[..count].iter_mut().zip(&mut answers);
        let is_done = each.fold(true, |is_done, (ray, hit)| {
            ray.cone = ray.cone.or_zero();
            is_done && one(&view, task, ray, walk, hit)
        });
        snapshots.clear();
        let _ = KEPT.try_with(|place| place.set(Some(kept)));
        if is_done {
            hits.write(0, &answers[..count]);
        }
        Ok(is_done)
    })
}

/// The answer to one ray, if that is its walk's, and whole.
fn one(view: &SceneView, task: Task, ray: &Ray, walk: &mut SceneWalk, hit: &mut Hit) -> bool {
    walk.begin(view, ray);
    if trace(view, task, ray, walk) != Step::Done {
        return false;
    }
    let found = walk.best();
    if found.has_transmitted() && task.want.has(Want::ERROR) || is_early(view, ray, &found) {
        return false;
    }
    !found.is_hit() || matches!(answer_one(view, ray, &found, task.want, hit), Ok(true))
}
