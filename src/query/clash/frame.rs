//! The common frame of two placed trees.

use crate::math::DBounds;
use crate::scene::placed::Placed;
use crate::structure::pairs::PairFrame;
use glam::{DAffine3, DVec3};

/// The frames of two placed trees: axes of the world, and an origin near both, so that corners keep their digits far
/// from zero.
pub(in crate::query) struct Frames {
    /// The origin in the world.
    pub origin: DVec3,
    /// The maps from the frames of both trees. Boxes of the first grow.
    pub of: [PairFrame; 2],
}

impl Frames {
    /// `reach`: distance within which pairs are sought.
    pub fn new(placed: [&Placed; 2], reach: f64) -> Self {
        let origin = origin(placed.map(|p| p.bounds), reach);
        let of = |p: &Placed, grown| {
            let frame = p.frame();
            PairFrame::new(DAffine3 { translation: frame.translation - origin, ..frame }, grown)
        };
        Self { origin, of: [of(placed[0], reach), of(placed[1], 0.0)] }
    }
}

/// A point with few digits near where both boxes, which are within `reach` of each other, meet. It does not depend on
/// their order.
fn origin([a, b]: [DBounds; 2], reach: f64) -> DVec3 {
    let (min, max) = (a.min.max(b.min), a.max.min(b.max));
    let middle = (min + max) * 0.5;
    rounded(middle, ((max - min).abs() + reach).max_element())
}

/// A point with few digits near another: up to a sixteenth of `size` away along each axis.
pub(super) fn rounded(p: DVec3, size: f64) -> DVec3 {
    // Sums of powers of two and coordinates in single precision are exact.
    let step = (size.max(f64::MIN_POSITIVE).log2().floor() - 4.0).clamp(-1000.0, 1000.0).exp2();
    let rounded = (p / step).round() * step;
    if rounded.is_finite() { rounded } else { DVec3::ZERO }
}
