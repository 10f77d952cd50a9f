//! Where to split: binned surface area heuristic over three axes.
//!
//! Source: Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", RT 2007.
//! Deviation: ties go to the lower axis and bin, so that the result is a function of the set.

use super::par::Par;
use super::refs::Ref;
use crate::math::Bounds;
use glam::{IVec4, Vec4, Vec4Swizzles};

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
    const EMPTY: Self = Self {
        low: Vec4::INFINITY,
        high: Vec4::NEG_INFINITY,
        center_low: Vec4::INFINITY,
        center_high: Vec4::NEG_INFINITY,
    };

    #[inline]
    fn add(&mut self, r: &Ref) {
        self.low = self.low.min(r.low);
        self.high = self.high.max(r.high);
        let c = r.center2();
        self.center_low = self.center_low.min(c);
        self.center_high = self.center_high.max(c);
    }

    fn merge(self, o: Self) -> Self {
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

    /// Bounds of the boxes.
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.low.xyz(), max: self.high.xyz() }
    }
}

/// A plane between two bins.
#[derive(Debug, Clone, Copy)]
pub struct Split {
    axis: usize,
    /// First bin on the right.
    bin: i32,
    mapping: Mapping,
    /// Sum over both sides of half area times references.
    pub cost: f32,
    /// Sum over both sides of half area.
    pub side_areas: f32,
    /// Bounds of the left side.
    pub left: Bounds,
    /// Bounds of the right side.
    pub right: Bounds,
}

/// From middles to bins.
#[derive(Debug, Clone, Copy)]
struct Mapping {
    from: Vec4,
    scale: Vec4,
}

impl Mapping {
    fn new(e: &Extents, bins: usize) -> Self {
        let size = e.center_high - e.center_low;
        // 0.999: the greatest middle must not round into a bin of its own.
        let scale = Vec4::splat(bins as f32 * 0.999) / size;
        Self { from: e.center_low, scale: Vec4::select(size.cmpgt(Vec4::ZERO), scale, Vec4::ZERO) }
    }

    #[inline]
    fn bins(&self, r: &Ref) -> IVec4 {
        ((r.center2() - self.from) * self.scale).as_ivec4()
    }
}

/// A plane on one axis: what it costs, and its first bin on the right.
struct Plane {
    cost: f32,
    side_areas: f32,
    bin: i32,
    left: Bounds,
}

#[derive(Clone, Copy)]
struct Bin {
    low: Vec4,
    high: Vec4,
    count: u32,
}

#[derive(Clone)]
struct Bins<const B: usize>([[Bin; B]; 3]);

impl<const B: usize> Bins<B> {
    fn of(refs: &[Ref], mapping: &Mapping) -> Self {
        let empty = Bin { low: Vec4::INFINITY, high: Vec4::NEG_INFINITY, count: 0 };
        let mut bins = Self([[empty; B]; 3]);
        for r in refs {
            let at = mapping.bins(r);
            for (axis, at) in [at.x, at.y, at.z].into_iter().enumerate() {
                let bin = &mut bins.0[axis][at as usize & (B - 1)];
                bin.low = bin.low.min(r.low);
                bin.high = bin.high.max(r.high);
                bin.count += 1;
            }
        }
        bins
    }

    fn merge(mut self, o: &Self) -> Self {
        for (a, b) in self.0.iter_mut().flatten().zip(o.0.iter().flatten()) {
            a.low = a.low.min(b.low);
            a.high = a.high.max(b.high);
            a.count += b.count;
        }
        self
    }

    /// Bounds of the bins from `first` on.
    fn bounds_from(&self, axis: usize, first: usize) -> Bounds {
        let bins = &self.0[axis][first..];
        let low = bins.iter().fold(Vec4::INFINITY, |b, bin| b.min(bin.low));
        let high = bins.iter().fold(Vec4::NEG_INFINITY, |b, bin| b.max(bin.high));
        Bounds { min: low.xyz(), max: high.xyz() }
    }

    /// The cheapest plane on one axis.
    fn best(&self, axis: usize) -> Option<Plane> {
        let bins = &self.0[axis];
        let mut right = [(0.0f32, 0u32); B];
        let (mut low, mut high, mut count) = (Vec4::INFINITY, Vec4::NEG_INFINITY, 0);
        for i in (1..B).rev() {
            low = low.min(bins[i].low);
            high = high.max(bins[i].high);
            count += bins[i].count;
            right[i] = (half_area(low, high), count);
        }
        let (mut low, mut high, mut count) = (Vec4::INFINITY, Vec4::NEG_INFINITY, 0);
        let mut best: Option<Plane> = None;
        for i in 1..B {
            low = low.min(bins[i - 1].low);
            high = high.max(bins[i - 1].high);
            count += bins[i - 1].count;
            let (right_area, right_count) = right[i];
            if count == 0 || right_count == 0 {
                continue;
            }
            let left_area = half_area(low, high);
            let cost = left_area * count as f32 + right_area * right_count as f32;
            if best.as_ref().is_none_or(|b| cost < b.cost) {
                let left = Bounds { min: low.xyz(), max: high.xyz() };
                best = Some(Plane { cost, side_areas: left_area + right_area, bin: i as i32, left });
            }
        }
        best
    }
}

#[inline]
fn half_area(low: Vec4, high: Vec4) -> f32 {
    let e = high - low;
    let p = e * e.yzxw();
    p.x + p.y + p.z
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
    let mut best: Option<Split> = None;
    for axis in (0..3).filter(|&a| mapping.scale[a] > 0.0) {
        if let Some(Plane { cost, side_areas, bin, left }) = bins.best(axis)
            && cost.is_finite()
            && best.is_none_or(|b| cost < b.cost)
        {
            let right = bins.bounds_from(axis, bin as usize);
            best = Some(Split { axis, bin, mapping, cost, side_areas, left, right });
        }
    }
    best
}

/// Moves the left side of `split` to the front; returns where the right begins. The order inside
/// each side is a function of the order before.
pub fn partition(refs: &mut [Ref], split: &Split) -> usize {
    let left = |r: &Ref| split.mapping.bins(r)[split.axis] < split.bin;
    let (mut i, mut j) = (0, refs.len());
    loop {
        while i < j && left(&refs[i]) {
            i += 1;
        }
        while i < j && !left(&refs[j - 1]) {
            j -= 1;
        }
        if i >= j {
            return i;
        }
        refs.swap(i, j - 1);
        i += 1;
        j -= 1;
    }
}

/// Halves a range by the middles on the widest axis: for ranges that the heuristic cannot split, or
/// that have become too deep.
pub fn partition_median(refs: &mut [Ref], extents: &Extents) -> usize {
    let size = (extents.center_high - extents.center_low).xyz();
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let half = refs.len() / 2;
    refs.select_nth_unstable_by(half, |a, b| {
        a.center2()[axis].total_cmp(&b.center2()[axis]).then(a.triangle().cmp(&b.triangle()))
    });
    half
}
