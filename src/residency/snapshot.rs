//! Which blocks of a model are in memory, at one moment.

use super::account::{Account, Charge};
use super::slots::Slot;
use crate::base::ids::BlockId;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Blocks of a page: a new snapshot copies only the pages that change.
pub(super) const PAGE: usize = 64;

/// Lanes of stamps. A stamp is the number of a pass times [`CHANNELS`], plus the channel of the view that made it: so a
/// block that one view used does not count as used by another that has rested since. More views than channels share
/// them.
pub(super) const CHANNELS: usize = 4;
/// The channel of users other than views.
pub(super) const NO_VIEW: u32 = CHANNELS as u32 - 1;

/// The channel of a stamp.
#[inline(always)]
pub(super) fn channel(stamp: u32) -> usize {
    stamp as usize % CHANNELS
}

/// A page, and what pays for it.
#[derive(Debug)]
struct Page {
    slots: [Option<Slot>; PAGE],
    _charge: Charge,
}

/// Bytes of a page.
pub(super) const PAGE_BYTES: u64 = size_of::<Page>() as u64 + 16;

/// An immutable table from block to slot.
///
/// Nothing that a snapshot shows changes or goes while it is held: evicting a block publishes a snapshot without it,
/// and its slot is free once the last snapshot that has it is gone. A held snapshot keeps memory that others may
/// wait for: hold it for as long as a pass lasts, not while waiting.
#[derive(Debug)]
pub struct Snapshot {
    pages: Vec<Arc<Page>>,
    blocks: u32,
    /// When each block was last used in each channel. Shared by all snapshots of a model.
    stamps: Arc<[[AtomicU32; CHANNELS]]>,
    _charge: Charge,
}

/// A snapshot, held: by a count of its own, or for a moment without ([`super::ModelBlocks::shown`]).
pub type Shown = arc_swap::Guard<Arc<Snapshot>>;

impl Snapshot {
    /// Of a model with `blocks` blocks, none in memory.
    pub fn empty(blocks: u32) -> Self {
        let page = Arc::new(Page { slots: [const { None }; PAGE], _charge: Charge::default() });
        let count = (blocks as usize).div_ceil(PAGE);
        let stamps = (0..count * PAGE).map(|_| [const { AtomicU32::new(0) }; CHANNELS]).collect();
        Self { pages: vec![page; count], blocks, stamps, _charge: Charge::default() }
    }

    /// Bytes that the table of a model with `blocks` blocks takes: `[what stays, what each snapshot adds at most]`.
    pub(super) fn bytes_for(blocks: u32) -> [u64; 2] {
        let pages = u64::from(blocks).div_ceil(PAGE as u64);
        [pages * (PAGE * CHANNELS * 4) as u64, pages * (PAGE_BYTES + 8)]
    }

    /// The words of a block, if it is in memory. An id beyond the last block is never in memory.
    #[inline(always)]
    pub fn block(&self, id: BlockId) -> Option<&[u32]> {
        let page = self.pages.get(id.0 as usize / PAGE)?;
        page.slots[id.0 as usize % PAGE].as_ref().map(Slot::words)
    }

    /// [`Snapshot::block`], and notes that the block is used in the pass with `stamp`: what a pass that is still stood
    /// on has used is not evicted. Writes only where the stamp is an earlier one.
    #[inline(always)]
    pub fn visit(&self, id: BlockId, stamp: u32) -> Option<&[u32]> {
        let words = self.block(id)?;
        if let Some(channels) = self.stamps.get(id.0 as usize)
            && let last = &channels[channel(stamp)]
            && last.load(Relaxed) < stamp
        {
            // Not over a later pass that uses it too.
            last.fetch_max(stamp, Relaxed);
        }
        Some(words)
    }

    /// The slot of a block.
    pub(super) fn slot(&self, id: BlockId) -> Option<&Slot> {
        self.pages.get(id.0 as usize / PAGE)?.slots[id.0 as usize % PAGE].as_ref()
    }

    /// The blocks in memory, ascending.
    pub(super) fn resident(&self) -> impl Iterator<Item = (BlockId, &Slot)> {
        let pages = self.pages.iter().enumerate();
        pages.flat_map(|(p, page)| {
            let slots = page.slots.iter().enumerate();
            slots.filter_map(move |(i, slot)| Some((BlockId((p * PAGE + i) as u32), slot.as_ref()?)))
        })
    }

    /// The passes that last used a block, in each channel; 0 for none.
    pub(super) fn stamps(&self, id: BlockId) -> [u32; CHANNELS] {
        self.stamps
            .get(id.0 as usize)
            .map_or([0; CHANNELS], |channels| std::array::from_fn(|channel| channels[channel].load(Relaxed)))
    }

    /// Notes that a block is used in a pass, unless a later one used it.
    pub(super) fn stamp_at_least(&self, id: BlockId, stamp: u32) {
        if let Some(channels) = self.stamps.get(id.0 as usize) {
            channels[channel(stamp)].fetch_max(stamp, Relaxed);
        }
    }

    /// Number of blocks of the model.
    pub fn blocks(&self) -> u32 {
        self.blocks
    }

    /// This snapshot with some blocks other than they are, paid for by `account`; `None` if that has too little. Ids
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
        Some(Self { pages, blocks: self.blocks, stamps: Arc::clone(&self.stamps), _charge: charge })
    }

    /// This snapshot with `added` in memory too. Ids beyond the last block are ignored.
    pub fn with(&self, added: impl IntoIterator<Item = (BlockId, Slot)>) -> Self {
        let added = added.into_iter().map(|(id, slot)| (id, Some(slot))).collect();
        self.changed(added, None).unwrap_or_else(|| Self::empty(self.blocks))
    }

    /// This snapshot with only the blocks that `keep` accepts: for tests of walks that meet missing ones.
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
    fn what_is_held_stays_and_counts_until_it_goes() {
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
        // The slot and its page; the other page is shared.
        assert_eq!(before - account.used(), Slot::bytes_for(1) + PAGE_BYTES + 8 * 4);
        drop(without);
        assert_eq!(account.used(), 0);
    }

    #[test]
    fn a_table_that_cannot_be_paid_for_is_not_made() {
        let account = Account::new(PAGE_BYTES);
        let changes = |n: u32| (0..n).map(|i| (BlockId(i * PAGE as u32), None)).collect();
        assert!(Snapshot::empty(64).changed(changes(1), Some(&account)).is_none());
        assert_eq!(account.used(), 0);
    }

    #[test]
    fn a_visit_is_noted() {
        let snapshot = Snapshot::empty(2).with([(BlockId(1), Slot::new(&[5]))]);
        assert_eq!(snapshot.visit(BlockId(1), 9).map(|w| w[0]), Some(5));
        assert!(snapshot.visit(BlockId(0), 9).is_none() && snapshot.visit(BlockId(u32::MAX), 9).is_none());
        // Of the same channel, and of another.
        snapshot.stamp_at_least(BlockId(1), 5);
        snapshot.stamp_at_least(BlockId(1), 7);
        assert_eq!([0, 1, 64].map(|b| snapshot.stamps(BlockId(b))), [[0; 4], [0, 9, 0, 7], [0; 4]]);
    }
}
