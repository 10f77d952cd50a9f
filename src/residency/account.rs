//! Accounts: bytes that count against a limit until their charge is dropped.

use super::sync::Ordering::{Acquire, Relaxed, Release};
use super::sync::{Arc, AtomicU64};

/// A count of bytes in use that never exceeds its limit. Clones share the count. Thread-safe.
#[derive(Debug, Clone)]
pub(super) struct Account {
    limit: u64,
    used: Arc<AtomicU64>,
}

impl Account {
    /// Creates an account with nothing in use.
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

    /// Charges `bytes` if `leaving` bytes then remain free.
    pub fn charge(&self, bytes: u64, leaving: u64) -> Option<Charge> {
        let most = self.limit.checked_sub(leaving)?;
        let take = |used: u64| used.checked_add(bytes).filter(|&sum| sum <= most);
        // Acquire: memory that was given back is free by then.
        self.used.fetch_update(Acquire, Relaxed, take).ok()?;
        Some(Charge { account: Some(self.clone()), bytes })
    }
}

/// Bytes in use, until the charge is dropped. The memory that they pay for must be freed before.
#[derive(Debug, Default)]
pub(super) struct Charge {
    account: Option<Account>,
    bytes: u64,
}

impl Charge {
    /// Moves `bytes` (all, if there are fewer) to a charge of their own.
    pub fn split(&mut self, bytes: u64) -> Self {
        let bytes = bytes.min(self.bytes);
        self.bytes -= bytes;
        Self { account: self.account.clone(), bytes }
    }

    /// Adds the bytes of another charge of the same account.
    pub fn join(&mut self, mut other: Self) {
        self.bytes += std::mem::take(&mut other.bytes);
        self.account = self.account.take().or(other.account.take());
    }

    /// True if at least half of the account's limit is in use.
    pub fn is_scarce(&self) -> bool {
        self.account.as_ref().is_some_and(|account| account.used() >= account.limit() / 2)
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        if let Some(account) = &self.account {
            account.used.fetch_sub(self.bytes, Release);
        }
    }
}
