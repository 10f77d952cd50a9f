//! The context: the workers, the log and the memory budget that all other objects use. There is no global state, so any
//! number of contexts can exist at the same time.

use crate::base::error::{Error, Result};
use crate::base::tasks::{Ending, Executor, Pool, Work};
use crate::base::threads;
use crate::base::working::WorkingMemory;
use crate::residency::{Fetchers, Residency, ResidencyOptions};
use crate::simd::{DenormalsOff, Isa};
use std::any::Any;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// The importance of a log line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum LogLevel {
    /// An operation failed.
    Error = 1,
    /// Something is not as it should be; the work continues.
    Warning = 2,
    /// Information for users.
    Info = 3,
    /// Information for developers.
    Debug = 4,
}

/// Receives log lines. It may be called from any thread, never under a lock of the library.
pub type Log = Arc<dyn Fn(LogLevel, &str) + Send + Sync>;

/// Options of [`Context::new`].
#[derive(Clone)]
pub struct ContextOptions {
    /// Number of the library's own threads that trace. Default: one per core. With 0 the caller drives the work with
    /// [`Context::step`] or by waiting. At most [`threads::most`]. Ignored if an executor is given.
    pub threads: usize,
    /// The host's own threads: with an executor the library starts no threads at all.
    pub executor: Option<Arc<dyn Executor>>,
    /// Bytes that models may hold in memory, including tables and the working memory of reading. 0 means three quarters
    /// of the machine's memory; more than the machine has is rejected. Never exceeded. A model may be larger than the
    /// budget: its data is read on use, and the least recently used data is evicted. Buffers of frames and of batches
    /// come on top.
    pub memory_budget: u64,
    /// True if models that fit the budget are read in the background before all of their data was requested. Default:
    /// true.
    pub read_ahead: bool,
    /// True if models only have their compact form in memory. By default exact rays through a model that is in memory
    /// as a whole go through a faster form, which takes about twice the memory of the compact one, as far as the budget
    /// has room. Answers are the same.
    pub compact: bool,
    /// Receives log lines.
    pub log: Option<Log>,
    /// Instruction set; `None` selects the best that the machine has.
    pub isa: Option<Isa>,
}

impl Default for ContextOptions {
    fn default() -> Self {
        Self {
            threads: threads::processors(),
            executor: None,
            memory_budget: 0,
            read_ahead: true,
            compact: false,
            log: None,
            isa: None,
        }
    }
}

/// The context that all objects made from it share; cloning is cheap and gives the same context. Thread-safe.
///
/// Its threads end when the last clone and all objects made from it are gone.
#[derive(Clone)]
pub struct Context(Arc<Inner>);

struct Inner {
    /// The order matters: fetchers are dropped, and end, before the members that they use.
    _fetchers: Option<Fetchers>,
    pool: Pool,
    log: Option<Log>,
    residency: Residency,
    pumping: Arc<Pumping>,
    isa: Isa,
    is_compact: bool,
    /// Working memory of ended batches, for reuse.
    scratch: WorkingMemory,
    /// Bytes of working memory of rays, in batches, that wait for blocks.
    waiting: Arc<AtomicU64>,
    /// Held while a scene is put into another.
    nesting: Mutex<()>,
}

impl Context {
    /// A new context. Fails with [`Error::Io`] if threads cannot be started, and with [`Error::BadArgument`] if there
    /// are too many threads, or the machine lacks the instruction set or has less memory than the budget. (Too small a
    /// budget is reported when a model is opened, as the least budget depends on the model.)
    pub fn new(options: ContextOptions) -> Result<Self> {
        let isa = options.isa.unwrap_or_else(Isa::best);
        if !isa.is_available() {
            return Err(Error::bad_argument(format!("this machine does not support {}", isa.name())));
        }
        if options.executor.is_none() {
            threads::check(options.threads, "threads")?;
        }
        let budget = budget_of(options.memory_budget, machine_memory())?;
        let is_stepped = options.threads == 0 && options.executor.is_none();
        let pool = Pool::new(options.threads, options.executor, without_denormals)?;
        let residency = Residency::new(ResidencyOptions { budget, promote: options.read_ahead });
        let fetchers = (pool.threads() > 0).then(|| residency.start(FETCHERS)).transpose()?;
        let has_fetchers = fetchers.is_some();
        if is_stepped {
            residency.set_stepped();
        }
        let pumping = Arc::new(Pumping::of(&residency));
        // The limit is one more than the workers, or the host's calling threads, that can use working memory at once.
        let workers = threads::processors().max(pool.concurrency());
        let (log, scratch, is_compact) = (options.log, WorkingMemory::new(workers + 1), options.compact);
        let (waiting, nesting) = (Arc::default(), Mutex::default());
        let inner = Arc::new(Inner {
            _fetchers: fetchers,
            pool,
            log,
            residency,
            pumping,
            isa,
            is_compact,
            scratch,
            waiting,
            nesting,
        });
        if !has_fetchers {
            let weak = Arc::downgrade(&inner);
            inner.residency.set_waker(Some(Arc::new(move || pump_in_pool(&weak))));
        }
        Ok(Self(inner))
    }

    /// Working memory that was given back, or new.
    pub(crate) fn take_scratch<T: Any + Send + Default>(&self) -> Box<T> {
        self.0.scratch.take()
    }

    /// Gives working memory back.
    pub(crate) fn give_scratch(&self, scratch: Box<dyn Any + Send>) {
        self.0.scratch.give(scratch);
    }

    /// The count of the bytes of working memory of rays, in batches, that wait for blocks.
    pub(crate) fn waiting(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.0.waiting)
    }

    /// Runs a small piece of waiting work, if any, in the caller's thread. Returns true if there was one. Thread-safe;
    /// meant for contexts without threads, allowed for all.
    pub fn step(&self) -> bool {
        self.0.pool.step()
    }

    /// Number of the library's own threads.
    pub fn threads(&self) -> usize {
        self.0.pool.threads()
    }

    /// Number of workers that may serve a job at once: the library's or the host's threads, at least 1.
    pub fn concurrency(&self) -> usize {
        self.pool().concurrency()
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.0.isa
    }

    /// See [`ContextOptions::compact`].
    pub(crate) fn is_compact(&self) -> bool {
        self.0.is_compact
    }

    /// The budget in bytes.
    pub fn memory_budget(&self) -> u64 {
        self.0.residency.budget()
    }

    /// Held while a scene is put into another.
    pub(super) fn nesting(&self) -> MutexGuard<'_, ()> {
        self.0.nesting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes of the budget in use.
    pub fn memory_used(&self) -> u64 {
        self.0.residency.used()
    }

    /// Writes a log line.
    pub fn log(&self, level: LogLevel, line: &str) {
        if let Some(log) = &self.0.log {
            log(level, line);
        }
    }

    /// The workers.
    pub(crate) fn pool(&self) -> &Pool {
        &self.0.pool
    }

    /// The memory of models.
    pub(crate) fn residency(&self) -> &Residency {
        &self.0.residency
    }

    /// True if both are the same context.
    pub fn same(&self, other: &Context) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Number of the library's own threads that read, in addition to those that trace. They are mostly asleep or wait for
/// the disk, which delivers more with several requests at once. (Two threads: 430 MB decoded per second, four: 570.)
const FETCHERS: usize = 4;

/// Reading as a job of the pool, for contexts without own threads.
struct Pumping {
    residency: Residency,
    /// True while the job is in the pool.
    runs: AtomicBool,
    /// True if work may have arrived since the job last checked.
    again: AtomicBool,
    did: AtomicBool,
}

impl Pumping {
    fn of(residency: &Residency) -> Self {
        let [runs, again, did] = [const { AtomicBool::new(false) }; 3];
        Self { residency: residency.clone(), runs, again, did }
    }
}

fn pump_in_pool(context: &Weak<Inner>) {
    let Some(context) = context.upgrade() else { return };
    context.pumping.again.store(true, SeqCst);
    if !context.pumping.runs.swap(true, SeqCst) {
        let work = Arc::clone(&context.pumping);
        context.pool.submit(1, work);
    }
}

impl Work for Pumping {
    fn run(&self, _: usize) -> Result<()> {
        self.again.store(false, SeqCst);
        self.did.store(self.residency.pump_on(), SeqCst);
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        if self.did.load(SeqCst) || self.again.load(SeqCst) {
            return Ok(1);
        }
        self.runs.store(false, SeqCst);
        // A thread that found the job running in the meantime has left its work to it.
        Ok(usize::from(self.again.load(SeqCst) && !self.runs.swap(true, SeqCst)))
    }

    fn ended(&self, ending: &Ending) {
        if !matches!(ending, Ending::Finished) {
            self.runs.store(false, SeqCst);
        }
    }
}

/// Runs the work of every thread, the library's, the host's or a waiting caller's, with denormals off.
fn without_denormals(work: &mut dyn FnMut()) {
    let _off = DenormalsOff::set();
    work();
}

/// The budget for a request of `asked` bytes on a machine with `there` bytes, if known. A budget that exceeds the
/// machine's memory is rejected instead of reduced: a host that relies on its size must know.
fn budget_of(asked: u64, there: Option<u64>) -> Result<u64> {
    match (asked, there) {
        (0, there) => Ok(there.unwrap_or(UNKNOWN_MEMORY) / 4 * 3),
        (asked, Some(there)) if asked > there => {
            let text =
                format!("a memory budget of {asked} bytes is more than the {there} bytes of memory of the machine");
            Err(Error::BadArgument(text))
        }
        (asked, _) => Ok(asked),
    }
}

/// Assumed memory in bytes of a machine that does not report it.
const UNKNOWN_MEMORY: u64 = 8 << 30;

/// Memory of the machine in bytes, if it reports it.
fn machine_memory() -> Option<u64> {
    let total = |text: String| {
        let line = text.lines().find_map(|l| l.strip_prefix("MemTotal:").map(str::to_owned))?;
        line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok().map(|kb| kb << 10)
    };
    std::fs::read_to_string("/proc/meminfo").ok().and_then(total)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_as_requested_or_rejected() {
        let gb = 1u64 << 30;
        assert_eq!(budget_of(0, Some(16 * gb)).ok(), Some(12 * gb));
        assert_eq!(budget_of(0, None).ok(), Some(6 * gb));
        for (asked, there) in [(1, Some(gb)), (gb, Some(gb)), (u64::MAX, None)] {
            assert_eq!(budget_of(asked, there).ok(), Some(asked));
        }
        let refused = budget_of(gb + 1, Some(gb)).map_err(|e| e.to_string());
        assert!(refused.is_err_and(|why| why.contains("1073741825") && why.contains("1073741824")));
    }
}
