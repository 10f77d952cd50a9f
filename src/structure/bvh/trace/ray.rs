//! What a walk needs of a ray, prepared once.

use crate::geom::Shear;
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
pub(super) const UNIT: f32 = 4.0 / 16_777_216.0;

impl LocalRay {
    /// Not valid: misses all.
    pub const NONE: Self =
        Self { org: Vec3::ZERO, dir: Vec3::ZERO, t_min: 0.0, t_max: 0.0, cone: Cone::ZERO };

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
pub(super) fn abs<const N: usize, L: Lanes<N>>(zero: L, v: L) -> L {
    v.max(zero - v)
}

/// What a plane's distance may be off by in box tests, as a part of the greatest magnitude of a coordinate over the
/// direction: the derivation is at [`PreparedRay::new`].
pub(super) const BOX_SLACK: f32 = 64.0 / 16_777_216.0;

/// A ray ready for box and triangle tests.
///
/// A box plane at `p` is met at `p * inv - off`. `off_near` and `off_far` differ by twice the
/// greatest rounding error that the expression can have, so that a box test never misses
/// (the derivation is at [`PreparedRay::new`]).
#[derive(Debug, Clone, Copy)]
pub struct PreparedRay {
    /// The origin.
    pub org: Vec3,
    /// Reciprocal direction; components of less than 1e-18 of the greatest count as that, signed.
    pub inv: [f32; 3],
    /// See the type's comment.
    pub off_near: [f32; 3],
    /// See the type's comment.
    pub off_far: [f32; 3],
    /// For each axis, which of a node's six runs of planes is met first.
    pub near: [usize; 3],
    /// For the triangle test.
    pub shear: Shear,
    /// Least distance of a hit.
    pub t_min: f32,
    /// Magnitudes of the direction.
    pub dir: Vec3,
    /// See [`LocalRay::cone`].
    pub cone: Cone,
}

impl PreparedRay {
    /// Prepares `ray` (valid) for a tree whose coordinates are at most `reach` in magnitude.
    ///
    /// Error of a plane's distance, with `m = max(|org|, reach)`, `h = 2^-24` and the computed
    /// reciprocal `inv`: the grid's products `origin * inv`, `q * (step * inv)` and `org * inv` have a
    /// relative error of at most `3h` each (two roundings, and one of `inv` itself) and magnitudes of at
    /// most `m`, `2m` and `m` times `|inv|`; the two sums add `h` times at most `4m |inv|` each. That
    /// is below `24 h m |inv|`; [`BOX_SLACK`] is 64 h, so that 40 h are left at least: who meets a cell, which is taken larger by
    /// 32 h and rounded by 7 h (`stand_in.rs`), has met the boxes of all above it. It also covers what clamping
    /// a direction component does, and flat boxes met edge-on: there the reciprocal is so large that
    /// the slack exceeds every distance.
    #[inline(always)]
    pub fn new(ray: &LocalRay, reach: f32) -> Self {
        let least = ray.dir.abs().max_element() * 1e-18;
        let magnitude = ray.dir.abs().max(Vec3::splat(least));
        let inv = Vec3::ONE / magnitude.copysign(ray.dir);
        let slack = inv.abs() * ray.org.abs().max(Vec3::splat(reach)) * BOX_SLACK;
        let off = ray.org * inv;
        let negative = inv.is_negative_bitmask() as usize;
        Self {
            org: ray.org,
            inv: inv.to_array(),
            off_near: (off + slack).to_array(),
            off_far: (off - slack).to_array(),
            near: [3 * (negative & 1), 1 + 3 * (negative >> 1 & 1), 2 + 3 * (negative >> 2 & 1)],
            shear: Shear::new(ray.dir),
            t_min: ray.t_min,
            dir: ray.dir.abs(),
            cone: ray.cone,
        }
    }
}
