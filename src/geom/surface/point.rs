//! A point of a surface with its derivatives.

use glam::DVec3;

/// A point of a surface with its first and second derivatives by the parameters u and v.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SurfacePoint {
    /// The point.
    pub position: DVec3,
    /// First derivative by u.
    pub du: DVec3,
    /// First derivative by v.
    pub dv: DVec3,
    /// Second derivative by u.
    pub duu: DVec3,
    /// Mixed second derivative.
    pub duv: DVec3,
    /// Second derivative by v.
    pub dvv: DVec3,
}

impl SurfacePoint {
    /// The unit normal along `du × dv`; zero where the derivatives are parallel or zero, as at poles.
    pub fn normal(&self) -> DVec3 {
        self.du.cross(self.dv).normalize_or_zero()
    }

    /// The principal curvatures, the larger one first, positive where the surface bends towards its normal. `None`
    /// where the surface has no normal. They are the roots of `k² − 2Hk + K` with the mean curvature H and the Gaussian
    /// curvature K of the first and second fundamental forms.
    pub fn curvatures(&self) -> Option<[f64; 2]> {
        let normal = self.normal();
        let (e, f, g) = (self.du.length_squared(), self.du.dot(self.dv), self.dv.length_squared());
        let area = e * g - f * f;
        if normal == DVec3::ZERO || area <= 0.0 {
            return None;
        }
        let (l, m, n) = (self.duu.dot(normal), self.duv.dot(normal), self.dvv.dot(normal));
        let mean = (e * n - 2.0 * f * m + g * l) / (2.0 * area);
        let gauss = (l * n - m * m) / area;
        let root = (mean * mean - gauss).max(0.0).sqrt();
        Some([mean + root, mean - root])
    }
}
