//! The one piece of lock-free coordination of the workers: a round of items, each claimed once,
//! and one of all that take part told that it was the last.

use super::sync::{AtomicUsize, Ordering};

/// `total` items. Invariants:
/// - an index below `total` is returned by at most one [`Round::claim`];
/// - `left` is `total` minus the items completed or drained, so it reaches 0 once, and exactly one
///   [`Round::complete`] or [`Round::drain`] returns `true`: then no thread works on an item any more,
///   and all that was done on items happened before (the `AcqRel` chain on `left`).
pub struct Round {
    next: AtomicUsize,
    left: AtomicUsize,
    total: usize,
}

impl Round {
    /// A round of `total` > 0 items.
    pub fn new(total: usize) -> Self {
        Self { next: AtomicUsize::new(0), left: AtomicUsize::new(total), total }
    }

    /// An item that is the caller's alone, to be followed by one [`Round::complete`]; `None` when all are claimed.
    pub fn claim(&self) -> Option<usize> {
        // The load keeps `next` from running away while many workers find nothing.
        if self.next.load(Ordering::Relaxed) >= self.total {
            return None;
        }
        let item = self.next.fetch_add(1, Ordering::Relaxed);
        (item < self.total).then_some(item)
    }

    /// Says that a claimed item is finished; `true` for the last one of the round.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.left.fetch_sub(1, Ordering::AcqRel) == 1
    }

    /// Takes away all items that no thread has claimed; `true` if with them the round is over.
    #[must_use]
    pub fn drain(&self) -> bool {
        let claimed = self.next.swap(self.total, Ordering::Relaxed).min(self.total);
        let skipped = self.total - claimed;
        skipped > 0 && self.left.fetch_sub(skipped, Ordering::AcqRel) == skipped
    }

    /// Whether an item may still be claimed.
    pub fn has_items(&self) -> bool {
        self.next.load(Ordering::Relaxed) < self.total
    }
}
