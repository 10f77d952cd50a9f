//! Long work in one piece: builds and loads.
//!
//! The work runs on a thread of the context or as one task of the host's executor. In a context that has neither it
//! runs inside a wait or a step.

use super::guard::caught;
use super::job::{LongWork, Snapshot, Wake};
use super::status::OC_STATUS_OK;
use crate::base::error::{Error, Result};
use crate::base::handle::Handle;
use crate::base::progress::{Cancel, Phase, Progress};
use std::any::Any;
use std::sync::Arc;
use std::time::Duration;

/// Result of long work: a model, or the report of a build.
pub(crate) type Product = Box<dyn Any + Send + Sync>;
type Todo = Box<dyn FnOnce(&Task) -> Result<Product> + Send>;

/// One piece of long work. Its handle and the thread that runs it share it.
pub(crate) struct Task {
    /// The work writes it, polls read it.
    pub(crate) progress: Arc<Progress>,
    /// The work checks it regularly.
    pub(crate) cancel: Cancel,
    waiters_work: WaitersWork,
    /// Holds the work itself until a thread begins it.
    handle: Handle<Outcome, Option<Todo>>,
}

type Outcome = std::result::Result<Arc<Product>, Arc<Error>>;

/// When a waiting thread itself runs work that has not begun.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum WaitersWork {
    /// Never: a thread of the library runs the work.
    Never,
    /// Only in a wait without a timeout. The host's executor will run the work, but the waiting thread may be its only
    /// one.
    Untimed,
    /// Always: no other thread runs the work.
    Always,
}

impl Task {
    /// Creates work that has not begun.
    pub(crate) fn new(
        progress: Arc<Progress>,
        cancel: Cancel,
        waiters_work: WaitersWork,
        todo: impl FnOnce(&Task) -> Result<Product> + Send + 'static,
    ) -> Arc<Self> {
        let todo: Todo = Box::new(todo);
        Arc::new(Self { progress, cancel, waiters_work, handle: Handle::new(Some(todo)) })
    }

    /// Runs the work in this thread. Returns `false` if a thread began it before.
    pub(crate) fn run(&self) -> bool {
        let Some(todo) = self.handle.lock().take() else { return false };
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
        self.handle.end(outcome.map(Arc::new).map_err(Arc::new));
        true
    }

    /// Returns the result of the work, if it has succeeded.
    pub(crate) fn product(&self) -> Option<Arc<Product>> {
        self.handle.ending()?.ok()
    }

    fn snapshot(&self, ending: Option<Outcome>) -> Snapshot {
        let mut snapshot = match ending {
            None => Snapshot::running(),
            Some(Ok(_)) => Snapshot::done(),
            Some(Err(error)) => Snapshot::ended_with(&error),
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
        self.snapshot(self.handle.ending())
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
        self.snapshot(self.handle.wait(timeout.unwrap_or(Duration::MAX)))
    }

    fn cancel(&self) {
        self.cancel.cancel();
        // Work that no thread has begun, and perhaps none ever would, ends here.
        self.run();
    }

    fn set_wake(&self, wake: Option<Wake>) {
        self.handle.set_wake(wake.map(Wake::into_fn));
    }

    fn product(&self) -> Option<Arc<Product>> {
        Task::product(self)
    }
}
