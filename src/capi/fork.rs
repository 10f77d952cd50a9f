//! Processes: handles belong to the process that created them.
//!
//! A child of `fork` has copies of the objects but not the threads behind them: a wait would never end, and a release
//! would join threads that do not exist. Calls on handles of the parent therefore fail, and releases only let go.

#[cfg(target_os = "linux")]
mod system {
    use std::sync::Once;
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

    /// Number of forks between the process that loaded the library and this one.
    static FORKS: AtomicU32 = AtomicU32::new(0);
    static REGISTER: Once = Once::new();

    extern "C" fn in_child() {
        FORKS.fetch_add(1, Relaxed);
    }

    /// Returns a number that differs from that of all processes from which this one was forked.
    #[inline]
    pub(crate) fn process() -> u32 {
        FORKS.load(Relaxed)
    }

    /// Called before an object is created.
    pub(crate) fn watch() {
        // SAFETY: the handler changes one atomic number, which is allowed after a fork. The C library removes it when
        // the shared library is unloaded. (A failure, for lack of memory, would only leave forks undetected.)
        REGISTER.call_once(|| unsafe {
            libc::pthread_atfork(None, None, Some(in_child));
        });
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    /// Returns a number that differs from that of all processes from which this one was forked.
    pub(crate) fn process() -> u32 {
        std::process::id()
    }

    /// Called before an object is created.
    pub(crate) fn watch() {}
}

pub(crate) use system::{process, watch};
