//! Where to split: binned surface area heuristic over three axes.
//!
//! Source: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", RT 2007.
//! Deviation: ties go to the lower axis and bin, so that the result is a function of the set.

use super::par::Par;
use super::refs::Ref;
use crate::math::Bounds;
use bytemuck::must_cast;
use glam::{Vec4, Vec4Swizzles};

/// Bins on an axis: of a range, and of one so small that sixteen would mostly be empty.
const BINS: usize = 16;
const FEW_BINS: usize = 8;
/// References from which a range has all bins.
const FEW: usize = 32;

/// Below this a range is binned by one thread.
const PARALLEL: usize = 1 << 17;

/// Bounds of a range: of the boxes, and of twice their middles.
#[derive(Debug, Clone, Copy)]
pub struct Extents {
    low: Vec4,
    high: Vec4,
    center_low: Vec4,
    center_high: Vec4,
}

impl Extents {
    /// Of nothing.
    pub const EMPTY: Self = Self {
        low: Vec4::INFINITY,
        high: Vec4::NEG_INFINITY,
        center_low: Vec4::INFINITY,
        center_high: Vec4::NEG_INFINITY,
    };

    /// Grown to hold `r`.
    #[inline(always)]
    pub fn add(&mut self, r: &Ref) {
        self.low = self.low.min(r.low);
        self.high = self.high.max(r.high);
        let c = r.center2();
        self.center_low = self.center_low.min(c);
        self.center_high = self.center_high.max(c);
    }

    /// Of both.
    pub fn merge(self, o: Self) -> Self {
        Self {
            low: self.low.min(o.low),
            high: self.high.max(o.high),
            center_low: self.center_low.min(o.center_low),
            center_high: self.center_high.max(o.center_high),
        }
    }

    /// Of a range.
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

    /// The axis on which the middles spread most.
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
    /// The mapping's, on the axis.
    from: f32,
    scale: f32,
    /// What maps below it is on the left.
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
    /// Which side a reference belongs to: the bins' own arithmetic.
    #[inline(always)]
    pub fn is_left(&self, r: &Ref) -> bool {
        (r.low[self.axis] + r.high[self.axis] - self.from) * self.scale + MAGIC < self.below
    }
}

/// From middles to bins.
#[derive(Debug, Clone, Copy)]
struct Mapping {
    from: Vec4,
    scale: Vec4,
}

/// Added to a number below sixteen, it leaves the whole part in bits [`SHIFT`] and up: a conversion would
/// check for overflow, lane by lane.
const MAGIC: f32 = 12288.0;
const SHIFT: u32 = 10;

impl Mapping {
    fn new(e: &Extents, bins: usize) -> Self {
        let size = (e.center_high - e.center_low).with_w(0.0);
        // 0.999: the greatest middle must not round into a bin of its own.
        let scale = Vec4::splat(bins as f32 * 0.999) / size;
        // Smaller than this, the scale might not be finite.
        let wide = size.cmpgt(Vec4::splat(1e-30));
        Self { from: e.center_low.with_w(0.0), scale: Vec4::select(wide, scale, Vec4::ZERO) }
    }

    /// A bin on each axis, of `B`.
    #[inline(always)]
    fn bins<const B: usize>(&self, r: &Ref) -> [usize; 3] {
        let at = (r.center2() - self.from) * self.scale + Vec4::splat(MAGIC);
        let [x, y, z, _] = must_cast::<Vec4, [u32; 4]>(at);
        [x, y, z].map(|bits| (bits >> SHIFT) as usize & (B - 1))
    }
}

/// A box while it grows; `w` means nothing.
#[derive(Debug, Clone, Copy)]
struct Grown {
    low: Vec4,
    high: Vec4,
}

impl Grown {
    const EMPTY: Self = Self { low: Vec4::INFINITY, high: Vec4::NEG_INFINITY };

    #[inline(always)]
    fn with(self, low: Vec4, high: Vec4) -> Self {
        Self { low: self.low.min(low), high: self.high.max(high) }
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: self.low.xyz(), max: self.high.xyz() }
    }
}

/// Half areas of three boxes, in the first three lanes. Infinite where a box is empty.
#[inline(always)]
fn half_areas(boxes: &[Grown; 3]) -> Vec4 {
    let [a, b, c] = [0, 1, 2].map(|i| boxes[i].high - boxes[i].low);
    let x = Vec4::new(a.x, b.x, c.x, 0.0);
    let y = Vec4::new(a.y, b.y, c.y, 0.0);
    let z = Vec4::new(a.z, b.z, c.z, 0.0);
    x * y + y * z + z * x
}

/// Bins of a range on all axes.
#[derive(Clone)]
struct Bins<const B: usize> {
    /// By axis, then bin.
    boxes: [[Grown; B]; 3],
    /// By bin, then axis.
    counts: [[i32; 4]; B],
}

impl<const B: usize> Bins<B> {
    fn of(refs: &[Ref], mapping: &Mapping) -> Self {
        let mut bins = Self { boxes: [[Grown::EMPTY; B]; 3], counts: [[0; 4]; B] };
        for r in refs {
            let at = mapping.bins::<B>(r);
            for (axis, at) in at.into_iter().enumerate() {
                let grown = &mut bins.boxes[axis][at];
                *grown = grown.with(r.low, r.high);
                bins.counts[at][axis] += 1;
            }
        }
        bins
    }

    fn merge(mut self, o: &Self) -> Self {
        for (a, b) in self.boxes.iter_mut().flatten().zip(o.boxes.iter().flatten()) {
            *a = a.with(b.low, b.high);
        }
        for (a, b) in self.counts.iter_mut().flatten().zip(o.counts.iter().flatten()) {
            *a += b;
        }
        self
    }

    /// The bounds of some bins of an axis.
    fn bounds(&self, axis: usize, bins: std::ops::Range<usize>) -> Bounds {
        self.boxes[axis][bins].iter().fold(Grown::EMPTY, |b, bin| b.with(bin.low, bin.high)).bounds()
    }

    /// The cheapest plane of each axis: its cost, and its first bin on the right. The cost is infinite
    /// where all is in one bin.
    fn best(&self) -> (Vec4, Vec4) {
        let right = self.right_costs();
        let (mut boxes, mut count) = ([Grown::EMPTY; 3], [0; 4]);
        let (mut best, mut at) = (Vec4::INFINITY, Vec4::ZERO);
        for (i, right) in (1..B).zip(&right[1..]) {
            // An empty side costs infinity times zero, which is less than nothing else.
            let cost = self.grow(i - 1, &mut boxes, &mut count) + *right;
            let better = cost.cmplt(best);
            best = Vec4::select(better, cost, best);
            at = Vec4::select(better, Vec4::splat(i as f32), at);
        }
        (best, at)
    }

    /// Costs of what is right of each plane, by axis.
    fn right_costs(&self) -> [Vec4; B] {
        let mut right = [Vec4::ZERO; B];
        let (mut boxes, mut count) = ([Grown::EMPTY; 3], [0; 4]);
        for i in (1..B).rev() {
            right[i] = self.grow(i, &mut boxes, &mut count);
        }
        right
    }

    /// Adds a bin to a side on each axis; half area times references of that.
    #[inline(always)]
    fn grow(&self, bin: usize, boxes: &mut [Grown; 3], count: &mut [i32; 4]) -> Vec4 {
        for (b, bins) in boxes.iter_mut().zip(&self.boxes) {
            *b = b.with(bins[bin].low, bins[bin].high);
        }
        for (all, c) in count.iter_mut().zip(&self.counts[bin]) {
            *all += c;
        }
        half_areas(boxes) * Vec4::from_array(count.map(|c| c as f32))
    }
}

/// The cheapest split of a range, or `None` where all middles are one point.
pub fn find(refs: &[Ref], extents: &Extents, par: &Par) -> Option<Split> {
    if refs.len() < FEW { find_with::<FEW_BINS>(refs, extents, par) } else { find_with::<BINS>(refs, extents, par) }
}

fn find_with<const B: usize>(refs: &[Ref], extents: &Extents, par: &Par) -> Option<Split> {
    let mapping = Mapping::new(extents, B);
    let bins = if refs.len() < PARALLEL {
        Bins::<B>::of(refs, &mapping)
    } else {
        let chunks: Vec<&[Ref]> = refs.chunks(PARALLEL / 4).collect();
        let mut parts = par.map_items(chunks, |c| Bins::<B>::of(c, &mapping)).into_iter();
        let first = parts.next()?;
        parts.fold(first, |a, b| a.merge(&b))
    };
    let (costs, planes) = bins.best();
    let axis = (1..3).fold(0, |best, axis| if costs[axis] < costs[best] { axis } else { best });
    let cost = costs[axis];
    if !cost.is_finite() {
        return None;
    }
    let bin = planes[axis] as usize;
    let (left, right) = (bins.bounds(axis, 0..bin), bins.bounds(axis, bin..B));
    let (from, scale) = (mapping.from[axis], mapping.scale[axis]);
    let side_areas = left.half_area() + right.half_area();
    Some(Split { axis, from, scale, below: MAGIC + bin as f32, cost, side_areas, left, right })
}
