//! The choice of a mesh's origin, and the triangles that single precision relative to an origin resolves.

use super::batch::Batch;
use super::origin::{self, FAR};
use crate::math::DBounds;
use glam::DVec3;

/// Greatest distance that rounding may move a corner, as a fraction of the triangle's size.
const MOST_MOVED: f64 = 1.0 / 2048.0;

/// Least altitude of a triangle that rounding must not flatten, as a fraction of its size. Thinner triangles may lose
/// their area: they are mostly artefacts of the program that wrote them.
const LEAST_ALTITUDE: f64 = 1.0 / 65536.0;

/// Distance from the origin, in sizes of a triangle, up to which rounding moves no corner by more than half of
/// [`MOST_MOVED`]. It is a power of two.
const NEAR: f64 = 8192.0;

/// Number of samples whose corners are tried as origins.
const CANDIDATES: usize = 64;

/// Greatest extent of a triangle on any axis.
pub fn size(corners: &[DVec3; 3]) -> f64 {
    DBounds::of(corners).extent().max_element()
}

/// Altitude over the longest edge, as a fraction of `size`, to within a factor of two.
fn altitude([a, b, c]: &[DVec3; 3], size: f64) -> f64 {
    ((b - a) / size).cross((c - a) / size).length()
}

/// True if a triangle keeps its shape when its corners are rounded to single precision relative to `origin`, or if it
/// is dropped anyway.
pub fn is_resolved(corners: &[DVec3; 3], origin: DVec3) -> bool {
    let stored = corners.map(|c| (c - origin).as_vec3());
    let moved = corners
        .iter()
        .zip(&stored)
        .fold(0.0f64, |most, (c, s)| most.max((*c - (origin + s.as_dvec3())).abs().max_element()));
    if moved == 0.0 {
        return true;
    }
    // The comparison is false for NaN: such a corner is out of range too.
    let is_in_range = stored.iter().all(|s| s.abs().max_element() <= FAR);
    let size = size(corners);
    if !is_in_range || size == 0.0 {
        return true;
    }
    let altitude = altitude(corners, size);
    let keeps_area = altitude <= LEAST_ALTITUDE || origin::has_area(&stored);
    altitude == 0.0 || (moved <= size * MOST_MOVED && keeps_area)
}

/// True if a triangle keeps its shape relative to `origin` because it is near. (A far one may be exact by chance. The
/// test of its distance is much faster.)
pub fn is_near(corners: &[DVec3; 3], origin: DVec3) -> bool {
    reach(corners, origin) <= NEAR * size(corners) && is_resolved(corners, origin)
}

/// Greatest distance of a corner from `origin` on any axis.
fn reach(corners: &[DVec3; 3], origin: DVec3) -> f64 {
    corners.iter().fold(0.0f64, |far, c| far.max((*c - origin).abs().max_element()))
}

/// Corners of triangles that are evenly distributed over the input.
pub type Samples = Vec<[DVec3; 3]>;

/// Adds one in `step` of the triangles of `batch` that `is_asked_for`, chosen by a hash of their primitive ids, except
/// those that cannot be stored.
pub fn sample(batch: &Batch, step: u32, is_asked_for: impl Fn(&[DVec3; 3]) -> bool, samples: &mut Samples) {
    let picked = (0..batch.prims.len()).filter(|i| batch.prims[*i].wrapping_mul(0x9e37_79b1).is_multiple_of(step));
    let picked = picked.map(|i| batch.positions.triangle(i));
    samples.extend(picked.filter(|t| !origin::is_too_large(t) && is_asked_for(t)));
}

/// Returns the step of decimal positions, such as 0.001 for coordinates with three decimals; `None` if the samples have
/// more than 12 digits, as computed coordinates have.
pub fn decimal_step(samples: &Samples) -> Option<f64> {
    let mut decimals = 0;
    for x in samples.iter().flatten().flat_map(|p| p.to_array()) {
        while !has_decimals(x, decimals)? {
            decimals += 1;
        }
    }
    Some(1.0 / 10f64.powi(decimals))
}

/// True if a number has at most so many decimals; `None` if that many are more than 12 digits.
fn has_decimals(x: f64, decimals: i32) -> Option<bool> {
    let scaled = x * 10f64.powi(decimals);
    // Two roundings: of the number and of the product.
    let is_whole = (scaled - scaled.round()).abs() <= 2.0 * f64::EPSILON * scaled.abs();
    (scaled.abs() < 1e12 && decimals <= 12).then_some(is_whole)
}

/// Number of bits of the samples' sizes, over all samples, that are lost beyond those that [`is_resolved`] allows.
pub fn lost(samples: &Samples, origin: DVec3) -> f64 {
    samples.iter().map(|corners| bits_lost(corners, origin)).sum()
}

fn bits_lost(corners: &[DVec3; 3], origin: DVec3) -> f64 {
    let ratio = reach(corners, origin) / (NEAR * size(corners));
    if ratio > 1.0 { ratio.log2().min(100.0) } else { 0.0 }
}

/// Returns the origin that loses the fewest bits: `middle`, or a point near a sample. Equal ones count in this order.
pub fn best(samples: &Samples, middle: DVec3) -> DVec3 {
    let (mut best, mut least) = (middle, lost(samples, middle));
    for near in candidates(samples, |corners| bits_lost(corners, middle) > 0.0) {
        if least == 0.0 {
            break;
        }
        let lost = lost(samples, near);
        if lost < least {
            (best, least) = (near, lost);
        }
    }
    best
}

/// Points near some of the samples that are `asked_for`, evenly distributed over these. (Over all samples, a mesh that
/// repeats a pattern of large and small triangles could yield large ones only.)
fn candidates(samples: &Samples, asked_for: impl Fn(&[DVec3; 3]) -> bool) -> impl Iterator<Item = DVec3> {
    let asked_for: Vec<DVec3> = samples.iter().filter(|corners| asked_for(corners)).map(rounded).collect();
    let step = asked_for.len().div_ceil(CANDIDATES).max(1);
    asked_for.into_iter().step_by(step).filter(|near| near.is_finite())
}

/// A point near a triangle, with few digits: positions relative to one such point are mostly exact relative to another.
fn rounded(corners: &[DVec3; 3]) -> DVec3 {
    multiple(corners, 16.0)
}

/// The origin of a tree for details like this triangle. It has so few digits that positions up to 2^32 sizes of the
/// triangle away can be exact relative to two such origins.
pub fn near(corners: &[DVec3; 3]) -> DVec3 {
    multiple(corners, 256.0)
}

/// The point nearest to a triangle whose coordinates are multiples of a power of two, about `sizes` times its size.
fn multiple(corners: &[DVec3; 3], sizes: f64) -> DVec3 {
    let step = (sizes * size(corners)).max(f64::MIN_POSITIVE).log2().ceil().exp2();
    (corners[0] / step).round() * step
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A right triangle with legs of `size`.
    fn triangle(at: DVec3, size: f64) -> [DVec3; 3] {
        [at, at + DVec3::X * size, at + DVec3::Y * size]
    }

    #[test]
    fn a_triangle_is_resolved_if_rounding_is_small_beside_it() {
        let at = DVec3::new(512345.678, 5412345.678, 412.345);
        assert!(!is_resolved(&triangle(at, 0.01), DVec3::ZERO));
        assert!(is_resolved(&triangle(at, 0.01), at));
        assert!(is_resolved(&triangle(at, 1000.0), DVec3::ZERO));
        // Integers of 23 bits are exact.
        assert!(is_resolved(&triangle(DVec3::new(512345.0, 5412345.0, 412.0), 1.0), DVec3::ZERO));
        // Triangles that are dropped anyway do not count.
        assert!(is_resolved(&[at; 3], DVec3::ZERO));
        assert!(is_resolved(&[at, at + DVec3::X * 0.001, at + DVec3::X * 0.002], DVec3::ZERO));
        assert!(is_resolved(&triangle(DVec3::splat(1e20), 3.0), DVec3::ZERO));
    }

    #[test]
    fn the_origin_is_where_the_detail_is() {
        let city = DVec3::new(512345.678, 5412345.678, 412.345);
        let house: Samples = (0..40).map(|i| triangle(city + DVec3::X * f64::from(i), 0.3)).collect();
        let stray = triangle(DVec3::ZERO, 0.1);
        let samples: Samples = std::iter::once(stray).chain(house.iter().copied()).collect();
        let origin = best(&samples, city / 2.0);
        assert!(origin.distance(city) < 50.0, "{origin}");
        assert_eq!(lost(&house, origin), 0.0);
        // If the middle loses nothing, it stays.
        let middle = city + DVec3::X * 20.0;
        assert_eq!(best(&house, middle), middle);
    }

    #[test]
    fn decimals_of_samples() {
        let at = |x: f64| [DVec3::new(x, 5412345.678, -0.5); 3];
        assert_eq!(decimal_step(&vec![at(1.0), at(512345.25)]), Some(0.001));
        assert_eq!(decimal_step(&vec![at(1.0), at(0.0625)]), Some(0.0001));
        assert_eq!(decimal_step(&vec![[DVec3::new(3.0, -70.0, 0.0); 3]]), Some(1.0));
        assert_eq!(decimal_step(&vec![at(1.0), at(1.0 / 3.0)]), None);
        assert_eq!(decimal_step(&vec![at(f64::from(0.1f32))]), None);
    }

    #[test]
    fn a_pattern_of_large_and_small_triangles_hides_no_detail() {
        // 130 samples of which every third is small: with steps of three, from the first on, all would be large.
        let city = DVec3::new(512345.678, 5412345.678, 412.345);
        let samples: Samples = (0..130).map(|i| triangle(city, if i % 3 == 2 { 0.001 } else { 4000.0 })).collect();
        assert!(best(&samples, DVec3::ZERO).distance(city) < 1.0);
    }
}
