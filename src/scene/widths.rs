//! Widths of rays, and the boxes whose cells are too large to stand in for any of them.

use super::alike::Alike;
use super::beam::Beam;
use crate::lod::LEAST;
use crate::math::{Cone, DBounds, Ray};

/// A bound of the widths of some rays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Width {
    /// The greatest widths at the beginning, and the greatest growth.
    cone: Cone,
    /// The least length of a direction.
    length: f64,
}

/// A factor below the rounding of areas and widths in single precision.
const LESS: f64 = 0.98;

impl Width {
    /// Of rays with unit directions.
    pub fn of_units(cone: Cone) -> Self {
        Self { cone, length: 1.0 }
    }

    /// Of some rays; `alike` holds their common traits.
    #[inline]
    pub fn of(rays: &[Ray], alike: &Alike) -> Self {
        if alike.is_exact() {
            return Self::of_units(Cone::ZERO);
        }
        // NaN and negative widths are those of exact rays.
        let greatest = |all: Cone, ray: &Ray| Cone { a: all.a.max(ray.cone.a), b: all.b.max(ray.cone.b) };
        let cone = rays.iter().fold(Cone::ZERO, greatest);
        let least = rays.iter().fold(f32::INFINITY, |least, ray| least.min(ray.dir.length()));
        Self { cone, length: f64::from(least) }
    }

    /// True if one of the rays of a beam may be as wide as `least` in a box.
    #[inline]
    pub fn may_reach(&self, least: f64, b: &DBounds, beam: &Beam) -> bool {
        if least == f64::INFINITY || self.cone == Cone::ZERO {
            return false;
        }
        let farthest = beam.farthest(b) / self.length;
        let width = f64::from(self.cone.a) + f64::from(self.cone.b) * farthest;
        let is_narrow = width < least;
        !is_narrow
    }
}

/// The least width of rays for which a cell in a box may stand in. (The sum of the areas of a box's faces, each times
/// the component of a unit direction across it, is at least the smallest area.)
pub(super) fn least_width(b: &DBounds) -> f64 {
    let e = b.extent();
    let area = (e.x * e.y).min(e.y * e.z).min(e.z * e.x);
    (area * f64::from(LEAST)).sqrt() * LESS
}
