//! Notification of fetchers that there is work.

use super::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Function that is called when there is work, from any thread, without a lock held.
type Waker = std::sync::Arc<dyn Fn() + Send + Sync>;

/// Counts the notifications, so that no fetcher sleeps through one.
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
    /// Notifies all fetchers that there may be work.
    pub fn wake(&self) {
        self.lock().reasons += 1;
        self.changed.notify_all();
        let waker = self.waker.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(waker) = waker {
            waker();
        }
    }

    /// Sets a function that each notification calls too.
    pub fn set_waker(&self, waker: Option<Waker>) {
        *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = waker;
    }

    /// Returns the number of notifications so far; to be read before the search for work. `None` once fetchers must
    /// end.
    pub fn reasons(&self) -> Option<u64> {
        let count = self.lock();
        (!count.stop).then_some(count.reasons)
    }

    /// Sleeps until the number differs from `seen` or fetchers must end, `timeout` at most.
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

    /// Makes all fetchers end.
    pub fn stop(&self) {
        self.lock().stop = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Count> {
        self.count.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
