//! Memory for one decoded block, on cache-line boundaries.

use super::account::Charge;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// A cache line.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([u32; 16]);

/// The words of a decoded block; shared, never written again. Its memory counts until the last holder lets go,
/// whether or not the block is still in the latest snapshot.
#[derive(Debug, Clone)]
pub struct Slot {
    // Dropped in this order: what is given back is free by then. `lines` and `_charge` are only ever cloned and dropped
    // together, so the last of the one goes before the last of the other.
    lines: Arc<[Line]>,
    _charge: Option<Arc<Charge>>,
}

impl Slot {
    /// A copy of `words`, with zeros up to the next cache line. Counts against no budget.
    pub fn new(words: &[u32]) -> Self {
        let (whole, rest) = words.as_chunks::<16>();
        let mut last = Line([0; 16]);
        last.0[..rest.len()].copy_from_slice(rest);
        // Of known length: written once, in place.
        let lines = whole.iter().map(|words| Line(*words)).chain((!rest.is_empty()).then_some(last)).collect();
        Self { lines, _charge: None }
    }

    /// A copy of `words` that is paid for by `charge`.
    pub(super) fn charged(words: &[u32], charge: Charge) -> Self {
        Self { _charge: Some(Arc::new(charge)), ..Self::new(words) }
    }

    /// The words.
    #[inline(always)]
    pub fn words(&self) -> &[u32] {
        bytemuck::must_cast_slice(&self.lines)
    }

    /// The addresses of its words.
    pub(super) fn addresses(&self) -> std::ops::Range<usize> {
        let range = self.lines.as_ptr_range();
        range.start as usize..range.end as usize
    }

    /// Bytes of memory for the words.
    pub fn bytes(&self) -> u64 {
        size_of_val(&*self.lines) as u64
    }

    /// Bytes of memory that a slot of `words` words takes in all: its lines, and what shares and counts them.
    pub fn bytes_for(words: usize) -> u64 {
        ((words.div_ceil(16) + 2) * size_of::<Line>()) as u64
    }
}
