//! Basis functions at a parameter, and the derivatives of a control polygon.

use super::desc::MAX_DEGREE;
use glam::DVec4;

/// Greatest number of basis functions that are not zero at a parameter.
pub(super) const MOST: usize = MAX_DEGREE as usize + 1;

/// Space for the control points of a line of a degree under N.
pub(super) type Line<const N: usize> = [DVec4; N];

/// A parameter at which basis functions are asked for.
pub(super) enum Place<'a> {
    /// In a span of a B-spline, with the 2 · degree knots around it.
    Span(f64, &'a [f64]),
    /// In an interval, for Bernstein polynomials. If it is empty, all derivatives are those of equal points: 0.
    Interval(f64, [f64; 2]),
}

/// The basis functions of degrees p, p − 1 and p − 2 at one parameter. They are sums of products of numbers that are
/// not negative, hence each is exact but for a few units in its last place.
///
/// Derivatives come from the differences of neighbouring control points, which are weighed by basis functions of lower
/// degree. The difference of rounded values never occurs, and no span is a divisor but supports of basis functions, so
/// that tiny spans do no harm.
pub(super) struct Basis<const N: usize> {
    degree: usize,
    values: [f64; N],
    first: [f64; N],
    second: [f64; N],
    /// Factors of first differences, and of the differences of those.
    over_first: [f64; N],
    over_second: [f64; N],
}

impl<const N: usize> Basis<N> {
    /// The basis of a degree under N, by the recursion of Cox and de Boor (equations 2.5 and 2.7 of The NURBS Book).
    pub(super) fn at(degree: usize, place: &Place<'_>) -> Self {
        match *place {
            Place::Span(t, knots) => Self::new(degree, t, |i| knots[i]),
            Place::Interval(t, [begin, end]) => {
                let end = if begin < end { end } else { begin + begin.abs().max(1.0) };
                Self::new(degree, t, |i| if i < degree { begin } else { end })
            }
        }
    }

    fn new(degree: usize, t: f64, knot: impl Fn(usize) -> f64) -> Self {
        let zeros = [0.0; N];
        let mut basis =
            Self { degree, values: zeros, first: zeros, second: zeros, over_first: zeros, over_second: zeros };
        basis.values[0] = 1.0;
        for d in 1..=degree {
            basis.second = basis.first;
            basis.first = basis.values;
            basis.values = zeros;
            for j in 0..d {
                let (lower, upper) = (knot(degree - d + j), knot(degree + j));
                let share = basis.first[j] / (upper - lower);
                basis.values[j] += (upper - t) * share;
                basis.values[j + 1] += (t - lower) * share;
            }
        }
        for j in 0..degree {
            basis.over_first[j] = degree as f64 / (knot(degree + j) - knot(j));
        }
        for j in 0..degree - 1 {
            basis.over_second[j] = (degree - 1) as f64 / (knot(degree + j) - knot(j + 1));
        }
        basis
    }

    /// The point and the first two derivatives of a line with these control points. `line` serves as work space.
    pub(super) fn derivatives(&self, line: &mut Line<N>) -> [DVec4; 3] {
        let p = self.degree;
        let value = weighed(&self.values, &line[..=p]);
        for j in 0..p {
            line[j] = (line[j + 1] - line[j]) * self.over_first[j];
        }
        let first = weighed(&self.first, &line[..p]);
        for j in 0..p - 1 {
            line[j] = (line[j + 1] - line[j]) * self.over_second[j];
        }
        [value, first, weighed(&self.second, &line[..p - 1])]
    }
}

fn weighed(weights: &[f64], points: &[DVec4]) -> DVec4 {
    weights.iter().zip(points).fold(DVec4::ZERO, |sum, (&weight, &point)| sum + point * weight)
}
