//! Model tests of snapshots, stamps and accounts, and of the wakeup of fetchers: loom runs every interleaving that the
//! memory model allows.

/// Loom's locks and counters for the same sources.
mod sync {
    pub use loom::sync::atomic::{AtomicU64, Ordering};
    pub use loom::sync::{Arc, Condvar, Mutex, MutexGuard};
    pub use std::sync::PoisonError;
}
#[allow(clippy::duplicate_mod, dead_code)] // included again on purpose, with other counters
#[path = "account.rs"]
mod account;
#[allow(clippy::duplicate_mod, dead_code)]
#[path = "wakeup.rs"]
mod wakeup;

use account::{Account, Charge};
use loom::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use loom::sync::{Arc, Mutex};
use loom::thread;
use wakeup::Wakeup;

/// A slot that records when it is dropped.
struct Slot {
    gone: Arc<AtomicBool>,
    _charge: Charge,
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.gone.store(true, Relaxed);
    }
}

/// A residency of one block: its published slot, and its last-used stamp.
struct Scheme {
    account: Account,
    /// Replaces the atomic pointer to a snapshot: loading it is one step.
    published: Mutex<Option<Arc<Slot>>>,
    stamp: AtomicU32,
    /// The oldest live pass of the view.
    oldest_live_pass: AtomicU32,
}

impl Scheme {
    fn new() -> Arc<Self> {
        let account = Account::new(2);
        let charge = account.charge(1, 0).unwrap();
        let slot = Arc::new(Slot { gone: Arc::new(AtomicBool::new(false)), _charge: charge });
        let (stamp, oldest_live_pass) = (AtomicU32::new(1), AtomicU32::new(2));
        Arc::new(Self { account, published: Mutex::new(Some(slot)), stamp, oldest_live_pass })
    }

    fn snapshot(&self) -> Option<Arc<Slot>> {
        self.published.lock().unwrap().clone()
    }

    /// Acts as a render worker: takes a snapshot and visits the block, which stays until the snapshot is dropped.
    fn read(&self) {
        let snapshot = self.snapshot();
        if let Some(slot) = &snapshot {
            if self.stamp.load(Relaxed) != 2 {
                self.stamp.store(2, Relaxed);
            }
            assert!(!slot.gone.load(Relaxed), "a slot went while a snapshot had it");
        }
    }

    /// Acts as a thread that makes room: unpublishes the block if no live pass used it, then takes its place.
    fn evict_and_fetch(&self) {
        let before = {
            let mut published = self.published.lock().unwrap();
            let evictable = self.stamp.load(Relaxed) < self.oldest_live_pass.load(Relaxed);
            if evictable { published.take() } else { None }
        };
        let gone = before.as_ref().map(|slot| Arc::clone(&slot.gone));
        drop(before);
        // Two bytes are free only once all holders have dropped the old slot.
        if let Some(charge) = self.account.charge(2, 0) {
            assert!(gone.is_some_and(|gone| gone.load(Relaxed)), "room before the slot was gone");
            let slot = Arc::new(Slot { gone: Arc::new(AtomicBool::new(false)), _charge: charge });
            *self.published.lock().unwrap() = Some(slot);
        }
    }
}

#[test]
fn a_reader_keeps_its_snapshot_and_no_byte_is_lost() {
    loom::model(|| {
        let scheme = Scheme::new();
        let reader = Arc::clone(&scheme);
        let reader = thread::spawn(move || reader.read());
        scheme.evict_and_fetch();
        reader.join().unwrap();
        assert!(scheme.account.used() <= 2);
        let account = scheme.account.clone();
        drop(scheme);
        assert_eq!(account.used(), 0);
    });
}

#[test]
fn no_fetcher_sleeps_through_a_want_and_all_end() {
    loom::model(|| {
        let (wakeup, wants) = (Arc::new(Wakeup::default()), Arc::new(AtomicU32::new(0)));
        let (sleeper, left) = (Arc::clone(&wakeup), Arc::clone(&wants));
        let fetcher = thread::spawn(move || {
            let mut did = 0;
            while let Some(seen) = sleeper.reasons() {
                did += left.swap(0, Relaxed);
                sleeper.sleep(seen, None);
            }
            // Fetchers do no work once they must end, so the test counts the wants that are left.
            did + left.swap(0, Relaxed)
        });
        wants.fetch_add(1, Relaxed);
        wakeup.wake();
        wants.fetch_add(1, Relaxed);
        wakeup.wake();
        wakeup.stop();
        assert_eq!(fetcher.join().unwrap(), 2);
    });
}
