//! What a walk needs of a ray, prepared once.

use crate::geom::Shear;
use crate::math::Cone;
use crate::structure::ray::LocalRay;
pub(super) use crate::structure::ray::{MAX_DIR, MIN_DIR, abs};
use glam::Vec3;

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
    /// Error of a plane's distance, with `m = max(|org|, reach)`, `h = 2^-24` and the computed reciprocal `inv`: the
    /// grid's products `origin * inv`, `q * (step * inv)` and `org * inv` have a relative error of at most `3h` each
    /// (two roundings, and one of `inv` itself) and magnitudes of at most `m`, `2m` and `m` times `|inv|`; the two sums
    /// add `h` times at most `4m |inv|` each. That is below `24 h m |inv|`; [`BOX_SLACK`] is 64 h, so that 40 h are
    /// left at least: a ray that meets a cell, which is taken larger by 32 h and rounded by 7 h (`stand_in.rs`), has
    /// met the boxes of all above it. It also covers what clamping a direction component does, and flat boxes met
    /// edge-on: there the reciprocal is so large that the slack exceeds every distance.
    #[inline(always)]
    pub fn new(ray: &LocalRay, max_coord: f32) -> Self {
        let least = ray.dir.abs().max_element() * 1e-18;
        let magnitude = ray.dir.abs().max(Vec3::splat(least));
        let inv = Vec3::ONE / magnitude.copysign(ray.dir);
        let slack = inv.abs() * ray.org.abs().max(Vec3::splat(max_coord)) * BOX_SLACK;
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
