//! How fetchers learn that there is something to do.

use super::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What to call when there is work; from any thread, under no lock of ours.
type Waker = std::sync::Arc<dyn Fn() + Send + Sync>;

/// Counts the reasons to look for work, so that none is slept through.
#[derive(Default)]
pub(super) struct Wakeup {
    count: Mutex<Count>,
    changed: Condvar,
    waker: std::sync::Mutex<Option<Waker>>,
}

#[derive(Default)]
struct Count {
    reasons: u64,
    stop: bool,
}

impl Wakeup {
    /// There may be work.
    pub fn wake(&self) {
        self.lock().reasons += 1;
        self.changed.notify_all();
        let waker = self.waker.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(waker) = waker {
            waker();
        }
    }

    /// What to call besides.
    pub fn set_waker(&self, waker: Option<Waker>) {
        *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = waker;
    }

    /// Reasons so far: to be asked for before looking for work. `None` once it is to end.
    pub fn reasons(&self) -> Option<u64> {
        let count = self.lock();
        (!count.stop).then_some(count.reasons)
    }

    /// Sleeps until there are other reasons than `seen`, or it is to end, `timeout` at most.
    pub fn sleep(&self, seen: u64, timeout: Option<Duration>) {
        let mut count = self.lock();
        while count.reasons == seen && !count.stop {
            count = match timeout {
                None => self.changed.wait(count).unwrap_or_else(PoisonError::into_inner),
                Some(timeout) => {
                    let _ = self.changed.wait_timeout(count, timeout);
                    return;
                }
            };
        }
    }

    /// All who sleep are to end.
    pub fn stop(&self) {
        self.lock().stop = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Count> {
        self.count.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
