//! Finds object splits: binned surface area heuristic over three axes.
//!
//! Source: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", RT 2007. Deviation: ties go to the
//! lower axis and bin, so that the result is a function of the set.

use super::refs::Ref;
use super::sweep::{Bins, MAGIC, Plane, whole};
use crate::math::Bounds;
use crate::structure::par::Par;
use glam::{Vec4, Vec4Swizzles};

/// Number of bins on an axis: for a range, and for a range so small that sixteen bins would mostly be empty.
pub const BINS: usize = 16;
pub const FEW_BINS: usize = 8;
/// Number of references from which on a range has all bins.
pub const FEW: usize = 32;

/// Ranges of fewer references than this are binned by one thread.
pub const PARALLEL: usize = 1 << 17;

/// Bounds of a range: of the boxes, and of twice their centres.
#[derive(Debug, Clone, Copy)]
pub struct Extents {
    low: Vec4,
    high: Vec4,
    center_low: Vec4,
    center_high: Vec4,
}

impl Extents {
    /// Extents of an empty range.
    pub const EMPTY: Self = Self {
        low: Vec4::INFINITY,
        high: Vec4::NEG_INFINITY,
        center_low: Vec4::INFINITY,
        center_high: Vec4::NEG_INFINITY,
    };

    /// Extends the bounds to contain `r`.
    #[inline(always)]
    pub fn add(&mut self, r: &Ref) {
        self.low = self.low.min(r.low);
        self.high = self.high.max(r.high);
        let c = r.center2();
        self.center_low = self.center_low.min(c);
        self.center_high = self.center_high.max(c);
    }

    /// Returns the union of both.
    pub fn merge(self, o: Self) -> Self {
        Self {
            low: self.low.min(o.low),
            high: self.high.max(o.high),
            center_low: self.center_low.min(o.center_low),
            center_high: self.center_high.max(o.center_high),
        }
    }

    /// Returns the extents of a range.
    pub fn of(refs: &[Ref], par: &Par) -> Self {
        let one = |refs: &[Ref]| {
            let mut e = Self::EMPTY;
            refs.iter().for_each(|r| e.add(r));
            e
        };
        if refs.len() < PARALLEL {
            return one(refs);
        }
        let chunks: Vec<&[Ref]> = refs.chunks(PARALLEL / 4).collect();
        par.map_items(chunks, one).into_iter().fold(Self::EMPTY, Self::merge)
    }

    /// Returns the axis on which the centres spread most.
    pub fn widest_axis(&self) -> usize {
        let size = (self.center_high - self.center_low).xyz();
        if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        }
    }

    /// Bounds of the boxes.
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.low.xyz(), max: self.high.xyz() }
    }
}

/// A plane between two bins.
#[derive(Debug, Clone, Copy)]
pub struct Split {
    axis: usize,
    /// Mapping of centres to bins, on the axis.
    from: f32,
    scale: f32,
    /// References that map below this are on the left.
    below: f32,
    /// Sum over both sides of half area times references.
    pub cost: f32,
    /// Sum over both sides of half area.
    pub side_areas: f32,
    /// Bounds of the left side.
    pub left: Bounds,
    /// Bounds of the right side.
    pub right: Bounds,
}

impl Split {
    /// True if a reference belongs to the left side, by the arithmetic of the bins.
    #[inline(always)]
    pub fn is_left(&self, r: &Ref) -> bool {
        (r.low[self.axis] + r.high[self.axis] - self.from) * self.scale + MAGIC < self.below
    }
}

/// Maps centres to bins.
#[derive(Debug, Clone, Copy)]
struct Mapping {
    from: Vec4,
    scale: Vec4,
}

impl Mapping {
    fn new(e: &Extents, bins: usize) -> Self {
        let size = (e.center_high - e.center_low).with_w(0.0);
        // With 0.999, the greatest centre does not round into a bin of its own.
        let scale = Vec4::splat(bins as f32 * 0.999) / size;
        // For a smaller size, the scale might not be finite.
        let wide = size.cmpgt(Vec4::splat(1e-30));
        Self { from: e.center_low.with_w(0.0), scale: Vec4::select(wide, scale, Vec4::ZERO) }
    }

    /// Returns a bin on each axis, of `B`.
    #[inline(always)]
    fn bins<const B: usize>(&self, r: &Ref) -> [usize; 3] {
        whole::<B>((r.center2() - self.from) * self.scale + Vec4::splat(MAGIC))
    }
}

fn bin<const B: usize>(refs: &[Ref], mapping: &Mapping) -> Bins<B> {
    let mut bins = Bins::EMPTY;
    for r in refs {
        for (axis, at) in mapping.bins::<B>(r).into_iter().enumerate() {
            bins.boxes[axis][at].add(r.low, r.high);
            bins.enter[at][axis] += 1;
        }
    }
    // No reference lies in two bins.
    bins.leave = bins.enter;
    bins
}

/// Returns the cheapest split of a range, or `None` if all centres are one point.
pub fn find(refs: &[Ref], extents: &Extents, par: &Par) -> Option<Split> {
    if refs.len() < FEW { find_with::<FEW_BINS>(refs, extents, par) } else { find_with::<BINS>(refs, extents, par) }
}

fn find_with<const B: usize>(refs: &[Ref], extents: &Extents, par: &Par) -> Option<Split> {
    let mapping = Mapping::new(extents, B);
    let bins = if refs.len() < PARALLEL {
        bin::<B>(refs, &mapping)
    } else {
        let chunks: Vec<&[Ref]> = refs.chunks(PARALLEL / 4).collect();
        let parts = par.map_items(chunks, |c| bin::<B>(c, &mapping));
        parts.iter().fold(Bins::EMPTY, Bins::merge)
    };
    let Plane { axis, bin, cost, left, right } = bins.cheapest()?;
    let (from, scale) = (mapping.from[axis], mapping.scale[axis]);
    let side_areas = left.half_area() + right.half_area();
    Some(Split { axis, from, scale, below: MAGIC + bin as f32, cost, side_areas, left, right })
}
