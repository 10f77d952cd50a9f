//! Sweep over bins by the surface area heuristic: finds the cheapest plane between two bins, on three axes at once.

use crate::math::Bounds;
use bytemuck::must_cast;
use glam::{Vec4, Vec4Swizzles};
use std::ops::Range;

/// A box while it grows; `w` is meaningless.
#[derive(Debug, Clone, Copy)]
pub struct Grown {
    low: Vec4,
    high: Vec4,
}

impl Grown {
    /// The empty box.
    pub const EMPTY: Self = Self { low: Vec4::INFINITY, high: Vec4::NEG_INFINITY };

    /// Extends the box to contain another one.
    #[inline(always)]
    pub fn add(&mut self, low: Vec4, high: Vec4) {
        self.low = self.low.min(low);
        self.high = self.high.max(high);
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: self.low.xyz(), max: self.high.xyz() }
    }
}

/// Counts on three axes; the fourth element is meaningless.
type Counts = [i32; 4];

/// Bins of references on three axes.
#[derive(Debug, Clone)]
pub struct Bins<const B: usize> {
    /// Box of the references in each bin: by axis, then bin.
    pub boxes: [[Grown; B]; 3],
    /// Number of references that begin in each bin: by bin, then axis.
    pub enter: [Counts; B],
    /// Number of references that end in each bin.
    pub leave: [Counts; B],
}

/// Added to a number below sixteen, it leaves the integer part in bits [`SHIFT`] and up. A conversion would check for
/// overflow, lane by lane.
pub const MAGIC: f32 = 12288.0;
const SHIFT: u32 = 10;

/// Returns the bins of a point, given its position in bins plus [`MAGIC`].
#[inline(always)]
pub fn whole<const B: usize>(at: Vec4) -> [usize; 3] {
    let [x, y, z, _] = must_cast::<Vec4, [u32; 4]>(at);
    [x, y, z].map(|bits| (bits >> SHIFT) as usize & (B - 1))
}

/// Like [`whole`], on one axis.
#[inline(always)]
pub fn whole1<const B: usize>(at: f32) -> usize {
    (at.to_bits() >> SHIFT) as usize & (B - 1)
}

/// A plane between bins.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    /// Axis to which it is perpendicular.
    pub axis: usize,
    /// First bin on the right.
    pub bin: usize,
    /// Sum over both sides of half area times references.
    pub cost: f32,
    /// Bounds of the left side.
    pub left: Bounds,
    /// Bounds of the right side.
    pub right: Bounds,
}

impl<const B: usize> Bins<B> {
    /// Empty bins.
    pub const EMPTY: Self = Self { boxes: [[Grown::EMPTY; B]; 3], enter: [[0; 4]; B], leave: [[0; 4]; B] };

    /// Returns the union of both.
    pub fn merge(mut self, o: &Self) -> Self {
        for (a, b) in self.boxes.iter_mut().flatten().zip(o.boxes.iter().flatten()) {
            a.add(b.low, b.high);
        }
        let mine = self.enter.iter_mut().chain(&mut self.leave);
        for (a, b) in mine.flatten().zip(o.enter.iter().chain(&o.leave).flatten()) {
            *a += b;
        }
        self
    }

    /// Returns the cheapest plane with references on either side; of equal ones the first, by axis and then bin.
    pub fn cheapest(&self) -> Option<Plane> {
        let (costs, bins) = self.cheapest_by_axis();
        let axis = (1..3).fold(0, |best, axis| if costs[axis] < costs[best] { axis } else { best });
        let (cost, bin) = (costs[axis], bins[axis] as usize);
        cost.is_finite().then(|| Plane {
            axis,
            bin,
            cost,
            left: self.bounds(axis, 0..bin),
            right: self.bounds(axis, bin..B),
        })
    }

    /// Returns the bounds of some bins of an axis.
    pub fn bounds(&self, axis: usize, bins: Range<usize>) -> Bounds {
        let mut all = Grown::EMPTY;
        self.boxes[axis][bins].iter().for_each(|b| all.add(b.low, b.high));
        all.bounds()
    }

    /// Returns the cost for each axis, and the first bin on the right. The cost is infinite if there is no plane.
    fn cheapest_by_axis(&self) -> (Vec4, Vec4) {
        let right = self.right_costs();
        let (mut boxes, mut count) = ([Grown::EMPTY; 3], [0; 4]);
        let (mut best, mut at) = (Vec4::INFINITY, Vec4::ZERO);
        for (i, right) in (1..B).zip(&right[1..]) {
            // An empty side costs infinity times zero: NaN, which is not less than any cost.
            let cost = self.grow(i - 1, &self.enter, &mut boxes, &mut count) + *right;
            let better = cost.cmplt(best);
            best = Vec4::select(better, cost, best);
            at = Vec4::select(better, Vec4::splat(i as f32), at);
        }
        (best, at)
    }

    /// Returns the costs of the right side of each plane, by axis.
    fn right_costs(&self) -> [Vec4; B] {
        let mut right = [Vec4::ZERO; B];
        let (mut boxes, mut count) = ([Grown::EMPTY; 3], [0; 4]);
        for i in (1..B).rev() {
            right[i] = self.grow(i, &self.leave, &mut boxes, &mut count);
        }
        right
    }

    /// Adds a bin to a side on each axis; returns half area times references of the sides.
    #[inline(always)]
    fn grow(&self, bin: usize, counts: &[Counts; B], boxes: &mut [Grown; 3], count: &mut Counts) -> Vec4 {
        for (b, bins) in boxes.iter_mut().zip(&self.boxes) {
            b.add(bins[bin].low, bins[bin].high);
        }
        for (all, c) in count.iter_mut().zip(&counts[bin]) {
            *all += c;
        }
        half_areas(boxes) * Vec4::from_array(count.map(|c| c as f32))
    }
}

/// Returns half the areas of three boxes, in the first three lanes. They are infinite for empty boxes.
#[inline(always)]
fn half_areas(boxes: &[Grown; 3]) -> Vec4 {
    let [a, b, c] = [0, 1, 2].map(|i| boxes[i].high - boxes[i].low);
    let x = Vec4::new(a.x, b.x, c.x, 0.0);
    let y = Vec4::new(a.y, b.y, c.y, 0.0);
    let z = Vec4::new(a.z, b.z, c.z, 0.0);
    x * y + y * z + z * x
}
