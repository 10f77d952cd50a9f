//! The context: threads, log and memory budget that all else hangs on.

use super::background::{Product, Task, WaitersWork};
use super::guard::{Checked, Failure, Sized32, bad, boundary, out, read, read_or_default};
use super::handles::{self, Shell, handle};
use super::job::{give_job, oc_job};
use super::status::oc_status;
use super::version::{OC_HEADER_VERSION, OC_VERSION_PATCH};
use crate::base::error::{Error, Result};
use crate::base::progress::{Cancel, Progress};
use crate::base::tasks::{Executor, Task as HostTask};
use crate::scene::{Context, ContextOptions, LogLevel};
use crate::simd::Isa;
use crate::store::header::VERSION;
use std::collections::VecDeque;
use std::ffi::{CString, c_char, c_void};
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// As many threads as the machine has cores.
pub const OC_ALL_THREADS: u32 = 0xFFFFFFFF;

/// How much a log line matters.
pub type oc_log_level = u32;
/// Something failed.
pub const OC_LOG_ERROR: oc_log_level = 1;
/// Something is not as it should be; work goes on.
pub const OC_LOG_WARNING: oc_log_level = 2;
/// What a user may want to know.
pub const OC_LOG_INFO: oc_log_level = 3;
/// What a developer may want to know.
pub const OC_LOG_DEBUG: oc_log_level = 4;

/// Takes a log line: called from any thread, never under a lock of the library's; must not unwind.
/// `message` is valid during the call.
// SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
pub type oc_log_fn = Option<unsafe extern "C" fn(user: *mut c_void, level: oc_log_level, message: *const c_char)>;

/// A piece of work for the host's threads: call it once with the `task` that came with it.
// SAFETY, for who calls it: the library's own function; the task that came with it, and once.
pub type oc_run_fn = Option<unsafe extern "C" fn(task: *mut c_void)>;

/// Takes a piece of work: `run(task)` must be called exactly once, soon, from any thread, also at once from inside this
/// call: then calls that begin work in the background return when that is done. Called from any thread of the host,
/// never under a lock of the library's.
// SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
pub type oc_submit_fn = Option<unsafe extern "C" fn(user: *mut c_void, run: oc_run_fn, task: *mut c_void)>;

/// The host's own threads: a context that has them never starts a thread of its own.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_executor {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// How many tasks can run at once, 1 or more; so many are handed in at a time at most (each build and load is
    /// one more).
    pub concurrency: u32,
    /// Given to `submit`.
    pub user: *mut c_void,
    /// Takes work.
    pub submit: oc_submit_fn,
}

// SAFETY: `repr(C)`, two words, a pointer and a nullable function; `struct_size` first.
unsafe impl Sized32 for oc_executor {
    const NAME: &'static str = "oc_executor";
}

/// Vector instructions.
pub type oc_instruction_set = u32;
/// The best that the machine has.
pub const OC_INSTRUCTION_SET_BEST: oc_instruction_set = 0;
/// What every machine has.
pub const OC_INSTRUCTION_SET_BASELINE: oc_instruction_set = 1;
/// AVX2.
pub const OC_INSTRUCTION_SET_AVX2: oc_instruction_set = 2;
/// AVX-512.
pub const OC_INSTRUCTION_SET_AVX512: oc_instruction_set = 3;

/// Flags of oc_context_desc.
pub type oc_context_flags = u32;
/// Nothing is read before it is asked for. Without it a model that fits the memory budget is read in the background,
/// all of it, when nothing more urgent is to be read.
pub const OC_CONTEXT_NO_READ_AHEAD: oc_context_flags = 1;

/// What a context is made with. All zeros: no threads, three quarters of the machine's memory.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_context_desc {
    /// Set by OC_INIT.
    pub struct_size: u32,
    /// Threads that trace, 4096 at most. 0: none; then the caller drives, by oc_context_step or by waiting, and reads
    /// and traces by turns: of a model that is being read pictures get better more slowly than with a thread, most of
    /// all if by oc_context_step. OC_ALL_THREADS: one for each core. Ignored with an executor.
    pub threads: u32,
    /// Bytes that all models together may hold in memory, with tables and what reading takes; never exceeded. 0: three
    /// quarters of the machine's; more than the machine has is refused. A model may be larger, many times: its coarse
    /// blocks are read when it is opened, what is used is read then, and what has not been used for longest goes. What
    /// has to stay is small: tables, the blocks at the roots, and a few megabytes to read with; if not even those fit,
    /// opening fails with OC_STATUS_OVER_BUDGET and oc_last_error_need names the least budget that would do. Where what
    /// frames show does not fit they get coarser, evenly; exact queries take longer. Buffers of frames and batches come
    /// on top.
    pub memory_budget: u64,
    /// The host's own threads, or NULL. The struct is copied; its `user` must outlive the context.
    pub executor: *const oc_executor,
    /// Takes log lines, or NULL.
    pub log: oc_log_fn,
    /// Given to `log`; must outlive the context.
    pub log_user: *mut c_void,
    /// An OC_INSTRUCTION_SET_ number. 0: the best that the machine has. All give the same answers.
    pub instruction_set: oc_instruction_set,
    /// OC_CONTEXT_ flags, joined with `|`.
    pub flags: oc_context_flags,
}

// SAFETY: `repr(C)`, words, pointers and a nullable function; `struct_size` first.
unsafe impl Sized32 for oc_context_desc {
    const NAME: &'static str = "oc_context_desc";
}

/// Threads, log and memory budget that all else is made from. There is no other global state: any
/// number of contexts live side by side.
pub struct oc_context {
    _private: [u8; 0],
}

handle!(oc_context, ContextObject, 1);

pub(crate) struct ContextObject {
    pub(crate) context: Context,
    host: Option<Arc<HostExecutor>>,
    /// Work for contexts without threads, to be done by a step.
    waiting: Mutex<VecDeque<Weak<Task>>>,
}

impl ContextObject {
    /// Has long work done in the background, as this context does that.
    pub(crate) fn begin(
        &self,
        progress: Arc<Progress>,
        cancel: Cancel,
        todo: impl FnOnce(&Task) -> Result<Product> + Send + 'static,
    ) -> Result<*mut oc_job> {
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
            std::thread::Builder::new()
                .name("outcrop work".into())
                .spawn(move || task.run())
                .map_err(|e| Error::io("background thread", "start", e))?;
        }
        Ok(give_job(task))
    }

    /// Does one piece of work in this thread, if there is any.
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

/// The host's executor behind the crate's trait.
struct HostExecutor {
    concurrency: usize,
    user: *mut c_void,
    // SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
    submit: unsafe extern "C" fn(*mut c_void, oc_run_fn, *mut c_void),
}

// SAFETY: the header says that `submit` is called from any thread.
unsafe impl Send for HostExecutor {}
// SAFETY: as above.
unsafe impl Sync for HostExecutor {}

type Once = Box<dyn FnOnce() + Send>;

impl HostExecutor {
    /// Hands in something to be run once.
    fn submit_once(&self, run: Once) {
        /// Runs what `submit_once` packed; a panic stays here.
        ///
        /// # Safety
        /// NULL, or what `submit_once` packed and nobody has run.
        unsafe extern "C" fn run_packed(task: *mut c_void) {
            if task.is_null() {
                return;
            }
            // SAFETY: packed below, and run once by the header's rule.
            let run = unsafe { Box::from_raw(task.cast::<Once>()) };
            let _ = super::guard::caught(|| {
                run();
                Ok(())
            });
        }
        let task = Box::into_raw(Box::new(run)).cast();
        // SAFETY: the caller gave the function for this.
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

/// The caller's log function behind the crate's.
struct HostLog {
    // SAFETY, for who calls it: the host vouches for the pointer, and is given what its comment in the header promises.
    log: unsafe extern "C" fn(*mut c_void, oc_log_level, *const c_char),
    user: *mut c_void,
}

// SAFETY: the header says that it is called from any thread.
unsafe impl Send for HostLog {}
// SAFETY: as above.
unsafe impl Sync for HostLog {}

impl HostLog {
    fn line(&self, level: LogLevel, line: &str) {
        let mut bytes = line.as_bytes().to_vec();
        bytes.retain(|&b| b != 0);
        let text = CString::new(bytes).unwrap_or_default();
        // SAFETY: the caller gave both for this; the text lives during the call.
        unsafe { (self.log)(self.user, level as u32, text.as_ptr()) }
    }
}

/// Whether so many threads may be meant.
pub(super) fn check_threads(asked: u32, name: &str) -> Checked<()> {
    if asked <= MOST_THREADS || asked == OC_ALL_THREADS {
        Ok(())
    } else {
        bad(format!("{name} is {asked}; up to {MOST_THREADS}"))
    }
}

/// More than any machine has: a larger number was not meant.
const MOST_THREADS: u32 = 4096;

/// Reads the caller's executor, if there is one.
///
/// # Safety
/// NULL or initialised.
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
        return bad("oc_executor.concurrency is 0");
    }
    let concurrency = executor.concurrency as usize;
    Ok(Some(Arc::new(HostExecutor { concurrency, user: executor.user, submit })))
}

/// Makes a context. `header_version` is OC_HEADER_VERSION, so that a program and a library that do not
/// belong together say so instead of crashing. `desc` may be NULL: all defaults.
///
/// OC_STATUS_VERSION_MISMATCH if they do not; OC_STATUS_INVALID_ARGUMENT if the machine lacks the instruction set, or
/// has less memory than the budget; OC_STATUS_IO if a thread cannot be started. Ownership: the caller owns a count.
/// Thread safety: any thread. Cheap.
/// # Safety
/// `desc` is NULL or initialised, and so is its executor; `out_context` writable.
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
        if desc.flags & !OC_CONTEXT_NO_READ_AHEAD != 0 {
            return bad(format!("oc_context_desc.flags {:#x}: some are unknown", desc.flags));
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
            log,
            isa,
        })?;
        let (isa, threads) = (context.isa().name(), context.concurrency());
        let version = env!("CARGO_PKG_VERSION");
        context.log(LogLevel::Info, &format!("outcrop {version}: {isa}, room for {threads} at work"));
        out.write(handles::give::<oc_context>(ContextObject { context, host, waiting: Mutex::default() }));
        Ok(())
    })
}

/// `None` for the best.
fn instruction_set(number: oc_instruction_set) -> super::guard::Checked<Option<Isa>> {
    match Isa::ALL.into_iter().find(|isa| *isa as u32 == number) {
        None if number != OC_INSTRUCTION_SET_BEST => {
            bad(format!("oc_context_desc.instruction_set {number} is unknown"))
        }
        isa => Ok(isa),
    }
}

/// While the major version is 0, a minor version is a new interface.
fn check_version(header: u32) -> super::guard::Checked<()> {
    if header / 100 == OC_HEADER_VERSION / 100 {
        return Ok(());
    }
    let name = |v: u32| format!("{}.{}.{}", v / 10000, v / 100 % 100, v % 100);
    debug_assert_eq!(OC_HEADER_VERSION % 100, OC_VERSION_PATCH);
    Err(Failure::VersionMismatch(format!(
        "the program was compiled with the header of outcrop {}, the library is {}",
        name(header),
        name(OC_HEADER_VERSION)
    )))
}

/// Does one small piece of waiting work in this thread, if there is any: some tens of microseconds to a few
/// milliseconds of a frame or a batch of rays, or a whole build or load of a context without threads. `out_did`, which
/// may be NULL, gets 1 if there was any, else 0.
///
/// Thread safety: any thread. Blocks while it works.
/// # Safety
/// Live handle; `out_did` writable or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_step(context: *const oc_context, out_did: *mut u32) -> oc_status {
    // SAFETY: the function's own contract.
    boundary(|| unsafe {
        handles::with_callbacks(context, |context: &Shell<ContextObject>| {
            let did = context.step();
            if !out_did.is_null() {
                out_did.write(u32::from(did));
            }
            Ok(())
        })
    })
}

/// What can be asked of a context.
pub type oc_property = u32;
/// The library's version, as OC_HEADER_VERSION is made.
pub const OC_PROPERTY_VERSION: oc_property = 1;
/// Threads of the library's own.
pub const OC_PROPERTY_THREADS: oc_property = 2;
/// How many threads, own or the host's, may work at once.
pub const OC_PROPERTY_CONCURRENCY: oc_property = 3;
/// The memory budget in bytes.
pub const OC_PROPERTY_MEMORY_BUDGET: oc_property = 4;
/// The vector instructions in use: an OC_INSTRUCTION_SET_ number.
pub const OC_PROPERTY_INSTRUCTION_SET: oc_property = 5;
/// The largest width and height of a frame.
pub const OC_PROPERTY_MAX_FRAME_SIZE: oc_property = 6;
/// The newest format of models that can be opened: major * 65536 + minor.
pub const OC_PROPERTY_FORMAT: oc_property = 7;
/// Bytes in use of the memory budget now.
pub const OC_PROPERTY_MEMORY_USED: oc_property = 8;

/// Asks for a property. OC_STATUS_INVALID_ARGUMENT for one that this library does not know.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// Live handle; `out_value` writable.
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

/// Adds a count. NULL does nothing. Thread safety: any thread. Cheap.
/// # Safety
/// NULL or a live handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_retain(context: *mut oc_context) {
    // SAFETY: the function's own contract.
    unsafe { handles::retain(context) }
}

/// Takes a count back. Objects made from the context keep what they need of it; its threads end with the
/// last of them. NULL does nothing.
///
/// Thread safety: any thread. Blocks until threads have ended, if nothing else keeps the context any more: a frame or
/// job that was released while it ran keeps it for a moment longer.
/// # Safety
/// NULL or a live handle of which the caller owns a count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_context_release(context: *mut oc_context) {
    // SAFETY: the function's own contract.
    unsafe { handles::release(context) }
}
