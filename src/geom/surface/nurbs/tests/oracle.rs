//! The definition of B-splines, in doubled precision: sums over all control points, basis functions and their
//! derivatives by the recursions that define them.

use super::{Owned, Rng, parameter};
use crate::geom::surface::SurfacePoint;
use glam::DVec3;

/// A number of about 106 bits: the sum of two doubles (Dekker, Numerische Mathematik 18, 1971).
#[derive(Clone, Copy)]
struct Long(f64, f64);

impl Long {
    const ZERO: Self = Self(0.0, 0.0);

    fn sum(a: f64, b: f64) -> Self {
        let s = a + b;
        let t = s - a;
        Self(s, (a - (s - t)) + (b - t))
    }
    fn plus(self, o: Self) -> Self {
        let s = Self::sum(self.0, o.0);
        Self::sum(s.0, s.1 + self.1 + o.1)
    }
    fn minus(self, o: Self) -> Self {
        self.plus(Self(-o.0, -o.1))
    }
    fn times(self, o: Self) -> Self {
        let p = self.0 * o.0;
        let rest = self.0.mul_add(o.0, -p);
        Self::sum(p, rest + self.0 * o.1 + self.1 * o.0)
    }
    fn over(self, o: Self) -> Self {
        let q = self.0 / o.0;
        let rest = self.minus(o.times(Self(q, 0.0)));
        let more = rest.0 / o.0;
        let rest = rest.minus(o.times(Self(more, 0.0)));
        Self::sum(q, more).plus(Self(rest.0 / o.0, 0.0))
    }
}

/// A knot vector with the end of its domain, which belongs to the last span.
struct Basis<'a> {
    knots: &'a [f64],
    last: f64,
}

impl Basis<'_> {
    /// The derivative of an order of basis function `i` of a degree at `t`; quotients by an empty support are 0.
    fn value(&self, i: usize, degree: usize, order: usize, t: f64) -> Long {
        let k = self.knots;
        if degree == 0 {
            let is_in = if t == self.last { k[i] < t && t <= k[i + 1] } else { k[i] <= t && t < k[i + 1] };
            return Long(f64::from(u8::from(is_in && order == 0)), 0.0);
        }
        let span = |a: usize, b: usize| Long::sum(k[b], -k[a]);
        let part = |i: usize, factor: Long| {
            let width = span(i, i + degree);
            let order = order.saturating_sub(1);
            if width.0 == 0.0 { Long::ZERO } else { self.value(i, degree - 1, order, t).times(factor).over(width) }
        };
        if order > 0 {
            let p = Long(degree as f64, 0.0);
            return part(i, p).minus(part(i + 1, p));
        }
        part(i, Long::sum(t, -k[i])).plus(part(i + 1, Long::sum(k[i + degree + 1], -t)))
    }
}

/// The derivatives of the homogeneous point of orders (0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2).
fn homogeneous(surface: &Owned, at: [f64; 2]) -> [[Long; 4]; 6] {
    let tables = [0, 1].map(|axis| {
        let (knots, n, p) = (&surface.knots[axis], surface.counts[axis] as usize, surface.degree[axis] as usize);
        let basis = Basis { knots, last: knots[n] };
        [0, 1, 2].map(|order| (0..n).map(|i| basis.value(i, p, order, at[axis])).collect::<Vec<_>>())
    });
    [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)].map(|(du, dv)| {
        let mut sum = [Long::ZERO; 4];
        for (i, point) in surface.points.iter().enumerate() {
            let columns = surface.counts[1] as usize;
            let weight = Long(surface.weights.as_ref().map_or(1.0, |w| w[i]), 0.0);
            let share = tables[0][du][i / columns].times(tables[1][dv][i % columns]).times(weight);
            let point = [point.x, point.y, point.z, 1.0];
            (0..4).for_each(|c| sum[c] = sum[c].plus(share.times(Long(point[c], 0.0))));
        }
        sum
    })
}

/// A component of the point and its derivatives, by the quotient rule.
fn component([a, au, av, auu, auv, avv]: [Long; 6], [w, wu, wv, wuu, wuv, wvv]: [Long; 6]) -> [f64; 6] {
    let two = Long(2.0, 0.0);
    let s = a.over(w);
    let su = au.minus(s.times(wu)).over(w);
    let sv = av.minus(s.times(wv)).over(w);
    let suu = auu.minus(su.times(wu).times(two)).minus(s.times(wuu)).over(w);
    let suv = auv.minus(su.times(wv)).minus(sv.times(wu)).minus(s.times(wuv)).over(w);
    let svv = avv.minus(sv.times(wv).times(two)).minus(s.times(wvv)).over(w);
    [s, su, sv, suu, suv, svv].map(|long| long.0)
}

fn by_definition(surface: &Owned, at: [f64; 2]) -> SurfacePoint {
    let all = homogeneous(surface, at);
    let [x, y, z] = [0, 1, 2].map(|c| component(all.map(|d| d[c]), all.map(|d| d[3])));
    let [position, du, dv, duu, duv, dvv] = [0, 1, 2, 3, 4, 5].map(|k| DVec3::new(x[k], y[k], z[k]));
    SurfacePoint { position, du, dv, duu, duv, dvv }
}

fn all(p: &SurfacePoint) -> [DVec3; 6] {
    [p.position, p.du, p.dv, p.duu, p.duv, p.dvv]
}

#[test]
fn points_and_derivatives_are_those_of_the_definition() {
    let mut rng = Rng::new(1);
    for round in 0..300 {
        let owned = Owned::random(&mut rng, 5, true);
        let surface = owned.surface();
        for _ in 0..4 {
            let at = [0, 1].map(|axis| parameter(&mut rng, &owned.knots[axis], surface.domain()[axis]));
            let (found, exact) = (all(&surface.evaluate(at[0], at[1])), all(&by_definition(&owned, at)));
            // Derivatives are compared with the size that differences of control points can give them.
            for (order, (a, b)) in found.into_iter().zip(exact).enumerate() {
                let least = [1.0, 10.0, 10.0, 1e3, 1e3, 1e3][order];
                assert!(a.distance(b) <= 1e-14 * b.length().max(least), "round {round}, {at:?}, {order}: {a} {b}");
            }
        }
    }
}

#[test]
fn high_degrees_are_as_exact() {
    let (p, mut rng) = (32u32, Rng::new(2));
    // The definition's recursion is exponential in the degree: Bernstein polynomials instead.
    let knots = [vec![0.0; 33], vec![1.0; 33]].concat();
    let points: Vec<_> = (0..33 * 2).map(|_| rng.inside(DVec3::splat(-1.0), DVec3::ONE)).collect();
    let line = vec![0.0, 0.0, 1.0, 1.0];
    let owned = Owned { degree: [p, 1], counts: [33, 2], knots: [knots, line], points: points.clone(), weights: None };
    let surface = owned.surface();
    for u in (0..=64).map(|i| f64::from(i) / 64.0) {
        let bernstein = |i: i32| {
            let binomial = (0..i)
                .fold(Long(1.0, 0.0), |b, k| b.times(Long(f64::from(32 - k), 0.0)).over(Long(f64::from(k + 1), 0.0)));
            let one_less = (0..32 - i).fold(binomial, |b, _| b.times(Long::sum(1.0, -u)));
            (0..i).fold(one_less, |b, _| b.times(Long(u, 0.0))).0
        };
        let exact: DVec3 = (0..33).map(|i| points[2 * i] * bernstein(i as i32)).sum();
        assert!(surface.evaluate(u, 0.0).position.distance(exact) < 1e-14, "{u}");
    }
}

#[test]
fn derivatives_are_limits_of_differences() {
    let mut rng = Rng::new(3);
    for _ in 0..200 {
        let owned = Owned::random(&mut rng, 4, false);
        let surface = owned.surface();
        let [[u0, u1], [v0, v1]] = surface.piece([0, 0]).domain();
        let h = 1e-4;
        let (u, v) = (rng.between(u0 + 2.0 * h, u1 - 2.0 * h), rng.between(v0 + 2.0 * h, v1 - 2.0 * h));
        let at = |i: f64, j: f64| surface.evaluate(u + i * h, v + j * h).position;
        let p = surface.evaluate(u, v);
        let (left, right, below, above) = (at(-1.0, 0.0), at(1.0, 0.0), at(0.0, -1.0), at(0.0, 1.0));
        let mixed = at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0);
        let pairs = [
            (p.du, (right - left) / (2.0 * h)),
            (p.dv, (above - below) / (2.0 * h)),
            (p.duu, (right - 2.0 * p.position + left) / (h * h)),
            (p.duv, mixed / (4.0 * h * h)),
            (p.dvv, (above - 2.0 * p.position + below) / (h * h)),
        ];
        for (order, (exact, difference)) in pairs.into_iter().enumerate() {
            assert!(exact.distance(difference) < 2e-4 * exact.length().max(100.0), "{order}: {exact} {difference}");
        }
    }
}
