//! The context: workers, log and memory budget that everything else hangs on. No global state:
//! any number of contexts live side by side.

use crate::base::error::{Error, Result};
use crate::base::tasks::{Ending, Executor, Pool, Work};
use crate::base::working::WorkingMemory;
use crate::residency::{Fetchers, Residency, ResidencyOptions};
use crate::simd::{DenormalsOff, Isa};
use std::any::Any;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Weak};

/// How much a log line matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum LogLevel {
    /// Something failed.
    Error = 1,
    /// Something is not as it should be, work goes on.
    Warning = 2,
    /// What a user may want to know.
    Info = 3,
    /// What a developer may want to know.
    Debug = 4,
}

/// Receives log lines; may be called from any thread, never under a lock of ours.
pub type Log = Arc<dyn Fn(LogLevel, &str) + Send + Sync>;

/// Options of [`Context::new`].
#[derive(Clone)]
pub struct ContextOptions {
    /// Threads of ours that trace; 0: none, then the caller drives with [`Context::step`] or by
    /// waiting. Ignored when an executor is given. Default: one for each core.
    pub threads: usize,
    /// The host's own threads: with it no thread of ours ever exists.
    pub executor: Option<Arc<dyn Executor>>,
    /// Bytes that models may hold in memory, tables and working memory of reading included; 0: three quarters of the
    /// machine's; more than that has is refused. Never exceeded. A model larger than that opens: what is used is read,
    /// and what has not been used for longest goes. Buffers of frames and of batches come on top.
    pub memory_budget: u64,
    /// Whether models that fit the budget are read in the background before all of them was asked for. Default: yes.
    pub read_ahead: bool,
    /// Receives log lines.
    pub log: Option<Log>,
    /// Instruction set; `None`: the best that the machine has.
    pub isa: Option<Isa>,
}

impl Default for ContextOptions {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        Self { threads, executor: None, memory_budget: 0, read_ahead: true, log: None, isa: None }
    }
}

/// Shared by everything made from it; cloning is cheap and gives the same context. Thread-safe.
///
/// When the last clone and everything made from it are gone, its threads end.
#[derive(Clone)]
pub struct Context(Arc<Inner>);

struct Inner {
    /// Before what they use: they end first.
    _fetchers: Option<Fetchers>,
    pool: Pool,
    log: Option<Log>,
    residency: Residency,
    pumping: Arc<Pumping>,
    isa: Isa,
    /// Working memory of batches that have ended, for the next ones.
    scratch: WorkingMemory,
}

impl Context {
    /// A new context. Fails with [`Error::Io`] if threads cannot be started, with [`Error::BadArgument`] if the machine
    /// lacks the instruction set, or has less memory than the budget. (Too small a budget is found when a model is
    /// opened: the least depends on it.)
    pub fn new(options: ContextOptions) -> Result<Self> {
        let isa = options.isa.unwrap_or_else(Isa::best);
        if !isa.is_available() {
            return Err(Error::bad_argument(format!("this machine does not have {}", isa.name())));
        }
        let budget = budget_of(options.memory_budget, machine_memory())?;
        let pool = Pool::new(options.threads, options.executor, without_denormals)?;
        let residency = Residency::new(ResidencyOptions { budget, promote: options.read_ahead });
        let fetchers = (pool.threads() > 0).then(|| residency.start(FETCHERS)).transpose()?;
        let has_fetchers = fetchers.is_some();
        let pumping = Arc::new(Pumping::of(&residency));
        // As much is kept as workers can use at once, or the host's threads that ask, and one more.
        let threads = std::thread::available_parallelism().map_or(1, usize::from).max(pool.concurrency());
        let (log, scratch) = (options.log, WorkingMemory::new(threads + 1));
        let inner = Arc::new(Inner { _fetchers: fetchers, pool, log, residency, pumping, isa, scratch });
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

    /// Runs a small piece of waiting work, if any, in the caller's thread; whether there was one.
    /// Thread-safe; meant for contexts without threads, allowed with all.
    pub fn step(&self) -> bool {
        self.0.pool.step()
    }

    /// Threads of ours.
    pub fn threads(&self) -> usize {
        self.0.pool.threads()
    }

    /// How many workers may serve a job at once: threads of ours or of the host, at least 1.
    pub fn concurrency(&self) -> usize {
        self.pool().concurrency()
    }

    /// The instruction set in use.
    pub fn isa(&self) -> Isa {
        self.0.isa
    }

    /// The budget in bytes.
    pub fn memory_budget(&self) -> u64 {
        self.0.residency.budget()
    }

    /// Bytes in use of the budget.
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

    /// Whether both are the same context.
    pub fn same(&self, other: &Context) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// Threads of ours that read, beside those that trace: mostly asleep, or waiting for the disk, which does more when
/// asked for more at once (two: 430 MB decoded a second, four: 570).
const FETCHERS: usize = 4;

/// Reading as a job of the pool, for contexts without threads of ours.
struct Pumping {
    residency: Residency,
    /// The job is there.
    runs: AtomicBool,
    /// There may be more to do than when it last looked.
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
        // A thread that found it running meanwhile has left it to this one.
        Ok(usize::from(self.again.load(SeqCst) && !self.runs.swap(true, SeqCst)))
    }

    fn ended(&self, ending: &Ending) {
        if !matches!(ending, Ending::Finished) {
            self.runs.store(false, SeqCst);
        }
    }
}

/// Around the work of every thread, ours, the host's or a waiter's.
fn without_denormals(work: &mut dyn FnMut()) {
    let _off = DenormalsOff::set();
    work();
}

/// The budget, where `asked` is asked for and the machine has `there` bytes, if it says. A budget that it cannot hold
/// is refused, not cut: a host that relies on its size should know.
fn budget_of(asked: u64, there: Option<u64>) -> Result<u64> {
    match (asked, there) {
        (0, there) => Ok(there.unwrap_or(UNKNOWN_MEMORY) / 4 * 3),
        (asked, Some(there)) if asked > there => {
            let what = format!("a memory budget of {asked} bytes is more than the {there} that the machine has");
            Err(Error::BadArgument(what))
        }
        (asked, _) => Ok(asked),
    }
}

/// Bytes of memory, where the machine does not say.
const UNKNOWN_MEMORY: u64 = 8 << 30;

/// Bytes of memory of the machine, if it says.
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
    fn a_budget_is_what_was_asked_or_refused() {
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
