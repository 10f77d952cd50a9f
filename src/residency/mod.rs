//! How blocks come to be in memory. Knows blocks and a decoder that it is handed, not trees.
//!
//! One [`Cache`] a context holds the budget of decoded bytes. Each opened model has its
//! [`ModelBlocks`]: blocks are read, checked and decoded once, and a [`Snapshot`] says which are in
//! memory. A snapshot never changes: a job takes one and works with it, and asks for what it missed
//! between rounds. Nothing is evicted yet: opening refuses a model that the budget cannot hold.
#![forbid(unsafe_code)]

mod blocks;
mod cache;
mod claims;
#[cfg(test)]
mod claims_tests;
mod fill;
mod slots;
mod snapshot;
mod sync;

pub use blocks::{Decoder, ModelBlocks};
pub use cache::Cache;
pub use slots::Slot;
pub use snapshot::Snapshot;
