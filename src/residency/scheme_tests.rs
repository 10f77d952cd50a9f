//! Model tests of the scheme of snapshots, stamps and accounts, and of how fetchers are woken: loom runs every
//! interleaving that the memory model allows.

/// The same sources over loom's locks and counters.
mod sync {
    pub use loom::sync::atomic::{AtomicU64, Ordering};
    pub use loom::sync::{Arc, Condvar, Mutex, MutexGuard};
    pub use std::sync::PoisonError;
}
#[allow(clippy::duplicate_mod, dead_code)] // once more on purpose: over other counters
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

/// A slot that says when it is gone.
struct Slot {
    gone: Arc<AtomicBool>,
    _charge: Charge,
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.gone.store(true, Relaxed);
    }
}

/// One block's worth of residency: what is published, and when it was used.
struct Scheme {
    account: Account,
    /// In place of the atomic pointer to a snapshot: loading it is one step.
    published: Mutex<Option<Arc<Slot>>>,
    stamp: AtomicU32,
    /// The pass that the view stands on.
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

    /// As a render worker: a snapshot, a visit, and what it shows is there until it is let go.
    fn read(&self) {
        let snapshot = self.snapshot();
        if let Some(slot) = &snapshot {
            if self.stamp.load(Relaxed) != 2 {
                self.stamp.store(2, Relaxed);
            }
            assert!(!slot.gone.load(Relaxed), "a slot went while a snapshot had it");
        }
    }

    /// As whoever makes room: publishes without the block if nobody stands on what used it, then takes its place.
    fn evict_and_fetch(&self) {
        let before = {
            let mut published = self.published.lock().unwrap();
            let evictable = self.stamp.load(Relaxed) < self.oldest_live_pass.load(Relaxed);
            if evictable { published.take() } else { None }
        };
        let gone = before.as_ref().map(|slot| Arc::clone(&slot.gone));
        drop(before);
        // Two bytes are there only once the old slot is let go by all.
        if let Some(charge) = self.account.charge(2, 0) {
            assert!(gone.is_some_and(|gone| gone.load(Relaxed)), "room before the slot was gone");
            let slot = Arc::new(Slot { gone: Arc::new(AtomicBool::new(false)), _charge: charge });
            *self.published.lock().unwrap() = Some(slot);
        }
    }
}

#[test]
fn a_reader_keeps_what_its_snapshot_shows_and_no_byte_is_lost() {
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
fn no_want_is_slept_through_and_all_end() {
    loom::model(|| {
        let (wakeup, wants) = (Arc::new(Wakeup::default()), Arc::new(AtomicU32::new(0)));
        let (sleeper, left) = (Arc::clone(&wakeup), Arc::clone(&wants));
        let fetcher = thread::spawn(move || {
            let mut did = 0;
            while let Some(seen) = sleeper.reasons() {
                did += left.swap(0, Relaxed);
                sleeper.sleep(seen, None);
            }
            // Nothing is read any more once it is to end.
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
