//! Reading ahead of being asked.

use super::guard::{Checked, bad, boundary, out, read};
use super::handles::{self, Shell};
use super::job::{LongWork, Snapshot, Wake, give_job, oc_job};
use super::scene::{SceneObject, oc_scene};
use super::status::oc_status;
use super::view::oc_camera;
use crate::math::DBounds;
use crate::render::{Prefetch, PrefetchState, PrefetchStatus};
use glam::DVec3;
use std::sync::Arc;
use std::time::Duration;

/// A prefetch behind an `oc_job`.
struct PrefetchWork(Prefetch);

impl PrefetchWork {
    fn snapshot(status: PrefetchStatus) -> Snapshot {
        let base = match (status.state, &status.error) {
            (PrefetchState::Running, _) => Snapshot::running(),
            (PrefetchState::Done, _) => Snapshot::done(),
            (PrefetchState::Full, _) => Snapshot::within_budget(),
            (PrefetchState::Failed, Some(error)) => Snapshot::ended_with(error),
            (PrefetchState::Cancelled | PrefetchState::Failed, _) => Snapshot::cancelled(),
        };
        Snapshot { fraction: status.fraction, done: status.blocks, bytes: status.bytes, ..base }
    }
}

impl LongWork for PrefetchWork {
    fn poll(&self) -> Snapshot {
        Self::snapshot(self.0.poll())
    }
    fn wait(&self, timeout: Option<Duration>) -> Snapshot {
        Self::snapshot(self.0.wait(timeout.unwrap_or(Duration::MAX)))
    }
    fn cancel(&self) {
        self.0.cancel();
    }
    fn set_wake(&self, wake: Option<Wake>) {
        self.0.set_wake(wake.map(Wake::into_fn));
    }
}

/// A point of the caller's.
///
/// # Safety
/// NULL or three doubles.
unsafe fn point(pointer: *const f64, name: &str) -> Checked<DVec3> {
    if pointer.is_null() {
        return bad(format!("{name} is NULL"));
    }
    // SAFETY: not null; three doubles by the contract.
    Ok(DVec3::from_array(unsafe { pointer.cast::<[f64; 3]>().read_unaligned() }))
}

/// Begins to read, in the background, what of the committed scene lies in a box: blocks below cells that meet it and
/// are longer than `cell` (world units; 0: all of them), those below the longest cells first. What frames and queries
/// ask for comes before, and no picture gets coarser for it.
///
/// The job counts blocks and their bytes in memory. It ends as OC_STATE_DONE when all is in memory, as
/// OC_STATE_COMPLETE_WITHIN_BUDGET when no more fits beside what frames use, as OC_STATE_FAILED when some of it cannot
/// be read (the rest then is, as far as it fits). What was read stays until room is needed and nothing else has been
/// used less lately. Releasing the job ends the reading.
///
/// `low`, `high`: three doubles each, world space. OC_STATUS_INVALID_ARGUMENT for NaN, or a `cell` below 0.
/// Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `low` and `high` have three doubles; `out_job` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_prefetch_box(
    scene: *const oc_scene,
    low: *const f64,
    high: *const f64,
    cell: f64,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        let bounds = DBounds { min: point(low, "low")?, max: point(high, "high")? };
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let prefetch = Prefetch::of_box(&scene.scene.state(), &bounds, cell)?;
            out.write(give_job(Arc::new(PrefetchWork(prefetch))));
            Ok(())
        })
    })
}

/// Begins to read, in the background, what a picture of `width` by `height` pixels of the committed scene would need at
/// `poe` pixels of error (0: exact), the most visible first, as far as a ray in every fourth pixel of every fourth row
/// finds it; without shadows and what is behind transparent surfaces. For the view that comes next, for instance. As
/// oc_scene_prefetch_box otherwise.
///
/// OC_STATUS_INVALID_ARGUMENT for a bad camera or size, or a `poe` that is not finite or below 0.
/// Ownership: the caller owns a count of the job. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `camera` initialised; `out_job` writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_scene_prefetch_camera(
    scene: *const oc_scene,
    camera: *const oc_camera,
    width: u32,
    height: u32,
    poe: f32,
    out_job: *mut *mut oc_job,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_job, "out_job")?;
        let camera = read(camera)?.to_rust()?;
        handles::with(scene, |scene: &Shell<SceneObject>| {
            let prefetch = Prefetch::of_camera(&scene.scene.state(), &camera, (width, height), poe)?;
            out.write(give_job(Arc::new(PrefetchWork(prefetch))));
            Ok(())
        })
    })
}
