//! Snapshots: immutable tables of a model's blocks in memory.

use super::account::{Account, Charge};
use super::companion::Companion;
use super::slots::Slot;
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::memory::room;
use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Number of blocks in a page. A new snapshot copies only the pages that change.
pub(super) const PAGE: usize = 64;

/// Number of channels for last-used stamps. A stamp is the number of a pass times [`CHANNELS`], plus the channel of the
/// view that made the pass. So a block used by one view does not count as used by another view that has rested since.
/// If there are more views than channels, views share channels.
pub(super) const CHANNELS: usize = 4;
/// Channel of users other than views.
pub(super) const NO_VIEW: u32 = CHANNELS as u32 - 1;

/// Returns the channel of a stamp.
#[inline(always)]
pub(super) fn channel(stamp: u32) -> usize {
    stamp as usize % CHANNELS
}

/// A page of slots, and the charge for its memory.
#[derive(Debug)]
struct Page {
    slots: [Option<Slot>; PAGE],
    _charge: Charge,
}

/// Bytes of a page.
pub(super) const PAGE_BYTES: u64 = size_of::<Page>() as u64 + 16;

/// An immutable table from block to slot.
///
/// The blocks of a snapshot neither change nor disappear while it is held. Evicting a block publishes a snapshot
/// without it, and the slot is free once the last snapshot with it is dropped. A held snapshot keeps memory that others
/// may wait for: hold it for the length of a pass, not while waiting.
#[derive(Debug)]
pub struct Snapshot {
    pages: Vec<Arc<Page>>,
    blocks: u32,
    /// Last-used stamps of each block, one per channel. All snapshots of a model share them.
    stamps: Arc<[[AtomicU32; CHANNELS]]>,
    companion: Option<Arc<Companion>>,
    _charge: Charge,
}

/// A held snapshot: with its own reference count or, for a moment, without ([`super::ModelBlocks::shown`]).
pub type Shown = arc_swap::Guard<Arc<Snapshot>>;

impl Snapshot {
    /// Creates the snapshot of a model with `blocks` blocks, none in memory.
    pub fn empty(blocks: u32) -> Self {
        let page = Arc::new(Page { slots: [const { None }; PAGE], _charge: Charge::default() });
        let count = (blocks as usize).div_ceil(PAGE);
        let stamps = (0..count * PAGE).map(|_| [const { AtomicU32::new(0) }; CHANNELS]).collect();
        Self { pages: vec![page; count], blocks, stamps, companion: None, _charge: Charge::default() }
    }

    /// [`Snapshot::empty`] that fails with `NoMemory` if the system lacks memory for the table.
    pub(super) fn none(blocks: u32) -> Result<Self> {
        // A shared slice can only be allocated without a check, so its size is tried before.
        let [stays, changes] = Self::bytes_for(blocks);
        let tried: Vec<u8> = room((stays + changes) as usize, "the table of the blocks of a model")?;
        drop(tried);
        Ok(Self::empty(blocks))
    }

    /// Returns the bytes of the table of a model with `blocks` blocks: `[shared part, greatest addition per snapshot]`.
    pub(super) fn bytes_for(blocks: u32) -> [u64; 2] {
        let pages = u64::from(blocks).div_ceil(PAGE as u64);
        [pages * (PAGE * CHANNELS * 4) as u64, pages * (PAGE_BYTES + 8)]
    }

    /// Returns the words of a block if it is in memory. An id beyond the last block is never in memory.
    #[inline(always)]
    pub fn block(&self, id: BlockId) -> Option<&[u32]> {
        let page = self.pages.get(id.0 as usize / PAGE)?;
        page.slots[id.0 as usize % PAGE].as_ref().map(Slot::words)
    }

    /// Like [`Snapshot::block`], and marks the block as used in the pass with `stamp`. Blocks that a live pass has used
    /// are not evicted. Writes only if the last-used stamp is older.
    #[inline(always)]
    pub fn visit(&self, id: BlockId, stamp: u32) -> Option<&[u32]> {
        let words = self.block(id)?;
        if let Some(channels) = self.stamps.get(id.0 as usize)
            && let last = &channels[channel(stamp)]
            && last.load(Relaxed) < stamp
        {
            // `fetch_max` does not overwrite the stamp of a later pass that uses the block too.
            last.fetch_max(stamp, Relaxed);
        }
        Some(words)
    }

    /// Returns the slot of a block, if it is in memory.
    pub(super) fn slot(&self, id: BlockId) -> Option<&Slot> {
        self.pages.get(id.0 as usize / PAGE)?.slots[id.0 as usize % PAGE].as_ref()
    }

    /// Returns the blocks in memory, ascending.
    pub(super) fn resident(&self) -> impl Iterator<Item = (BlockId, &Slot)> {
        let pages = self.pages.iter().enumerate();
        pages.flat_map(|(p, page)| {
            let slots = page.slots.iter().enumerate();
            slots.filter_map(move |(i, slot)| Some((BlockId((p * PAGE + i) as u32), slot.as_ref()?)))
        })
    }

    /// Returns the last-used stamps of a block, one per channel; 0 for none.
    pub(super) fn stamps(&self, id: BlockId) -> [u32; CHANNELS] {
        self.stamps
            .get(id.0 as usize)
            .map_or([0; CHANNELS], |channels| std::array::from_fn(|channel| channels[channel].load(Relaxed)))
    }

    /// Marks a block as used in a pass, unless a later one has used it.
    pub(super) fn stamp_at_least(&self, id: BlockId, stamp: u32) {
        if let Some(channels) = self.stamps.get(id.0 as usize) {
            channels[channel(stamp)].fetch_max(stamp, Relaxed);
        }
    }

    /// Number of blocks of the model.
    pub fn blocks(&self) -> u32 {
        self.blocks
    }

    /// Returns this snapshot with `changes` applied, paid for by `account`; `None` if the account has too little. Ids
    /// beyond the last block are ignored.
    pub(super) fn changed(&self, changes: Vec<(BlockId, Option<Slot>)>, account: Option<&Account>) -> Option<Self> {
        let pay = |bytes| account.map_or(Some(Charge::default()), |a| a.charge(bytes, 0));
        let mut pages = self.pages.clone();
        let charge = pay(8 * pages.len() as u64)?;
        let mut changed: Vec<(usize, Page)> = Vec::new();
        for (id, slot) in changes.into_iter().filter(|(id, _)| id.0 < self.blocks) {
            let at = id.0 as usize / PAGE;
            let place = match changed.iter().rposition(|(page, _)| *page == at) {
                Some(place) => place,
                None => {
                    changed.push((at, Page { slots: pages[at].slots.clone(), _charge: pay(PAGE_BYTES)? }));
                    changed.len() - 1
                }
            };
            changed[place].1.slots[id.0 as usize % PAGE] = slot;
        }
        for (at, page) in changed {
            pages[at] = Arc::new(page);
        }
        let (stamps, companion) = (Arc::clone(&self.stamps), self.companion.clone());
        Some(Self { pages, blocks: self.blocks, stamps, companion, _charge: charge })
    }

    /// Returns this snapshot with another companion, or without any; `None` if `account` has too little for its table.
    pub(super) fn with_companion(&self, companion: Option<Arc<Companion>>, account: &Account) -> Option<Self> {
        Some(Self { companion, ..self.changed(Vec::new(), Some(account))? })
    }

    /// The companion of the model's blocks, if there is one.
    #[inline(always)]
    pub fn companion<T: Any>(&self) -> Option<&T> {
        self.companion.as_ref()?.value().downcast_ref()
    }

    /// Bytes of the companion.
    pub(super) fn companion_bytes(&self) -> u64 {
        self.companion.as_ref().map_or(0, |companion| companion.bytes())
    }

    /// Returns this snapshot with `added` in memory too. Ids beyond the last block are ignored.
    pub fn with(&self, added: impl IntoIterator<Item = (BlockId, Slot)>) -> Self {
        let added = added.into_iter().map(|(id, slot)| (id, Some(slot))).collect();
        self.changed(added, None).unwrap_or_else(|| Self::empty(self.blocks))
    }

    /// Returns this snapshot with only the blocks that `keep` accepts: for tests of walks that reach missing blocks.
    pub fn filtered(&self, keep: impl Fn(BlockId) -> bool) -> Self {
        let kept = self.resident().filter(|(id, _)| keep(*id)).map(|(id, slot)| (id, slot.clone()));
        Self::empty(self.blocks).with(kept)
    }
}

impl Default for Snapshot {
    fn default() -> Self {
        Self::empty(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn held_blocks_stay_and_count_until_dropped() {
        let account = Account::new(1 << 20);
        let slot = |word| Slot::charged(&[word], account.charge(Slot::bytes_for(1), 0).expect("room"));
        let empty = Snapshot::empty(200);
        let with = empty.changed(vec![(BlockId(3), Some(slot(7))), (BlockId(199), Some(slot(8)))], Some(&account));
        let with = with.expect("room");
        let without = with.changed(vec![(BlockId(3), None)], Some(&account)).expect("room");
        assert_eq!((with.block(BlockId(3)).map(|w| w[0]), without.block(BlockId(3))), (Some(7), None));
        assert_eq!(without.block(BlockId(199)).map(|w| w[0]), Some(8));
        let before = account.used();
        drop(with);
        // The slot, its page and the list of pages. Both snapshots share the other page.
        assert_eq!(before - account.used(), Slot::bytes_for(1) + PAGE_BYTES + 8 * 4);
        drop(without);
        assert_eq!(account.used(), 0);
    }

    #[test]
    fn a_table_beyond_the_budget_is_not_made() {
        let account = Account::new(PAGE_BYTES);
        let changes = |n: u32| (0..n).map(|i| (BlockId(i * PAGE as u32), None)).collect();
        assert!(Snapshot::empty(64).changed(changes(1), Some(&account)).is_none());
        assert_eq!(account.used(), 0);
    }

    #[test]
    fn a_visit_sets_the_stamp() {
        let snapshot = Snapshot::empty(2).with([(BlockId(1), Slot::new(&[5]))]);
        assert_eq!(snapshot.visit(BlockId(1), 9).map(|w| w[0]), Some(5));
        assert!(snapshot.visit(BlockId(0), 9).is_none() && snapshot.visit(BlockId(u32::MAX), 9).is_none());
        // Stamps of the same channel and of another one.
        snapshot.stamp_at_least(BlockId(1), 5);
        snapshot.stamp_at_least(BlockId(1), 7);
        assert_eq!([0, 1, 64].map(|b| snapshot.stamps(BlockId(b))), [[0; 4], [0, 9, 0, 7], [0; 4]]);
    }
}
