//! The only lock-free coordination of the workers: a round of items, each of which one worker claims. Exactly one of
//! the participants learns that it was the last.

use super::sync::{AtomicUsize, Ordering};

/// A round of `total` items. Invariants:
/// - For each index below `total`, at most one [`Round::claim`] returns it.
/// - `left` is `total` minus the number of items completed or drained, so it reaches 0 once, and exactly one
///   [`Round::complete`] or [`Round::drain`] returns `true`. Then no thread works on an item any more, and all work on
///   items happened before (by the `AcqRel` chain on `left`).
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

    /// Claims an item for the caller, which later calls [`Round::complete`] once. `None` if all items are claimed.
    pub fn claim(&self) -> Option<usize> {
        // The load keeps `next` from growing without bound while many workers find no item.
        if self.next.load(Ordering::Relaxed) >= self.total {
            return None;
        }
        let item = self.next.fetch_add(1, Ordering::Relaxed);
        (item < self.total).then_some(item)
    }

    /// Marks a claimed item as finished. Returns `true` for the last one of the round.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.left.fetch_sub(1, Ordering::AcqRel) == 1
    }

    /// Removes all items that no thread has claimed. Returns `true` if that ends the round.
    #[must_use]
    pub fn drain(&self) -> bool {
        let claimed = self.next.swap(self.total, Ordering::Relaxed).min(self.total);
        let skipped = self.total - claimed;
        skipped > 0 && self.left.fetch_sub(skipped, Ordering::AcqRel) == skipped
    }

    /// True if an item may be left to claim.
    pub fn has_items(&self) -> bool {
        self.next.load(Ordering::Relaxed) < self.total
    }
}
