//! The common frame of two placed trees.

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
        let origin = origin(placed, reach);
        let of = |p: &Placed, grown| {
            let frame = p.frame();
            PairFrame::new(DAffine3 { translation: frame.translation - origin, ..frame }, grown)
        };
        Self { origin, of: [of(placed[0], reach), of(placed[1], 0.0)] }
    }
}

/// The origin of a tree that is only shifted: its corners are then not rounded, nor are those of the other tree if both
/// are of one mesh. Otherwise a point with few digits near where both boxes, which are within `reach` of each other,
/// meet. It does not depend on their order.
fn origin(placed: [&Placed; 2], reach: f64) -> DVec3 {
    match placed.map(Placed::only_shifted) {
        [Some(a), Some(b)] => return if a.to_array() <= b.to_array() { a } else { b },
        [Some(origin), None] | [None, Some(origin)] => return origin,
        [None, None] => {}
    }
    let [a, b] = placed.map(|p| p.bounds);
    let (min, max) = (a.min.max(b.min), a.max.min(b.max));
    rounded((min + max) * 0.5, ((max - min).abs() + reach).max_element())
}

/// A point with few digits near another: up to a sixteenth of `size` away along each axis.
pub(super) fn rounded(p: DVec3, size: f64) -> DVec3 {
    // Sums of powers of two and coordinates in single precision are exact.
    let step = (size.max(f64::MIN_POSITIVE).log2().floor() - 4.0).clamp(-1000.0, 1000.0).exp2();
    let rounded = (p / step).round() * step;
    if rounded.is_finite() { rounded } else { DVec3::ZERO }
}
