//! Distances compared with brute force over all features, in twice double precision.

use super::distances::{Between, distance_bounds, point_triangle, segment_segment, triangle_triangle};
use super::pairs::{Relation, relate};
use super::pairs_tests::Random;
use glam::DVec3;
use std::ops::{Add, Div, Mul, Sub};

/// A number of twice the digits of a double: the sum of two.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
struct Long(f64, f64);

fn sum(a: f64, b: f64) -> Long {
    let s = a + b;
    let t = s - a;
    Long(s, (a - (s - t)) + (b - t))
}

fn product(a: f64, b: f64) -> Long {
    let split = |x: f64| {
        let c = x * 134_217_729.0;
        let high = c - (c - x);
        (high, x - high)
    };
    let (p, (ah, al), (bh, bl)) = (a * b, split(a), split(b));
    Long(p, al * bl - (((p - ah * bh) - al * bh) - ah * bl))
}

impl Add for Long {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        let (s, t) = (sum(self.0, o.0), sum(self.1, o.1));
        let s = sum(s.0, s.1 + t.0);
        sum(s.0, s.1 + t.1)
    }
}

impl Sub for Long {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + Long(-o.0, -o.1)
    }
}

impl Mul for Long {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let p = product(self.0, o.0);
        sum(p.0, p.1 + (self.0 * o.1 + self.1 * o.0))
    }
}

impl Div for Long {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let first = self.0 / o.0;
        let rest = self - o * Long(first, 0.0);
        let second = rest.0 / o.0;
        let rest = rest - o * Long(second, 0.0);
        sum(first, second) + Long(rest.0 / o.0, 0.0)
    }
}

type Vector = [Long; 3];
const ZERO: Long = Long(0.0, 0.0);
const ONE: Long = Long(1.0, 0.0);

fn minus(a: DVec3, b: DVec3) -> Vector {
    [0, 1, 2].map(|i| sum(a[i], -b[i]))
}

fn dot(a: Vector, b: Vector) -> Long {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [1, 2, 0].map(|i| a[i] * b[(i + 1) % 3] - a[(i + 1) % 3] * b[i])
}

/// Squared distance from a point to a segment.
fn to_segment(p: DVec3, a: DVec3, b: DVec3) -> Long {
    let (u, q) = (minus(b, a), minus(p, a));
    let (along, square) = (dot(u, q), dot(u, u));
    if along <= ZERO || square <= ZERO {
        dot(q, q)
    } else if along >= square {
        dot(minus(p, b), minus(p, b))
    } else {
        let n = cross(u, q);
        dot(n, n) / square
    }
}

/// Squared distance of `q` from the plane of `u` and `v`, if the nearest point has coefficients that `is_inside`
/// accepts.
fn to_plane(q: Vector, u: Vector, v: Vector, is_inside: impl Fn(Long, Long) -> bool) -> Option<Long> {
    let n = cross(u, v);
    let square = dot(n, n);
    if square.0 <= dot(u, u).0 * dot(v, v).0 * 1e-50 {
        return None;
    }
    let (first, second) = (dot(cross(q, v), n) / square, dot(cross(u, q), n) / square);
    let height = dot(n, q);
    is_inside(first, second).then(|| height * height / square)
}

fn is_in_triangle(first: Long, second: Long) -> bool {
    first >= ZERO && second >= ZERO && first + second <= ONE
}

fn least(all: impl IntoIterator<Item = Long>) -> f64 {
    let squared = all.into_iter().fold(Long(f64::INFINITY, 0.0), |a, b| if b < a { b } else { a });
    squared.0.max(0.0).sqrt()
}

fn edges(t: &[DVec3; 3]) -> [[DVec3; 2]; 3] {
    [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]
}

fn all_of_point(p: DVec3, t: &[DVec3; 3]) -> Vec<Long> {
    let face = to_plane(minus(p, t[0]), minus(t[1], t[0]), minus(t[2], t[0]), is_in_triangle);
    edges(t).iter().map(|e| to_segment(p, e[0], e[1])).chain(face).collect()
}

fn all_of_segments([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> Vec<Long> {
    let is_inside = |s: Long, t: Long| s >= ZERO && s <= ONE && t >= ZERO && t <= ONE;
    let inside = to_plane(minus(c, a), minus(b, a), minus(c, d), is_inside);
    let ends = [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)];
    ends.into_iter().chain(inside).collect()
}

fn all_of_triangles(a: &[DVec3; 3], b: &[DVec3; 3]) -> Vec<Long> {
    let mut all: Vec<Long> = a.iter().flat_map(|p| all_of_point(*p, b)).collect();
    all.extend(b.iter().flat_map(|p| all_of_point(*p, a)));
    for e in edges(a) {
        all.extend(edges(b).into_iter().flat_map(|f| all_of_segments(e, f)));
    }
    all
}

/// Triangles of all shapes: well-shaped, slivers down to a rounding's width, segments, points, on a grid, almost
/// parallel to each other.
fn pair(random: &mut Random) -> [[DVec3; 3]; 2] {
    let mut vector = |size: f64| DVec3::from([0; 3].map(|_| (random.unit() * 2.0 - 1.0) * size));
    let ends = [vector(1.0), vector(1.0)];
    let loose = [vector(1.0), vector(1.0), vector(1.0), vector(1.0)];
    let off = [vector(1.0), vector(1.0), vector(1.0), vector(1.0)];
    let width = 10f64.powf(-17.0 * random.unit());
    let apart = 10f64.powf(2.0 - 16.0 * random.unit());
    let at = [random.unit(), random.unit()];
    let on = |place: f64| ends[0] + (ends[1] - ends[0]) * place;
    let sliver = [ends[0], on(at[0]) + off[0] * width, ends[1]];
    let mut one = match random.below(6) {
        0 => [ends[0], ends[0], ends[1]],
        1 => [ends[0]; 3],
        2 => [loose[0], loose[1], loose[2]],
        _ => sliver,
    };
    let mut other = match random.below(4) {
        0 => [loose[1], loose[2], loose[3]],
        1 => [on(at[1]) + off[1] * apart, loose[2] * 3.0, loose[3] * 3.0],
        2 => [on(at[1]), on(2.0 - at[0]), on(at[0] * at[1])].map(|p| p + off[2] * width + off[3] * apart),
        _ => [0, 1, 2].map(|i| one[i] + off[i] * apart),
    };
    if random.below(4) == 0 {
        let round = |t: [DVec3; 3]| t.map(|p| (p * 4.0).round());
        (one, other) = (round(one), round(other));
    }
    let scale = 10f64.powf(random.unit() * 40.0 - 20.0);
    let moved = |t: [DVec3; 3]| t.map(|p| p * scale);
    [moved(one), moved(other)]
}

/// The greatest part of a bound that an error reached.
#[derive(Default)]
struct Worst(f64);

impl Worst {
    fn check(&mut self, squared: f64, exact: f64, error: f64) {
        let off = (squared.sqrt() - exact).abs();
        assert!(off <= error, "{:e} {exact:e} {error:e}", squared.sqrt());
        if error > 0.0 {
            self.0 = self.0.max(off / error);
        }
    }
}

fn check_points(found: &Between, a: &[DVec3; 3], b: &[DVec3; 3]) {
    let size = a.iter().chain(b).fold(0.0f64, |size, p| size.max(p.abs().max_element()));
    let slack = found.error + size * 1e-15;
    let [p, q] = found.points;
    assert!((p.distance(q) - found.squared.sqrt()).abs() <= slack);
    assert!(point_triangle(p, a).bounds()[0] <= slack && point_triangle(q, b).bounds()[0] <= slack);
}

#[test]
fn distances_are_within_their_bounds() {
    let mut random = Random(1);
    let mut worst: [Worst; 3] = Default::default();
    let mut zeros = 0;
    for _ in 0..150_000 {
        let [a, b] = pair(&mut random);
        let found = point_triangle(a[0], &b);
        worst[0].check(found.squared, least(all_of_point(a[0], &b)), found.error);
        let slack = found.error + 1e-15 * b.iter().fold(0.0f64, |size, p| size.max(p.abs().max_element()));
        assert!((found.point.distance(a[0]) - found.squared.sqrt()).abs() <= slack);
        let (e, f) = ([a[0], a[1]], [b[0], b[1]]);
        let found = segment_segment(e, f);
        worst[1].check(found.squared, least(all_of_segments(e, f)), found.error);
        check_points(&found, &[a[0], a[0], a[1]], &[b[0], b[0], b[1]]);
        let found = triangle_triangle(&a, &b);
        assert_eq!(found.squared == 0.0, relate(&a, &b) != Relation::Apart);
        if found.squared == 0.0 {
            zeros += 1;
            assert_eq!((found.points[0], found.error), (found.points[1], 0.0));
        } else {
            worst[2].check(found.squared, least(all_of_triangles(&a, &b)), found.error);
        }
        check_points(&found, &a, &b);
        let [low, high] = found.bounds();
        let [least, greatest] = distance_bounds(&a, &b);
        assert!(least == low && high <= greatest * (1.0 + 1e-13));
    }
    // The bounds are not a thousand times too great.
    assert!(zeros > 10_000 && worst.iter().all(|w| w.0 > 0.002), "{zeros} {:?}", worst.map(|w| w.0));
}

/// Each point of a triangle is as far from another as the bounds say.
#[test]
fn greatest_distances_are_at_corners() {
    let mut random = Random(2);
    for _ in 0..3000 {
        let [a, b] = pair(&mut random);
        let [least, greatest] = distance_bounds(&a, &b);
        let mut found = 0.0f64;
        for i in 0..30 {
            let (u, v) = (random.unit(), random.unit());
            let inside = a[0] + (a[1] - a[0]) * u + (a[2] - a[0]) * (v * (1.0 - u));
            let near = point_triangle(if i < 3 { a[i] } else { inside }, &b);
            let [low, high] = near.bounds();
            // The point inside is rounded.
            let slack = near.error + 1e-15 * a[0].abs().max_element();
            assert!(low <= greatest + slack && high >= least - slack);
            found = found.max(high);
        }
        assert!(found * 1.000001 >= greatest, "{found:e} {greatest:e}");
    }
}

/// Not a bit depends on the order of corners or of the triangles.
#[test]
fn distances_do_not_depend_on_order() {
    let mut random = Random(3);
    for _ in 0..30_000 {
        let [a, b] = pair(&mut random);
        let mut mixed = |t: &[DVec3; 3]| {
            let mut t = *t;
            t.rotate_left(random.below(3) as usize);
            t.swap(0, random.below(3) as usize);
            t
        };
        let (x, y) = (mixed(&a), mixed(&b));
        let (found, again, back) = (triangle_triangle(&a, &b), triangle_triangle(&x, &y), triangle_triangle(&y, &x));
        assert_eq!(found, again);
        assert_eq!((found.squared, found.points), (back.squared, [back.points[1], back.points[0]]));
        assert_eq!(point_triangle(a[0], &b), point_triangle(a[0], &y));
        assert_eq!(segment_segment([a[0], a[1]], [b[0], b[1]]), segment_segment([a[1], a[0]], [b[1], b[0]]));
    }
}

/// Closed forms: above a face, beside an edge, beyond a corner, crosswise edges, a point, a segment.
#[test]
fn distances_in_closed_form() {
    let p = DVec3::new;
    let t = [p(0.0, 0.0, 0.0), p(4.0, 0.0, 0.0), p(0.0, 4.0, 0.0)];
    let near = |q: DVec3| (point_triangle(q, &t).squared, point_triangle(q, &t).point);
    assert_eq!(near(p(1.0, 1.0, 3.0)), (9.0, p(1.0, 1.0, 0.0)));
    assert_eq!(near(p(2.0, -3.0, 4.0)), (25.0, p(2.0, 0.0, 0.0)));
    assert_eq!(near(p(3.0, 3.0, 0.0)), (2.0, p(2.0, 2.0, 0.0)));
    assert_eq!(near(p(-2.0, -1.0, 2.0)), (9.0, t[0]));
    assert_eq!(point_triangle(p(1.0, 2.0, 2.0), &[t[0]; 3]).squared, 9.0);
    assert_eq!(point_triangle(p(1.0, 2.0, 2.0), &[t[0], t[1], t[1]]).squared, 8.0);
    let crosswise = segment_segment([p(-1.0, 0.0, 0.0), p(1.0, 0.0, 0.0)], [p(0.0, -1.0, 2.0), p(0.0, 1.0, 2.0)]);
    assert_eq!((crosswise.squared, crosswise.points), (4.0, [DVec3::ZERO, p(0.0, 0.0, 2.0)]));
    let above = t.map(|q| q + p(0.0, 0.0, 0.5));
    assert_eq!(triangle_triangle(&t, &above).squared, 0.25);
    assert_eq!(triangle_triangle(&t, &t).squared, 0.0);
}

#[test]
fn extreme_lengths_do_not_panic() {
    let mut random = Random(4);
    let odd = [0.0, 1.0, 1e150, -1e150, -1e-320, 1e-150, 1e308, f64::INFINITY, f64::NAN];
    for i in 0..100_000 {
        let kinds = if i % 2 == 0 { 4 } else { 9 };
        let mut triangle = || [0; 3].map(|_| DVec3::from([0; 3].map(|_| odd[random.below(kinds) as usize])));
        let (a, b) = (triangle(), triangle());
        let found = triangle_triangle(&a, &b);
        let near = point_triangle(a[0], &b);
        let _ = (segment_segment([a[0], a[1]], [b[0], b[1]]), distance_bounds(&a, &b));
        if kinds == 4 {
            assert_eq!(found.squared == 0.0, relate(&a, &b) != Relation::Apart);
            assert!(near.squared.is_finite() && found.squared.is_finite());
        }
    }
}
