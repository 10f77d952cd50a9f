//! The intersection of a ray and a triangle in double precision: distance, weights, and the bounds that a hit promises.
//!
//! **Error.** M is the placed tree's map to the world, s its largest singular value. `position` is origin + t · dir,
//! rounded. [`meet`] finds a point q of the triangle with |M⁻¹ position − q| = `gap`. M q lies on the stored triangle,
//! at most `position_error` from the input's in the world. Some original surface therefore lies within
//!
//! `error` = s · gap + position_error + r, r = l (|origin| + |t dir| + |offset| + s · reach),
//!
//! where reach is the tree's greatest coordinate and r covers rounding in double precision. l is 8 · 2⁻⁵² if M is the
//! identity, else the bound of `measures::loss`. Single precision only chose the triangle; `gap` measures how well.
//!
//! **t_free.** Single precision may have put a nearer surface behind the hit. Walks see ray and triangles displaced by
//! at most 2⁻²³ · 14 reaches, as origins are within 6 reaches; [`Placed::slack`] allows 4 times that, and 2 r more
//! unless M is the identity. It divides by a cosine of 1/64 to the normal: surfaces within 0.9° of edge-on are exempt.

use crate::math::Ray;
use crate::scene::placed::{Placed, not_below};
use glam::{DVec3, Vec3};

/// The intersection of a ray and a triangle, in double precision in the tree's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Meeting {
    /// Distance in units of the world ray's direction.
    pub t: f64,
    /// Weights of the second and third vertex; their point lies in the triangle.
    pub weights: [f64; 2],
    /// Distance from the ray's point at `t` to the triangle's point at `weights`, in the tree's frame.
    pub gap: f64,
}

/// The plane of a triangle in double precision. The corners are single-precision numbers, so edges and their products
/// carry few roundings.
pub(super) struct Plane {
    corner: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
}

impl Meeting {
    /// Bound of the distance from the answered position to original surface, in the world: see the module. `origin` and
    /// `dir` are the ray's.
    #[inline(always)]
    pub fn error(&self, placed: &Placed, origin: DVec3, dir: Vec3) -> f32 {
        let along = dir.as_dvec3() * self.t;
        not_below(placed.stretch * self.gap + placed.position_error + placed.rounding_along(origin, along))
    }

    /// Distance before which no original surface lies on the ray, if it begins before that: see the module.
    #[inline(always)]
    pub fn free(&self, placed: &Placed, origin: DVec3, dir: Vec3) -> f64 {
        self.t - placed.slack(origin, dir, self.t)
    }
}

impl Plane {
    #[inline(always)]
    pub fn new(corners: &[Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(|v| v.as_dvec3());
        let edges = [b - a, c - a];
        Self { corner: a, edges, normal: edges[0].cross(edges[1]) }
    }

    /// Weights of the triangle's point nearest to `p`, and its distance.
    #[inline]
    fn clamped(&self, p: DVec3) -> ([f64; 2], f64) {
        let from = p - self.corner;
        let [u, v] = self.weights_of(from);
        if is_inside([u, v]) { self.at_weights(from, [u, v]) } else { self.on_border(from) }
    }

    /// Weights of the point nearest to `from`, relative to the corner, in the triangle's plane.
    #[inline(always)]
    fn weights_of(&self, from: DVec3) -> [f64; 2] {
        let inverse = 1.0 / self.normal.length_squared();
        let u = from.cross(self.edges[1]).dot(self.normal) * inverse;
        let v = self.edges[0].cross(from).dot(self.normal) * inverse;
        [u, v]
    }

    /// The distance at which a ray meets the plane.
    #[inline(always)]
    fn distance(&self, org: DVec3, dir: DVec3) -> f64 {
        self.normal.dot(self.corner - org) / self.normal.dot(dir)
    }

    /// The intersection of a ray and the plane: distance, weights, and the gap there. True if the point is in the
    /// triangle up to rounding; then [`meet`] returns the same.
    #[inline(always)]
    pub fn through(&self, org: DVec3, dir: DVec3) -> (f64, [f64; 2], f64, bool) {
        let t = self.distance(org, dir);
        let is_finite = t.is_finite();
        let t = t.max(0.0);
        let from = org + dir * t - self.corner;
        let weights = self.weights_of(from);
        let gap = self.at_weights(from, weights).1;
        (t, weights, gap, is_finite & is_inside(weights) & (gap <= rounding(org, dir, t)))
    }

    /// These weights, and the distance of their point to `from`, which is relative to the corner.
    #[inline(always)]
    fn at_weights(&self, from: DVec3, weights: [f64; 2]) -> ([f64; 2], f64) {
        (weights, (from - self.edges[0] * weights[0] - self.edges[1] * weights[1]).length())
    }

    /// The border's point nearest to `from`. Weights clamped to their range would not do: on a sliver their point may
    /// be far from the nearest one.
    #[cold]
    fn on_border(&self, from: DVec3) -> ([f64; 2], f64) {
        let along = |from: DVec3, edge: DVec3| {
            let s = from.dot(edge) / edge.length_squared();
            if s.is_nan() { 0.0 } else { s.clamp(0.0, 1.0) }
        };
        let [ab, ac] = self.edges;
        let s = along(from - ab, ac - ab);
        let three = [[along(from, ab), 0.0], [0.0, along(from, ac)], [1.0 - s, s]];
        let of_three = three.map(|weights| self.at_weights(from, weights));
        let better = |a: ([f64; 2], f64), b: ([f64; 2], f64)| if b.1 < a.1 { b } else { a };
        better(better(of_three[0], of_three[1]), of_three[2])
    }
}

#[inline(always)]
fn is_inside([u, v]: [f64; 2]) -> bool {
    (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
}

/// A gap up to which no other point of the ray is better than one in the plane and within the triangle.
#[inline(always)]
fn rounding(org: DVec3, dir: DVec3, t: f64) -> f64 {
    (org.abs().max_element() + dir.abs().max_element() * t.abs()) * 1e-14
}

/// Intersects a ray and a triangle of the tree's frame again, in double precision. `found` is the distance that the
/// walk found.
///
/// The ray's t is its intersection with the triangle's plane. Nearly edge-on that is ill-conditioned, and the walk's
/// own t, or the t nearest to the triangle's point, may leave a smaller gap: the smallest gap wins. `gap` is thus
/// measured, not estimated. The result does not depend on the ray's interval.
#[inline]
pub(crate) fn meet(placed: &Placed, corners: &[Vec3; 3], ray: &Ray, found: f64) -> Meeting {
    let plane = Plane::new(corners);
    let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
    let at = |t: f64| {
        let t = t.max(0.0);
        let (weights, gap) = plane.clamped(org + dir * t);
        Meeting { t, weights, gap }
    };
    let t = plane.distance(org, dir);
    let best = if t.is_finite() { at(t) } else { at(found) };
    if best.gap <= rounding(org, dir, best.t) { best } else { least_gap(&plane, org, dir, [best, at(found)], at) }
}

/// The distance at which a ray's line meets a triangle that it crosses, before the ray's origin too: that of the
/// triangle's plane, within the span of the corners' distances.
pub(crate) fn distance(placed: &Placed, corners: &[Vec3; 3], ray: &Ray, [least, greatest]: [f64; 2]) -> f64 {
    let plane = Plane::new(corners);
    let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
    // NaN leaves the least.
    plane.distance(org, dir).min(greatest).max(least)
}

/// Weights of the second and the third corner of a triangle's point nearest to `p`; 0 for a triangle without an area
/// whose weights would be NaN.
pub(crate) fn clamped_weights(corners: &[Vec3; 3], p: DVec3) -> [f64; 2] {
    Plane::new(corners).clamped(p).0.map(|weight| if weight.is_nan() { 0.0 } else { weight })
}

/// The better of two intersections, and of a third one at the ray's point nearest to the better one's triangle point.
#[cold]
fn least_gap(plane: &Plane, org: DVec3, dir: DVec3, two: [Meeting; 2], at: impl Fn(f64) -> Meeting) -> Meeting {
    let better = if two[1].gap < two[0].gap { two[1] } else { two[0] };
    let point = plane.corner + plane.edges[0] * better.weights[0] + plane.edges[1] * better.weights[1];
    let nearest = at((point - org).dot(dir) / dir.length_squared());
    if nearest.gap < better.gap { nearest } else { better }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DMat3};

    fn placed(offset: DVec3, linear: DMat3) -> Placed {
        Placed::for_tests(DVec3::ZERO, 2.0, &DAffine3 { matrix3: linear, translation: offset })
    }

    fn corners(v: [[f32; 3]; 3]) -> [Vec3; 3] {
        v.map(Vec3::from)
    }

    #[test]
    fn far_from_zero_the_distance_keeps_its_digits() {
        let offset = DVec3::new(1e7, -2e7, 3e7);
        let p = placed(offset, DMat3::IDENTITY);
        let t = corners([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]);
        let ray = Ray::new(offset + DVec3::new(0.25, 0.25, 4.0), Vec3::new(0.0, 0.0, -1.0));
        let m = meet(&p, &t, &ray, 3.4999);
        assert!((m.t - 3.5).abs() < 1e-8, "{m:?}");
        assert!((m.weights[0] - 0.25).abs() < 1e-8 && m.gap < 1e-8);
    }

    #[test]
    fn outside_a_sliver_the_gap_is_the_true_distance() {
        // Weights clamped to their range gave 3e-4 here, and an error in t of the same size.
        let t = corners([[0.0; 3], [35.0, 0.01, 0.0], [35.0, 0.02, 0.0]]);
        let above = Plane::new(&t).clamped(DVec3::new(20.0, 0.012, 0.0));
        let slope = 0.02f64.atan2(35.0);
        assert!((above.1 - (0.012 - 20.0 * slope.tan()) * slope.cos()).abs() < 1e-9, "{above:?}");
        let behind = Plane::new(&t).clamped(DVec3::new(-3.0, 0.0, 4.0));
        assert_eq!(behind, ([0.0, 0.0], 5.0));
        let beyond = Plane::new(&t).clamped(DVec3::new(36.0, 0.015, 0.0));
        assert!((beyond.1 - 1.0).abs() < 1e-9 && (beyond.0[0] - 0.5).abs() < 1e-3 && (beyond.0[1] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn edge_on_the_gap_stays_small_and_t_sane() {
        // The ray lies in the triangle's plane.
        let p = placed(DVec3::ZERO, DMat3::IDENTITY);
        let t = corners([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let ray = Ray::new(DVec3::new(-1.0, 0.25, 0.0), Vec3::X);
        let m = meet(&p, &t, &ray, 1.25);
        assert!((1.0..=1.75).contains(&m.t) && m.gap < 1e-6, "{m:?}");
        // The ray starts slightly above the plane and is tilted by less than single precision can represent.
        let ray = Ray::new(DVec3::new(-1.0, 0.25, 1e-9), Vec3::new(1.0, 0.0, -1e-12));
        let m = meet(&p, &t, &ray, 1.25);
        assert!((1.0..=1.75).contains(&m.t) && m.gap < 1e-8, "{m:?}");
    }
}
