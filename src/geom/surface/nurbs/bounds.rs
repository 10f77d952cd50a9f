//! Boxes around Bézier patches.

use super::bezier::BezierPatch;
use crate::math::DBounds;
use glam::DVec3;

impl BezierPatch {
    /// The box of the control points, wider by [`Self::rounding`] on all sides: it encloses the surface over the
    /// domain of the patch, and each of its evaluated points. The weights are positive, so that each point is a convex
    /// combination of the control points.
    pub fn bounds(&self) -> DBounds {
        let margin = DVec3::splat(self.rounding());
        let corner = |b: DBounds, p: &glam::DVec4| b.with(self.origin + p.truncate() / p.w);
        let tight = self.points.iter().fold(DBounds::EMPTY, corner);
        DBounds { min: tight.min - margin, max: tight.max + margin }
    }

    /// The box of the part of the patch over a rectangle of parameters, which is moved into the domain.
    pub fn bounds_of_part(&self, domain: [[f64; 2]; 2]) -> DBounds {
        self.part(domain).bounds()
    }

    /// Greatest distance along an axis by which rounding has moved the patch from the surface that it was made of,
    /// plus that of an evaluation.
    ///
    /// With the unit u = 2⁻⁵³ and the reach R, the greatest coordinate of a control point around the origin: an
    /// interpolation of homogeneous points errs by at most 6 u R w along an axis, where w is the interpolated weight
    /// (two factors with two roundings each, two products, a sum), and the weight by 6 u w. The quotient of both thus
    /// errs by 12 u R for each interpolation, and an evaluation is as many as both degrees. The last sum, with the
    /// origin, errs by u of its result.
    pub fn rounding(&self) -> f64 {
        let unit = f64::EPSILON * 0.5;
        let interpolations = f64::from(self.steps) + 2.0 * (self.degree[0] + self.degree[1]) as f64 + 2.0;
        16.0 * unit * interpolations * self.reach + 4.0 * unit * (self.origin.abs().max_element() + self.reach)
    }
}
