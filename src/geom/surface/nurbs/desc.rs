//! The description of a NURBS surface, and its check.

use super::knots::Knots;
use crate::base::error::{Error, Result};
use glam::DVec3;

/// Greatest degree of a surface.
pub const MAX_DEGREE: u32 = 32;
/// Greatest magnitude of coordinates and knots.
pub const MAX_COORDINATE: f64 = 1e30;
/// Least distance of two neighbouring knots that differ.
pub const MIN_SPAN: f64 = 1e-30;
/// Greatest ratio of two weights of a surface.
pub const MAX_WEIGHT_RATIO: f64 = 1e12;

/// A NURBS surface: the tensor product of two B-spline bases, in borrowed arrays.
///
/// Index 0 of a pair is of the direction u, index 1 of v. The surface is defined where both bases sum to 1:
/// `knots[degree]..=knots[count]` in each direction. Clamped, unclamped and periodic surfaces differ only in their
/// knots; a periodic surface repeats its first control points at the end.
#[derive(Debug, Clone, Copy)]
pub struct NurbsDesc<'a> {
    /// Degrees, from 1 to [`MAX_DEGREE`].
    pub degree: [u32; 2],
    /// Numbers of control points in each direction, more than the degree.
    pub counts: [u32; 2],
    /// `counts[0] + degree[0] + 1` knots, not decreasing; at most `degree[0] + 1` of them are equal.
    pub knots_u: &'a [f64],
    /// `counts[1] + degree[1] + 1` knots, not decreasing; at most `degree[1] + 1` of them are equal.
    pub knots_v: &'a [f64],
    /// `counts[0] * counts[1]` control points, in any unit of length: that with the indices i along u and j along v is
    /// `points[i * counts[1] + j]`. They are not multiplied by their weights.
    pub points: &'a [DVec3],
    /// A positive weight of each control point; `None`: all are 1.
    pub weights: Option<&'a [f64]>,
}

impl NurbsDesc<'_> {
    /// First and last parameter of u, and of v, of a valid description. Fails as [`super::Nurbs::new`].
    pub fn domain(&self) -> Result<[[f64; 2]; 2]> {
        Ok(self.check()?.each_ref().map(Knots::domain))
    }

    /// Checks everything that the documentation of the fields says, and returns the knots.
    pub(super) fn check(&self) -> Result<[Knots; 2]> {
        let knots_u = Knots::new("knots_u", self.degree[0], self.counts[0], self.knots_u)?;
        let knots_v = Knots::new("knots_v", self.degree[1], self.counts[1], self.knots_v)?;
        self.check_points()?;
        self.check_weights()?;
        Ok([knots_u, knots_v])
    }

    fn check_points(&self) -> Result<()> {
        let [n, m] = self.counts.map(u64::from);
        if n * m != self.points.len() as u64 {
            return Err(fault("points", format!("{} points, but the counts are {n} × {m}", self.points.len())));
        }
        let is_right = |p: &DVec3| p.abs().max_element() <= MAX_COORDINATE && !p.is_nan();
        match self.points.iter().position(|p| !is_right(p)) {
            Some(i) => {
                Err(fault("points", format!("point {i} is not finite, or a coordinate exceeds {MAX_COORDINATE:e}")))
            }
            None => Ok(()),
        }
    }

    fn check_weights(&self) -> Result<()> {
        let Some(weights) = self.weights else { return Ok(()) };
        if weights.len() != self.points.len() {
            return Err(fault("weights", format!("{} weights of {} points", weights.len(), self.points.len())));
        }
        let is_positive = |w: &f64| *w > 0.0 && *w < f64::INFINITY;
        if let Some(i) = weights.iter().position(|w| !is_positive(w)) {
            return Err(fault("weights", format!("weight {i} is {}, not a positive number", weights[i])));
        }
        let greatest = weights.iter().fold(0.0, |most: f64, &w| most.max(w));
        match weights.iter().position(|&w| w < greatest / MAX_WEIGHT_RATIO) {
            Some(i) => Err(fault("weights", format!("weight {i} is under {MAX_WEIGHT_RATIO:e}-th of the greatest"))),
            None => Ok(()),
        }
    }
}

/// An error of an argument of a surface.
pub(super) fn fault(argument: &str, why: String) -> Error {
    Error::BadArgument(format!("surface: {argument}: {why}"))
}
