//! Residency: which blocks are in memory, and how they get there. It knows blocks and a decoder that it is given, not
//! trees.
//!
//! Each context has one [`Residency`], which holds the budget. Each opened model has its [`ModelBlocks`], and a
//! [`Snapshot`] is the table of its blocks in memory. A snapshot never changes: a job takes one and works with it.
//! After each pass a [`View`] reports the blocks that it lacked. The wants of all views are ranked, and threads that
//! pump, of the library or of the host, read them. When room is needed, the least recently used blocks are evicted.
//! When the wants of views do not fit, a factor on their thresholds (the pressure) rises until they do. Exact jobs
//! bring the blocks that they need themselves. Where views leave no room, they take turns with a [`Lease`] of a part of
//! the budget reserved for them.
#![deny(unsafe_code)]

mod account;
mod admit;
mod blocks;
mod bring;
mod claims;
mod companion;
#[cfg(test)]
mod claims_tests;
mod core;
mod evict;
mod failures;
mod fill;
#[allow(unsafe_code)] // calls `madvise`
mod huge_pages;
mod kept;
mod lease;
#[cfg(test)]
mod lease_tests;
mod links;
mod load;
mod own;
#[allow(unsafe_code)] // calls `madvise`
mod pages;
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
#[cfg(test)]
mod turn_tests;
mod view;
mod wakeup;

pub use self::core::{Residency, ResidencyOptions};
pub use admit::{Admission, Needs};
pub use blocks::{BlockClass, Decoder, ModelBlocks, ModelKey};
pub use bring::Held;
pub use companion::CompanionRoom;
pub use kept::{Kept, UNCOUNTED, counted};
pub use lease::Lease;
pub use links::{Entries, MOST_NODES, Reference, Statements};
pub use own::OwnBlocks;
pub use pump::Fetchers;
pub use slots::Slot;
pub use snapshot::{Shown, Snapshot};
pub use view::{ForRequest, View, ViewState, ViewStatus, Wanted};
