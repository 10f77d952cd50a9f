//! The locks of [`super::claims`]. A name of its own, so that its model test can put loom's in their place.

pub use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
