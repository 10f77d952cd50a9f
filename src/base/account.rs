//! The memory of tables whose size depends on the input: names, parts, instances. It is counted before it is taken.

use super::error::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bytes of a budget that tables leave to the rest of the work.
const REST: u64 = 32 << 20;

/// Bytes that tables may take in addition to the budget.
const BESIDE: u64 = 24 << 20;

/// Counts the bytes of tables in one budget. Copies share one count. The default has no limit.
#[derive(Debug, Clone, Default)]
pub struct Account {
    budget: u64,
    count: Arc<Count>,
}

#[derive(Debug, Default)]
struct Count {
    used: AtomicU64,
    peak: AtomicU64,
}

impl Account {
    /// A budget in bytes; 0 for no limit.
    pub fn new(budget: u64) -> Self {
        Self { budget, count: Arc::default() }
    }

    /// Counts bytes, whether they fit or not.
    pub fn add(&self, bytes: u64) {
        let used = self.count.used.fetch_add(bytes, Relaxed) + bytes;
        self.count.peak.fetch_max(used, Relaxed);
    }

    /// Uncounts bytes.
    pub fn give(&self, bytes: u64) {
        self.count.used.fetch_sub(bytes, Relaxed);
    }

    /// The part of the budget that is left to the rest of the work, at least 1; 0 if there is no limit.
    pub fn rest(&self) -> u64 {
        let used = self.count.used.load(Relaxed).saturating_sub(BESIDE);
        if self.budget == 0 { 0 } else { self.budget.saturating_sub(used).max(1) }
    }

    /// True if the counted bytes fit.
    pub fn fits(&self) -> bool {
        self.budget == 0 || need(self.count.used.load(Relaxed)) <= self.budget
    }

    /// Returns the error of `what`, if all bytes that were counted at any time, and `more`, do not fit.
    pub fn over(&self, more: u64, what: String) -> Error {
        let need = need(self.count.peak.load(Relaxed).saturating_add(more));
        Error::OverBudget { what, need, have: self.budget }
    }

    /// Returns a claim of no bytes yet, which are uncounted when it is dropped.
    pub fn claim(&self) -> Claim {
        Claim { account: self.clone(), bytes: 0 }
    }
}

/// Counted bytes of one table.
#[derive(Debug)]
pub struct Claim {
    account: Account,
    bytes: u64,
}

impl Claim {
    /// Counts more bytes. Returns `false` if they do not fit.
    #[inline]
    pub fn grow(&mut self, bytes: u64) -> bool {
        self.bytes += bytes;
        self.account.add(bytes);
        self.account.fits()
    }

    /// Returns the error of a table that does not fit, of which only the share `done` is counted. Other tables of
    /// `later` bytes follow from this share.
    pub fn over(&self, done: f64, later: u64, what: String) -> Error {
        let all = (self.bytes + later) as f64 / done.clamp(1e-6, 1.0);
        let rest = (all as u64).saturating_sub(self.bytes);
        self.account.over(rest, what)
    }
}

/// Returns the budget that suffices for tables of this size.
fn need(tables: u64) -> u64 {
    tables.saturating_sub(BESIDE).saturating_add(REST)
}

impl Drop for Claim {
    fn drop(&mut self) {
        self.account.give(self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_that_do_not_fit_name_the_budget_that_does() {
        let account = Account::new(64 << 20);
        account.add(BESIDE);
        assert_eq!(account.rest(), 64 << 20);
        let mut claim = account.claim();
        assert!(claim.grow(32 << 20));
        assert_eq!(account.rest(), 32 << 20);
        assert!(!claim.grow(1 << 20));
        // Half of a table of 66 MiB is counted.
        let Error::OverBudget { need, have, what } = claim.over(0.5, 1 << 20, "names".into()) else {
            panic!("another error")
        };
        assert_eq!((need, have, what.as_str()), (100 << 20, 64 << 20, "names"));
        drop(claim);
        account.add(32 << 20);
        assert!(account.fits());
        account.add(1);
        assert!(!account.fits() && account.rest() == (32 << 20) - 1);
        account.add(1 << 40);
        assert_eq!(account.rest(), 1);
        let none = Account::default();
        assert!(none.claim().grow(1 << 60) && none.fits() && none.rest() == 0);
    }
}
