//! How blocks come to be in memory. Knows blocks and a decoder that it is handed, not trees.
//!
//! One [`Residency`] a context holds the budget. Each opened model has its [`ModelBlocks`], and a [`Snapshot`] says
//! which of them are in memory. A snapshot never changes: a job takes one and works with it. A [`View`] says after each
//! pass which blocks it lacked. The wants of all views are ranked, and threads that pump, of ours or of the host, read
//! them; the blocks that have not been used for longest go when room is needed. When what views want does not fit, a
//! factor on their thresholds rises until it does. Exact jobs bring what they need themselves; where views leave no
//! room they take turns with a [`Lease`] of a part of the budget that is theirs.
#![deny(unsafe_code)]

mod account;
mod blocks;
mod bring;
mod claims;
#[cfg(test)]
mod claims_tests;
mod core;
mod evict;
mod failures;
mod fill;
#[allow(unsafe_code)] // advice to the system
mod huge_pages;
mod lease;
#[cfg(test)]
mod lease_tests;
mod links;
mod load;
mod pressure;
mod pump;
mod rank;
#[cfg(test)]
mod scheme_tests;
mod slots;
mod snapshot;
mod sync;
#[cfg(test)]
mod tests;
mod view;
mod wakeup;

pub use self::core::{Residency, ResidencyOptions};
pub use blocks::{BlockClass, Decoder, ModelBlocks, ModelKey};
pub use bring::Held;
pub use lease::Lease;
pub use links::Reference;
pub use pump::Fetchers;
pub use slots::Slot;
pub use snapshot::{Shown, Snapshot};
pub use view::{View, ViewState, ViewStatus, Wanted};
