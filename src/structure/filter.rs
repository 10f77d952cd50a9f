//! What rays pass through: hidden parts, and hits outside of an interval that is known better than in single precision.

use super::hit::Triangle;

/// What rays pass through.
#[derive(Debug, Clone, Copy, Default)]
pub struct PartFilter<'a> {
    /// Bit `i % 64` of word `i / 64`: the model's part `i` is hidden. Parts beyond are visible.
    pub hidden: &'a [u64],
    /// The model's part that the tree's local part 0 is here.
    pub first_part: u32,
    /// The bits (`lod::summary_bit`) of all local parts that are hidden or look otherwise than in the file: a cell
    /// with one of them among others does not stand in.
    pub touched: u32,
    /// A further test of each hit, if there is one. Packets and bundles with such a test go ray by ray.
    pub within: Option<&'a dyn Within>,
}

/// A test of hits in more than single precision.
pub trait Within: std::fmt::Debug + Sync {
    /// Whether a hit on `triangle` at `t` counts.
    fn triangle(&self, triangle: &Triangle, t: f32) -> bool;
    /// Whether a cell that is met at `t` may stand in; if not, the walk goes on below it.
    fn cell(&self, t: f32) -> bool;
    /// Whether `t` is behind the end of the ray.
    fn is_beyond(&self, t: f32) -> bool;
}

impl PartFilter<'_> {
    /// Whether a local part is hidden.
    #[inline]
    pub fn hides(&self, local_part: u32) -> bool {
        let part = u64::from(self.first_part) + u64::from(local_part);
        self.hidden.get((part / 64) as usize).is_some_and(|word| word >> (part % 64) & 1 == 1)
    }

    /// Whether each hit is to be tested by itself, ray by ray: kernels that do more at once leave it to single walks.
    #[inline]
    pub fn is_by_ray(filter: Option<&Self>) -> bool {
        filter.is_some_and(|filter| filter.within.is_some())
    }

    /// Whether rays pass through a triangle of `part` that is met at `t`. `triangle` is asked for only where a further
    /// test needs it.
    #[inline]
    pub fn rejects(&self, part: impl Fn() -> u32, triangle: impl Fn() -> Triangle, t: f32) -> bool {
        self.hides(part()) || self.within.is_some_and(|within| !within.triangle(&triangle(), t))
    }

    /// Whether a cell that is met at `t` must not stand in, for its content is to be tested hit by hit.
    #[inline]
    pub fn descends(&self, t: f32) -> bool {
        self.within.is_some_and(|within| !within.cell(t))
    }

    /// Whether what is met at `t` is behind the end of the ray.
    #[inline]
    pub fn is_beyond(&self, t: f32) -> bool {
        self.within.is_some_and(|within| within.is_beyond(t))
    }
}
