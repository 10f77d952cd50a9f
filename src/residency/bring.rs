//! Blocks for exact jobs: read in the caller's thread, and held so that they are not evicted before they are used.

use super::admit::grown;
use super::blocks::ModelBlocks;
use super::claims::Claim;
use super::load::{RUN_BYTES, runs};
use super::slots::Slot;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;

/// Number of blocks claimed at a time. Other threads may want the rest.
const AT_ONCE: usize = 32;

/// Blocks, with the slots that hold them in memory.
pub type Held = Vec<(BlockId, Slot)>;

impl ModelBlocks {
    /// Brings `ids` into memory as far as there is room beside the blocks that views use, and publishes them. Returns
    /// the blocks that are in memory. Reads the disk and blocks the thread.
    ///
    /// Fails with `Corrupt` naming the block, `Io` or `Cancelled`. Blocks that were read before the failing one stay.
    pub fn bring(&self, ids: &[BlockId], cancel: &Cancel) -> Result<Held> {
        let mut held = Held::new();
        let mut left = ids.to_vec();
        left.sort_unstable();
        left.dedup();
        loop {
            cancel.check()?;
            self.hold_resident(&mut left, &mut held);
            let absent = || {
                let there = self.snapshot();
                left.iter().copied().filter(|&id| there.block(id).is_none()).collect::<Vec<_>>()
            };
            if left.is_empty() {
                return Ok(held);
            }
            let Some(claim) = self.inner.claims.claim(absent, AT_ONCE) else { continue };
            let brought = self.bring_claimed(&claim, &mut left, &mut held, cancel);
            self.inner.residency.give_back(&self.inner, claim);
            if !brought? {
                return Ok(held);
            }
        }
    }

    /// Moves those of `left` that are in memory to `held`.
    fn hold_resident(&self, left: &mut Vec<BlockId>, held: &mut Held) {
        let there = self.snapshot();
        left.retain(|&id| {
            let slot = there.slot(id).cloned();
            held.extend(slot.iter().map(|slot| (id, slot.clone())));
            slot.is_none()
        });
    }

    /// Reads claimed blocks. Returns false if there was no room for all.
    fn bring_claimed(&self, claim: &Claim, left: &mut Vec<BlockId>, held: &mut Held, cancel: &Cancel) -> Result<bool> {
        let (inner, shared) = (&self.inner, &self.inner.residency);
        let stamp = shared.now();
        if let Some(id) = claim.ids.iter().find(|id| id.0 >= inner.file.block_count()) {
            return Err(inner.corrupt(*id, "the block does not exist"));
        }
        for run in runs(&inner.file, &claim.ids, RUN_BYTES) {
            let Ok(mut room) = shared.make_room(inner, run) else { return Ok(false) };
            let loaded = inner.load(run, &mut room.charge, &mut room.buffers, cancel);
            // If there is no memory for the table, the blocks are only held, not published.
            shared.publish(inner, &loaded.slots, stamp);
            left.retain(|id| loaded.slots.binary_search_by_key(id, |slot| slot.0).is_err());
            held.extend(loaded.slots);
            if let Some((_, error)) = loaded.failed.into_iter().next() {
                return Err(error);
            }
            cancel.check()?;
        }
        Ok(true)
    }

    /// Like [`ModelBlocks::bring`], but for all blocks or none: fails with `OverBudget` if there is no room.
    pub fn fetch(&self, ids: &[BlockId], cancel: &Cancel) -> Result<Held> {
        let held = self.bring(ids, cancel)?;
        let mut wanted = ids.to_vec();
        wanted.sort_unstable();
        wanted.dedup();
        if held.len() < wanted.len() {
            let bytes: u64 = wanted.iter().map(|&id| self.inner.slot_bytes(id)).sum();
            let have = self.inner.residency.budget();
            let what = format!("reading the requested blocks of {}", self.inner.file.name().display());
            return Err(Error::OverBudget { what, need: grown(have, bytes), have });
        }
        Ok(held)
    }
}
