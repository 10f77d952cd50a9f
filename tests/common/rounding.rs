//! How far single precision may move an answer.
//!
//! The model is the watertight test of Woop, Benthin, Wald ("Watertight Ray/Triangle Intersection",
//! JCGT 2(1), 2013) in f32 without fused multiply-add, u = 2^-24, in the frame of the stored
//! vertices. With M the largest coordinate of a corner relative to the ray's origin:
//!
//! - **Corners.** `v - org` is rounded (u M), the shear constant is rounded (u), multiplied (u) and
//!   applied to a rounded depth (u), and the sheared coordinate is rounded (u |x|, |x| <= 2 M): each
//!   of the two sheared coordinates is within 6 u M of the true one to first order, so the corner is
//!   within 6 sqrt(2) u M of its true place in the plane of [`Seen`]. Every triangle with that corner
//!   sees the same moved corner.
//! - **Edges.** Rounding is monotone, so the difference of two rounded products has the right sign
//!   or is zero, and zero is decided in double precision: given the moved corners, which side of an
//!   edge the ray passes is *exact*. Hence f32 answers exactly for a mesh whose corners moved by at most
//!   [`shift`]: triangles farther from the ray cannot be hit, triangles entered deeper cannot be lost.
//! - **Distance.** See [`Seen::t_bound`].
//!
//! None of these numbers is tuned; they grow with the coordinates and with nothing else.

use super::brute::{Ray64, Tri};
use glam::{DVec2, DVec3};

/// Unit roundoff of f32.
pub const U: f64 = 1.0 / (1u64 << 24) as f64;

/// What else was rounded before the triangle test began, in u.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounding {
    /// The origin was rounded to f32 in the vertices' frame: u times this times its largest coordinate.
    pub origin: f64,
    /// The direction was rounded: u times this times the distance.
    pub direction: f64,
    /// A further shift in world units (for instance stored vertices against the caller's), absolute.
    pub absolute: f64,
    /// Factor to what is not absolute: sqrt(3) times the ratio of an instance's largest to its smallest singular
    /// value, where vertices were stored and rounded in another frame than the oracle's.
    pub stretch: f64,
}

impl Rounding {
    /// The ray is given in f32 in the vertices' own frame: nothing was rounded.
    pub const NONE: Self = Self { origin: 0.0, direction: 0.0, absolute: 0.0, stretch: 1.0 };
    /// A world ray brought into the vertices' frame: origin and direction rounded once per coordinate
    /// (sqrt(3) of the largest coordinate's error at most).
    pub const LOCALISED: Self = Self { origin: 1.7321, direction: 1.7321, absolute: 0.0, stretch: 1.0 };
}

/// How far a corner may have moved as seen along `ray`, in world units.
pub fn shift(ray: &Ray64, tri: &Tri, r: Rounding) -> f64 {
    let m = tri.iter().map(|v| (*v - ray.org).abs().max_element()).fold(0.0, f64::max);
    let org = ray.org.abs().max_element();
    // Underflow: products below the least normal f32 lose all digits, so a floor of its square root.
    let relative = 6.0 * std::f64::consts::SQRT_2 * U * m + r.origin * U * org + r.direction * U * m;
    r.stretch * relative + r.absolute + 1e-22
}

/// A triangle as the ray sees it: moved along the ray onto the plane through the origin across the axis of the
/// direction's greatest component. This is the frame of the watertight test, in double precision; lengths in it are
/// at least those across the ray, and at most sqrt(3) times as long.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Corners in that plane; the ray is at zero.
    pub p: [DVec2; 3],
    /// How far along the ray each corner was moved back, in world units.
    pub z: [f64; 3],
    /// 1 / |dir|: world units to units of `t`.
    pub t_per_unit: f64,
}

impl Seen {
    pub fn new(ray: &Ray64, tri: &Tri) -> Self {
        let d = ray.dir;
        let k = d.abs().max_position();
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (sx, sy) = (d[i] / d[k], d[j] / d[k]);
        // Scaled first: the square of a tiny or huge direction would under- or overflow.
        let length = (d / d[k]).length() * d[k].abs();
        let per_axis = length / d[k];
        let rel = tri.map(|v| v - ray.org);
        Self {
            p: rel.map(|v| DVec2::new(v[i] - sx * v[k], v[j] - sy * v[k])),
            z: rel.map(|v| v[k] * per_axis),
            t_per_unit: 1.0 / length,
        }
    }

    /// Distance of the ray to the nearest edge: positive inside the triangle, negative outside.
    pub fn depth(&self) -> f64 {
        let nearest = (0..3).map(|i| self.edge_distance(i)).fold(f64::INFINITY, f64::min);
        if self.covers() { nearest } else { -nearest }
    }

    /// Whether the ray's line passes through the triangle, borders included (also when seen edge-on).
    pub fn covers(&self) -> bool {
        let [a, b, c] = self.p;
        let s = [a.perp_dot(b), b.perp_dot(c), c.perp_dot(a)];
        s.iter().all(|&x| x >= 0.0) || s.iter().all(|&x| x <= 0.0)
    }

    /// Distance of the ray to the edge from corner `i` to the next, as seen along the ray.
    pub fn edge_distance(&self, i: usize) -> f64 {
        segment_distance(self.p[i], self.p[(i + 1) % 3])
    }

    /// Least and greatest depth of the corners, in units of `t`.
    pub fn t_range(&self) -> (f64, f64) {
        let (lo, hi) = self.depths();
        (lo * self.t_per_unit, hi * self.t_per_unit)
    }

    fn depths(&self) -> (f64, f64) {
        let [a, b, c] = self.z;
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// How far the `t` of a hit on this triangle may be from the truth (in units of `t`), `moved` being
    /// [`shift`]. In world units,
    ///
    /// ```text
    /// moved (1 + tan) + sum_i 3 u |p_j'| |p_k'| (z_far - z_near) / det' + 8 u max|z|
    /// ```
    ///
    /// The first term moves the corners (`tan`: of the angle between ray and normal; the plane through moved corners
    /// differs from the old one by at most this at each of them, so between them too). The second is the rounding of
    /// the three edge functions as weights, `p'` and `det'` being the largest and smallest that moved corners
    /// can have; the third of the weighted mean and its quotient. Weights of one sign cannot leave the range of the
    /// corners' depths, which caps the sum: an edge-on triangle may answer with any of its depths.
    pub fn t_bound(&self, moved: f64) -> f64 {
        let [a, b, c] = self.p;
        let (ab, ac, bc) = (b - a, c - a, c - b);
        let det = ab.perp_dot(ac).abs();
        let det_least = det - moved * (ab.length() + ac.length() + bc.length()) - 4.0 * moved * moved;
        let z_max = self.z.iter().map(|z| z.abs()).fold(0.0, f64::max);
        let (lo, hi) = self.depths();
        let cap = hi - lo + 2.0 * moved;
        // Gradient of depth across the ray.
        let (zb, zc) = (self.z[1] - self.z[0], self.z[2] - self.z[0]);
        let grad = DVec2::new(zb * ac.y - zc * ab.y, zc * ab.x - zb * ac.x) / det;
        let far = self.p.map(|p| p.length() + moved);
        let weights: f64 =
            (0..3).map(|i| far[(i + 1) % 3] * far[(i + 2) % 3]).sum::<f64>() * 3.0 * U * (hi - lo) / det_least;
        let sum = if det_least > 0.0 { moved * (1.0 + grad.length()) + weights } else { cap };
        (sum.min(cap) + 8.0 * U * z_max) * self.t_per_unit
    }
}

/// Distance of the origin to the segment `ab`.
pub fn segment_distance(a: DVec2, b: DVec2) -> f64 {
    let ab = b - a;
    let len2 = ab.length_squared();
    let s = if len2 > 0.0 { (-a.dot(ab) / len2).clamp(0.0, 1.0) } else { 0.0 };
    // Across the middle of a long edge the cross product is the more exact.
    if s > 0.0 && s < 1.0 { a.perp_dot(b).abs() / len2.sqrt() } else { (a + ab * s).length() }
}

/// Distance of `p` to the triangle, in world units: never less than it is but for roundings of coordinates, for it is
/// that to a point of the triangle. (A plane's normal is not that good: of a sliver it is off by as many roundings as
/// the sliver is longer than wide.)
pub fn point_distance(p: DVec3, tri: &Tri) -> f64 {
    let [a, b, c] = *tri;
    let seg = |x: DVec3, y: DVec3| {
        let xy = y - x;
        let l2 = xy.length_squared();
        let s = if l2 > 0.0 { ((p - x).dot(xy) / l2).clamp(0.0, 1.0) } else { 0.0 };
        ((p - x) - xy * s).length()
    };
    seg(a, b).min(seg(b, c)).min(seg(c, a)).min(plane_distance(p - a, b - a, c - a))
}

/// Distance of `p` to the point of a triangle with a corner at zero that is beneath it, or to one near that.
fn plane_distance(p: DVec3, b: DVec3, c: DVec3) -> f64 {
    let n = b.cross(c);
    let n2 = n.length_squared();
    if n2 <= 0.0 {
        return p.length();
    }
    let (mut u, mut v) = (0.0, 0.0);
    // The first step's rest is short, so the second's roundings are.
    for _ in 0..2 {
        let rest = p - b * u - c * v;
        u = (u + rest.cross(c).dot(n) / n2).clamp(0.0, 1.0);
        v = (v + b.cross(rest).dot(n) / n2).clamp(0.0, 1.0 - u);
    }
    (p - b * u - c * v).length()
}
