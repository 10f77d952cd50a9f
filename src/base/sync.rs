//! The atomics of [`super::round`]. A name of its own, so that its model test can put loom's in
//! their place.

pub use std::sync::atomic::{AtomicUsize, Ordering};
