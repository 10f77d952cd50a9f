//! The context: threads, log and memory budget of all other objects.

use super::background::{Product, Task, WaitersWork};
use super::guard::{Checked, Failure, Sized32, bad, boundary, out, read, read_or_default};
use super::handles::{self, Shell, handle};
use super::job::{give_job, oc_job};
use super::status::oc_status;
use super::version::{OC_HEADER_VERSION, OC_VERSION_PATCH};
use crate::base::error::{Error, Result};
use crate::base::inside_read::refuse_inside_read;
use crate::base::progress::{Cancel, Progress};
use crate::base::tasks::{Executor, Task as HostTask};
use crate::base::threads;
use crate::scene::{Context, ContextOptions, LogLevel};
use crate::simd::Isa;
use crate::store::header::VERSION;
use std::collections::VecDeque;
use std::ffi::{CString, c_char, c_void};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Number of threads: one for each core of the machine.
pub const OC_ALL_THREADS: u32 = 0xFFFFFFFF;

/// Severity of a log line.
pub type oc_log_level = u32;
/// An operation failed.
pub const OC_LOG_ERROR: oc_log_level = 1;
/// Something is wrong, but the operation continues.
pub const OC_LOG_WARNING: oc_log_level = 2;
/// Information for users.
pub const OC_LOG_INFO: oc_log_level = 3;
/// Information for developers.
pub const OC_LOG_DEBUG: oc_log_level = 4;

/// Callback: receives a log line.
///
/// - `user`: `log_user` of oc_context_desc.
/// - `level`: one of the OC_LOG_ constants.
/// - `message`: valid during the call.
///
/// Any thread may call it, but never while the library holds a lock. It must not unwind.
// SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment above.
pub type oc_log_fn = Option<unsafe extern "C" fn(user: *mut c_void, level: oc_log_level, message: *const c_char)>;

/// Runs a task of the library on a thread of the host. oc_submit_fn receives it. Call it once, with the `task` that was
/// passed with it.
// SAFETY of a call: it is the library's own function. The host passes the task that came with it, once.
pub type oc_run_fn = Option<unsafe extern "C" fn(task: *mut c_void)>;

/// Callback: receives a task for the host's threads.
///
/// - `user`: `user` of oc_executor.
/// - `run`, `task`: the host must call `run(task)` exactly once, soon, from any thread. It may call it inside this
///   callback. Then library functions that begin background work return after that work is done.
///
/// Any thread of the host may call it, but never while the library holds a lock.
// SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment above.
pub type oc_submit_fn = Option<unsafe extern "C" fn(user: *mut c_void, run: oc_run_fn, task: *mut c_void)>;

/// The host's own threads. A context with an executor never starts a thread.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_executor {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Number of tasks that can run at once, 1 or more. The library submits at most as many at a time, plus one for
    /// each build and load.
    pub concurrency: u32,
    /// Passed to `submit`.
    pub user: *mut c_void,
    /// Receives the tasks.
    pub submit: oc_submit_fn,
}

// SAFETY: `repr(C)`, two integers, a pointer and a nullable function; `struct_size` first.
unsafe impl Sized32 for oc_executor {
    const NAME: &'static str = "oc_executor";
}

/// Set of vector instructions.
pub type oc_instruction_set = u32;
/// The best set that the machine has.
pub const OC_INSTRUCTION_SET_BEST: oc_instruction_set = 0;
/// The set that every machine of this architecture has.
pub const OC_INSTRUCTION_SET_BASELINE: oc_instruction_set = 1;
/// AVX2.
pub const OC_INSTRUCTION_SET_AVX2: oc_instruction_set = 2;
/// AVX-512.
pub const OC_INSTRUCTION_SET_AVX512: oc_instruction_set = 3;

/// Flags of oc_context_desc.
pub type oc_context_flags = u32;
/// The library reads only the data that frames and queries need. Without this flag it also reads the geometry and
/// colours of a model that fits the memory budget, in the background, while nothing more urgent waits to be read.
/// Primitive ids are read only on request.
pub const OC_CONTEXT_NO_READ_AHEAD: oc_context_flags = 1;
/// Models only have their compact form in memory. Without this flag a model that is in memory as a whole also gets a
/// form in which exact rays are traced faster, made in the background. It takes some 50 to 70 bytes for each triangle,
/// as far as `memory_budget` has room, and is given back when other data needs the room. Answers and pictures are the
/// same.
pub const OC_CONTEXT_COMPACT: oc_context_flags = 2;

/// Options of a context. All zeros: no threads, three quarters of the machine's memory.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_context_desc {
    /// Size of this struct in bytes; OC_INIT sets it.
    pub struct_size: u32,
    /// Number of worker threads, at most four for each core, or 64 if that is more. OC_ALL_THREADS: one for each core.
    /// Ignored with an executor.
    ///
    /// 0: no worker threads. Your thread alternates reading and tracing inside `oc_context_step` or waits; refinement
    /// of a model that is being read is slower, slowest with `oc_context_step`.
    pub threads: u32,
    /// Limit in bytes of the memory that the blocks of all models take, including tables (parts and their names too)
    /// and buffers for reading, and that the instances, placed meshes and looks of scenes take. Never exceeded. 0:
    /// three quarters of the machine's memory. A value above the machine's memory is refused.
    ///
    /// Not included:
    /// - Batches: 24 MiB for the rays of all batches that wait for data, and 2 MiB for each thread that traces.
    /// - oc_scene_overlap_box, oc_scene_overlap_frustum: 1 MiB for each call, and 96 bytes for each part found.
    /// - Frames: three times the bytes of the buffers (once more for each picture that is still mapped), and 16 bytes
    ///   for each pixel.
    /// - Scenes: 80 KiB for each, and while parts are chosen 13 bytes for each id in the list.
    /// - Reading: three blocks (192 KiB) for each thread that reads, and the rest of huge pages (at most a sixteenth).
    ///
    /// A model may be many times larger than the budget:
    /// - Opening a model reads its coarse blocks. Other blocks are read when they are used. The least recently used
    ///   blocks are evicted.
    /// - Tables, root blocks and 2 to 12 MiB for reading must stay in memory. If they do not fit, opening fails
    ///   with OC_STATUS_OVER_BUDGET, and oc_last_error_need returns the least budget that suffices.
    /// - If the data of a view does not fit, its picture is coarser at first and then completed part by part, see
    ///   oc_frame_request. Exact queries take longer.
    pub memory_budget: u64,
    /// The host's own threads, or NULL. The struct is copied. Its `user` must stay valid longer than the context.
    pub executor: *const oc_executor,
    /// Receives log lines, or NULL.
    pub log: oc_log_fn,
    /// Passed to `log`. Must stay valid longer than the context.
    pub log_user: *mut c_void,
    /// One of the OC_INSTRUCTION_SET_ constants. 0: the best set that the machine has. All sets give the same answers.
    pub instruction_set: oc_instruction_set,
    /// OC_CONTEXT_ flags, combined with `|`.
    pub flags: oc_context_flags,
}

// SAFETY: `repr(C)`, integers, pointers and a nullable function; `struct_size` first.
unsafe impl Sized32 for oc_context_desc {
    const NAME: &'static str = "oc_context_desc";
}

/// Threads, log and memory budget. All other objects are created from a context. The library has no other global state:
/// a program may use any number of contexts at the same time.
///
/// Objects belong to the process that created them. In a child of `fork`, calls on them return OC_STATUS_INVALID_STATE,
/// and releases do nothing, because threads do not survive a fork. A child may create a context of its own.
pub struct oc_context {
    _private: [u8; 0],
}

handle!(oc_context, ContextObject, 1);

pub(crate) struct ContextObject {
    pub(crate) context: Context,
    host: Option<Arc<HostExecutor>>,
    /// In a context without threads: work that a step will do.
    waiting: Mutex<VecDeque<Weak<Task>>>,
}

impl ContextObject {
    /// Starts long work in the background: on a new thread, on the host's executor, or queued for a step or a wait.
    pub(crate) fn begin(
        &self,
        progress: Arc<Progress>,
        cancel: Cancel,
        todo: impl FnOnce(&Task) -> Result<Product> + Send + 'static,
    ) -> Result<*mut oc_job> {
        Ok(give_job(self.begin_task(progress, cancel, todo)?))
    }

    /// [`Self::begin`], without a handle.
    pub(crate) fn begin_task(
        &self,
        progress: Arc<Progress>,
        cancel: Cancel,
        todo: impl FnOnce(&Task) -> Result<Product> + Send + 'static,
    ) -> Result<Arc<Task>> {
        let waiters_work = match (&self.host, self.context.threads()) {
            (Some(_), _) => WaitersWork::Untimed,
            (None, 0) => WaitersWork::Always,
            (None, _) => WaitersWork::Never,
        };
        let context = self.context.clone();
        let todo = move |task: &Task| todo(task).inspect_err(|error| context.log(LogLevel::Error, &error.to_string()));
        let task = Task::new(progress, cancel, waiters_work, todo);
        if let Some(host) = &self.host {
            let task = Arc::clone(&task);
            host.submit_once(Box::new(move || {
                task.run();
            }));
        } else if waiters_work == WaitersWork::Always {
            let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            waiting.retain(|t| t.strong_count() > 0);
            waiting.push_back(Arc::downgrade(&task));
        } else {
            let task = Arc::clone(&task);
            threads::named("outcrop work".into())
                .spawn(move || task.run())
                .map_err(|e| Error::io("background thread", "start", e))?;
        }
        Ok(task)
    }

    /// Does one piece of work in this thread. Returns false if there is none.
    fn step(&self) -> bool {
        if self.context.step() {
            return true;
        }
        loop {
            let next = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
            let Some(task) = next else { return false };
            if task.upgrade().is_some_and(|t| t.run()) {
                return true;
            }
        }
    }
}

/// The host's executor, as an [`Executor`] of the crate.
struct HostExecutor {
    concurrency: usize,
    user: *mut c_void,
    // SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment on
    // `oc_submit_fn`.
    submit: unsafe extern "C" fn(*mut c_void, oc_run_fn, *mut c_void),
}

// SAFETY: the header says that any thread may call `submit`.
unsafe impl Send for HostExecutor {}
// SAFETY: as above.
unsafe impl Sync for HostExecutor {}

type Once = Box<dyn FnOnce() + Send>;

impl HostExecutor {
    /// Submits a closure that runs once.
    fn submit_once(&self, run: Once) {
        /// Runs a closure that `submit_once` packed. A panic is caught here.
        ///
        /// # Safety
        /// `task` is NULL, or a closure that `submit_once` packed and that has not run yet.
        unsafe extern "C" fn run_packed(task: *mut c_void) {
            if task.is_null() {
                return;
            }
            // SAFETY: packed below, and run once by the rule in the header.
            let run = unsafe { Box::from_raw(task.cast::<Once>()) };
            let _ = super::guard::caught(|| {
                run();
                Ok(())
            });
        }
        let task = Box::into_raw(Box::new(run)).cast();
        // SAFETY: the host registered the function for this call.
        unsafe { (self.submit)(self.user, Some(run_packed), task) }
    }
}

impl Executor for HostExecutor {
    fn concurrency(&self) -> usize {
        self.concurrency
    }
    fn submit(&self, task: HostTask) {
        self.submit_once(Box::new(move || task.run()));
    }
}

/// The host's log function, as a log function of the crate.
struct HostLog {
    // SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment on `oc_log_fn`.
    log: unsafe extern "C" fn(*mut c_void, oc_log_level, *const c_char),
    user: *mut c_void,
}

// SAFETY: the header says that any thread may call it.
unsafe impl Send for HostLog {}
// SAFETY: as above.
unsafe impl Sync for HostLog {}

impl HostLog {
    fn line(&self, level: LogLevel, line: &str) {
        let mut bytes = line.as_bytes().to_vec();
        bytes.retain(|&b| b != 0);
        let text = CString::new(bytes).unwrap_or_default();
        // SAFETY: the host registered the function with this `user` for this call. The text lives during the call.
        unsafe { (self.log)(self.user, level as u32, text.as_ptr()) }
    }
}

/// Refuses a number of threads that is out of range.
pub(super) fn check_threads(asked: u32, name: &str) -> Checked<()> {
    if asked == OC_ALL_THREADS { Ok(()) } else { Ok(threads::check(asked as usize, name)?) }
}

/// Reads the host's executor, if there is one.
///
/// # Safety
/// `executor` is NULL or initialised.
unsafe fn host_executor(executor: *const oc_executor) -> super::guard::Checked<Option<Arc<HostExecutor>>> {
    if executor.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's contract.
    let executor = unsafe { read(executor)? };
    let Some(submit) = executor.submit else {
        return bad("oc_executor.submit is NULL");
    };
    if executor.concurrency == 0 {
        return bad("oc_executor.concurrency must not be 0");
    }
    let concurrency = executor.concurrency as usize;
    Ok(Some(Arc::new(HostExecutor { concurrency, user: executor.user, submit })))
}

/// Creates a context.
///
/// - `header_version`: OC_HEADER_VERSION. A program and a library of different versions then report an error instead of
///   crashing.
/// - `desc`: options. NULL: all defaults.
/// - `out_context`: receives the context.
///
/// Errors:
/// - OC_STATUS_VERSION_MISMATCH: header and library have different versions.
/// - OC_STATUS_INVALID_ARGUMENT: too many threads, or the machine lacks the instruction set, or has less memory than
///   the budget.
/// - OC_STATUS_IO: a thread cannot be started.
///
/// Ownership: the caller receives one reference.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `desc` is NULL or initialised, and so is its executor; `out_context` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_create(
    header_version: u32,
    desc: *const oc_context_desc,
    out_context: *mut *mut oc_context,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_context, "out_context")?;
        check_version(header_version)?;
        let desc = read_or_default(desc)?;
        if desc.flags & !(OC_CONTEXT_NO_READ_AHEAD | OC_CONTEXT_COMPACT) != 0 {
            return bad(format!("oc_context_desc.flags {:#x}: unknown flags", desc.flags));
        }
        let isa = instruction_set(desc.instruction_set)?;
        let host = host_executor(desc.executor)?;
        if host.is_none() {
            check_threads(desc.threads, "oc_context_desc.threads")?;
        }
        let log = desc.log.map(|log| {
            let host = HostLog { log, user: desc.log_user };
            Arc::new(move |level, line: &str| host.line(level, line)) as Arc<dyn Fn(LogLevel, &str) + Send + Sync>
        });
        let all = ContextOptions::default();
        let context = Context::new(ContextOptions {
            threads: if desc.threads == OC_ALL_THREADS { all.threads } else { desc.threads as usize },
            executor: host.clone().map(|h| h as Arc<dyn Executor>),
            memory_budget: desc.memory_budget,
            read_ahead: desc.flags & OC_CONTEXT_NO_READ_AHEAD == 0,
            compact: desc.flags & OC_CONTEXT_COMPACT != 0,
            log,
            isa,
        })?;
        let (isa, threads) = (context.isa().name(), context.concurrency());
        let version = env!("CARGO_PKG_VERSION");
        context.log(LogLevel::Info, &format!("outcrop {version}: {isa}, concurrency {threads}"));
        out.write(handles::give::<oc_context>(ContextObject { context, host, waiting: Mutex::default() }));
        Ok(())
    })
}

/// Returns `None` for the best set.
fn instruction_set(number: oc_instruction_set) -> super::guard::Checked<Option<Isa>> {
    match Isa::ALL.into_iter().find(|isa| *isa as u32 == number) {
        None if number != OC_INSTRUCTION_SET_BEST => {
            bad(format!("oc_context_desc.instruction_set {number} is unknown"))
        }
        isa => Ok(isa),
    }
}

/// Compares versions. While the major version is 0, each minor version is a new interface.
fn check_version(header: u32) -> super::guard::Checked<()> {
    if header / 100 == OC_HEADER_VERSION / 100 {
        return Ok(());
    }
    let name = |v: u32| format!("{}.{}.{}", v / 10000, v / 100 % 100, v % 100);
    debug_assert_eq!(OC_HEADER_VERSION % 100, OC_VERSION_PATCH);
    Err(Failure::VersionMismatch(format!(
        "the program was compiled with the header of outcrop {}, but the version of the library is {}",
        name(header),
        name(OC_HEADER_VERSION)
    )))
}

/// Does one small piece of waiting work in the calling thread, if there is any. A piece of a frame, a prefetch or a
/// batch of rays takes some tens of microseconds to a few milliseconds. In a context without threads a build or a load
/// is one piece.
///
/// - `out_did`: receives 1 if there was work, else 0. May be NULL.
///
/// Errors: OC_STATUS_INVALID_STATE inside a read function of a model.
///
/// Thread safety: any thread. Blocks while it works.
/// # Safety
/// `context` is a live handle; `out_did` is writable or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_step(context: *const oc_context, out_did: *mut u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(context, |context: &Shell<ContextObject>| {
            refuse_inside_read()?;
            let did = context.step();
            if !out_did.is_null() {
                out_did.write(u32::from(did));
            }
            Ok(())
        })
    })
}

/// Property of a context.
pub type oc_property = u32;
/// Version of the library, in the format of OC_HEADER_VERSION.
pub const OC_PROPERTY_VERSION: oc_property = 1;
/// Number of the library's own threads.
pub const OC_PROPERTY_THREADS: oc_property = 2;
/// Number of threads, the library's or the host's, that may work at once.
pub const OC_PROPERTY_CONCURRENCY: oc_property = 3;
/// Memory budget in bytes.
pub const OC_PROPERTY_MEMORY_BUDGET: oc_property = 4;
/// Vector instructions in use: one of the OC_INSTRUCTION_SET_ constants.
pub const OC_PROPERTY_INSTRUCTION_SET: oc_property = 5;
/// Largest width and height of a frame, in pixels.
pub const OC_PROPERTY_MAX_FRAME_SIZE: oc_property = 6;
/// Newest format of model files that the library reads: major * 65536 + minor.
pub const OC_PROPERTY_FORMAT: oc_property = 7;
/// Bytes of the memory budget that are in use now.
pub const OC_PROPERTY_MEMORY_USED: oc_property = 8;

/// Returns a property.
///
/// - `property`: one of the OC_PROPERTY_ constants.
/// - `out_value`: receives the value.
///
/// Errors: OC_STATUS_INVALID_ARGUMENT if this library does not know the property.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `context` is a live handle; `out_value` is writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_property(
    context: *const oc_context,
    property: oc_property,
    out_value: *mut u64,
) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        let out = out(out_value, "out_value")?;
        handles::with(context, |context: &Shell<ContextObject>| {
            let value = match property {
                OC_PROPERTY_VERSION => u64::from(OC_HEADER_VERSION),
                OC_PROPERTY_THREADS => context.context.threads() as u64,
                OC_PROPERTY_CONCURRENCY => context.context.concurrency() as u64,
                OC_PROPERTY_MEMORY_BUDGET => context.context.memory_budget(),
                OC_PROPERTY_MEMORY_USED => context.context.memory_used(),
                OC_PROPERTY_INSTRUCTION_SET => u64::from(context.context.isa() as u32),
                OC_PROPERTY_MAX_FRAME_SIZE => 65536,
                OC_PROPERTY_FORMAT => u64::from(VERSION.0) << 16 | u64::from(VERSION.1),
                other => return bad(format!("property {other} is unknown")),
            };
            out.write(value);
            Ok(())
        })
    })
}

/// Adds one reference. NULL: does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// `context` is NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_retain(context: *mut oc_context) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(context) }
}

/// Releases one reference. Objects created from the context keep the parts of it that they need; its threads end with
/// the last of these objects. NULL: does nothing.
///
/// Thread safety: any thread. Blocks until the threads have ended, if nothing else uses the context. A frame or job
/// that was released while it ran uses it for a moment longer.
/// # Safety
/// `context` is NULL or a live handle of which the caller owns a reference.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_release(context: *mut oc_context) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(context) }
}
