//! Opening a model: all workers of a context read many blocks at once.

use super::blocks::ModelBlocks;
use super::core::FOR_ROOM;
use super::load::{RUN_BYTES, runs};
use super::pump::stored_len;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::{Cancel, Progress};
use crate::base::tasks::{Pool, Work};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Blocks that several workers read.
struct Filling<'a> {
    blocks: &'a ModelBlocks,
    shares: Vec<&'a [BlockId]>,
    progress: &'a Progress,
    cancel: &'a Cancel,
    /// Bytes of the file that were read; `total` is the number to be read.
    read: AtomicU64,
    total: u64,
}

/// Progress of opening when all blocks are in memory. Tables are built after that.
const ALL_READ: f64 = 0.99;

impl Work for Filling<'_> {
    fn run(&self, item: usize) -> Result<()> {
        let held = self.blocks.bring(self.shares[item], self.cancel)?;
        let bytes = held.iter().map(|(id, _)| stored_len(&self.blocks.inner, *id)).sum();
        let read = self.read.fetch_add(bytes, Relaxed) + bytes;
        self.progress.bytes_read.fetch_add(bytes, Relaxed);
        self.progress.advance(ALL_READ * read as f64 / self.total.max(1) as f64);
        Ok(())
    }
}

impl ModelBlocks {
    /// Brings `ids`, each named once, into memory as far as there is room, with the workers of `pool` and the caller.
    /// Waits for the reads. Neighbours in the file are read in one run.
    ///
    /// Progress counts the bytes read. A cancellation takes effect within a block of each worker. Fails like
    /// [`ModelBlocks::bring`].
    pub fn fill(&self, ids: &[BlockId], pool: &Pool, progress: &Progress, cancel: &Cancel) -> Result<()> {
        let mut ids = ids.to_vec();
        ids.sort_unstable();
        let shares = runs(self.file(), &ids, RUN_BYTES).collect();
        let total = ids.iter().map(|&id| stored_len(&self.inner, id)).sum();
        let filling = Filling { blocks: self, shares, progress, cancel, read: AtomicU64::new(0), total };
        pool.run_scoped(filling.shares.len(), &filling).into_result()
    }

    /// Brings `ids` into memory, also by evicting blocks in use. Waits until passes that hold those have ended,
    /// [`FOR_ROOM`] at most. Fails with `OverBudget` if there is no room.
    pub fn require(&self, ids: &[BlockId], cancel: &Cancel) -> Result<()> {
        let begun = Instant::now();
        loop {
            match self.fetch(ids, cancel) {
                Err(Error::OverBudget { .. }) if begun.elapsed() < FOR_ROOM => {}
                fetched => return fetched.map(drop),
            }
            let absent = ids.iter().filter(|id| !self.inner.is_there(**id));
            self.inner.residency.takes_room(absent.map(|&id| self.slot_bytes(id)).sum());
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Marks all blocks of the model as being in memory. Fetchers then collapse its memory into huge pages when they
    /// have no other work (`huge_pages.rs`).
    pub fn completed(&self) {
        if !self.inner.is_complete.swap(true, Relaxed) {
            self.inner.residency.wake();
        }
    }

    /// True if all blocks were in memory, or being read, at some time.
    pub fn is_complete(&self) -> bool {
        self.inner.is_complete.load(Relaxed)
    }

    /// Marks the model as opened. From now on its blocks are read ahead if they fit.
    pub fn opened(&self) {
        self.inner.may_promote.store(true, Relaxed);
        self.inner.residency.wake();
    }
}
