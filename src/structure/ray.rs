//! Rays in the form that structures take: in the tree's own frame, in single precision.

use crate::math::Cone;
use crate::simd::Lanes;
use glam::Vec3;

/// A ray in a tree's own frame. It has the same `t` as the world ray, so its direction need not be of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalRay {
    /// Origin, relative to the tree's origin.
    pub org: Vec3,
    /// Direction.
    pub dir: Vec3,
    /// Hits before this distance are ignored; at least 0.
    pub t_min: f32,
    /// Hits beyond this distance are ignored.
    pub t_max: f32,
    /// Footprint. A stand-in may replace the content of a cell if the sum of the areas of the cell's faces, each times
    /// the direction's magnitude across that face, is at most the square of `a + b t`. For a unit direction that sum is
    /// the area of the cell's projection.
    pub cone: Cone,
}

/// A direction counts as unit if its squared length differs from 1 by at most this much: four roundings of single
/// precision.
pub(in crate::structure) const UNIT: f32 = 4.0 / 16_777_216.0;

impl LocalRay {
    /// An invalid ray: it misses everything.
    pub const NONE: Self = Self { org: Vec3::ZERO, dir: Vec3::ZERO, t_min: 0.0, t_max: 0.0, cone: Cone::ZERO };

    /// Returns [`LocalRay::cone`] for a ray with footprint `cone` and direction `dir`.
    #[inline(always)]
    pub fn cone_of(cone: Cone, dir: Vec3) -> Cone {
        // The square roots take as long as all other work to take a ray over, and most directions are unit within
        // single precision. Without the roots the width is off by at most a quarter of [`UNIT`], relatively.
        if cone == Cone::ZERO || Self::is_unit(dir) {
            return cone;
        }
        let root = dir.length_squared().sqrt().sqrt();
        Cone { a: cone.a * root, b: cone.b * root }
    }

    /// True if a direction is unit within single precision.
    #[inline(always)]
    pub fn is_unit(dir: Vec3) -> bool {
        (dir.length_squared() - 1.0).abs() <= UNIT
    }

    /// True if the ray can be traced: all numbers but `t_max` are finite, and the direction is not zero.
    #[inline(always)]
    pub fn is_valid(&self) -> bool {
        let size = self.dir.abs().max_element();
        self.org.is_finite()
            && self.dir.is_finite()
            && (MIN_DIR..=MAX_DIR).contains(&size)
            && self.t_min >= 0.0
            && self.t_max >= self.t_min
    }
}

/// Some rays, one column each: the fields of [`LocalRay`].
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct LocalRays<const N: usize> {
    /// Origins, axis by axis.
    pub org: [[f32; N]; 3],
    /// Directions, axis by axis.
    pub dir: [[f32; N]; 3],
    /// Ends of the intervals.
    pub t_min: [f32; N],
    /// See `t_min`.
    pub t_max: [f32; N],
    /// Widths at the origins, and their growth for each unit of distance.
    pub cone: [[f32; N]; 2],
}

impl<const N: usize> LocalRays<N> {
    /// Invalid rays: all miss.
    pub const NONE: Self =
        Self { org: [[0.0; N]; 3], dir: [[0.0; N]; 3], t_min: [0.0; N], t_max: [0.0; N], cone: [[0.0; N]; 2] };

    /// Ray `i`.
    #[inline(always)]
    pub fn one(&self, i: usize) -> LocalRay {
        let at = |rows: &[[f32; N]; 3]| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        let cone = Cone { a: self.cone[0][i], b: self.cone[1][i] };
        LocalRay { org: at(&self.org), dir: at(&self.dir), t_min: self.t_min[i], t_max: self.t_max[i], cone }
    }

    /// Sets ray `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: &LocalRay) {
        for axis in 0..3 {
            (self.org[axis][i], self.dir[axis][i]) = (ray.org[axis], ray.dir[axis]);
        }
        (self.t_min[i], self.t_max[i]) = (ray.t_min, ray.t_max);
        (self.cone[0][i], self.cone[1][i]) = (ray.cone.a, ray.cone.b);
    }
}

/// Smallest and greatest value that the largest component of a traceable direction may have. Outside of this range
/// reciprocals and products leave the range of single precision. Callers scale such rays.
pub const MIN_DIR: f32 = 1e-15;
/// See [`MIN_DIR`].
pub const MAX_DIR: f32 = 1e15;

/// Range of the largest component for directions that need no scaling. In this range all digits of single precision
/// count.
pub const USUAL_DIRS: std::ops::RangeInclusive<f32> = 1e-6..=1e6;

/// Magnitudes of all lanes; `zero` is 0 in each lane.
#[inline(always)]
pub(in crate::structure) fn abs<const N: usize, L: Lanes<N>>(zero: L, v: L) -> L {
    v.max(zero - v)
}

/// Tolerance of box slabs as a part of the greatest magnitude of a coordinate. Rounding needs 7 h (h = 2^-24).
/// Packets test the boxes of triangles with the same tolerance, which needs the rest.
pub(in crate::structure) const SLACK: f32 = 32.0 / 16_777_216.0;

/// Returns the tolerance of a box's planes for a ray with origin coordinate `org` on an axis, signed like the inverse
/// direction `inv`. Callers subtract it from the near planes and add it to the far planes.
#[inline(always)]
pub(in crate::structure) fn slack(org: f32, inv: f32, max_coord: f32) -> f32 {
    (org.abs().max(max_coord) * SLACK).copysign(inv)
}
