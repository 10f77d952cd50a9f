//! Prefetch: reads blocks before a frame or a query needs them.

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

/// Reads a point from the caller's memory.
///
/// # Safety
/// `pointer` is NULL or points to three readable doubles.
unsafe fn point(pointer: *const f64, name: &str) -> Checked<DVec3> {
    if pointer.is_null() {
        return bad(format!("{name} is NULL"));
    }
    // SAFETY: the pointer is not null and points to three doubles by the contract.
    Ok(DVec3::from_array(unsafe { pointer.cast::<[f64; 3]>().read_unaligned() }))
}

/// Begins to read, in the background, the part of the committed scene that lies in a box.
///
/// The job reads the blocks below all cells that intersect the box and are longer than `cell`. Blocks below the longest
/// cells come first. Hidden parts are included. Reads for frames and queries have priority, and no picture becomes
/// coarser because of a prefetch.
///
/// - `low`, `high`: corners of the box, three doubles each, world space.
/// - `cell`: length in world units, 0 or more. 0: all blocks of geometry (not primitive ids and colours).
/// - `out_job`: receives the job. Its progress counts blocks (`done`) and their bytes in memory (`bytes`).
///
/// The job ends as
/// - OC_STATE_DONE: all blocks are in memory.
/// - OC_STATE_COMPLETE_WITHIN_BUDGET: no more blocks fit next to those that frames use.
/// - OC_STATE_FAILED: a block cannot be read. The others were read as far as they fit.
///
/// The blocks stay in memory until the library needs room and they are the least recently used. Releasing the job ends
/// the reading.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if a coordinate or `cell` is NaN, or `cell` is below 0.
///
/// Ownership: the caller receives one reference to the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `low` and `high` have three doubles; `out_job` is writable.
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

/// Begins to read, in the background, the blocks that a picture of the committed scene would need, e.g. for the next
/// view. The most visible blocks come first.
///
/// The job traces a ray through every fourth pixel of every fourth row to find the blocks. It ignores shadows and
/// everything behind transparent surfaces. Priority, progress and end of the job: as for oc_scene_prefetch_box.
///
/// - `camera`: initialised with OC_INIT.
/// - `width`, `height`: size of the picture in pixels, 1 to 65536.
/// - `poe`: pixels of error of the picture (see oc_frame_settings). 0: exact.
/// - `out_job`: receives the job.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if the camera or the size is out of range, or `poe` is not finite or below 0.
///
/// Ownership: the caller receives one reference to the job.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `scene` is a live handle; `camera` is initialised; `out_job` is writable.
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
