//! Opening a model: many blocks at once, by all workers of a context.

use super::blocks::ModelBlocks;
use super::slots::Slot;
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::progress::{Cancel, Progress};
use crate::base::tasks::{Ending, Pool, Work};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Blocks that a worker reads before it looks for other work: 1 MB or so.
const SHARE: usize = 16;

/// Blocks being read by several workers.
struct Filling<'a> {
    blocks: &'a ModelBlocks,
    shares: Vec<&'a [BlockId]>,
    progress: &'a Progress,
    cancel: &'a Cancel,
    slots: Mutex<Vec<(BlockId, Slot)>>,
    /// Bytes of the file, read and to be read.
    read: AtomicU64,
    total: u64,
}

/// How far opening is when all blocks are in memory: how they refer to each other is still to be checked.
const ALL_READ: f64 = 0.99;

impl Work for Filling<'_> {
    fn run(&self, item: usize) -> Result<()> {
        let (mut slots, end) = self.blocks.load(self.shares[item], self.cancel);
        let bytes = slots.iter().map(|(id, _)| self.blocks.stored_len(*id)).sum();
        let read = self.read.fetch_add(bytes, Relaxed) + bytes;
        self.progress.bytes_read.fetch_add(bytes, Relaxed);
        self.progress.advance(ALL_READ * read as f64 / self.total.max(1) as f64);
        self.slots.lock().unwrap_or_else(PoisonError::into_inner).append(&mut slots);
        end
    }
}

impl ModelBlocks {
    /// Brings `ids`, each named once, into memory, by the workers of `pool`: its own threads, or the host's, or the
    /// caller's where it has none. Blocks.
    ///
    /// Nobody else can be fetching, so no lock is held while the workers, which may be busy, are waited for.
    /// Progress counts bytes read; a cancel takes effect within a block of each worker. Fails like
    /// [`ModelBlocks::fetch`].
    pub fn fill(&mut self, ids: &[BlockId], pool: &Pool, progress: &Progress, cancel: &Cancel) -> Result<()> {
        let shares: Vec<_> = ids.chunks(SHARE).collect();
        let total = ids.iter().map(|&id| self.stored_len(id)).sum();
        let (slots, read) = (Mutex::default(), AtomicU64::new(0));
        let filling = Filling { blocks: self, shares, progress, cancel, slots, read, total };
        let ending = pool.run_scoped(filling.shares.len(), &filling);
        let slots = filling.slots.into_inner().unwrap_or_else(PoisonError::into_inner);
        // Also after a failure: what is published is given back when the model goes.
        self.publish(slots);
        match ending {
            Ending::Finished => Ok(()),
            Ending::Cancelled => Err(crate::Error::Cancelled),
            Ending::Failed(error) => Err((*error).clone()),
        }
    }

    /// Bytes of a block in the file.
    fn stored_len(&self, id: BlockId) -> u64 {
        self.file().directory().get(id.0 as usize).map_or(0, |row| u64::from(row.stored_len))
    }
}
