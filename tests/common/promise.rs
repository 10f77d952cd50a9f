//! The promise of a hit (design, section 6): some original surface lies within its error.

use super::bvh64::Bvh64;
use glam::DVec3;

/// By how much a hit states more than it is off: its error over the distance of where it is from the nearest surface, a
/// million at most. Where the promise is broken that distance, as far as it was looked for: 1.5 times the error.
pub fn slack(oracle: &Bvh64, position: DVec3, error: f64) -> Result<f64, f64> {
    let truth = oracle.distance(position, error * 1.5);
    if truth <= error { Ok(error / truth.max(error * 1e-6)) } else { Err(truth) }
}
