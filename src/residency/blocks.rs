//! The blocks of one opened model: read, checked, decoded once, published in snapshots.

use super::cache::Cache;
use super::slots::Slot;
use super::snapshot::Snapshot;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::ModelFile;
use arc_swap::ArcSwap;
use std::sync::{Arc, Mutex};

/// Turns a block's file form into its trace form.
pub trait Decoder: Send + Sync {
    /// The trace form of block `id`, checked so that a walk can trust it; or what is wrong with it.
    fn decode(&self, id: BlockId, payload: &[u8]) -> std::result::Result<Vec<u32>, String>;
}

/// The blocks of an opened model. Thread-safe.
pub struct ModelBlocks {
    file: Arc<ModelFile>,
    decoder: Box<dyn Decoder>,
    cache: Arc<Cache>,
    published: ArcSwap<Snapshot>,
    /// Held while blocks are added: one fetch at a time, so that none is decoded twice.
    adding: Mutex<()>,
}

/// Blocks decoded before they are published together.
const BATCH: usize = 64;

impl ModelBlocks {
    /// Of `file`, with nothing in memory.
    pub fn new(file: Arc<ModelFile>, decoder: Box<dyn Decoder>, cache: Arc<Cache>) -> Self {
        let published = ArcSwap::from_pointee(Snapshot::empty(file.block_count()));
        Self { file, decoder, cache, published, adding: Mutex::new(()) }
    }

    /// The file.
    pub fn file(&self) -> &Arc<ModelFile> {
        &self.file
    }

    /// What is in memory now. Never blocks.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.published.load_full()
    }

    /// Brings `ids` into memory; those that are stay. Reads the disk: blocks.
    ///
    /// Fails with `Corrupt` naming the block, `Io`, `OverBudget` or `Cancelled`; blocks fetched before
    /// the failing one stay. `threads`: how many may decode, the caller's among them (more than one
    /// starts threads for the duration of the call).
    pub fn fetch(&self, ids: &[BlockId], threads: usize, cancel: &Cancel) -> Result<()> {
        // A panic while holding the lock cannot leave half a state: the guard protects nothing.
        let _one_at_a_time = self.adding.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let present = self.snapshot();
        let mut missing: Vec<BlockId> = ids.iter().copied().filter(|&id| present.block(id).is_none()).collect();
        missing.sort_unstable();
        missing.dedup();
        for batch in missing.chunks(BATCH * threads.max(1)) {
            cancel.check()?;
            self.fetch_batch(batch, threads)?;
        }
        Ok(())
    }

    fn fetch_batch(&self, ids: &[BlockId], threads: usize) -> Result<()> {
        let share = ids.len().div_ceil(threads.max(1)).max(1);
        let results: Vec<Result<Vec<(BlockId, Slot)>>> = std::thread::scope(|scope| {
            let mut shares = ids.chunks(share);
            let own = shares.next();
            let others: Vec<_> = shares.map(|ids| scope.spawn(|| self.load(ids))).collect();
            let mut results: Vec<_> = own.map(|ids| self.load(ids)).into_iter().collect();
            for other in others {
                let lost = || Err(Error::Internal("a decoding thread panicked".into()));
                results.push(other.join().unwrap_or_else(|_| lost()));
            }
            results
        });
        let mut failed = None;
        let mut added = Vec::with_capacity(ids.len());
        for result in results {
            match result {
                Ok(slots) => added.extend(slots),
                Err(error) => failed = failed.or(Some(error)),
            }
        }
        self.published.store(Arc::new(self.snapshot().with(added)));
        failed.map_or(Ok(()), Err)
    }

    /// Reads, checks and decodes `ids`, in order. On failure gives back what it reserved.
    fn load(&self, ids: &[BlockId]) -> Result<Vec<(BlockId, Slot)>> {
        let (mut scratch, mut payload) = (Vec::new(), Vec::new());
        let mut slots: Vec<(BlockId, Slot)> = Vec::with_capacity(ids.len());
        for &id in ids {
            match self.load_one(id, &mut scratch, &mut payload) {
                Ok(slot) => slots.push((id, slot)),
                Err(error) => {
                    slots.iter().for_each(|(_, slot)| self.cache.release(slot.bytes()));
                    return Err(error);
                }
            }
        }
        Ok(slots)
    }

    fn load_one(&self, id: BlockId, scratch: &mut Vec<u8>, payload: &mut Vec<u8>) -> Result<Slot> {
        let corrupt = |why: String| Error::corrupt(self.file.name(), Some(id.0), why);
        if id.0 >= self.file.block_count() {
            return Err(corrupt("no such block".into()));
        }
        self.file.read_block(id, scratch, payload)?;
        let words = self.decoder.decode(id, payload).map_err(corrupt)?;
        if words.len() * 4 != self.file.decoded_len(id) as usize {
            return Err(corrupt("its decoded size is not what the directory says".into()));
        }
        self.cache.reserve("a model", Slot::bytes_for(words.len()))?;
        Ok(Slot::new(&words))
    }

    /// Bytes of the blocks in memory.
    pub fn resident_bytes(&self) -> u64 {
        let snapshot = self.snapshot();
        (0..snapshot.blocks()).filter_map(|b| snapshot.block(BlockId(b))).map(|w| size_of_val(w) as u64).sum()
    }
}

impl Drop for ModelBlocks {
    fn drop(&mut self) {
        self.cache.release(self.resident_bytes());
    }
}

impl std::fmt::Debug for ModelBlocks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelBlocks").field("blocks", &self.file.block_count()).finish_non_exhaustive()
    }
}
