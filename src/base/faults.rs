//! Disks that fail, for tests of whole builds: in a thread that asked for it, one call of those that write
//! fails. Elsewhere, and outside of this crate's tests, nothing does.

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

    /// Runs `work` with call `n` of [`writing`] in this thread failing, counted from 0; says whether it came to that.
    pub fn fail_at<T>(n: u32, work: impl FnOnce() -> T) -> (T, bool) {
        LEFT.set(Some(n));
        let done = work();
        (done, LEFT.take().is_none())
    }

    /// Called before each write: fails as a full disk does when its turn has come.
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
