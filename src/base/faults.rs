//! Simulated disk failures for tests of whole builds: one write in a thread fails if the test requests it. Without such
//! a request, and outside of this crate's tests, nothing fails.

use std::io;

/// Called before each write.
#[cfg(not(test))]
#[inline(always)]
pub fn writing() -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
pub use tests_only::{fail_at, writing};

#[cfg(test)]
mod tests_only {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        static LEFT: Cell<Option<u32>> = const { Cell::new(None) };
    }

    /// Runs `work`; call number `n` of [`writing`] in this thread, counted from 0, fails. Also returns whether there
    /// was such a call.
    pub fn fail_at<T>(n: u32, work: impl FnOnce() -> T) -> (T, bool) {
        LEFT.set(Some(n));
        let done = work();
        (done, LEFT.take().is_none())
    }

    /// Called before each write. Fails as a full disk does if it is the selected call.
    pub fn writing() -> io::Result<()> {
        match LEFT.get() {
            Some(0) => {
                LEFT.set(None);
                Err(io::ErrorKind::StorageFull.into())
            }
            left => {
                LEFT.set(left.map(|n| n - 1));
                Ok(())
            }
        }
    }
}
