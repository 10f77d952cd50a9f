//! Which blocks of a model are in memory, at one moment.

use super::slots::Slot;
use crate::base::ids::BlockId;
use std::sync::Arc;

/// Blocks of a page: a new snapshot copies only the pages that change.
const PAGE: usize = 256;

type Page = [Option<Slot>; PAGE];

/// An immutable table from block to slot.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    pages: Vec<Arc<Page>>,
    blocks: u32,
}

impl Snapshot {
    /// Of a model with `blocks` blocks, none in memory.
    pub fn empty(blocks: u32) -> Self {
        let page: Arc<Page> = Arc::new([const { None }; PAGE]);
        Self { pages: vec![page; (blocks as usize).div_ceil(PAGE)], blocks }
    }

    /// The words of a block, if it is in memory. An id beyond the last block is never in memory.
    #[inline(always)]
    pub fn block(&self, id: BlockId) -> Option<&[u32]> {
        let page = self.pages.get(id.0 as usize / PAGE)?;
        page[id.0 as usize % PAGE].as_ref().map(Slot::words)
    }

    /// Number of blocks of the model.
    pub fn blocks(&self) -> u32 {
        self.blocks
    }

    /// This snapshot with `added` in memory too. Ids beyond the last block are ignored.
    pub fn with(&self, added: impl IntoIterator<Item = (BlockId, Slot)>) -> Self {
        let mut next = self.clone();
        for (id, slot) in added {
            if id.0 < self.blocks {
                let page = Arc::make_mut(&mut next.pages[id.0 as usize / PAGE]);
                page[id.0 as usize % PAGE] = Some(slot);
            }
        }
        next
    }

    /// This snapshot with only the blocks that `keep` accepts: for tests of walks that meet missing ones.
    pub fn filtered(&self, keep: impl Fn(BlockId) -> bool) -> Self {
        let all = (0..self.blocks).map(BlockId);
        let kept = all.filter(|&id| keep(id)).filter_map(|id| {
            let slot = self.pages[id.0 as usize / PAGE][id.0 as usize % PAGE].clone();
            slot.map(|s| (id, s))
        });
        Self::empty(self.blocks).with(kept)
    }
}
