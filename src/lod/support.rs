//! Extents of a cell's content along eight axes at once.
#![allow(clippy::needless_range_loop)] // an axis is a lane of several arrays

use super::oriented_slabs::{Content, OrientedSlabs};
use crate::math::Bounds;
use glam::{DVec3, Vec3};

/// Number of axes that are measured at once, one in each lane.
pub const AXES: usize = 8;
/// Eight axes, by component.
pub type Axes = [[f32; AXES]; 3];

/// Lanes of a vector of double precision. (With eight lanes, or with comparisons in place of `min` and `max`, the
/// AVX-512 code takes twice as long.)
const HALF: usize = AXES / 2;
/// Half of the axes, by component.
type Half = [[f64; HALF]; 3];

/// Bound on the error of a cell's ends along an axis, as a part of the greatest magnitude of a coordinate: 17 h
/// (`trace/oriented_slabs.rs`) and a reserve.
const ENDS: f64 = 24.0 / 16_777_216.0;

/// Returns for each axis the least and the greatest `axis . p` over the content. For pieces known only by their cells
/// the extent may be larger. Double precision makes the result the same with any instruction set. (Always inlined, so
/// that it is compiled for the instruction set of its caller.)
#[inline(always)]
pub fn extents(content: &Content, axes: &Axes) -> [[f64; AXES]; 2] {
    let mut halves: [Half; 2] = [[[0.0; HALF]; 3]; 2];
    for k in 0..3 {
        for lane in 0..AXES {
            halves[lane / HALF][k][lane % HALF] = f64::from(axes[k][lane]);
        }
    }
    let mut ends = [[[f64::INFINITY; HALF], [f64::NEG_INFINITY; HALF]]; 2];
    for p in content.points() {
        add_point(p, &halves, &mut ends);
    }
    for (cell, slabs, _) in content.cells() {
        for half in 0..2 {
            let mut back = halves[half];
            for k in 0..3 {
                for lane in 0..HALF {
                    back[k][lane] = -back[k][lane];
                }
            }
            let (behind, before) = (farthest_of(cell, slabs, &back), farthest_of(cell, slabs, &halves[half]));
            let [low, high] = &mut ends[half];
            for lane in 0..HALF {
                low[lane] = low[lane].min(-behind[lane]);
                high[lane] = high[lane].max(before[lane]);
            }
        }
    }
    let mut out = [[0.0; AXES]; 2];
    for lane in 0..AXES {
        (out[0][lane], out[1][lane]) = (ends[lane / HALF][0][lane % HALF], ends[lane / HALF][1][lane % HALF]);
    }
    out
}

#[inline(always)]
fn add_point(p: &Vec3, axes: &[Half; 2], ends: &mut [[[f64; HALF]; 2]; 2]) {
    let (x, y, z) = (f64::from(p.x), f64::from(p.y), f64::from(p.z));
    for half in 0..2 {
        let [along_x, along_y, along_z] = &axes[half];
        let [low, high] = &mut ends[half];
        for lane in 0..HALF {
            let at = x * along_x[lane] + y * along_y[lane] + z * along_z[lane];
            low[lane] = low[lane].min(at);
            high[lane] = high[lane].max(at);
        }
    }
}

/// Upper bound on `axis . p` for points of a cell that are inside of its slabs.
pub fn farthest(cell: &Bounds, slabs: &OrientedSlabs<f32>, axis: DVec3) -> f64 {
    farthest_of(cell, slabs, &axis.to_array().map(|component| [component]))[0]
}

/// Upper bounds along several axes.
///
/// For any factors `f`, `axis . p = (axis - f0 a0 - f1 a1) . p + f0 (a0 . p) + f1 (a1 . p)`. The cell bounds the first
/// term, the slabs bound the others. The best factor for one slab is zero or cancels one component of the remaining
/// axis. Planes at a cell's ends are computed in single precision, so content may be outside of them. The bound
/// therefore adds this error times the factor, which may be large.
#[inline(always)]
fn farthest_of<const N: usize>(cell: &Bounds, slabs: &OrientedSlabs<f32>, axes: &[[f64; N]; 3]) -> [f64; N] {
    let (centre, half) =
        ((cell.min.as_dvec3() + cell.max.as_dvec3()) * 0.5, (cell.max.as_dvec3() - cell.min.as_dvec3()) * 0.5);
    let give = (centre.abs() + half).max_element() * ENDS;
    let (centre, half) = (centre.to_array(), half.to_array());
    let (mut rest, mut sum) = (*axes, [0.0; N]);
    for slab in slabs {
        let across = slab.axis.map(f64::from);
        let (low, high) = (f64::from(slab.low), f64::from(slab.high));
        let (mut least, mut factors, mut beyonds) = (in_cell(&centre, &half, &rest), [0.0; N], [0.0; N]);
        for k in 0..3 {
            let (mut left, mut factor, mut beyond) = (rest, [0.0; N], [0.0; N]);
            for lane in 0..N {
                let by = rest[k][lane] / across[k];
                let plane = if by > 0.0 { high } else { low };
                (factor[lane], beyond[lane]) = (by, by * plane + by.abs() * give);
                for axis in 0..3 {
                    left[axis][lane] = rest[axis][lane] - across[axis] * by;
                }
            }
            let in_cell = in_cell(&centre, &half, &left);
            for lane in 0..N {
                let all = in_cell[lane] + beyond[lane];
                // False for NaN and infinity, which occur if the slab's axis lacks that component.
                let is_less = all < least[lane];
                least[lane] = if is_less { all } else { least[lane] };
                factors[lane] = if is_less { factor[lane] } else { factors[lane] };
                beyonds[lane] = if is_less { beyond[lane] } else { beyonds[lane] };
            }
        }
        for lane in 0..N {
            for axis in 0..3 {
                rest[axis][lane] -= across[axis] * factors[lane];
            }
            sum[lane] += beyonds[lane];
        }
    }
    let mut all = in_cell(&centre, &half, &rest);
    for lane in 0..N {
        all[lane] += sum[lane];
    }
    all
}

/// Extents of a cell along several axes, from its centre and half its extent.
#[inline(always)]
fn in_cell<const N: usize>(centre: &[f64; 3], half: &[f64; 3], [x, y, z]: &[[f64; N]; 3]) -> [f64; N] {
    let mut out = [0.0; N];
    for lane in 0..N {
        let middle = centre[0] * x[lane] + centre[1] * y[lane] + centre[2] * z[lane];
        out[lane] = middle + (half[0] * x[lane].abs() + half[1] * y[lane].abs() + half[2] * z[lane].abs());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::Fill;
    use super::super::oriented_slabs::{Middle, fields, normal_bytes, oriented_slabs};
    use super::*;
    use crate::simd::{Isa, Op, Simd, dispatch};
    use proptest::prelude::*;

    struct Reach<'a>(&'a Content, &'a Axes);

    impl Op for Reach<'_> {
        type Out = [[f64; AXES]; 2];

        #[inline(always)]
        fn run<S: Simd>(self, _: S) -> Self::Out {
            extents(self.0, self.1)
        }
    }

    /// The scalar twin of `farthest_of`, for one axis.
    fn one_by_one(cell: &Bounds, slabs: &OrientedSlabs<f32>, axis: DVec3) -> f64 {
        let (centre, half) =
            ((cell.min.as_dvec3() + cell.max.as_dvec3()) * 0.5, (cell.max.as_dvec3() - cell.min.as_dvec3()) * 0.5);
        let give = (centre.abs() + half).max_element() * ENDS;
        let in_cell = |axis: DVec3| centre.dot(axis) + half.dot(axis.abs());
        let (mut rest, mut sum) = (axis, 0.0);
        for slab in slabs {
            let across = Vec3::from(slab.axis).as_dvec3();
            let mut best = (in_cell(rest), 0.0, 0.0);
            for k in 0..3 {
                let factor = rest[k] / across[k];
                let plane = if factor > 0.0 { slab.high } else { slab.low };
                let beyond = factor * f64::from(plane) + factor.abs() * give;
                let all = in_cell(rest - across * factor) + beyond;
                // False for NaN and infinity, which occur if the slab's axis lacks that component.
                if all < best.0 {
                    best = (all, factor, beyond);
                }
            }
            (rest, sum) = (rest - across * best.1, sum + best.2);
        }
        in_cell(rest) + sum
    }

    fn points() -> impl Strategy<Value = Vec<Vec3>> {
        prop::collection::vec(prop::array::uniform3(-9.0f32..9.0).prop_map(Vec3::from), 1..20)
    }

    fn axes() -> impl Strategy<Value = Axes> {
        prop::array::uniform3(prop::array::uniform8(-1.0f32..1.0))
    }

    fn axis(axes: &Axes, lane: usize) -> DVec3 {
        Vec3::from([axes[0][lane], axes[1][lane], axes[2][lane]]).as_dvec3()
    }

    proptest! {
        #[test]
        fn extents_equal_those_of_single_points(points in points(), axes in axes()) {
            let content = Content::of_points(points.clone());
            for isa in Isa::ALL {
                let [low, high] = dispatch(isa, Reach(&content, &axes));
                for lane in 0..AXES {
                    let at = |p: &Vec3| p.as_dvec3().dot(axis(&axes, lane));
                    prop_assert_eq!(low[lane], points.iter().map(at).fold(f64::INFINITY, f64::min));
                    prop_assert_eq!(high[lane], points.iter().map(at).fold(f64::NEG_INFINITY, f64::max));
                }
            }
        }

        #[test]
        fn extents_of_cells_equal_scalar_ones_and_contain_the_points(points in points(), normal: u16, axes in axes()) {
            let (content, cell) = (Content::of_points(points.clone()), Bounds::of(&points));
            let middle = Middle { at: cell.center().to_array(), half: (cell.extent() * 0.5).to_array() };
            let own = content.oriented_slabs(normal.into(), &middle);
            let slabs = oriented_slabs(fields(own), normal_bytes(normal.into()), &middle);
            let large = Content::of_cells(vec![(cell, slabs, Fill::of(&content, &cell))]);
            for isa in Isa::ALL {
                let [low, high] = dispatch(isa, Reach(&large, &axes));
                for lane in 0..AXES {
                    let along = axis(&axes, lane);
                    let singly = [-one_by_one(&cell, &slabs, -along), one_by_one(&cell, &slabs, along)];
                    prop_assert_eq!([low[lane], high[lane]], singly);
                    for p in &points {
                        let at = p.as_dvec3().dot(along);
                        let [low, high] = [low[lane], high[lane]];
                        prop_assert!(low - 1e-4 <= at && at <= high + 1e-4, "{} {at} {}", low, high);
                    }
                }
            }
        }
    }
}
