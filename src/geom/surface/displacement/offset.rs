//! The displaced surface S + h N and its first derivatives.

use crate::geom::surface::SurfacePoint;
use glam::DVec3;

/// The unit normal of a surface and its first derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalFrame {
    /// The unit normal.
    pub normal: DVec3,
    /// Its derivatives by u and v.
    pub derivatives: [DVec3; 2],
}

impl NormalFrame {
    /// The frame at a point, by Weingarten's equations in the form of the quotient rule: the derivative of `n / |n|` is
    /// that of n, without its part along n, over |n|, where `n = du × dv`. `None` where n is zero.
    pub fn of(point: &SurfacePoint) -> Option<Self> {
        let area = point.du.cross(point.dv);
        let normal = point.normal();
        if normal == DVec3::ZERO {
            return None;
        }
        let derivative = |by: DVec3| (by - normal * normal.dot(by)) / area.length();
        let by_u = point.duu.cross(point.dv) + point.du.cross(point.duv);
        let by_v = point.duv.cross(point.dv) + point.du.cross(point.dvv);
        Some(Self { normal, derivatives: [derivative(by_u), derivative(by_v)] })
    }

    /// The frame at a pole, from the limit of the normal and the mean curvature there, positive where the surface bends
    /// towards its normal. It is exact where the curvature is the same in all directions.
    pub fn at_pole(point: &SurfacePoint, normal: DVec3, curvature: f64) -> Self {
        Self { normal, derivatives: [point.du * -curvature, point.dv * -curvature] }
    }
}

/// A point of a displaced surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displaced {
    /// The point.
    pub position: DVec3,
    /// First derivative by u.
    pub du: DVec3,
    /// First derivative by v.
    pub dv: DVec3,
}

impl Displaced {
    /// The unit normal along `du × dv`; zero where there is none.
    pub fn normal(&self) -> DVec3 {
        self.du.cross(self.dv).normalize_or_zero()
    }
}

/// Moves a point along its normal by a height with these derivatives by u and v. A displacement beyond the radius of
/// curvature, inwards, turns the surface inside out: `du × dv` is then opposite to the normal.
pub fn displace(point: &SurfacePoint, frame: &NormalFrame, height: f64, gradient: [f64; 2]) -> Displaced {
    let by = |tangent: DVec3, axis: usize| tangent + frame.normal * gradient[axis] + frame.derivatives[axis] * height;
    Displaced { position: point.position + frame.normal * height, du: by(point.du, 0), dv: by(point.dv, 1) }
}
