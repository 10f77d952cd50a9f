//! The handle that all jobs contain: how the job has ended, the threads that wait for its end, and the wake function,
//! which is called at the end.
//!
//! Each [`Job`](crate::base::tasks::Job) has a handle, and a batch of rays uses that of its job. Prefetches, builds and
//! loads have their own. A frame ends once for each request, so it has only a [`Waker`].

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;
use std::time::{Duration, Instant};

/// A function that tells the owner of a job that the job has news, for instance its end.
pub type WakeFn = Arc<dyn Fn() + Send + Sync>;

/// A wake function, and the threads that are calling it. The waker is kept under a lock; the function is called under
/// none.
#[derive(Default)]
pub struct Waker {
    wake: Option<WakeFn>,
    callers: Vec<ThreadId>,
}

impl Waker {
    /// Replaces the function. Returns the old one, which the caller drops outside of the lock: it may own the locked
    /// object.
    #[must_use]
    pub fn set(&mut self, wake: Option<WakeFn>) -> Option<WakeFn> {
        std::mem::replace(&mut self.wake, wake)
    }

    /// Returns the function, for this thread to call now. The thread calls [`Waker::returned`] afterwards.
    pub fn call(&mut self) -> Option<WakeFn> {
        let wake = self.wake.clone()?;
        self.callers.push(std::thread::current().id());
        Some(wake)
    }

    /// Like [`Waker::call`], but removes the function.
    pub fn call_last(&mut self) -> Option<WakeFn> {
        let wake = self.call();
        self.wake = None;
        wake
    }

    /// Records that this thread's call of the function has returned.
    pub fn returned(&mut self) {
        let me = std::thread::current().id();
        if let Some(at) = self.callers.iter().position(|caller| *caller == me) {
            self.callers.swap_remove(at);
        }
    }

    /// True if a thread other than this one is calling the function. (A thread that waited for its own call would wait
    /// for ever.)
    pub fn is_called_elsewhere(&self) -> bool {
        let me = std::thread::current().id();
        self.callers.iter().any(|caller| *caller != me)
    }
}

/// The end of a job, `E`, which is set once, and the job's own state, `S`, under the same lock.
pub struct Handle<E, S = ()> {
    core: Mutex<Core<E, S>>,
    /// Signalled at the end, again after the wake function has returned, and by [`Handle::notify`].
    changed: Condvar,
}

/// The content of a [`Handle`]'s lock. Dereferences to the job's own state.
pub struct Core<E, S> {
    end: Option<E>,
    waker: Waker,
    own: S,
}

impl<E, S> Core<E, S> {
    /// How the job has ended; `None` while it runs.
    pub fn ending(&self) -> Option<&E> {
        self.end.as_ref()
    }

    /// True if the job has ended and no other thread is calling the wake function.
    fn is_over(&self) -> bool {
        self.end.is_some() && !self.waker.is_called_elsewhere()
    }
}

impl<E, S> Deref for Core<E, S> {
    type Target = S;
    fn deref(&self) -> &S {
        &self.own
    }
}

impl<E, S> DerefMut for Core<E, S> {
    fn deref_mut(&mut self) -> &mut S {
        &mut self.own
    }
}

/// The longest time that a thread sleeps at once: some systems do not support longer ones.
const LONGEST: Duration = Duration::from_secs(3600);

impl<E: Clone, S> Handle<E, S> {
    /// The handle of a running job.
    pub fn new(own: S) -> Self {
        let core = Core { end: None, waker: Waker::default(), own };
        Self { core: Mutex::new(core), changed: Condvar::new() }
    }

    /// Takes the lock. No work of a job and no call to its owner is done under it.
    pub fn lock(&self) -> MutexGuard<'_, Core<E, S>> {
        // Every step under the lock leaves a valid state, so a poisoned lock is harmless.
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How the job has ended; `None` while it runs. Never blocks.
    pub fn ending(&self) -> Option<E> {
        self.lock().end.clone()
    }

    /// Ends the job: wakes the waiting threads, then calls the wake function in this thread. Only the first call has an
    /// effect.
    pub fn end(&self, end: E) {
        let wake = {
            let mut core = self.lock();
            if core.end.is_some() {
                return;
            }
            core.end = Some(end);
            core.waker.call_last()
        };
        self.changed.notify_all();
        if let Some(wake) = wake {
            let call = Call { handle: self, wake: Some(wake) };
            call.wake.as_deref().inspect(|wake| wake());
        }
    }

    /// Sets the wake function, which replaces an earlier one; `None` removes it. It is called once, when the job ends,
    /// in the thread that ends it, and never under a lock. If the job has already ended, it is called now, in this
    /// thread.
    pub fn set_wake(&self, wake: Option<WakeFn>) {
        let mut core = self.lock();
        if core.end.is_none() {
            let before = core.waker.set(wake);
            drop(core);
            drop(before);
        } else if let Some(wake) = wake {
            drop(core);
            wake();
        }
    }

    /// Makes the waiting threads call `todo` again.
    pub fn notify(&self) {
        self.changed.notify_all();
    }

    /// Waits, for `timeout` at most, until the job has ended and no other thread is calling the wake function. Returns
    /// how the job has ended, or `None` after the timeout. So when a wait has reported the end, the owner may free all
    /// objects that the wake function refers to.
    pub fn wait(&self, timeout: Duration) -> Option<E> {
        self.wait_working(timeout, |_| None, |(), _| {})
    }

    /// [`Handle::wait`] of a thread that works meanwhile: `todo` returns a piece of work, if there is any, under the
    /// lock, and `work` works on it, for the given time at most.
    pub fn wait_working<T>(
        &self,
        timeout: Duration,
        todo: impl Fn(&S) -> Option<T>,
        work: impl Fn(T, Duration),
    ) -> Option<E> {
        let deadline = Instant::now().checked_add(timeout);
        let left = || deadline.map_or(Duration::MAX, |d| d.saturating_duration_since(Instant::now()));
        loop {
            let core = self.lock();
            if core.is_over() {
                return core.end.clone();
            }
            let time = left();
            if time.is_zero() {
                return None;
            }
            let task = if core.end.is_none() { todo(&core.own) } else { None };
            match task {
                Some(task) => {
                    drop(core);
                    work(task, left());
                }
                None => drop(self.changed.wait_timeout(core, time.min(LONGEST))),
            }
        }
    }
}

/// The last call of a wake function. The call counts as returned when this is dropped, even by unwinding.
struct Call<'a, E: Clone, S> {
    handle: &'a Handle<E, S>,
    wake: Option<WakeFn>,
}

impl<E: Clone, S> Drop for Call<'_, E, S> {
    fn drop(&mut self) {
        // The function is dropped before the call counts as returned: it may own the job, and a waiting thread may then
        // free the objects that it refers to.
        self.wake = None;
        self.handle.lock().waker.returned();
        self.handle.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
    use std::thread;

    const LONG: Duration = Duration::from_secs(120);
    const SHORT: Duration = Duration::from_millis(1);

    #[test]
    fn the_first_end_counts_and_wakes_once() {
        let (handle, woken) = (Handle::<u32>::new(()), Arc::new(AtomicUsize::new(0)));
        let wake = || -> Option<WakeFn> {
            let woken = Arc::clone(&woken);
            Some(Arc::new(move || {
                woken.fetch_add(1, SeqCst);
            }))
        };
        assert_eq!((handle.ending(), handle.wait(SHORT)), (None, None));
        handle.set_wake(wake());
        handle.set_wake(wake());
        handle.end(1);
        handle.end(2);
        assert_eq!((handle.ending(), handle.wait(LONG), woken.load(SeqCst)), (Some(1), Some(1), 1));
        // A function that is set after the end is called at once.
        handle.set_wake(wake());
        handle.set_wake(None);
        assert_eq!(woken.load(SeqCst), 2);
    }

    #[test]
    fn a_wait_lasts_as_long_as_the_call_of_another_thread_and_not_as_its_own() {
        let (handle, inside) = (Arc::new(Handle::<u32>::new(())), Arc::new(Barrier::new(2)));
        let (own, at) = (Arc::downgrade(&handle), Arc::clone(&inside));
        handle.set_wake(Some(Arc::new(move || {
            let ends = own.upgrade().map(|handle| handle.wait(LONG));
            assert_eq!(ends, Some(Some(7)));
            at.wait();
            at.wait();
        })));
        thread::scope(|threads| {
            threads.spawn(|| handle.end(7));
            inside.wait();
            assert_eq!((handle.wait(SHORT), handle.ending()), (None, Some(7)));
            inside.wait();
            assert_eq!(handle.wait(LONG), Some(7));
        });
        assert_eq!(Arc::strong_count(&inside), 1, "the wake function is gone");
    }

    #[test]
    fn a_wake_function_that_panics_keeps_nothing_waiting() {
        let handle = Handle::<u32>::new(());
        handle.set_wake(Some(Arc::new(|| panic!("woken"))));
        assert!(catch_unwind(AssertUnwindSafe(|| handle.end(3))).is_err());
        thread::scope(|threads| {
            threads.spawn(|| assert_eq!(handle.wait(LONG), Some(3)));
        });
    }

    #[test]
    fn a_thread_that_waits_works_while_there_is_something_to_do() {
        let (handle, left) = (Handle::<u32, Vec<u32>>::new(vec![1, 2, 3]), AtomicUsize::new(3));
        let work = |item, _| {
            assert_eq!(handle.lock().pop(), Some(item));
            if left.fetch_sub(1, SeqCst) == 1 {
                handle.end(item);
            }
        };
        assert_eq!(handle.wait_working(LONG, |items| items.last().copied(), work), Some(1));
    }
}
