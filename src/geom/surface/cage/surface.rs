//! The limit surface of one quad.

use super::super::point::SurfacePoint;
use super::bounds::bounds;
use super::evaluate::evaluate;
use super::plan::Plan;
use crate::base::error::{Error, Result};
use crate::math::DBounds;
use glam::DVec3;
use std::sync::Arc;

/// The limit surface of a quad of a cage: a plan with points.
#[derive(Debug, Clone)]
pub struct QuadSurface {
    plan: Arc<Plan>,
    points: Vec<DVec3>,
}

impl QuadSurface {
    /// The surface of a plan for control points in the neighbourhood's order.
    ///
    /// # Errors
    /// [`Error::BadArgument`] unless there are [`Plan::control_points`] of them.
    pub fn new(plan: Arc<Plan>, control: impl IntoIterator<Item = DVec3>) -> Result<Self> {
        let points = plan.points_for(control)?;
        Ok(QuadSurface { plan, points })
    }

    /// The plan.
    pub fn plan(&self) -> &Arc<Plan> {
        &self.plan
    }

    /// The control points, in the neighbourhood's order.
    pub fn control(&self) -> &[DVec3] {
        &self.points[..self.plan.control_points()]
    }

    /// The point at u, v, which are clamped to 0 to 1 (NaN to 0), with derivatives by u and v.
    ///
    /// Between two bicubic patches and at infinitely sharp edges the second derivatives are those of one side. At an
    /// irregular vertex itself the first derivatives, which grow without bounds towards it or vanish, are replaced by
    /// two vectors that span the tangent plane, of the same orientation; the second ones are zero there.
    pub fn evaluate(&self, u: f64, v: f64) -> SurfacePoint {
        evaluate(&self.plan, |i| self.points[i as usize], u, v)
    }

    /// A box around the part from (i, j) / 2^level to (i + 1, j + 1) / 2^level, and around its evaluated points.
    ///
    /// It is that of the part's Bézier points, and deep at irregular vertices that of the points which subdivision
    /// starts from, wider by [`Plan::rounding`] times the greatest coordinate of a control point. Levels above 30 count
    /// as 30, and parts beyond the quad as its last ones.
    pub fn bounds(&self, level: u32, i: u32, j: u32) -> DBounds {
        bounds(&self.plan, |i| self.points[i as usize], level, i, j)
    }
}

impl Plan {
    /// All points of the plan by its control points.
    pub(super) fn points_for(&self, control: impl IntoIterator<Item = DVec3>) -> Result<Vec<DVec3>> {
        let mut points = Vec::with_capacity(self.points());
        points.extend(control);
        let (given, wanted) = (points.len(), self.control_points());
        if given != wanted {
            return Err(Error::bad_argument(format!("{given} control points for a plan of {wanted}")));
        }
        for i in 0..self.rows.len() {
            points.push(self.rows.point(i, &points));
        }
        Ok(points)
    }
}
