//! The byte budget of a context, over all its models.

use crate::base::error::{Error, Result};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Counts decoded bytes against a budget. Thread-safe.
#[derive(Debug)]
pub struct Cache {
    budget: u64,
    used: AtomicU64,
}

impl Cache {
    /// With a budget in bytes.
    pub fn new(budget: u64) -> Self {
        Self { budget, used: AtomicU64::new(0) }
    }

    /// The budget in bytes.
    pub fn budget(&self) -> u64 {
        self.budget
    }

    /// Bytes in use.
    pub fn used(&self) -> u64 {
        self.used.load(Relaxed)
    }

    /// Takes `bytes`, or fails naming the least budget that would have done.
    pub fn reserve(&self, what: &'static str, bytes: u64) -> Result<()> {
        let take = |used: u64| used.checked_add(bytes).filter(|&sum| sum <= self.budget);
        match self.used.fetch_update(Relaxed, Relaxed, take) {
            Ok(_) => Ok(()),
            Err(used) => {
                Err(Error::OverBudget { what, need: used.saturating_add(bytes), have: self.budget })
            }
        }
    }

    /// Gives `bytes` back.
    pub fn release(&self, bytes: u64) {
        self.used.fetch_sub(bytes, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_does_not_fit_and_names_the_need() {
        let cache = Cache::new(100);
        cache.reserve("a", 60).expect("fits");
        match cache.reserve("b", 50) {
            Err(Error::OverBudget { what: "b", need: 110, have: 100 }) => {}
            other => panic!("{other:?}"),
        }
        assert!(cache.reserve("c", u64::MAX).is_err());
        cache.release(60);
        cache.reserve("d", 100).expect("fits");
        assert_eq!(cache.used(), 100);
    }
}
