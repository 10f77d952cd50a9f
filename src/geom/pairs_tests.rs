//! Relations and common points compared with integers: each triangle as linear constraints, the edges of the other
//! clipped by them, and the kind of the hull of all ends.

use super::pairs::{Relation, meeting, relate};
use glam::DVec3;
use std::cmp::Ordering;

type Point = [i128; 3];
type Triangle = [Point; 3];

/// Pseudo-random numbers.
pub(super) struct Random(pub u64);

impl Random {
    pub(super) fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((u128::from(self.0 >> 16) * u128::from(n)) >> 48) as u64
    }

    pub(super) fn unit(&mut self) -> f64 {
        self.below(1 << 40) as f64 / (1u64 << 40) as f64
    }

    fn point(&mut self, size: u64) -> Point {
        [0; 3].map(|_| i128::from(self.below(size)))
    }

    fn triangle(&mut self, size: u64) -> Triangle {
        [0; 3].map(|_| self.point(size))
    }
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Point, b: Point) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn double([a, b, c]: Triangle) -> [DVec3; 3] {
    [a, b, c].map(|p| DVec3::from(p.map(|x| x as f64)))
}

/// The point `p / w` of a rational line; `w` is positive.
#[derive(Clone, Copy, Debug)]
struct Ratio {
    p: Point,
    w: i128,
}

impl Ratio {
    fn order(&self, o: &Ratio) -> Ordering {
        (0..3).map(|i| (self.p[i] * o.w).cmp(&(o.p[i] * self.w))).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
    }

    fn double(&self) -> DVec3 {
        DVec3::from(self.p.map(|x| x as f64 / self.w as f64))
    }
}

/// A linear function `n · x - c`.
#[derive(Clone, Copy)]
struct Linear {
    n: Point,
    c: i128,
}

impl Linear {
    fn new(n: Point, at: Point) -> Self {
        Self { n, c: dot(n, at) }
    }

    fn at(&self, p: Point) -> i128 {
        dot(self.n, p) - self.c
    }

    fn sign(&self, r: &Ratio) -> i128 {
        (dot(self.n, r.p) - self.c * r.w).signum()
    }
}

/// A convex set: where all functions of the first list are zero and those of the second not negative. Those of the
/// second are positive in its relative interior.
struct Set {
    zero: Vec<Linear>,
    positive: Vec<Linear>,
    normal: Option<Linear>,
}

impl Set {
    fn new(t: Triangle) -> Self {
        let n = cross(minus(t[1], t[0]), minus(t[2], t[0]));
        if n != [0; 3] {
            let inward = |i: usize| Linear::new(cross(n, minus(t[(i + 1) % 3], t[i])), t[i]);
            let plane = Linear::new(n, t[0]);
            return Self { zero: vec![plane], positive: [0, 1, 2].map(inward).into(), normal: Some(plane) };
        }
        let (a, b) = (*t.iter().min().unwrap(), *t.iter().max().unwrap());
        let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
        if a == b {
            return Self { zero: axes.map(|n| Linear::new(n, a)).into(), positive: Vec::new(), normal: None };
        }
        let d = minus(b, a);
        let zero = axes.map(|n| Linear::new(cross(d, n), a)).into();
        Self { zero, positive: vec![Linear::new(d, a), Linear::new(d.map(|x| -x), b)], normal: None }
    }

    /// The ends of a part of a segment that is in the set.
    fn clip(&self, p: Point, q: Point) -> Option<[Ratio; 2]> {
        // Places along the segment as fractions with positive denominators.
        let (mut from, mut to) = ((0i128, 1i128), (1i128, 1i128));
        let opposite = |l: &Linear| Linear { n: l.n.map(|x| -x), c: -l.c };
        let both = self.zero.iter().flat_map(|l| [*l, opposite(l)]);
        for l in both.chain(self.positive.iter().copied()) {
            let (start, end) = (l.at(p), l.at(q));
            if start < 0 && end < 0 {
                return None;
            }
            if (start < 0) == (end < 0) {
                continue;
            }
            let at = (start.abs(), start.abs() + end.abs());
            let is_less = |a: (i128, i128), b: (i128, i128)| a.0 * b.1 < b.0 * a.1;
            if start < 0 && is_less(from, at) {
                from = at;
            } else if end < 0 && is_less(at, to) {
                to = at;
            }
            if is_less(to, from) {
                return None;
            }
        }
        let d = minus(q, p);
        let at = |(n, w): (i128, i128)| Ratio { p: [0, 1, 2].map(|i| p[i] * w + d[i] * n), w };
        Some([at(from), at(to)])
    }
}

/// Points whose hull is what two triangles share.
fn common(a: Triangle, b: Triangle) -> Vec<Ratio> {
    let clipped = |t: Triangle, o: Triangle| {
        let set = Set::new(o);
        (0..3).filter_map(move |i| set.clip(t[i], t[(i + 1) % 3])).flatten().collect::<Vec<_>>()
    };
    let mut all = clipped(a, b);
    all.extend(clipped(b, a));
    all.sort_by(Ratio::order);
    all.dedup_by(|p, q| p.order(q).is_eq());
    all
}

fn are_on_line(points: &[Ratio]) -> bool {
    let (first, last) = (points[0], points[points.len() - 1]);
    let from = |q: &Ratio| [0, 1, 2].map(|i| q.p[i] * first.w - first.p[i] * q.w);
    points.iter().all(|q| cross(from(&last), from(q)) == [0; 3])
}

/// The relation by its definition.
fn expected(a: Triangle, b: Triangle, common: &[Ratio]) -> Relation {
    if common.is_empty() {
        return Relation::Apart;
    }
    if !are_on_line(common) {
        return Relation::Coplanar;
    }
    let passes = |t: Triangle, o: Triangle| {
        let set = Set::new(o);
        let Some(plane) = set.normal else { return false };
        let sides = t.map(|p| plane.at(p).signum());
        let is_inside = |l: &Linear| common.iter().any(|p| l.sign(p) > 0);
        sides.contains(&1) && sides.contains(&-1) && set.positive.iter().all(is_inside)
    };
    if passes(a, b) || passes(b, a) {
        return Relation::Crossing;
    }
    let mut shared: Vec<_> = a.iter().filter(|p| b.contains(p)).map(|p| Ratio { p: *p, w: 1 }).collect();
    shared.sort_by(Ratio::order);
    let is_hull = shared.first().is_some_and(|p| p.order(&common[0]).is_eq())
        && shared.last().is_some_and(|p| p.order(&common[common.len() - 1]).is_eq());
    if is_hull { Relation::Adjacent } else { Relation::Touching }
}

fn check(a: Triangle, b: Triangle) -> Relation {
    let common = common(a, b);
    let expected = expected(a, b, &common);
    let (x, y) = (double(a), double(b));
    assert_eq!(relate(&x, &y), expected, "{a:?} {b:?} {common:?}");
    check_meeting(&x, &y, expected, &common);
    expected
}

fn check_meeting(a: &[DVec3; 3], b: &[DVec3; 3], relation: Relation, common: &[Ratio]) {
    let found = meeting(a, b);
    let Some([start, end]) = found else { return assert_eq!(relation, Relation::Apart) };
    let points: Vec<_> = common.iter().map(Ratio::double).collect();
    let size = a.iter().chain(b).fold(0.0f64, |size, p| size.max(p.max_element()));
    let near = |p: DVec3, q: DVec3| (p - q).abs().max_element() <= size * 1.5e-12;
    if relation == Relation::Coplanar {
        let pairs = points.iter().flat_map(|p| points.iter().map(|q| p.distance(*q)));
        let longest = pairs.fold(0.0f64, f64::max);
        assert!((start.distance(end) - longest).abs() <= size * 4e-12, "{a:?} {b:?} {found:?}");
        assert!([start, end].iter().all(|p| points.iter().any(|q| near(*p, *q))), "{a:?} {b:?} {found:?}");
    } else {
        let ends = [points[0], points[points.len() - 1]];
        // Rounded coordinates of a common end order otherwise than exact ones.
        let is_near = near(start, ends[0]) && near(end, ends[1]) || near(start, ends[1]) && near(end, ends[0]);
        assert!(is_near, "{a:?} {b:?} {found:?} {ends:?}");
        assert!(common.len() > 1 || start == end, "{a:?} {b:?} {found:?}");
    }
}

/// On small grids contacts of all kinds are common, also of segments and points.
#[test]
fn relations_are_those_of_integers() {
    let mut random = Random(1);
    for (size, cases) in [(2, 100_000), (3, 400_000), (4, 400_000), (6, 200_000), (9, 200_000), (24, 100_000)] {
        let mut seen = [0; 5];
        for _ in 0..cases {
            seen[check(random.triangle(size), random.triangle(size)) as usize] += 1;
        }
        let least = if size > 4 { [1000, 0, 100, 0, 1000] } else { [1000, 500, 1000, 100, 100] };
        assert!((0..5).all(|i| seen[i] >= least[i]), "{size}: {seen:?}");
    }
}

/// All pairs of triangles of a grid of 2 x 2 x 2 points, degenerate ones too.
#[test]
fn relations_of_all_triangles_of_a_cube() {
    let point = |i: usize| [i & 1, i >> 1 & 1, i >> 2].map(|x| x as i128);
    let all: Vec<Triangle> = (0..512)
        .filter(|i| i & 7 <= i >> 3 & 7 && i >> 3 & 7 <= i >> 6)
        .map(|i| [i & 7, i >> 3 & 7, i >> 6].map(point))
        .collect();
    assert_eq!(all.len(), 120);
    let mut seen = [0; 5];
    for a in &all {
        for b in &all {
            seen[check(*a, *b) as usize] += 1;
        }
    }
    assert_eq!(seen.iter().sum::<i32>(), 120 * 120);
    assert!(seen.iter().all(|&n| n > 0), "{seen:?}");
}

/// Triangles in one plane, turned in space, and triangles with common corners.
#[test]
fn relations_in_a_plane_and_of_neighbours() {
    let mut random = Random(2);
    let mut seen = [0; 5];
    for i in 0..200_000 {
        let (mut a, mut b) = (random.triangle(5), random.triangle(5));
        if i % 2 == 0 {
            let (u, v) = (random.point(4), random.point(4));
            let lift = |p: Point| [0, 1, 2].map(|i| u[i] * p[0] + v[i] * p[1]);
            (a, b) = (a.map(lift), b.map(lift));
        } else {
            b[0] = a[random.below(3) as usize];
            if random.below(2) == 0 {
                b[1] = a[random.below(3) as usize];
            }
        }
        seen[check(a, b) as usize] += 1;
    }
    assert!(seen.iter().all(|&n| n > 2000), "{seen:?}");
}

/// A permutation of the corners, and of the triangles.
fn mixed(random: &mut Random, a: &[DVec3; 3], b: &[DVec3; 3]) -> [[DVec3; 3]; 2] {
    let mut turn = |mut t: [DVec3; 3]| {
        t.rotate_left(random.below(3) as usize);
        if random.below(2) == 0 {
            t.swap(0, 1);
        }
        t
    };
    let (a, b) = (turn(*a), turn(*b));
    if random.below(2) == 0 { [a, b] } else { [b, a] }
}

/// Order changes nothing, not a bit; translations by what is exact and scales by powers of two change no relation.
#[test]
fn relations_keep_under_exchange_and_translation() {
    let mut random = Random(3);
    for i in 0..200_000 {
        let size = [3, 4, 6, 1 << 30][i % 4];
        let (a, b) = (double(random.triangle(size)), double(random.triangle(size)));
        let (relation, ends) = (relate(&a, &b), meeting(&a, &b));
        let [x, y] = mixed(&mut random, &a, &b);
        assert_eq!(relate(&x, &y), relation);
        assert_eq!(
            meeting(&x, &y).map(|e| e.map(|p| p.to_array().map(f64::to_bits))),
            ends.map(|e| e.map(|p| p.to_array().map(f64::to_bits)))
        );
        let by = DVec3::from([0; 3].map(|_| (random.below(1 << 50) as f64) - (1u64 << 49) as f64));
        let scale = 2f64.powi(random.below(600) as i32 - 300);
        let moved = |t: &[DVec3; 3]| t.map(|p| (p + by) * scale);
        assert_eq!(relate(&moved(&a), &moved(&b)), relation, "{a:?} {b:?} {by} {scale:e}");
    }
}

/// The overlap test of Guigue and Devillers by any orientation predicate, for triangles in general position.
pub(super) fn meets_by(a: [DVec3; 3], b: [DVec3; 3], orient: &impl Fn([DVec3; 4]) -> f64) -> bool {
    let sides = |t: [DVec3; 3], o: [DVec3; 3]| t.map(|p| orient([o[0], o[1], o[2], p]));
    let (of_a, of_b) = (sides(a, b), sides(b, a));
    let is_aside = |s: [f64; 3]| s.iter().all(|&x| x > 0.0) || s.iter().all(|&x| x < 0.0);
    if is_aside(of_a) || is_aside(of_b) {
        return false;
    }
    let turned = |t: [DVec3; 3], s: [f64; 3]| {
        let is_alone = |&i: &usize| {
            let [one, next, last] = [0, 1, 2].map(|k| s[(i + k) % 3]);
            next * last > 0.0 || (one != 0.0 && one * next <= 0.0 && one * last <= 0.0)
        };
        let i = (0..3).find(is_alone).unwrap_or(0);
        ([t[i], t[(i + 1) % 3], t[(i + 2) % 3]], s[i] > 0.0 || s[i] == 0.0 && s[(i + 1) % 3] < 0.0)
    };
    let ((mut a, is_a_above), (mut b, is_b_above)) = (turned(a, of_a), turned(b, of_b));
    if !is_a_above {
        b.swap(1, 2);
    }
    if !is_b_above {
        a.swap(1, 2);
    }
    orient([a[0], a[1], b[0], b[1]]) <= 0.0 && orient([a[0], a[2], b[2], b[0]]) <= 0.0
}

fn rounded([a, b, c, d]: [DVec3; 4]) -> f64 {
    (b - a).cross(c - a).dot(d - a)
}

fn in_integers(points: [DVec3; 4]) -> f64 {
    let [a, b, c, d] = points.map(|p| p.to_array().map(|x| x as i128));
    dot(cross(minus(b, a), minus(c, a)), minus(d, a)).signum() as f64
}

/// Slivers beside each other, as at the rims of parts that fit together: doubles call many pairs a hit that have no
/// common point (libigl#2381 is such), and others apart that meet.
#[test]
fn doubles_alone_give_false_hits() {
    let mut random = Random(4);
    let (mut false_hits, mut missed) = (0, 0);
    for i in 0..200_000 {
        let mut far = || DVec3::from([0; 3].map(|_| random.unit() - 0.5)) * 2f64.powi(39);
        let (along, far) = (far(), [far(), far()].map(DVec3::round));
        let mut corner = |place: f64| {
            let off = DVec3::from([0; 3].map(|_| random.below(9) as f64 - 4.0));
            (along * place).round() + off
        };
        let a = [corner(0.0), corner(0.9), corner(0.4)];
        // The other has one corner, two or three at the sliver.
        let b =
            [corner(0.1), if i % 3 > 0 { corner(1.0) } else { far[0] }, if i % 3 > 1 { corner(0.5) } else { far[1] }];
        let (exact, plain) = (meets_by(a, b, &in_integers), meets_by(a, b, &rounded));
        assert_eq!(relate(&a, &b) != Relation::Apart, exact, "{a:?} {b:?}");
        false_hits += i32::from(plain && !exact);
        missed += i32::from(exact && !plain);
    }
    assert!(false_hits > 1000 && missed > 1000, "{false_hits} {missed}");
}

/// Slivers almost in one plane, at 10^7 from zero.
#[test]
fn slivers_far_from_zero_are_exact() {
    let mut random = Random(5);
    let base = DVec3::new(1e7, -1e7, 3e7).round();
    let unit = 2f64.powi(-28);
    let mut seen = [0; 2];
    for _ in 0..100_000 {
        let mut corner = |along: f64| {
            let off = DVec3::from([0; 3].map(|_| random.below(3) as f64 - 1.0)) * unit;
            base + DVec3::new(along, along * 2.0, -along) * 0.5 + off
        };
        let (a, b) = ([corner(0.0), corner(64.0), corner(30.0)], [corner(10.0), corner(80.0), corner(41.0)]);
        let whole = |p: DVec3| (p - base) / unit;
        let (x, y) = (a.map(whole), b.map(whole));
        let is_general = in_integers([x[0], x[1], x[2], y[0]]) != 0.0 && in_integers([y[0], y[1], y[2], x[0]]) != 0.0;
        if is_general {
            let meets = relate(&a, &b) != Relation::Apart;
            assert_eq!(meets, meets_by(x, y, &in_integers), "{a:?} {b:?}");
            seen[usize::from(meets)] += 1;
        }
    }
    assert!(seen.iter().all(|&n| n > 1000), "{seen:?}");
}

/// Neither overflow, nor underflow, nor numbers that are none end in a panic.
#[test]
fn extreme_coordinates_do_not_panic() {
    let mut random = Random(6);
    let odd = [0.0, 1.0, -1.0, 1e150, -1e150, -1e-320, 1e-150, 1e308, f64::INFINITY, f64::NAN];
    for i in 0..200_000 {
        // The first five are in the exact range.
        let kinds = if i % 2 == 0 { 5 } else { 10 };
        let mut triangle = || [0; 3].map(|_| DVec3::from([0; 3].map(|_| odd[random.below(kinds) as usize])));
        let (a, b) = (triangle(), triangle());
        let relation = relate(&a, &b);
        let found = meeting(&a, &b);
        if kinds == 5 {
            assert_eq!(relate(&b, &a), relation);
            assert_eq!(found.is_some(), relation != Relation::Apart, "{a:?} {b:?}");
        }
    }
}
