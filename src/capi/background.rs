//! Work that takes long and is one piece: builds and loads.
//!
//! It runs on a thread of the context, as one task of the host's executor, or, where the context has
//! neither, inside whoever waits or steps.

use super::guard::caught;
use super::job::{LongWork, Snapshot, Wake};
use super::status::OC_STATUS_OK;
use crate::base::error::{Error, Result};
use crate::base::progress::{Cancel, Phase, Progress};
use std::any::Any;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What work leaves behind: a model, a build's report.
pub(crate) type Product = Box<dyn Any + Send + Sync>;
type Todo = Box<dyn FnOnce(&Task) -> Result<Product> + Send>;

/// One piece of long work, shared by its handle and by whoever runs it.
pub(crate) struct Task {
    /// Written by the work, read by polls.
    pub(crate) progress: Arc<Progress>,
    /// Asked by the work.
    pub(crate) cancel: Cancel,
    waiters_work: WaitersWork,
    state: Mutex<State>,
    ended: Condvar,
}

struct State {
    /// The work, until somebody begins it.
    todo: Option<Todo>,
    outcome: Option<std::result::Result<Arc<Product>, Arc<Error>>>,
    wake: Option<Wake>,
}

/// When a waiter does work itself that nobody has begun.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum WaitersWork {
    /// A thread of ours does it.
    Never,
    /// The host's executor will, but a waiter without a timeout may be its only thread.
    Untimed,
    /// Nobody else will.
    Always,
}

impl Task {
    /// Work that nobody has begun yet.
    pub(crate) fn new(
        progress: Arc<Progress>,
        cancel: Cancel,
        waiters_work: WaitersWork,
        todo: impl FnOnce(&Task) -> Result<Product> + Send + 'static,
    ) -> Arc<Self> {
        let state = State { todo: Some(Box::new(todo)), outcome: None, wake: None };
        Arc::new(Self { progress, cancel, waiters_work, state: Mutex::new(state), ended: Condvar::new() })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does the work in this thread; `false` if somebody has begun it before.
    pub(crate) fn run(&self) -> bool {
        let Some(todo) = self.lock().todo.take() else { return false };
        let outcome = caught(|| {
            #[cfg(debug_assertions)]
            super::testing::trip(super::testing::IN_WORK);
            self.cancel.check()?;
            todo(self)
        });
        self.progress.enter(Phase::Done);
        if outcome.is_ok() {
            self.progress.advance(1.0);
        }
        let wake = {
            let mut state = self.lock();
            state.outcome = Some(outcome.map(Arc::new).map_err(Arc::new));
            state.wake.take()
        };
        self.ended.notify_all();
        if let Some(wake) = wake {
            wake.call();
        }
        true
    }

    /// What the work left behind, if it has ended well.
    pub(crate) fn product(&self) -> Option<Arc<Product>> {
        self.lock().outcome.as_ref().and_then(|o| o.as_ref().ok().cloned())
    }

    fn snapshot(&self, state: &State) -> Snapshot {
        let mut snapshot = match &state.outcome {
            None => Snapshot::running(),
            Some(Ok(_)) => Snapshot::done(),
            Some(Err(error)) => Snapshot::ended_with(error),
        };
        debug_assert!(snapshot.error.is_some() || snapshot.status == OC_STATUS_OK);
        use std::sync::atomic::Ordering::Relaxed;
        snapshot.fraction = self.progress.fraction();
        snapshot.phase = self.progress.phase() as u32;
        snapshot.done = self.progress.triangles.load(Relaxed);
        snapshot.bytes = self.progress.bytes_read.load(Relaxed) + self.progress.bytes_written.load(Relaxed);
        snapshot
    }
}

impl LongWork for Task {
    fn poll(&self) -> Snapshot {
        self.snapshot(&self.lock())
    }

    fn wait(&self, timeout: Option<Duration>) -> Snapshot {
        let works = match self.waiters_work {
            WaitersWork::Never => false,
            WaitersWork::Untimed => timeout.is_none(),
            WaitersWork::Always => true,
        };
        if works {
            self.run();
        }
        let deadline = timeout.map(|t| Instant::now() + t);
        let mut state = self.lock();
        while state.outcome.is_none() {
            let left = deadline.map(|d| d.saturating_duration_since(Instant::now()));
            if left.is_some_and(|l| l.is_zero()) {
                break;
            }
            let left = left.unwrap_or(Duration::from_secs(3600));
            state = self.ended.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        self.snapshot(&state)
    }

    fn cancel(&self) {
        self.cancel.cancel();
        // Work that nobody has begun, and that nobody may ever begin, ends here and now.
        self.run();
    }

    fn set_wake(&self, wake: Option<Wake>) {
        let now = {
            let mut state = self.lock();
            if state.outcome.is_some() { wake } else { std::mem::replace(&mut state.wake, wake).and(None) }
        };
        if let Some(wake) = now {
            wake.call();
        }
    }

    fn product(&self) -> Option<Arc<Product>> {
        Task::product(self)
    }
}
