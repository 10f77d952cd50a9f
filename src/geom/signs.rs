//! Signs of volumes and areas that points span. They are exact: a filter of rounded arithmetic decides almost all, and
//! adaptive expansions the others (Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
//! Predicates", Discrete & Computational Geometry 18(3), 1997; the crate `robust`).
//!
//! Exact for finite coordinates below 2^500 of which the greatest is at most 2^600 times the least digit of another,
//! also with denormals off. Beyond that a sign may be wrong; nothing panics.

use glam::DVec3;
use robust::{Coord, Coord3D};

/// Bound of the rounding error of a determinant of differences, relative to the sum of the absolute values of its
/// products. Each product passes through at most 8 roundings: three differences, two multiplications, three sums; the
/// sum that the bound is compared with has lost at most as much.
pub(super) const FILTER: f64 = 10.0 * (f64::EPSILON / 2.0);
/// Bound of the error by underflow of a volume: six products of two differences lose at most 2^-1021 each if denormals
/// are off, and are multiplied by differences below 2^501.
pub(super) const TINY: f64 = f64::from_bits((1023 - 500) << 52);
/// The same for an area.
const TINY_AREA: f64 = f64::from_bits((1023 - 1000) << 52);

/// 1, 0 or -1; 0 for NaN.
#[inline(always)]
fn sign(value: f64) -> i32 {
    i32::from(value > 0.0) - i32::from(value < 0.0)
}

/// The plane of a triangle, prepared for the sides of points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    corners: [DVec3; 3],
    /// The cross product of two edges, and the sums of the absolute values of its products.
    pub normal: DVec3,
    pub weight: DVec3,
}

impl Plane {
    #[inline(always)]
    pub fn new(corners: &[DVec3; 3]) -> Self {
        let (u, v) = (corners[1] - corners[0], corners[2] - corners[0]);
        let (first, second) =
            (DVec3::new(u.y * v.z, u.z * v.x, u.x * v.y), DVec3::new(u.z * v.y, u.x * v.z, u.y * v.x));
        Self { corners: *corners, normal: first - second, weight: first.abs() + second.abs() }
    }

    /// The side of the plane on which a point is: 1 where the corners appear counter-clockwise, -1 on the other side, 0
    /// on the plane, and for all points if the corners are on a line.
    #[inline(always)]
    pub fn side(&self, point: DVec3) -> i32 {
        let side = self.certain_side(point);
        if side != 0 { side } else { self.exact_side(point) }
    }

    /// The side if the filter decides, else 0.
    #[inline(always)]
    fn certain_side(&self, point: DVec3) -> i32 {
        let d = point - self.corners[0];
        let volume = self.normal.dot(d);
        let bound = self.weight.dot(d.abs()) * FILTER + TINY;
        i32::from(volume > bound) - i32::from(volume < -bound)
    }

    #[cold]
    #[inline(never)]
    fn exact_sides(&self, points: &[DVec3; 3], mut sides: [i32; 3]) -> [i32; 3] {
        for (side, point) in sides.iter_mut().zip(points) {
            if *side == 0 {
                *side = self.exact_side(*point);
            }
        }
        sides
    }

    #[inline(always)]
    fn exact_side(&self, point: DVec3) -> i32 {
        side_exactly([self.corners[0], self.corners[1], self.corners[2], point])
    }

    /// [`Plane::side`] of three points.
    #[inline(always)]
    pub fn sides(&self, points: &[DVec3; 3]) -> [i32; 3] {
        let [a, b, c] = [points[0] - self.corners[0], points[1] - self.corners[0], points[2] - self.corners[0]];
        let reach = greater(a.abs(), greater(b.abs(), c.abs()));
        let bound = self.weight.dot(reach) * FILTER + TINY;
        let side = |volume: f64| i32::from(volume > bound) - i32::from(volume < -bound);
        // Without branches as long as the filter decides.
        let sides = [side(self.normal.dot(a)), side(self.normal.dot(b)), side(self.normal.dot(c))];
        if sides[0] * sides[1] * sides[2] == 0 { self.exact_sides(points, sides) } else { sides }
    }
}

/// Elementwise. (`DVec3::max` heeds NaN; here the bound is then NaN or infinite.)
#[inline(always)]
fn greater(a: DVec3, b: DVec3) -> DVec3 {
    let pick = |a: f64, b: f64| if a > b { a } else { b };
    DVec3::new(pick(a.x, b.x), pick(a.y, b.y), pick(a.z, b.z))
}

/// The side of the plane through the first three points on which the fourth is, as [`Plane::side`].
#[inline]
pub(super) fn side(points: [DVec3; 4]) -> i32 {
    Plane::new(&[points[0], points[1], points[2]]).side(points[3])
}

#[cold]
#[inline(never)]
fn side_exactly(points: [DVec3; 4]) -> i32 {
    let [a, b, c, d] = points;
    let is_flat = |axis: usize| a[axis] == d[axis] && b[axis] == d[axis] && c[axis] == d[axis];
    // Shared corners and planes across an axis are common.
    if d == a || d == b || d == c || is_flat(0) || is_flat(1) || is_flat(2) {
        return 0;
    }
    let [a, b, c, d] = scaled(points, 300).map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
    -sign(robust::orient3d(a, b, c, d))
}

/// Points times a power of two, so that the greatest coordinate is about 2^`exponent`: products of three neither
/// overflow nor underflow.
fn scaled<const N: usize>(points: [DVec3; N], exponent: i32) -> [DVec3; N] {
    let greatest = points.iter().fold(0.0f64, |greatest, p| greatest.max(p.abs().max_element()));
    let power = (greatest.to_bits() >> 52) as i32 - 1023;
    let factor = 2f64.powi((exponent - power).clamp(-1000, 1000));
    points.map(|p| p * factor)
}

/// The direction in which the projections of three points turn, along an axis: 1 counter-clockwise, -1 clockwise, 0 if
/// they are on a line.
#[inline]
pub(super) fn turn(axis: usize, [a, b, c]: [DVec3; 3]) -> i32 {
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let (first, second) = ((a[x] - c[x]) * (b[y] - c[y]), (a[y] - c[y]) * (b[x] - c[x]));
    let (area, bound) = (first - second, (first.abs() + second.abs()) * FILTER + TINY_AREA);
    if area > bound {
        1
    } else if area < -bound {
        -1
    } else {
        turn_exactly(axis, [a, b, c])
    }
}

#[cold]
#[inline(never)]
fn turn_exactly(axis: usize, points: [DVec3; 3]) -> i32 {
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let [a, b, c] = points.map(|p| [p[x], p[y]]);
    let is_flat = |i: usize| a[i] == c[i] && b[i] == c[i];
    if a == b || b == c || c == a || is_flat(0) || is_flat(1) {
        return 0;
    }
    let flat = points.map(|p| DVec3::new(p[x], p[y], 0.0));
    let [a, b, c] = scaled(flat, 400).map(|p| Coord { x: p.x, y: p.y });
    sign(robust::orient2d(a, b, c))
}

/// An axis along which the projections of the points are not on a line; `None` if the points are.
pub(super) fn open_axis(points: &[DVec3; 3]) -> Option<usize> {
    // The greatest component of the normal first: the filter decides it.
    let normal = Plane::new(points).normal.abs();
    let first = if normal.x >= normal.y && normal.x >= normal.z {
        0
    } else if normal.y >= normal.z {
        1
    } else {
        2
    };
    [first, (first + 1) % 3, (first + 2) % 3].into_iter().find(|&axis| turn(axis, *points) != 0)
}

/// Greatest error of a ratio that needs no expansions.
const RATIO_ERROR: f64 = f64::from_bits((1023 - 41) << 52);

/// `from / (from - to)`: the place between two values of opposite sign at which a linear function is zero. `None` if
/// the bounds of their errors are too great, or one has the wrong sign.
fn place(from: f64, to: f64, error: f64) -> Option<f64> {
    let size = from.abs() + to.abs();
    ((from < 0.0) != (to < 0.0) && error < size * RATIO_ERROR).then(|| from.abs() / size)
}

/// The place between `from` (0) and `to` (1) at which the line through them meets the plane; they are strictly on
/// opposite sides. Error: less than 2^-40.
pub(super) fn place_on_plane(plane: &[DVec3; 3], from: DVec3, to: DVec3) -> f64 {
    let prepared = Plane::new(plane);
    let value = |p: DVec3| prepared.normal.dot(p - plane[0]);
    let weight = |p: DVec3| prepared.weight.dot((p - plane[0]).abs()) * FILTER + TINY;
    place(value(from), value(to), weight(from) + weight(to)).unwrap_or_else(|| {
        let [a, b, c, from, to] = scaled([plane[0], plane[1], plane[2], from, to], 300);
        let (from, to) = (volume([a, b, c, from]), volume([a, b, c, to]));
        from.abs() / (from.abs() + to.abs())
    })
}

/// The same for a line of the plane: the projections of `from` and `to` along an axis are strictly on opposite sides of
/// that of the line.
pub(super) fn place_on_line(axis: usize, line: [DVec3; 2], from: DVec3, to: DVec3) -> f64 {
    // A plane through the line and along the axis. Its normal is the direction of the line, turned.
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let flat = |p: DVec3| DVec3::new(p[x], p[y], 0.0);
    let points = [line[0], line[1], from, to].map(flat);
    let size = points.iter().fold(0.0f64, |size, p| size.max(p.abs().max_element()));
    place_on_plane(&[points[0], points[1], points[0] + DVec3::Z * size], points[2], points[3])
}

/// The volume that four points span, with the sign of [`Plane::side`], to a few roundings of itself.
fn volume([a, b, c, d]: [DVec3; 4]) -> f64 {
    // A difference is the sum of two doubles.
    let row = |p: DVec3| [0, 1, 2].map(|axis| two_difference(p[axis], a[axis]));
    let (u, v, w) = (row(b), row(c), row(d));
    let mut sum = Expansion { terms: [0.0; 192], count: 0 };
    for (axis, u) in u.into_iter().enumerate() {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        sum.add_products(u, v[next], w[last], 1.0);
        sum.add_products(u, v[last], w[next], -1.0);
    }
    sum.terms[..sum.count].iter().sum()
}

/// A sum of doubles that share no digits, by ascending magnitude.
struct Expansion {
    /// A volume has 6 · 8 products of three, of four terms each.
    terms: [f64; 192],
    count: usize,
}

impl Expansion {
    fn add_products(&mut self, a: [f64; 2], b: [f64; 2], c: [f64; 2], factor: f64) {
        for i in 0..8 {
            let (high, low) = two_product(a[i & 1] * factor, b[i >> 1 & 1]);
            for part in [low, high] {
                let (high, low) = two_product(part, c[i >> 2]);
                self.add(low);
                self.add(high);
            }
        }
    }

    fn add(&mut self, value: f64) {
        let (mut rest, mut count) = (value, 0);
        for i in 0..self.count {
            let [sum, error] = two_difference(rest, -self.terms[i]);
            rest = sum;
            if error != 0.0 {
                self.terms[count] = error;
                count += 1;
            }
        }
        if rest != 0.0 {
            self.terms[count] = rest;
            count += 1;
        }
        self.count = count;
    }
}

/// The rounded difference and its error.
fn two_difference(a: f64, b: f64) -> [f64; 2] {
    let difference = a - b;
    let b_virtual = a - difference;
    let a_virtual = difference + b_virtual;
    [difference, (b_virtual - b) + (a - a_virtual)]
}

/// The rounded product and its error; a product below 2^1020 whose digits do not underflow.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    (product, a.mul_add(b, -product))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(p: [i64; 3]) -> DVec3 {
        DVec3::from(p.map(|x| x as f64))
    }

    /// Exact in integers.
    fn volume_of(p: [[i64; 3]; 4]) -> i128 {
        let row = |q: [i64; 3]| [0, 1, 2].map(|i| i128::from(q[i]) - i128::from(p[0][i]));
        let [u, v, w] = [row(p[1]), row(p[2]), row(p[3])];
        u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0])
    }

    fn corner() -> impl Strategy<Value = [i64; 3]> {
        let far = 1i64 << 38;
        prop_oneof![[-2i64..3, -2i64..3, -2i64..3], [-far..far, -far..far, -far..far]]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        /// Volumes of points almost on a plane have the sign that integers have, at any scale.
        #[test]
        fn signs_are_those_of_integers(
            p in [corner(), corner(), corner()], weights in [-3i64..4, -3i64..4], off in [-1i64..2, -1i64..2, -1i64..2],
            scale in -120i32..120,
        ) {
            let part = |k: usize, i: usize| weights[k - 1] * (p[k][i] - p[0][i]);
            let blend = |i: usize| p[0][i] + part(1, i) + part(2, i) + off[i];
            let p = [p[0], p[1], p[2], [0, 1, 2].map(blend)];
            let expected = volume_of(p).signum() as i32;
            let points = p.map(|q| point(q) * 2f64.powi(scale * 4));
            prop_assert_eq!(side(points), expected);
            let exact = volume(p.map(point));
            let relative = (exact - volume_of(p) as f64).abs() / exact.abs().max(1.0);
            prop_assert!(relative < 1e-15, "{} {}", exact, volume_of(p));
            for axis in 0..3 {
                let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
                let d = |q: [i64; 3], i: usize| i128::from(q[i]) - i128::from(p[0][i]);
                let area = d(p[1], x) * d(p[3], y) - d(p[1], y) * d(p[3], x);
                prop_assert_eq!(turn(axis, [points[0], points[1], points[3]]), area.signum() as i32);
            }
        }
    }

    /// Numbers beyond the exact range, infinite or not numbers, give some sign.
    #[test]
    fn nothing_panics() {
        let odd = [0.0, 1e-320, 1e-150, 1.0, 1e150, 1e308, f64::INFINITY, f64::NAN];
        for i in 0..4096usize {
            let at = |k: usize| odd[(i >> (3 * (k % 4))) % 8] * if (i + k).is_multiple_of(3) { -1.0 } else { 1.0 };
            let points = [0, 1, 2, 3].map(|k| DVec3::new(at(k), at(k + 1), at(k + 2)));
            assert!(side(points).abs() <= 1 && turn(0, [points[0], points[1], points[2]]).abs() <= 1);
            let _ = place_on_plane(&[points[0], points[1], points[2]], points[3], points[0]);
        }
    }
}
