//! Foundations for all other rooms: errors, ids, progress and cancellation, workers, the handle of a job, items by
//! group. Uses nothing.

pub mod account;
pub mod bytes;
pub mod error;
pub mod faults;
pub mod groups;
pub(crate) mod handle;
pub mod ids;
pub mod inputs;
pub mod inside_read;
pub mod memory;
pub mod output;
pub mod progress;
pub mod quota;
pub mod reserve;
mod round;
#[cfg(test)]
mod round_tests;
pub mod scratch;
mod sync;
pub mod tasks;
pub mod threads;
pub mod units;
pub mod working;
