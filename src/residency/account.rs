//! Bytes counted against a limit, given back by whoever lets go of them.

use super::sync::Ordering::{Acquire, Relaxed, Release};
use super::sync::{Arc, AtomicU64};

/// A count of bytes in use that never exceeds its limit. Cloning gives the same. Thread-safe.
#[derive(Debug, Clone)]
pub(super) struct Account {
    limit: u64,
    used: Arc<AtomicU64>,
}

impl Account {
    /// With nothing in use.
    pub fn new(limit: u64) -> Self {
        Self { limit, used: Arc::new(AtomicU64::new(0)) }
    }

    /// The limit in bytes.
    pub fn limit(&self) -> u64 {
        self.limit
    }

    /// Bytes in use.
    pub fn used(&self) -> u64 {
        self.used.load(Relaxed)
    }

    /// Takes `bytes` if that leaves `leaving` bytes free.
    pub fn charge(&self, bytes: u64, leaving: u64) -> Option<Charge> {
        let most = self.limit.checked_sub(leaving)?;
        let take = |used: u64| used.checked_add(bytes).filter(|&sum| sum <= most);
        // What was given back is free by then.
        self.used.fetch_update(Acquire, Relaxed, take).ok()?;
        Some(Charge { account: Some(self.clone()), bytes })
    }
}

/// Bytes in use, until it is dropped. What they pay for must be gone before.
#[derive(Debug, Default)]
pub(super) struct Charge {
    account: Option<Account>,
    bytes: u64,
}

impl Charge {
    /// Moves `bytes` of it (all, if it has fewer) to a charge of their own.
    pub fn split(&mut self, bytes: u64) -> Self {
        let bytes = bytes.min(self.bytes);
        self.bytes -= bytes;
        Self { account: self.account.clone(), bytes }
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        if let Some(account) = &self.account {
            account.used.fetch_sub(self.bytes, Release);
        }
    }
}
