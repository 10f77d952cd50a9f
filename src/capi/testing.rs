//! Panics on demand, for tests. Exists only in builds with debug assertions, and not in the header.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// At the start of an entry point, before its object is known.
pub(crate) const AT_ENTRY: u32 = 1;
/// In an entry point, after its object is known.
pub(crate) const IN_OBJECT: u32 = 2;
/// In background work.
pub(crate) const IN_WORK: u32 = 3;

static ARMED: AtomicU32 = AtomicU32::new(0);

/// The next thread that reaches a place of this kind panics.
#[unsafe(no_mangle)]
pub extern "C" fn oc_test_panic_at(place: u32) {
    ARMED.store(place, Relaxed);
}

pub(crate) fn trip(place: u32) {
    if ARMED.load(Relaxed) == place && ARMED.compare_exchange(place, 0, Relaxed, Relaxed).is_ok() {
        panic!("requested by a test");
    }
}
