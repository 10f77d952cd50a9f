//! A ray prepared for walks.

use super::ray::LocalRay;
use crate::geom::Shear;
use crate::math::Cone;
use glam::Vec3;

/// Bound of the error of a plane's distance in box tests, as a fraction of the greatest magnitude of a coordinate over
/// the direction. [`PreparedRay::new`] has the derivation.
pub(in crate::structure) const BOX_SLACK: f32 = 64.0 / 16_777_216.0;

/// A ray prepared for box and triangle tests.
///
/// The distance of a box plane at `p` is `p * inv - off`. The difference of `off_near` and `off_far` is at least twice
/// the greatest rounding error of that expression, so a box test never misses ([`PreparedRay::new`] has the
/// derivation).
#[derive(Debug, Clone, Copy)]
pub struct PreparedRay {
    /// The origin.
    pub org: Vec3,
    /// Reciprocal direction. A component below 1e-18 of the greatest is raised to that magnitude and keeps its sign.
    pub inv: [f32; 3],
    /// Offset of near planes, see the comment of the type.
    pub off_near: [f32; 3],
    /// Offset of far planes, see the comment of the type.
    pub off_far: [f32; 3],
    /// For each axis, the row of planes (least x, y, z, then greatest) that the ray reaches first.
    pub near: [usize; 3],
    /// Axis order and shear for the triangle test.
    pub shear: Shear,
    /// Least distance of a hit.
    pub t_min: f32,
    /// Magnitudes of the direction.
    pub dir: Vec3,
    /// Width of the ray, see [`LocalRay::cone`].
    pub cone: Cone,
}

impl PreparedRay {
    /// Prepares a valid `ray` for a tree with coordinates of at most `max_coord` in magnitude.
    ///
    /// Error of a plane's distance, with `m = max(|org|, max_coord)`, `h = 2^-24` and the computed reciprocal `inv`:
    /// the products `origin * inv`, `q * (step * inv)` and `org * inv` have a relative error of at most `3h` each (two
    /// roundings, and one of `inv` itself). Their magnitudes are at most `m`, `2m` and `m` times `|inv|`. The two sums
    /// add `h` times at most `4m |inv|` each. The total is below `24 h m |inv|`. [`BOX_SLACK`] is `64 h`, so at least
    /// `40 h` are left: the cell of a stand-in is enlarged by `32 h` and rounded by `7 h` (`stand_in.rs`), so a ray
    /// that enters a cell also enters the boxes of all nodes above it. The slack also covers the effect of clamping a
    /// direction component, and flat boxes hit edge-on: their reciprocal is so large that the slack exceeds every
    /// distance.
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
