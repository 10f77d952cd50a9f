//! Threads that are inside a read function of the caller. Such a function must not use the library for anything that
//! reads or waits: the thread reads for another call, which may hold what the new one would wait for.

use super::error::{Error, Result};
use std::cell::Cell;

thread_local! {
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// Restores the former state, also if the function unwinds.
struct Restore(bool);

impl Drop for Restore {
    fn drop(&mut self) {
        INSIDE.set(self.0);
    }
}

/// Calls a read function of the caller.
pub fn reading<T>(read: impl FnOnce() -> T) -> T {
    let _restore = Restore(INSIDE.replace(true));
    read()
}

/// Fails with [`Error::BadState`] if this thread is inside a read function of the caller.
pub fn refuse_inside_read() -> Result<()> {
    if INSIDE.get() {
        let why = "a read function of a model must not query, open, load, render or wait: its thread reads for another \
                   call, which could wait for itself";
        return Err(Error::BadState(why.into()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_inside_a_read_are_known_also_after_a_panic() {
        assert!(refuse_inside_read().is_ok());
        reading(|| {
            reading(|| assert!(refuse_inside_read().is_err()));
            assert!(refuse_inside_read().is_err());
        });
        let _ = std::panic::catch_unwind(|| reading(|| panic!("in a read")));
        assert!(refuse_inside_read().is_ok());
    }
}
