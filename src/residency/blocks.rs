//! The blocks of one opened model: read, checked, decoded once, published in snapshots.

use super::cache::Cache;
use super::claims::Claims;
use super::slots::Slot;
use super::snapshot::Snapshot;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::ModelFile;
use arc_swap::ArcSwap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::Arc;

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
    /// Blocks being read now, so that none is decoded twice.
    claims: Claims,
    report: Option<Report>,
    read_again: AtomicU64,
}

/// Told why a block is read again.
type Report = Box<dyn Fn(&Error) + Send + Sync>;

/// Blocks decoded before they are published together.
const BATCH: usize = 64;

impl ModelBlocks {
    /// Of `file`, with nothing in memory.
    pub fn new(file: Arc<ModelFile>, decoder: Box<dyn Decoder>, cache: Arc<Cache>) -> Self {
        let published = ArcSwap::from_pointee(Snapshot::empty(file.block_count()));
        let (claims, read_again) = (Claims::default(), AtomicU64::new(0));
        Self { file, decoder, cache, published, claims, report: None, read_again }
    }

    /// Has `report` told why a block is read again; called from any thread, under no lock.
    pub fn reporting(mut self, report: impl Fn(&Error) + Send + Sync + 'static) -> Self {
        self.report = Some(Box::new(report));
        self
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
    /// the failing one stay.
    pub fn fetch(&self, ids: &[BlockId], cancel: &Cancel) -> Result<()> {
        loop {
            cancel.check()?;
            let Some(claim) = self.claims.claim(|| self.missing(ids), BATCH) else { return Ok(()) };
            let (slots, end) = self.load(&claim.ids, cancel);
            self.publish(slots);
            end?;
        }
    }

    /// Those of `ids` that are not in memory.
    fn missing(&self, ids: &[BlockId]) -> Vec<BlockId> {
        let present = self.snapshot();
        ids.iter().copied().filter(|&id| present.block(id).is_none()).collect()
    }

    /// Shows `slots` to whoever takes a snapshot from now on.
    pub(super) fn publish(&self, slots: Vec<(BlockId, Slot)>) {
        // The next snapshot is made of the last: one after the other.
        self.claims.publishing(|| self.published.store(Arc::new(self.snapshot().with(slots))));
    }

    /// Reads, checks and decodes `ids`, in order, up to the first failure.
    pub(super) fn load(&self, ids: &[BlockId], cancel: &Cancel) -> (Vec<(BlockId, Slot)>, Result<()>) {
        let (mut scratch, mut payload) = (Vec::new(), Vec::new());
        let mut slots = Vec::with_capacity(ids.len());
        for &id in ids {
            match cancel.check().and_then(|()| self.load_one(id, &mut scratch, &mut payload)) {
                Ok(slot) => slots.push((id, slot)),
                Err(error) => return (slots, Err(error)),
            }
        }
        (slots, Ok(()))
    }

    /// A block whose reading or check fails is reported, counted and read once more: a disk or a network may
    /// have hiccuped.
    fn load_one(&self, id: BlockId, scratch: &mut Vec<u8>, payload: &mut Vec<u8>) -> Result<Slot> {
        let words = match self.read_and_decode(id, scratch, payload) {
            Err(error @ (Error::Corrupt { .. } | Error::Io { .. })) => {
                self.read_again.fetch_add(1, Relaxed);
                if let Some(report) = &self.report {
                    report(&error);
                }
                self.read_and_decode(id, scratch, payload)?
            }
            first => first?,
        };
        self.cache.reserve("a model", Slot::bytes_for(words.len()))?;
        Ok(Slot::new(&words))
    }

    fn read_and_decode(&self, id: BlockId, scratch: &mut Vec<u8>, payload: &mut Vec<u8>) -> Result<Vec<u32>> {
        let corrupt = |why: String| Error::corrupt(self.file.name(), Some(id.0), why);
        if id.0 >= self.file.block_count() {
            return Err(corrupt("no such block".into()));
        }
        self.file.read_block(id, scratch, payload)?;
        let words = self.decoder.decode(id, payload).map_err(corrupt)?;
        if words.len() * 4 != self.file.decoded_len(id) as usize {
            return Err(corrupt("its decoded size is not what the directory says".into()));
        }
        Ok(words)
    }

    /// How many times a block was read again because it had failed.
    pub fn read_again(&self) -> u64 {
        self.read_again.load(Relaxed)
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
