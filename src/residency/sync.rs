//! Locks and counters of the code that is tested in every interleaving. They have a module of their own so that the
//! model tests can replace them with loom's.

pub use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
pub use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
