//! Distances of points, segments and triangles, with bounds of their rounding errors.
//!
//! A nearest point inside a triangle or inside both segments is a least-squares solution in two unknowns, found by
//! Gram-Schmidt: the second column and the point less their parts along the first, then the point less its part along
//! the rest of the second. That is stable for slivers and almost parallel segments (Björck, "Solving Linear Least
//! Squares Problems by Gram-Schmidt Orthogonalization", BIT 7, 1967).
//!
//! The bound: a column is its computed parts put together again, up to 8 roundings of its length. The residual's parts
//! along the first column and along the rest of the second are zero up to 12 roundings of the greatest length. If
//! these two are not almost parallel, it is the exact residual of corners and a point that differ by at most 50
//! roundings, and so differs in length by no more. If the exact solution for these is outside, the nearest point is on
//! an edge; all edges are tried. If they are almost parallel, the rest is itself at most 16 roundings long: all points
//! are that near to the line of the first column, of which the residual is the way. [`error`] allows 128 roundings of
//! the diagonal of the box of all points.
//!
//! Lengths from 1e-140 to 1e150 keep the bounds. Beyond, results are poor, but nothing panics.

use super::pairs::{in_order, meeting, sorted};
use glam::DVec3;

/// The point of a set that is nearest to a given point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// The point, whose coordinates have errors of a rounding of themselves beside that of the distance.
    pub point: DVec3,
    /// Squared distance.
    pub squared: f64,
    /// Bound of the rounding error of the distance (the root of `squared`).
    pub error: f64,
}

/// The points of two sets that are nearest to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    /// A point of each set, in the order of the arguments.
    pub points: [DVec3; 2],
    /// Squared distance.
    pub squared: f64,
    /// Bound of the rounding error of the distance (the root of `squared`).
    pub error: f64,
}

impl Between {
    /// Bounds of the exact distance.
    pub fn bounds(&self) -> [f64; 2] {
        let distance = self.squared.sqrt();
        [(distance - self.error).max(0.0), distance + self.error]
    }
}

impl Nearest {
    /// Bounds of the exact distance.
    pub fn bounds(&self) -> [f64; 2] {
        let distance = self.squared.sqrt();
        [(distance - self.error).max(0.0), distance + self.error]
    }
}

/// Bound of the rounding errors of distances between sets in the box of all points: 2^-46 of its diagonal.
#[inline]
pub fn error(points: impl IntoIterator<Item = DVec3>) -> f64 {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = points.into_iter().fold(none, |(low, high), p| (low.min(p), high.max(p)));
    (high - low).length() * f64::from_bits((1023 - 46) << 52)
}

/// The point of a segment that is nearest to a point: its place from `a` (0) to `b` (1), and the way from it to the
/// point.
#[inline(always)]
fn on_segment(p: DVec3, a: DVec3, b: DVec3) -> (f64, DVec3) {
    let (u, q) = (b - a, p - a);
    // Without branches; not a number for segments of no length.
    let place = q.dot(u) / u.dot(u);
    let place = if place > 0.0 { place } else { 0.0 };
    let place = if place < 1.0 { place } else { 1.0 };
    (place, q - u * place)
}

/// The plane of two columns, prepared for points nearest to others.
struct Columns {
    u: DVec3,
    /// The part of the second column beside the first, and how often it holds the first.
    v_rest: DVec3,
    v_along: f64,
    /// One over squared lengths.
    u_scale: f64,
    rest_scale: f64,
}

impl Columns {
    /// `u_scale`: one over the squared length of `u`.
    #[inline(always)]
    fn new(u: DVec3, u_scale: f64, v: DVec3) -> Self {
        let v_along = v.dot(u) * u_scale;
        let v_rest = v - u * v_along;
        Self { u, v_rest, v_along, u_scale, rest_scale: 1.0 / v_rest.dot(v_rest) }
    }

    /// The coefficients with which the columns add up to the point nearest to `q`, and the way from that point to `q`.
    /// They are not numbers if the columns are parallel.
    #[inline(always)]
    fn nearest(&self, q: DVec3) -> ([f64; 2], DVec3) {
        let q_along = q.dot(self.u) * self.u_scale;
        let q_rest = q - self.u * q_along;
        let second = q_rest.dot(self.v_rest) * self.rest_scale;
        ([q_along - second * self.v_along, second], q_rest - self.v_rest * second)
    }
}

/// The inside of a triangle, prepared for points nearest to others.
struct Face {
    corner: DVec3,
    sides: [DVec3; 2],
    columns: Columns,
}

impl Face {
    #[inline(always)]
    fn new([a, b, c]: &[DVec3; 3]) -> Self {
        let (u, v) = (*b - *a, *c - *a);
        Self { corner: *a, sides: [u, v], columns: Columns::new(u, 1.0 / u.dot(u), v) }
    }

    /// The point nearest to `p`, and the way from it to `p`; `None` if the nearest point of the plane is outside.
    #[inline(always)]
    fn nearest(&self, p: DVec3) -> Option<(DVec3, DVec3)> {
        let ([first, second], way) = self.columns.nearest(p - self.corner);
        let is_inside = first >= 0.0 && second >= 0.0 && first + second <= 1.0;
        is_inside.then(|| (self.corner + self.sides[0] * first + self.sides[1] * second, way))
    }
}

/// The point of a triangle that is nearest to a point. The triangle may be a segment or a point. The result does not
/// depend on the order of the corners.
#[inline]
pub fn point_triangle(p: DVec3, triangle: &[DVec3; 3]) -> Nearest {
    let t = sorted(triangle);
    let error = error([p, t[0], t[1], t[2]]);
    if let Some((point, way)) = Face::new(&t).nearest(p) {
        return Nearest { point, squared: way.dot(way), error };
    }
    let mut best = Nearest { point: t[0], squared: f64::INFINITY, error };
    for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[0], t[2]]] {
        let (place, way) = on_segment(p, a, b);
        let squared = way.dot(way);
        if squared < best.squared {
            best = Nearest { point: point_at(a, b, place), squared, error };
        }
    }
    best
}

#[inline(always)]
fn point_at(a: DVec3, b: DVec3, place: f64) -> DVec3 {
    if place >= 1.0 { b } else { a + (b - a) * place }
}

/// The points of two segments that are nearest to each other. Segments may be points. The result does not depend on
/// the order of the ends.
pub fn segment_segment(a: [DVec3; 2], b: [DVec3; 2]) -> Between {
    // The second corner of the degenerate triangle is its first end again.
    let (x, y) = (sorted(&[a[0], a[0], a[1]]), sorted(&[b[0], b[0], b[1]]));
    let (first, second) = in_order(&x, &y);
    let is_kept = first == x;
    let mut best = Best::new();
    best.inside([first[0], first[2]], &[[second[0], second[2]]]);
    best.ends(&[first[0], first[2]], &[[second[0], second[2]]], false);
    best.ends(&[second[0], second[2]], &[[first[0], first[2]]], true);
    best.between(error(first.into_iter().chain(second)), is_kept)
}

/// The points of two triangles that are nearest to each other; triangles may be segments or points. The squared
/// distance is 0 if and only if they have a common point, which exact signs decide; both points are then that of
/// [`meeting`], and the error is 0. The result does not depend on any order, except that of the points.
pub fn triangle_triangle(a: &[DVec3; 3], b: &[DVec3; 3]) -> Between {
    match meeting(a, b) {
        Some([point, _]) => Between { points: [point; 2], squared: 0.0, error: 0.0 },
        None => apart_triangles(a, b),
    }
}

/// [`triangle_triangle`] for triangles that are known to be apart.
pub fn apart_triangles(a: &[DVec3; 3], b: &[DVec3; 3]) -> Between {
    let (first, second) = in_order(a, b);
    let is_kept = first == sorted(a);
    let mut best = Best::new();
    let edges = |t: &[DVec3; 3]| [[t[0], t[1]], [t[1], t[2]], [t[0], t[2]]];
    let (of_first, of_second) = (edges(&first), edges(&second));
    best.ends(&first, &of_second, false);
    best.ends(&second, &of_first, true);
    best.face(&first, &Face::new(&second), false);
    best.face(&second, &Face::new(&first), true);
    for edge in of_first {
        best.inside(edge, &of_second);
    }
    // Rounding may find no distance where there is some.
    best.squared = best.squared.max(f64::MIN_POSITIVE);
    best.between(error(first.into_iter().chain(second)), is_kept)
}

/// The nearest points found so far.
struct Best {
    points: [DVec3; 2],
    squared: f64,
}

impl Best {
    fn new() -> Self {
        Self { points: [DVec3::ZERO; 2], squared: f64::INFINITY }
    }

    /// A point of one set, its nearest of the other, and the way between them. `is_second`: the set is the second.
    #[inline(always)]
    fn offer(&mut self, way: DVec3, is_second: bool, points: impl FnOnce() -> [DVec3; 2]) {
        let squared = way.dot(way);
        if squared < self.squared {
            let [own, other] = points();
            *self = Self { points: if is_second { [other, own] } else { [own, other] }, squared };
        }
    }

    /// Corners of a set and edges of the other.
    #[inline(always)]
    fn ends(&mut self, corners: &[DVec3], edges: &[[DVec3; 2]], is_second: bool) {
        for p in corners {
            for [a, b] in edges {
                let (place, way) = on_segment(*p, *a, *b);
                self.offer(way, is_second, || [*p, point_at(*a, *b, place)]);
            }
        }
    }

    /// Corners of a set and the inside of the other.
    #[inline(always)]
    fn face(&mut self, corners: &[DVec3; 3], face: &Face, is_second: bool) {
        for p in corners {
            if let Some((point, way)) = face.nearest(*p) {
                self.offer(way, is_second, || [*p, point]);
            }
        }
    }

    /// The insides of an edge and of edges of the other set.
    #[inline(always)]
    fn inside(&mut self, [a, b]: [DVec3; 2], others: &[[DVec3; 2]]) {
        let u = b - a;
        let u_scale = 1.0 / u.dot(u);
        for [c, d] in others {
            let v = *d - *c;
            let ([along, back], way) = Columns::new(u, u_scale, v).nearest(*c - a);
            if (0.0..=1.0).contains(&along) && (-1.0..=0.0).contains(&back) {
                self.offer(way, false, || [a + u * along, *c - v * back]);
            }
        }
    }

    fn between(self, error: f64, is_kept: bool) -> Between {
        let [first, second] = self.points;
        Between { points: if is_kept { [first, second] } else { [second, first] }, squared: self.squared, error }
    }
}

/// Bounds of the distances from the points of `a` to `to`: below the least, and above the greatest. The distance to a
/// convex set is a convex function, so the greatest is at a corner.
pub fn distance_bounds(a: &[DVec3; 3], to: &[DVec3; 3]) -> [f64; 2] {
    let greatest = a.iter().map(|&p| point_triangle(p, to).bounds()[1]).fold(0.0, f64::max);
    [triangle_triangle(a, to).bounds()[0], greatest]
}
