//! Blocks that one reader reads and holds for itself, in memory that it was granted at the beginning. No other reader
//! sees them, and no view waits for their memory.

use super::account::Account;
use super::blocks::ModelBlocks;
use super::core::Residency;
use super::kept::Kept;
use super::load::{Buffers, reading_bytes, slot_bytes_of};
use super::slots::Slot;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::directory::Row;
use std::collections::HashMap;

/// The blocks of one reader. The memory counts against the budget until this is dropped, used or not.
pub struct OwnBlocks {
    account: Account,
    /// Each block with the number of its last use.
    held: HashMap<BlockId, (Slot, u64)>,
    uses: u64,
    _kept: Kept,
}

impl OwnBlocks {
    /// Least grant with which any block of the model can be read.
    pub fn least(model: &ModelBlocks) -> u64 {
        let row = Row::largest(model.file().header().block_size);
        slot_bytes_of(&row) + reading_bytes(&[row])
    }

    /// Takes `bytes` of the budget, at least [`OwnBlocks::least`]. Fails with `OverBudget`, which says `what` they are
    /// for.
    pub fn new(residency: &Residency, what: &str, bytes: u64) -> Result<Self> {
        let kept = residency.keep_all(what, bytes)?;
        Ok(Self { account: Account::new(bytes), held: HashMap::new(), uses: 0, _kept: kept })
    }

    /// Returns the words of a block that is held.
    #[inline]
    pub fn block(&mut self, id: BlockId) -> Option<&[u32]> {
        let (slot, last) = self.held.get_mut(&id)?;
        self.uses += 1;
        *last = self.uses;
        Some(slot.words())
    }

    /// Reads a block, unless it is held, and returns its words. Drops the least recently used blocks if it needs their
    /// memory. Fails with `Io`, `Corrupt`, `Cancelled`, or with `OverBudget` if the grant is too small.
    pub fn read(&mut self, model: &ModelBlocks, id: BlockId, cancel: &Cancel) -> Result<&[u32]> {
        if !self.held.contains_key(&id) {
            let slot = self.load(model, id, cancel)?;
            self.held.insert(id, (slot, 0));
        }
        self.block(id).ok_or_else(|| model.inner.corrupt(id, "the block does not exist"))
    }

    fn load(&mut self, model: &ModelBlocks, id: BlockId, cancel: &Cancel) -> Result<Slot> {
        let inner = &model.inner;
        if id.0 >= inner.file.block_count() {
            return Err(inner.corrupt(id, "the block does not exist"));
        }
        let bytes = inner.slot_bytes(id);
        let (mut charge, mut buffers) = loop {
            if let Some(charge) = self.account.charge(bytes, 0)
                && let Some(buffers) = Buffers::new(&self.account, &inner.file, &[id])
            {
                break (charge, buffers);
            }
            let oldest = self.held.iter().min_by_key(|(_, (_, last))| *last).map(|(id, _)| *id);
            let Some(oldest) = oldest else {
                let what = format!("a block of {}", inner.file.name().display());
                return Err(Error::OverBudget { what, need: Self::least(model), have: self.account.limit() });
            };
            self.held.remove(&oldest);
        };
        let mut loaded = inner.load(&[id], &mut charge, &mut buffers, cancel);
        match (loaded.slots.pop(), loaded.failed.pop()) {
            (Some((_, slot)), _) => Ok(slot),
            (None, Some((_, error))) => Err(error),
            (None, None) => Err(Error::Cancelled),
        }
    }
}
