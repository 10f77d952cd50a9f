//! Model test of [`super::claims`]: loom runs every interleaving that the memory model allows.

/// Loom's locks for the same source.
mod sync {
    pub use loom::sync::{Condvar, Mutex, MutexGuard};
    pub use std::sync::PoisonError;
}
#[allow(clippy::duplicate_mod)] // included again on purpose, with other locks
#[allow(dead_code)] // the test uses only a part
#[path = "claims.rs"]
mod claims;

use crate::base::ids::BlockId;
use claims::Claims;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use loom::thread;

/// Blocks of a model, a bit each, and the number of reads of each.
struct Blocks {
    claims: Claims,
    published: AtomicUsize,
    read: [AtomicUsize; 2],
    /// Number of reads that fail, from the first on.
    failing: AtomicUsize,
}

impl Blocks {
    fn new(failing: usize) -> Arc<Self> {
        let read = [AtomicUsize::new(0), AtomicUsize::new(0)];
        let (claims, published) = (Claims::default(), AtomicUsize::new(0));
        Arc::new(Self { claims, published, read, failing: AtomicUsize::new(failing) })
    }

    /// Acts as `ModelBlocks::fetch`, one block at a time. Returns false if a read of its own failed.
    fn fetch(&self, ids: &[u32]) -> bool {
        let missing = || {
            let there = self.published.load(Relaxed);
            ids.iter().filter(|&&id| there >> id & 1 == 0).map(|&id| BlockId(id)).collect()
        };
        while let Some(claim) = self.claims.claim(missing, 1) {
            let id = claim.ids[0].0;
            let fails = self.failing.load(Relaxed) > 0;
            if fails {
                self.failing.fetch_sub(1, Relaxed);
                return false;
            }
            self.read[id as usize].fetch_add(1, Relaxed);
            // Published before the claim is released.
            self.published.fetch_or(1 << id, Relaxed);
        }
        true
    }
}

#[test]
fn each_block_is_read_once_for_all_threads() {
    loom::model(|| {
        let blocks = Blocks::new(0);
        let other = Arc::clone(&blocks);
        let thread = thread::spawn(move || other.fetch(&[1, 0]));
        assert!(blocks.fetch(&[0, 1]));
        assert!(thread.join().unwrap());
        assert_eq!(blocks.published.load(Relaxed), 3);
        assert_eq!([0, 1].map(|i: usize| blocks.read[i].load(Relaxed)), [1, 1]);
    });
}

#[test]
fn a_waiting_thread_tries_a_failed_read_again() {
    loom::model(|| {
        let blocks = Blocks::new(1);
        let other = Arc::clone(&blocks);
        let thread = thread::spawn(move || other.fetch(&[0]));
        let (mine, theirs) = (blocks.fetch(&[0]), thread.join().unwrap());
        // The thread with the failed read returns false. The other one has the block, read once.
        assert!(mine != theirs);
        assert_eq!((blocks.published.load(Relaxed), blocks.read[0].load(Relaxed)), (1, 1));
    });
}
