//! Filters of hits: hidden parts, and ray intervals that are tested in double precision.

use super::hit::Triangle;

/// Rejects hits on hidden parts, and hits that fail a further test.
#[derive(Debug, Clone, Copy, Default)]
pub struct PartFilter<'a> {
    /// Bit `i % 64` of word `i / 64`: part `i` of the model is hidden. Parts beyond the last word are visible.
    pub hidden: &'a [u64],
    /// The model's part that corresponds to the tree's local part 0 in this instance.
    pub first_part: u32,
    /// The bits (`lod::summary_bit`) of all local parts that are hidden or look different from the file. A cell that
    /// mixes such a part with others is not shown as a stand-in.
    pub touched: u32,
    /// A further test of each hit, if there is one. Packets and bundles with such a test are traced as single rays.
    pub within: Option<&'a dyn Within>,
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
