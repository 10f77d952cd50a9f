//! What every room may use: errors, ids, progress and cancel, workers. Uses nothing.

pub mod error;
pub mod ids;
pub mod progress;
pub mod tasks;
