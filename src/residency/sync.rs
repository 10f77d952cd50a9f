//! The locks and counters of what is tried in every interleaving. A name of its own, so that the model tests can put
//! loom's in their place.

pub use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
pub use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
