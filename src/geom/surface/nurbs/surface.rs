//! NURBS surfaces.

use super::desc::NurbsDesc;
use super::knots::Knots;
use super::tensor::Homogeneous;
use crate::base::error::Result;
use crate::base::memory;
use crate::geom::surface::SurfacePoint;
use crate::math::DBounds;
use glam::{DVec3, DVec4};

/// A NURBS surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Nurbs {
    pub(super) knots: [Knots; 2],
    /// Number of control points along v.
    pub(super) columns: usize,
    /// Centre of the box of the control points.
    pub(super) origin: DVec3,
    /// Control points around the origin in homogeneous coordinates; all weights are in (0, 1].
    pub(super) points: Vec<DVec4>,
    /// False if all weights are 1.
    pub(super) is_rational: bool,
    /// Greatest distance of a control point from the origin, along an axis.
    pub(super) reach: f64,
}

impl Nurbs {
    /// Copies a surface. The error names the argument and the index of the first fault: of the degrees, the numbers of
    /// control points and knots, decreasing or too many equal knots, an empty domain, points that are not finite,
    /// weights that are not positive. Fails with [`crate::Error::NoMemory`].
    pub fn new(desc: &NurbsDesc<'_>) -> Result<Self> {
        let knots = desc.check()?;
        let bounds = DBounds::of(desc.points);
        let origin = bounds.min * 0.5 + bounds.max * 0.5;
        let greatest = desc.weights.map_or(1.0, |all| all.iter().fold(0.0, |most: f64, &w| most.max(w)));
        // All weights times one factor describe the same surface; a power of two rounds nothing.
        let scale = power_of_two_above(greatest);
        let reach = (bounds.max - origin).max(origin - bounds.min).max_element();
        let is_rational = desc.weights.is_some_and(|all| all.iter().any(|&w| w != all[0]));
        let mut points = memory::room(desc.points.len(), "the control points of a surface")?;
        points.extend(desc.points.iter().enumerate().map(|(i, &point)| {
            let weight = if is_rational { desc.weights.map_or(1.0, |all| all[i] / scale) } else { 1.0 };
            ((point - origin) * weight).extend(weight)
        }));
        Ok(Self { knots, columns: desc.counts[1] as usize, origin, points, is_rational, reach })
    }

    /// Degrees along u and v.
    pub fn degree(&self) -> [usize; 2] {
        self.knots.each_ref().map(Knots::degree)
    }

    /// First and last parameter of u, and of v.
    pub fn domain(&self) -> [[f64; 2]; 2] {
        self.knots.each_ref().map(Knots::domain)
    }

    /// The point at (u, v) and its derivatives. Parameters outside of the domain are moved to its border; NaN is taken
    /// as the first parameter. At a knot where a derivative jumps, it is that of the span after the knot.
    ///
    /// The relative error of the position in the extent of the surface is a few units in the last place, of a
    /// derivative that of the differences of the control points.
    pub fn evaluate(&self, u: f64, v: f64) -> SurfacePoint {
        let (row, along_u) = self.knots[0].place(self.knots[0].clamp(u));
        let (column, along_v) = self.knots[1].place(self.knots[1].clamp(v));
        let net = |i, j| self.points[(row + i) * self.columns + column + j];
        Homogeneous::at(self.degree(), &[along_u, along_v], net).project(self.origin, self.is_rational)
    }
}

/// The least power of two that is at least `x`, within what keeps quotients by it finite.
fn power_of_two_above(x: f64) -> f64 {
    let exponent = (x.log2().ceil() as i32).clamp(-1000, 1000);
    f64::powi(2.0, exponent)
}
