//! Bins of space: references are chopped at the planes between bins.
//!
//! Source: Stich et al. 2009, section 4. Deviation: instead of clipping polygons, the code follows each edge through
//! the bins, and its points at the planes extend the bins on both sides. The box of a bin is that of the edges inside,
//! which is that of the triangle. Boxes are in single precision, because they only rate planes.

use super::refs::Ref;
use super::sweep::{Bins, Grown, MAGIC, whole, whole1};
use crate::math::Bounds;
use glam::{Vec3, Vec4};

/// Bins of equal width in a box.
pub struct Grid<const B: usize> {
    low: Vec4,
    /// Number of bins per unit of length; 0 on an axis too thin to be divided.
    scale: Vec4,
    /// Width of a bin.
    step: Vec4,
}

impl<const B: usize> Grid<B> {
    /// Divides `bounds` into bins.
    pub fn new(bounds: &Bounds) -> Self {
        let (low, high) = (bounds.min.extend(0.0), bounds.max.extend(0.0));
        let step = (high - low) / B as f32;
        let parts = (low + step).cmpgt(low) & high.cmpgt(high - step) & step.cmpgt(Vec4::splat(1e-30));
        // With 0.999, the far side does not round into a bin of its own.
        let scale = Vec4::select(parts, Vec4::splat(0.999) / step, Vec4::ZERO);
        Self { low, scale, step }
    }

    /// Returns where the first `bins` bins of an axis end.
    #[inline(always)]
    pub fn plane(&self, axis: usize, bins: usize) -> f32 {
        self.low[axis] + self.step[axis] * bins as f32
    }

    #[inline(always)]
    fn bins(&self, point: Vec4) -> [usize; 3] {
        whole::<B>((point.with_w(0.0) - self.low) * self.scale + Vec4::splat(MAGIC))
    }
}

/// Sorts `refs`, which lie in the grid's box, into bins.
pub fn bin<const B: usize>(refs: &[Ref], triangles: &[[Vec3; 3]], grid: &Grid<B>) -> Bins<B> {
    let mut bins = Bins::EMPTY;
    for r in refs {
        let (first, last) = (grid.bins(r.low), grid.bins(r.high));
        for axis in 0..3 {
            bins.enter[first[axis]][axis] += 1;
            bins.leave[last[axis]][axis] += 1;
            if first[axis] == last[axis] {
                bins.boxes[axis][first[axis]].add(r.low, r.high);
            }
        }
        if first == last {
            continue;
        }
        let corners = triangles[r.triangle()].map(|c| c.extend(0.0));
        let [x, y, z] = &mut bins.boxes;
        if first[0] != last[0] {
            chop::<0, B>(r, &corners, grid, x);
        }
        if first[1] != last[1] {
            chop::<1, B>(r, &corners, grid, y);
        }
        if first[2] != last[2] {
            chop::<2, B>(r, &corners, grid, z);
        }
    }
    bins
}

/// Follows the edges of a triangle, as far as they lie in its reference, through the bins of an axis.
#[inline(always)]
fn chop<const AXIS: usize, const B: usize>(r: &Ref, corners: &[Vec4; 3], grid: &Grid<B>, bins: &mut [Grown; B]) {
    let (low, scale, step) = (grid.low[AXIS], grid.scale[AXIS], grid.step[AXIS]);
    let bin = |x: f32| whole1::<B>((x - low) * scale + MAGIC);
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let (a, b) = (corners[a], corners[b]);
        let (p, q) = if a[AXIS] <= b[AXIS] { (a, b) } else { (b, a) };
        let (from, to) = (p[AXIS].max(r.low[AXIS]), q[AXIS].min(r.high[AXIS]));
        if from > to {
            continue;
        }
        let length = q[AXIS] - p[AXIS];
        let slope = if length > 1e-30 { (q - p) * length.recip() } else { Vec4::ZERO };
        let point = |x: f32| (p + slope * (x - p[AXIS])).max(r.low).min(r.high);
        let (first, last) = (bin(from), bin(to));
        let start = point(from);
        bins[first].add(start, start);
        for i in first..last {
            let x = point(low + step * (i + 1) as f32);
            bins[i].add(x, x);
            bins[i + 1].add(x, x);
        }
        // An edge that ends at its own corner uses the corner: the edge may lie across the axis.
        let end = if to == q[AXIS] { q.max(r.low).min(r.high) } else { point(to) };
        bins[last].add(end, end);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structure::bvh::build::clip::clipped_bounds;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        [0i32..17, 0i32..17, 0i32..17].prop_map(|p| Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        /// The bins on either side of a plane have the bounds that clipping finds there.
        #[test]
        fn bins_hold_what_clipping_finds(a in point(), b in point(), c in point()) {
            let whole = Bounds { min: Vec3::ZERO, max: Vec3::splat(16.5) };
            let triangle = [a, b, c];
            let grid = Grid::<8>::new(&whole);
            let bins = bin(&[Ref::new(Bounds::of(&triangle), 0)], &[triangle], &grid);
            for axis in 0..3 {
                for i in 1..8 {
                    let plane = grid.plane(axis, i);
                    let (mut below, mut above) = (whole, whole);
                    (below.max[axis], above.min[axis]) = (plane, plane);
                    for (cell, part) in [(below, 0..i), (above, i..8)] {
                        let Some(exact) = clipped_bounds(&triangle, &cell) else { continue };
                        let found = bins.bounds(axis, part);
                        let grown = Bounds { min: found.min - 1e-3, max: found.max + 1e-3 };
                        prop_assert!(grown.contains(&exact), "{found:?} {exact:?}");
                        prop_assert!((found.half_area() - exact.half_area()).abs() < 0.1, "{found:?} {exact:?}");
                    }
                }
            }
        }
    }
}
