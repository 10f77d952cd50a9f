//! Jobs: builds, loads, batches of rays and prefetches behind one handle.

use super::background::Product;
use super::clash::ClashQueue;
use super::guard::{Checked, Fill, Sized32, bad, boundary, keep_error, out, status_of};
use super::handles::{self, handle};
use super::model::{ModelObject, oc_model};
use super::status::{OC_STATUS_CANCELLED, OC_STATUS_OK, oc_status};
use crate::base::error::Error;
use crate::base::inside_read::refuse_inside_read;
use std::ffi::c_void;
use std::sync::Arc;
use std::time::Duration;

/// State of long work.
pub type oc_state = u32;
/// Frames only: nothing was requested yet.
pub const OC_STATE_IDLE: oc_state = 0;
/// The work runs or waits for a thread.
pub const OC_STATE_RUNNING: oc_state = 1;
/// The work has ended with the complete result, as exact as requested.
pub const OC_STATE_DONE: oc_state = 2;
/// The work was cancelled. Do not use its outputs.
pub const OC_STATE_CANCELLED: oc_state = 3;
/// The work has failed. Do not use its outputs.
pub const OC_STATE_FAILED: oc_state = 4;
/// The work has ended with a part of the result: all that fits the memory budget or can be read. Only frames and
/// prefetches end so. The picture of such a frame is coarser than requested; oc_frame_get_accuracy returns by how much.
pub const OC_STATE_COMPLETE_WITHIN_BUDGET: oc_state = 5;

/// Phase of a build or load.
pub type oc_phase = u32;
/// The work has not begun, or it is neither a build nor a load.
pub const OC_PHASE_WAITING: oc_phase = 0;
/// Reading the input, or the model.
pub const OC_PHASE_READ: oc_phase = 1;
/// Building trees.
pub const OC_PHASE_BUILD: oc_phase = 2;
/// Encoding and writing blocks.
pub const OC_PHASE_WRITE: oc_phase = 3;
/// Flushing the file to the disk and giving it its name.
pub const OC_PHASE_SEAL: oc_phase = 4;
/// The work has ended.
pub const OC_PHASE_DONE: oc_phase = 5;

/// Timeout: wait without a limit.
pub const OC_FOREVER: u32 = 0xFFFFFFFF;

/// Progress of long work: builds, loads, batches of rays, prefetches and frames.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_progress {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// One of the OC_STATE_ constants.
    pub state: oc_state,
    /// Share of the work that is done, 0 to 1. Never decreases.
    pub fraction: f64,
    /// Units done. Builds: triangles read. Batches: rays answered. Frames: pixels. Prefetches: blocks read.
    pub done: u64,
    /// Units in total. 0: unknown.
    pub total: u64,
    /// Builds and loads: bytes read and written so far. Frames and prefetches: bytes in memory.
    pub bytes: u64,
    /// The least budget in bytes that suffices, if `error` is OC_STATUS_OVER_BUDGET. Otherwise 0.
    pub need: u64,
    /// Reason why the work failed or was cancelled. For a frame in OC_STATE_COMPLETE_WITHIN_BUDGET: the reason why some
    /// data could not be read, else OC_STATUS_OK. After a poll or wait, oc_last_error returns the reason in words.
    pub error: oc_status,
    /// Builds and loads: one of the OC_PHASE_ constants.
    pub phase: oc_phase,
}

// SAFETY: `repr(C)`, integers and a double without padding, `struct_size` first.
unsafe impl Sized32 for oc_progress {
    const NAME: &'static str = "oc_progress";
}

/// Callback: work has ended in any way, or a frame has a better picture.
///
/// - `user`: the pointer that was registered with the function.
///
/// Rules:
/// - Any thread may call it. This includes a thread inside a function of the library that ends the work, e.g.
///   oc_job_cancel or oc_frame_cancel.
/// - It must return soon and must not unwind.
/// - It may call functions that are marked `Cheap`.
// SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment above.
pub type oc_wake_fn = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// Work in flight: a build, a load, a batch of rays or a prefetch.
///
/// The release of the last reference cancels the work. For a batch of rays that release waits until no thread reads the
/// rays or writes the hits.
pub struct oc_job {
    _private: [u8; 0],
}

handle!(oc_job, JobObject, 2);

pub(crate) struct JobObject {
    pub(crate) work: Arc<dyn LongWork>,
}

impl Drop for JobObject {
    fn drop(&mut self) {
        self.work.cancel();
    }
}

/// State of the work at a poll, before it is converted to an [`oc_progress`].
pub(crate) struct Snapshot {
    pub(crate) state: oc_state,
    pub(crate) fraction: f64,
    pub(crate) done: u64,
    pub(crate) total: u64,
    pub(crate) bytes: u64,
    pub(crate) need: u64,
    pub(crate) status: oc_status,
    pub(crate) phase: oc_phase,
    pub(crate) error: Option<Arc<Error>>,
}

impl Snapshot {
    pub(crate) fn running() -> Self {
        Self {
            state: OC_STATE_RUNNING,
            fraction: 0.0,
            done: 0,
            total: 0,
            bytes: 0,
            need: 0,
            status: OC_STATUS_OK,
            phase: OC_PHASE_WAITING,
            error: None,
        }
    }

    pub(crate) fn done() -> Self {
        Self { state: OC_STATE_DONE, ..Self::running() }
    }

    pub(crate) fn within_budget() -> Self {
        Self { state: OC_STATE_COMPLETE_WITHIN_BUDGET, ..Self::running() }
    }

    pub(crate) fn cancelled() -> Self {
        Self { state: OC_STATE_CANCELLED, status: OC_STATUS_CANCELLED, ..Self::running() }
    }

    pub(crate) fn ended_with(error: &Arc<Error>) -> Self {
        let (status, need) = status_of(error);
        let state = if status == OC_STATUS_CANCELLED { OC_STATE_CANCELLED } else { OC_STATE_FAILED };
        Self { state, status, need, error: Some(Arc::clone(error)), ..Self::running() }
    }

    /// Fills the caller's struct, and stores the reason of a failure for `oc_last_error`.
    pub(crate) fn report(self, fill: Fill<oc_progress>) {
        match &self.error {
            Some(error) => keep_error(error),
            None if self.status == OC_STATUS_CANCELLED => keep_error(&Error::Cancelled),
            None => {}
        }
        fill.with(oc_progress {
            struct_size: 0,
            state: self.state,
            fraction: self.fraction,
            done: self.done,
            total: self.total,
            bytes: self.bytes,
            need: self.need,
            error: self.status,
            phase: self.phase,
        });
    }
}

/// The host's wake function and its `user`.
#[derive(Clone, Copy)]
pub(crate) struct Wake {
    // SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment on
    // `oc_wake_fn`.
    call: unsafe extern "C" fn(*mut c_void),
    user: *mut c_void,
}

// SAFETY: the header says that any thread may call the function.
unsafe impl Send for Wake {}
// SAFETY: as above.
unsafe impl Sync for Wake {}

impl Wake {
    pub(crate) fn new(wake: oc_wake_fn, user: *mut c_void) -> Option<Self> {
        wake.map(|call| Self { call, user })
    }

    /// Converts the callback to the type that the crate takes.
    pub(crate) fn into_fn(self) -> Arc<dyn Fn() + Send + Sync> {
        Arc::new(move || self.call())
    }

    pub(crate) fn call(self) {
        // SAFETY: the host registered the function with this `user` for this call.
        unsafe { (self.call)(self.user) }
    }
}

/// Interface of builds, loads, batches and prefetches behind a job handle.
pub(crate) trait LongWork: Send + Sync {
    fn poll(&self) -> Snapshot;
    /// `None`: waits without a limit.
    fn wait(&self, timeout: Option<Duration>) -> Snapshot;
    fn cancel(&self);
    /// Replaces the wake function. Calls the new one at once if the work has ended.
    fn set_wake(&self, wake: Option<Wake>);
    /// Returns the result of a build, load or search for clashes.
    fn product(&self) -> Option<Arc<Product>> {
        None
    }
    /// Returns the clashes that a search has found and the caller has not taken.
    fn clashes(&self) -> Option<&ClashQueue> {
        None
    }
}

/// Converts a timeout in milliseconds. `OC_FOREVER` becomes `None`.
pub(crate) fn timeout(ms: u32) -> Option<Duration> {
    (ms != OC_FOREVER).then(|| Duration::from_millis(u64::from(ms)))
}

/// Creates a job handle for `work`.
pub(crate) fn give_job(work: Arc<dyn LongWork>) -> *mut oc_job {
    handles::give::<oc_job>(JobObject { work })
}

/// Returns the result of the job, if it is a `T`.
pub(crate) fn product<T: 'static + Clone>(job: &JobObject, what: &str) -> Checked<T> {
    let product = job.work.product().ok_or_else(|| Error::BadState(format!("the job has not produced a {what}")))?;
    match product.downcast_ref::<T>() {
        Some(product) => Ok(product.clone()),
        None => bad(format!("this kind of job does not produce a {what}")),
    }
}

/// Returns the progress of a job.
///
/// - `out_progress`: receives the progress. Initialise it with OC_INIT.
///
/// If the job has failed or was cancelled, oc_last_error of this thread returns the reason.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `out_progress` is initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_poll(job: *const oc_job, out_progress: *mut oc_progress) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = Fill::new(out_progress)?;
        handles::with(job, |job| {
            job.work.poll().report(fill);
            Ok(())
        })
    })
}

/// Waits until a job has ended, and until its wake function has returned if another thread is calling it. Then the
/// `user` of the wake function may be freed.
///
/// - `timeout_ms`: longest time to wait, in milliseconds. OC_FOREVER: no limit. A timeout is not a failure: the state
///   is then OC_STATE_RUNNING.
/// - `out_progress`: receives the progress as oc_job_poll does. May be NULL.
///
/// Thread safety: any thread. Blocks. In a context without threads and without an executor this call does the work. It
/// then completes a build or load even if the timeout is shorter.
/// # Safety
/// `job` is a live handle; `out_progress` is initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_wait(job: *const oc_job, timeout_ms: u32, out_progress: *mut oc_progress) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = if out_progress.is_null() { None } else { Some(Fill::new(out_progress)?) };
        refuse_inside_read()?;
        handles::with_callbacks(job, |job| {
            let snapshot = job.work.wait(timeout(timeout_ms));
            if let Some(fill) = fill {
                snapshot.report(fill);
            }
            Ok(())
        })
    })
}

/// Asks a job to end. It ends within about 100 ms. A job that has ended does not change.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_cancel(job: *const oc_job) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(job, |job| {
            job.work.cancel();
            Ok(())
        })
    })
}

/// Registers a function that is called once, when the job ends. If the job has ended already, this call itself calls
/// the function. An earlier function is replaced.
///
/// - `wake`: the function. NULL: none.
/// - `user`: passed to `wake`. It must stay valid until `wake` has returned, or until `wake` is replaced before it was
///   called.
///
/// `wake` may release the job. The job has ended then, and its arrays belong to the caller again.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `wake` is NULL or may be called from any thread with `user`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_set_wake(job: *const oc_job, wake: oc_wake_fn, user: *mut c_void) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(job, |job| {
            job.work.set_wake(Wake::new(wake, user));
            Ok(())
        })
    })
}

/// Returns the model that a job of oc_model_load has opened.
///
/// - `out_model`: receives the model.
///
/// Errors:
/// - OC_STATUS_INVALID_STATE: the load is not done, or failed.
/// - OC_STATUS_INVALID_STATE or OC_STATUS_INVALID_ARGUMENT: the job is of another kind.
///
/// Ownership: the caller receives one reference to the model.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `job` is a live handle; `out_model` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_model(job: *const oc_job, out_model: *mut *mut oc_model) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_model, "out_model")?;
        handles::with(job, |job| {
            let model = product::<crate::scene::Model>(job, "model")?;
            out.write(handles::give::<oc_model>(ModelObject::new(model)));
            Ok(())
        })
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `job` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_retain(job: *mut oc_job) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(job) }
}

/// Releases one reference. The last release cancels the job. NULL: does nothing.
///
/// Thread safety: any thread, including the job's own wake function.
/// Batches of rays: blocks until no thread uses the arrays, and until the wake function has returned if another thread
/// is calling it. Other jobs: cheap.
/// # Safety
/// `job` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_release(job: *mut oc_job) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(job) }
}
