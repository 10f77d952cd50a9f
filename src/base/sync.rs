//! The atomics of [`super::round`]. They have a module of their own, so that the model test can replace them by loom's.

pub use std::sync::atomic::{AtomicUsize, Ordering};
