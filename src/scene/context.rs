//! The context: workers, log and memory budget that everything else hangs on. No global state:
//! any number of contexts live side by side.

use crate::base::error::Result;
use crate::base::tasks::{Executor, Pool};
use std::sync::Arc;

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
    /// Bytes that models may hold in memory; 0: three quarters of the machine's.
    pub memory_budget: u64,
    /// Receives log lines.
    pub log: Option<Log>,
}

impl Default for ContextOptions {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        Self { threads, executor: None, memory_budget: 0, log: None }
    }
}

/// Shared by everything made from it; cloning is cheap and gives the same context. Thread-safe.
///
/// When the last clone and everything made from it are gone, its threads end.
#[derive(Clone)]
pub struct Context(Arc<Inner>);

struct Inner {
    pool: Pool,
    log: Option<Log>,
    memory_budget: u64,
}

impl Context {
    /// A new context. Fails with [`crate::Error::Io`] if threads cannot be started, with
    /// [`crate::Error::BadArgument`] if the machine lacks the instruction set.
    pub fn new(options: ContextOptions) -> Result<Self> {
        let pool = Pool::new(options.threads, options.executor, |work| work())?;
        let memory_budget = match options.memory_budget {
            0 => u64::MAX,
            bytes => bytes,
        };
        Ok(Self(Arc::new(Inner { pool, log: options.log, memory_budget })))
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

    /// The budget in bytes.
    pub fn memory_budget(&self) -> u64 {
        self.0.memory_budget
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

    /// Whether both are the same context.
    pub fn same(&self, other: &Context) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}
