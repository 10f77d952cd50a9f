//! The point of a tensor-product surface and its derivatives.

use super::basis::{Basis, Line, MOST, Place};
use crate::geom::surface::SurfacePoint;
use glam::{DVec3, DVec4};

/// A point and derivatives in homogeneous coordinates.
pub(super) struct Homogeneous {
    value: DVec4,
    u: DVec4,
    v: DVec4,
    uu: DVec4,
    uv: DVec4,
    vv: DVec4,
}

impl Homogeneous {
    /// Weighs control points by the basis functions of both directions at a place of each. `net` returns the point with
    /// the local indices i along u and j along v.
    pub(super) fn at(degree: [usize; 2], places: &[Place<'_>; 2], net: impl Fn(usize, usize) -> DVec4) -> Self {
        // Small arrays for the degrees that are usual.
        match degree[0].max(degree[1]) {
            0..=3 => Self::within::<4>(degree, places, net),
            4..=7 => Self::within::<8>(degree, places, net),
            _ => Self::within::<MOST>(degree, places, net),
        }
    }

    fn within<const N: usize>(
        degree: [usize; 2],
        places: &[Place<'_>; 2],
        net: impl Fn(usize, usize) -> DVec4,
    ) -> Self {
        let [along_u, along_v]: [Basis<N>; 2] = [0, 1].map(|axis| Basis::at(degree[axis], &places[axis]));
        let mut lines: [Line<N>; 3] = [[DVec4::ZERO; N]; 3];
        let mut line: Line<N> = [DVec4::ZERO; N];
        for j in 0..=degree[1] {
            for (i, point) in line[..=degree[0]].iter_mut().enumerate() {
                *point = net(i, j);
            }
            for (line, value) in lines.iter_mut().zip(along_u.derivatives(&mut line)) {
                line[j] = value;
            }
        }
        let [value, v, vv] = along_v.derivatives(&mut lines[0]);
        let [u, uv, _] = along_v.derivatives(&mut lines[1]);
        let [uu, ..] = along_v.derivatives(&mut lines[2]);
        Self { value, u, v, uu, uv, vv }
    }

    /// The point of the surface, by the quotient rule (The NURBS Book, equation 4.20).
    pub(super) fn project(&self, origin: DVec3, is_rational: bool) -> SurfacePoint {
        let [at, du, dv, duu, duv, dvv] = [self.value, self.u, self.v, self.uu, self.uv, self.vv].map(DVec4::truncate);
        if !is_rational {
            return SurfacePoint { position: origin + at, du, dv, duu, duv, dvv };
        }
        let over = 1.0 / self.value.w;
        let at = at * over;
        let (wu, wv) = (self.u.w, self.v.w);
        let (du, dv) = ((du - at * wu) * over, (dv - at * wv) * over);
        SurfacePoint {
            position: origin + at,
            du,
            dv,
            duu: (duu - du * (2.0 * wu) - at * self.uu.w) * over,
            duv: (duv - dv * wu - du * wv - at * self.uv.w) * over,
            dvv: (dvv - dv * (2.0 * wv) - at * self.vv.w) * over,
        }
    }
}
