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
    /// where the surface has no normal. They are the eigenvalues of the second fundamental form in an orthonormal frame
    /// along du: their difference is then a root of squares, exact where both are equal, too.
    pub fn curvatures(&self) -> Option<[f64; 2]> {
        let normal = self.normal();
        let along = self.du.length();
        let across = self.dv.dot(normal.cross(self.du)) / along;
        if normal == DVec3::ZERO || across <= 0.0 {
            return None;
        }
        // dv = slant · du + across · (a unit vector across du).
        let slant = self.dv.dot(self.du) / (along * along);
        let (l, m, n) = (self.duu.dot(normal), self.duv.dot(normal), self.dvv.dot(normal));
        let a = l / (along * along);
        let b = (m - slant * l) / (along * across);
        let c = (n - 2.0 * slant * m + slant * slant * l) / (across * across);
        let (mean, root) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
        Some([mean + root, mean - root])
    }
}
