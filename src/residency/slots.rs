//! Memory for one decoded block, aligned to cache lines.

use super::account::Charge;
use super::pages;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// A cache line.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([u32; 16]);

/// The words of a decoded block, shared and never written again. Its memory counts against the budget until the last
/// holder drops it, even if the block is no longer in the latest snapshot.
#[derive(Debug, Clone)]
pub struct Slot {
    // Fields are dropped in this order: memory is free before its charge is returned. `lines` and `charge` are cloned
    // and dropped only together, so the last of the one is dropped before the last of the other.
    lines: Arc<[Line]>,
    charge: Option<Arc<Charge>>,
}

impl Slot {
    /// Copies `words` and adds zeros up to the next cache line. Counts against no budget.
    pub fn new(words: &[u32]) -> Self {
        let (whole, rest) = words.as_chunks::<16>();
        let mut last = Line([0; 16]);
        last.0[..rest.len()].copy_from_slice(rest);
        // The length of the iterator is known, so the lines are written once, in place.
        let lines = whole.iter().map(|words| Line(*words)).chain((!rest.is_empty()).then_some(last)).collect();
        Self { lines, charge: None }
    }

    /// Copies `words`; `charge` pays for the memory.
    pub(super) fn charged(words: &[u32], charge: Charge) -> Self {
        let mut slot = Self::new(words);
        slot.charge = Some(Arc::new(charge));
        slot
    }

    /// The words, padded with zeros.
    #[inline(always)]
    pub fn words(&self) -> &[u32] {
        bytemuck::must_cast_slice(&self.lines)
    }

    /// Address range of the words.
    pub(super) fn addresses(&self) -> std::ops::Range<usize> {
        let range = self.lines.as_ptr_range();
        range.start as usize..range.end as usize
    }

    /// Bytes of memory for the words.
    pub fn bytes(&self) -> u64 {
        size_of_val(&*self.lines) as u64
    }

    /// Bytes of memory for a slot of `words` words: the lines, and the counters that share them.
    pub fn bytes_for(words: usize) -> u64 {
        ((words.div_ceil(16) + 2) * size_of::<Line>()) as u64
    }
}

/// Where memory is scarce, blocks come and go, and no two have the same size: the allocator would keep a quarter of the
/// budget in holes. So the last holder first returns the whole pages of the block to the system. (If two holders are
/// dropped at once, neither may find itself the last one: the block is then only freed.)
impl Drop for Slot {
    fn drop(&mut self) {
        if Arc::strong_count(&self.lines) == 1
            && self.charge.as_ref().is_some_and(|charge| charge.is_scarce())
            && let Some(lines) = Arc::get_mut(&mut self.lines)
        {
            pages::give_back(bytemuck::must_cast_slice_mut(lines));
        }
    }
}
