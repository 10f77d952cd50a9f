//! Rays as structures take them: in a tree's own frame, in single precision.

use crate::math::Cone;
use crate::simd::Lanes;
use glam::Vec3;

/// A ray in a tree's own frame. `t` is shared with the world ray: the direction is not unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalRay {
    /// Where it starts, around the tree's origin.
    pub org: Vec3,
    /// Where it goes.
    pub dir: Vec3,
    /// Hits before this are ignored, >= 0.
    pub t_min: f32,
    /// Hits beyond this are ignored.
    pub t_max: f32,
    /// A cell stands in where the sum of its faces' areas, each times |dir| across it, is at most the square of
    /// `a + b t`. (For a unit direction that sum is the area of its projection.)
    pub cone: Cone,
}

/// Squares of lengths that are this near to 1 are of unit directions: four roundings of single precision.
pub(in crate::structure) const UNIT: f32 = 4.0 / 16_777_216.0;

impl LocalRay {
    /// Not valid: misses all.
    pub const NONE: Self = Self { org: Vec3::ZERO, dir: Vec3::ZERO, t_min: 0.0, t_max: 0.0, cone: Cone::ZERO };

    /// [`LocalRay::cone`] of a ray that is `cone` wide and goes along `dir`.
    #[inline(always)]
    pub fn cone_of(cone: Cone, dir: Vec3) -> Cone {
        // Roots take as long as all else that is done to take a ray over, and most directions are unit as far as single
        // precision goes: what is left out is a quarter of this.
        if cone == Cone::ZERO || Self::is_unit(dir) {
            return cone;
        }
        let root = dir.length_squared().sqrt().sqrt();
        Cone { a: cone.a * root, b: cone.b * root }
    }

    /// Whether a direction is unit as far as single precision goes.
    #[inline(always)]
    pub fn is_unit(dir: Vec3) -> bool {
        (dir.length_squared() - 1.0).abs() <= UNIT
    }

    /// Whether it can be traced: all finite but `t_max`, a direction that is not zero.
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

/// The least and the greatest component of a direction that can be traced: outside of it
/// reciprocals and products leave the range of single precision. Callers scale such rays.
pub const MIN_DIR: f32 = 1e-15;
/// See [`MIN_DIR`].
pub const MAX_DIR: f32 = 1e15;

/// Greatest components of directions that need no scaling: within, all of single precision's digits count.
pub const USUAL_DIRS: std::ops::RangeInclusive<f32> = 1e-6..=1e6;

/// Magnitudes.
#[inline(always)]
pub(in crate::structure) fn abs<const N: usize, L: Lanes<N>>(zero: L, v: L) -> L {
    v.max(zero - v)
}

/// How much larger a cell is taken, as a part of the greatest magnitude of a coordinate: 7 h for rounding (h = 2^-24),
/// the rest for packets, which test the boxes of triangles so too.
pub(in crate::structure) const SLACK: f32 = 32.0 / 16_777_216.0;

/// How far planes give way for a ray with origin `org` along an axis on which it goes as `inv` is signed: what is taken
/// from those that are met first, and added to those that are met last.
#[inline(always)]
pub(in crate::structure) fn slack(org: f32, inv: f32, max_coord: f32) -> f32 {
    (org.abs().max(max_coord) * SLACK).copysign(inv)
}
