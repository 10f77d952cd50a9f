//! Memory for one decoded block, on cache-line boundaries.

use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// A cache line.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([u32; 16]);

/// The words of a decoded block; shared, never written again.
#[derive(Debug, Clone)]
pub struct Slot {
    lines: Arc<[Line]>,
}

impl Slot {
    /// A copy of `words`, with zeros up to the next cache line.
    pub fn new(words: &[u32]) -> Self {
        let line = |chunk: &[u32]| {
            let mut line = Line([0; 16]);
            line.0[..chunk.len()].copy_from_slice(chunk);
            line
        };
        Self { lines: words.chunks(16).map(line).collect() }
    }

    /// The words.
    #[inline(always)]
    pub fn words(&self) -> &[u32] {
        bytemuck::must_cast_slice(&self.lines)
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        size_of_val(&*self.lines) as u64
    }

    /// Bytes of memory that `words` words will take.
    pub fn bytes_for(words: usize) -> u64 {
        (words.div_ceil(16) * size_of::<Line>()) as u64
    }
}
