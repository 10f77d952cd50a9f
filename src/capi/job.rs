//! Long work as a handle: builds, loads, batches of rays and prefetches.

use super::background::Product;
use super::guard::{Checked, Fill, Sized32, bad, boundary, keep_error, out, status_of};
use super::handles::{self, handle};
use super::model::{ModelObject, oc_model};
use super::status::{OC_STATUS_CANCELLED, OC_STATUS_OK, oc_status};
use crate::base::error::Error;
use std::ffi::c_void;
use std::sync::Arc;
use std::time::Duration;

/// The state of long work.
pub type oc_state = u32;
/// Nothing was asked for yet (frames only).
pub const OC_STATE_IDLE: oc_state = 0;
/// Going on, or waiting for a thread.
pub const OC_STATE_RUNNING: oc_state = 1;
/// Ended well: what was asked for is there, as exact as asked.
pub const OC_STATE_DONE: oc_state = 2;
/// Cancelled. Of what it would have written nothing is to be used.
pub const OC_STATE_CANCELLED: oc_state = 3;
/// Failed. Of what it would have written nothing is to be used.
pub const OC_STATE_FAILED: oc_state = 4;
/// Ended well, with less than was asked for: all that fits the memory budget, or can be read, is there. Frames, whose
/// picture is then coarser than asked (oc_frame_get_accuracy says by how much), and prefetches.
pub const OC_STATE_COMPLETE_WITHIN_BUDGET: oc_state = 5;

/// What a build or load is doing.
pub type oc_phase = u32;
/// Nothing begun, or neither build nor load.
pub const OC_PHASE_WAITING: oc_phase = 0;
/// Reading input, or a model.
pub const OC_PHASE_READ: oc_phase = 1;
/// Building trees.
pub const OC_PHASE_BUILD: oc_phase = 2;
/// Coding and writing blocks.
pub const OC_PHASE_WRITE: oc_phase = 3;
/// Making sure that the file is on the disk under its name.
pub const OC_PHASE_SEAL: oc_phase = 4;
/// Ended.
pub const OC_PHASE_DONE: oc_phase = 5;

/// A timeout without an end.
pub const OC_FOREVER: u32 = 0xFFFFFFFF;

/// How far long work is: the same for builds, loads, batches of rays, prefetches and frames.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_progress {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// An OC_STATE_ number.
    pub state: oc_state,
    /// From 0 to 1, never going back.
    pub fraction: f64,
    /// What is done: triangles read (builds), rays answered (batches), pixels (frames), blocks read (prefetches).
    pub done: u64,
    /// Of how many; 0 where that is not known.
    pub total: u64,
    /// Bytes read and written so far (builds, loads); in memory (frames, prefetches).
    pub bytes: u64,
    /// The least budget in bytes that would do, if it failed with OC_STATUS_OVER_BUDGET; else 0.
    pub need: u64,
    /// Why it failed or was cancelled, or of a frame that ended as OC_STATE_COMPLETE_WITHIN_BUDGET, why some of it
    /// could not be read. oc_last_error has the reason in words after a poll or wait.
    pub error: oc_status,
    /// An OC_PHASE_ number (builds and loads).
    pub phase: oc_phase,
}

// SAFETY: `repr(C)`, integers and a double without padding, `struct_size` first.
unsafe impl Sized32 for oc_progress {
    const NAME: &'static str = "oc_progress";
}

/// Called when work has ended, well or not, and for frames also when there is a better picture; from any thread, in
/// which it must return soon and must not unwind. It may call what is marked `Cheap`. `user` is what was given with the
/// function.
// SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
pub type oc_wake_fn = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// Long work in flight. Releasing its last count cancels it; for a batch of rays that release
/// waits until nobody reads the rays or writes the hits.
pub struct oc_job {
    _private: [u8; 0],
}

handle!(oc_job, JobObject, 2);

pub(crate) struct JobObject {
    work: Arc<dyn LongWork>,
}

impl Drop for JobObject {
    fn drop(&mut self) {
        self.work.cancel();
    }
}

/// What a poll tells, before it becomes an [`oc_progress`].
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

    /// Fills the caller's struct, and keeps the reason of a failure for `oc_last_error`.
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

/// The caller's wake function with its `user`.
#[derive(Clone, Copy)]
pub(crate) struct Wake {
    // SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
    call: unsafe extern "C" fn(*mut c_void),
    user: *mut c_void,
}

// SAFETY: the header says that it is called from any thread.
unsafe impl Send for Wake {}
// SAFETY: as above.
unsafe impl Sync for Wake {}

impl Wake {
    pub(crate) fn new(wake: oc_wake_fn, user: *mut c_void) -> Option<Self> {
        wake.map(|call| Self { call, user })
    }

    /// As the library's own calls take it.
    pub(crate) fn into_fn(self) -> Arc<dyn Fn() + Send + Sync> {
        Arc::new(move || self.call())
    }

    pub(crate) fn call(self) {
        // SAFETY: the caller gave both for this.
        unsafe { (self.call)(self.user) }
    }
}

/// Builds, loads, batches and prefetches behind one handle.
pub(crate) trait LongWork: Send + Sync {
    fn poll(&self) -> Snapshot;
    /// `None` waits without an end.
    fn wait(&self, timeout: Option<Duration>) -> Snapshot;
    fn cancel(&self);
    /// Replaces the wake function; called at once if the work has ended.
    fn set_wake(&self, wake: Option<Wake>);
    /// What a build or load left behind.
    fn product(&self) -> Option<Arc<Product>> {
        None
    }
}

/// A timeout in milliseconds as the header has it.
pub(crate) fn timeout(ms: u32) -> Option<Duration> {
    (ms != OC_FOREVER).then(|| Duration::from_millis(u64::from(ms)))
}

/// A handle for `work`.
pub(crate) fn give_job(work: Arc<dyn LongWork>) -> *mut oc_job {
    handles::give::<oc_job>(JobObject { work })
}

/// What the job left behind, if it is a `T`.
pub(crate) fn product<T: 'static + Clone>(job: &JobObject, what: &str) -> Checked<T> {
    let product = job.work.product().ok_or_else(|| Error::BadState(format!("the job has no {what} (yet)")))?;
    match product.downcast_ref::<T>() {
        Some(product) => Ok(product.clone()),
        None => bad(format!("this kind of job leaves no {what}")),
    }
}

/// How far the job is. After OC_STATE_FAILED oc_last_error of this thread tells why.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_progress` initialised.
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

/// Waits until the job has ended and its wake function, if another thread is calling it, has returned; `timeout_ms` at
/// most (OC_FOREVER: no limit). Says how far the job is. A timeout is no failure: the state is then OC_STATE_RUNNING.
/// So once this call says that the job has ended, `user` of the wake function may be freed. `out_progress` may be NULL.
///
/// Thread safety: any thread. Blocks. In a context without threads and without an executor this call does
/// the work; a build or load is then done to its end, whatever the timeout.
/// # Safety
/// Live handle; `out_progress` initialised or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_wait(job: *const oc_job, timeout_ms: u32, out_progress: *mut oc_progress) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let fill = if out_progress.is_null() { None } else { Some(Fill::new(out_progress)?) };
        handles::with_callbacks(job, |job| {
            let snapshot = job.work.wait(timeout(timeout_ms));
            if let Some(fill) = fill {
                snapshot.report(fill);
            }
            Ok(())
        })
    })
}

/// Asks the job to end; it does so within about 100 ms. A job that has ended stays as it is.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle.
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

/// Has `wake` called once, when the job ends; if it has ended already, now, from this call. Replaces an
/// earlier one; NULL: no call.
///
/// `user` must stay usable until `wake` has returned, or was replaced before it was called. `wake` may release the job;
/// then what the job was for is done, and its arrays are the caller's again. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `wake` is NULL or may be called from any thread with `user`.
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

/// The model that a job of oc_model_load has opened. OC_STATUS_INVALID_STATE before it is done, or
/// if it failed; of a job of another kind, that or OC_STATUS_INVALID_ARGUMENT.
///
/// Ownership: the caller owns a count of the model. Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_model` writable.
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

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_retain(job: *mut oc_job) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(job) }
}

/// Takes a count back; with the last one the job is cancelled. NULL does nothing.
///
/// Thread safety: any thread, also from the job's own wake function. For a batch of rays it blocks until no thread uses
/// the arrays and the wake function, if another thread is calling it, has returned; for other jobs it is cheap.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_job_release(job: *mut oc_job) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(job) }
}
