//! Filters of hits: hidden parts, and ray intervals that are tested in double precision.

use super::hit::Triangle;

/// Rejects hits on hidden parts, and hits that fail a further test.
#[derive(Debug, Clone, Copy)]
pub struct PartFilter<'a> {
    /// Bit `i % 64` of word `i / 64`: part `i` of the model is hidden. Parts beyond the last word are visible.
    pub hidden: &'a [u64],
    /// The model's part that corresponds to the tree's local part 0 in this instance.
    pub first_part: u32,
    /// The bits (`lod::summary_bit`) of all local parts that are hidden or look different from the file.
    pub touched: u32,
    /// The bits of all local parts that are hidden.
    pub hidden_bits: u32,
    /// The bits of all local parts that are hidden or see-through: cells do not show them in place of other parts.
    pub unseen_bits: u32,
    /// The bits of all local parts that are visible.
    pub visible_bits: u32,
    /// A further test of each hit, if there is one. Packets and bundles with such a test are traced as single rays.
    pub within: Option<&'a dyn Within>,
}

impl Default for PartFilter<'_> {
    /// Rejects nothing.
    fn default() -> Self {
        Self {
            hidden: &[],
            first_part: 0,
            touched: 0,
            hidden_bits: 0,
            unseen_bits: 0,
            visible_bits: u32::MAX,
            within: None,
        }
    }
}

/// The visible parts in and below each block of a tree. Walks pass by blocks that have none: such blocks are neither
/// needed nor read.
#[derive(Debug, Default)]
pub struct ShownBlocks {
    /// Id of the tree's first block.
    pub first_block: u32,
    /// The parts of each block.
    pub blocks: Box<[ShownBlock]>,
}

/// The visible parts in and below a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShownBlock {
    /// Their bits (`lod::summary_bit`), as parts of the tree. 0: there are none.
    pub bits: u32,
    /// One of them; [`ShownBlock::NO_PART`] if there are none, or they are unknown.
    pub part: u32,
}

impl ShownBlock {
    /// No part.
    pub const NO_PART: u32 = u32::MAX;
    /// All parts in the block are hidden.
    pub const NOTHING: Self = Self { bits: 0, part: Self::NO_PART };
    /// The parts in the block are unknown.
    pub const UNKNOWN: Self = Self { bits: u32::MAX, part: Self::NO_PART };
}

impl ShownBlocks {
    #[inline]
    fn of(&self, block: u32) -> ShownBlock {
        self.blocks.get(block.wrapping_sub(self.first_block) as usize).copied().unwrap_or(ShownBlock::UNKNOWN)
    }

    /// True if walks pass by a block.
    #[inline]
    pub fn lacks(&self, block: u32) -> bool {
        self.bits(block) == 0
    }

    /// The bits of the visible parts in and below a block.
    #[inline]
    pub fn bits(&self, block: u32) -> u32 {
        self.of(block).bits
    }

    /// A visible local part in or below a block, if one is known.
    pub fn part_in(&self, block: u32) -> Option<u32> {
        Some(self.of(block).part).filter(|&part| part != ShownBlock::NO_PART)
    }
}

/// A test of hits in more than single precision.
pub trait Within: std::fmt::Debug + Sync {
    /// True if a hit on `triangle` at `t` counts.
    fn triangle(&self, triangle: &Triangle, t: f32) -> bool;
    /// True if a cell that the ray enters at `t` may be shown as a stand-in. If not, the walk descends below the cell.
    fn cell(&self, t: f32) -> bool;
    /// True if `t` lies beyond the end of the ray.
    fn is_beyond(&self, t: f32) -> bool;
}

impl PartFilter<'_> {
    /// True if a local part is hidden.
    #[inline]
    pub fn hides(&self, local_part: u32) -> bool {
        let part = u64::from(self.first_part) + u64::from(local_part);
        self.hidden.get((part / 64) as usize).is_some_and(|word| word >> (part % 64) & 1 == 1)
    }

    /// True if each hit needs its own test. Packet kernels then fall back to single rays.
    #[inline]
    pub fn is_by_ray(filter: Option<&Self>) -> bool {
        filter.is_some_and(|filter| filter.within.is_some())
    }

    /// True if a hit at `t` on a triangle of `part` is rejected. `triangle` is called only if a further test needs it.
    #[inline]
    pub fn rejects(&self, part: impl Fn() -> u32, triangle: impl Fn() -> Triangle, t: f32) -> bool {
        self.hides(part()) || self.within.is_some_and(|within| !within.triangle(&triangle(), t))
    }

    /// True if a cell that the ray enters at `t` must not be shown as a stand-in, because each hit in it needs its own
    /// test.
    #[inline]
    pub fn descends(&self, t: f32) -> bool {
        self.within.is_some_and(|within| !within.cell(t))
    }

    /// True if a hit at `t` lies beyond the end of the ray.
    #[inline]
    pub fn is_beyond(&self, t: f32) -> bool {
        self.within.is_some_and(|within| within.is_beyond(t))
    }
}
