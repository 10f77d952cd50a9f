//! How far points reach along eight axes at once.
#![allow(clippy::needless_range_loop)] // an axis is a lane of several arrays

use crate::simd::{Isa, Op, Simd, dispatch};
use glam::Vec3;

/// Axes that are looked along at once: lanes.
pub const AXES: usize = 8;

/// The least and the greatest of `axis . p` over all points, for each axis. In double precision, the same with any vectors.
pub fn reach(points: &[Vec3], axes: &[[f32; 3]; AXES]) -> [[f64; 2]; AXES] {
    let mut lanes = [[[0.0; HALF]; 3]; 2];
    for (at, axis) in axes.iter().enumerate() {
        (0..3).for_each(|k| lanes[at / HALF][k][at % HALF] = f64::from(axis[k]));
    }
    let ends = dispatch(Isa::best(), Reach { points, axes: &lanes });
    std::array::from_fn(|at| ends[at / HALF].map(|row| row[at % HALF]))
}

/// Lanes of a vector. (Eight at once, or comparisons in place of `min` and `max`: compiled for AVX-512 half as fast.)
const HALF: usize = AXES / 2;

struct Reach<'a> {
    points: &'a [Vec3],
    axes: &'a [[[f64; HALF]; 3]; 2],
}

impl Op for Reach<'_> {
    /// Of each half the least, then the greatest.
    type Out = [[[f64; HALF]; 2]; 2];

    /// Without vectors of ours, which are of single precision: the loops over lanes become such.
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Out {
        let axes = *self.axes;
        let mut ends = [[[f64::INFINITY; HALF], [f64::NEG_INFINITY; HALF]]; 2];
        for p in self.points {
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
        ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_that_of_points_one_by_one(
            points in prop::collection::vec(prop::array::uniform3(-9.0f32..9.0).prop_map(Vec3::from), 0..20),
            axes in prop::array::uniform8(prop::array::uniform3(-1.0f32..1.0)),
        ) {
            let half = |h: usize| std::array::from_fn(|k| std::array::from_fn(|lane| f64::from(axes[h * HALF + lane][k])));
            for isa in Isa::ALL {
                let ends = dispatch(isa, Reach { points: &points, axes: &[half(0), half(1)] });
                for (lane, axis) in axes.into_iter().enumerate() {
                    let at = |p: &Vec3| p.as_dvec3().dot(Vec3::from(axis).as_dvec3());
                    let [low, high] = ends[lane / HALF].map(|row| row[lane % HALF]);
                    prop_assert_eq!(low, points.iter().map(at).fold(f64::INFINITY, f64::min));
                    prop_assert_eq!(high, points.iter().map(at).fold(f64::NEG_INFINITY, f64::max));
                    prop_assert_eq!(reach(&points, &axes)[lane], [low, high]);
                }
            }
        }
    }
}
