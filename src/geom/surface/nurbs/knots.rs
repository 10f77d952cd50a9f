//! Knot vectors.

use super::basis::Place;
use super::desc::{MAX_COORDINATE, MAX_DEGREE, MIN_SPAN, fault};
use crate::base::error::Result;
use crate::base::memory;

/// A checked knot vector with its degree.
///
/// Invariants: the degree p is in `1..=MAX_DEGREE`; the knots are finite and do not decrease; at most p + 1 are equal;
/// the domain `knots[p]..=knots[len - 1 - p]` is not empty. Hence the support of each basis function is not empty.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Knots {
    degree: usize,
    all: Vec<f64>,
    /// Index k of each span that is not empty and within the domain: it is from knot k to knot k + 1.
    spans: Vec<u32>,
}

impl Knots {
    /// Checks the knots of `count` control points. The errors name `argument`.
    pub(super) fn new(argument: &str, degree: u32, count: u32, knots: &[f64]) -> Result<Self> {
        if !(1..=MAX_DEGREE).contains(&degree) {
            return Err(fault("degree", format!("{degree} in the direction of {argument}, not in 1..={MAX_DEGREE}")));
        }
        if count <= degree {
            return Err(fault("counts", format!("{count} control points for degree {degree} ({argument})")));
        }
        if knots.len() as u64 != u64::from(count) + u64::from(degree) + 1 {
            let sum = u64::from(count) + u64::from(degree) + 1;
            return Err(fault(argument, format!("{} knots, not count + degree + 1 = {sum}", knots.len())));
        }
        let degree = degree as usize;
        check_order(argument, degree, knots)?;
        if knots[degree] >= knots[knots.len() - 1 - degree] {
            return Err(fault(argument, format!("the domain is empty: it is from knot {degree} to knot {count}")));
        }
        let mut all = memory::room(knots.len(), "knots")?;
        all.extend_from_slice(knots);
        let is_span = |k: &usize| knots[*k] < knots[k + 1];
        let count = (degree..knots.len() - 1 - degree).filter(is_span).count();
        let mut spans = memory::room(count, "knots")?;
        spans.extend((degree..knots.len() - 1 - degree).filter(is_span).map(|k| k as u32));
        Ok(Self { degree, all, spans })
    }

    /// The degree.
    pub(super) fn degree(&self) -> usize {
        self.degree
    }

    /// First and last parameter.
    pub(super) fn domain(&self) -> [f64; 2] {
        [self.all[self.degree], self.all[self.all.len() - 1 - self.degree]]
    }

    /// Number of spans of the domain that are not empty; at least 1.
    pub(super) fn span_count(&self) -> usize {
        self.spans.len()
    }

    /// The knot that begins a span, by the span's position among those that are not empty.
    pub(super) fn span(&self, at: usize) -> usize {
        self.spans[at] as usize
    }

    /// Ends of a span, by its first knot.
    pub(super) fn ends(&self, k: usize) -> [f64; 2] {
        [self.all[k], self.all[k + 1]]
    }

    /// The 2 · degree knots around span `k` that basis functions within it depend on.
    pub(super) fn around(&self, k: usize) -> &[f64] {
        &self.all[k + 1 - self.degree..=k + self.degree]
    }

    /// Moves a parameter into the domain; NaN becomes the first parameter.
    pub(super) fn clamp(&self, t: f64) -> f64 {
        let [first, last] = self.domain();
        t.max(first).min(last)
    }

    /// Position of the span of a parameter within the domain: the later one at a knot, but the last one at the end.
    pub(super) fn find(&self, t: f64) -> usize {
        self.spans.partition_point(|&k| self.all[k as usize] <= t).saturating_sub(1)
    }

    /// The place of a parameter within the domain, and the index of the first control point that a point depends on.
    pub(super) fn place(&self, t: f64) -> (usize, Place<'_>) {
        let k = self.span(self.find(t));
        (k - self.degree, Place::Span(t, self.around(k)))
    }
}

fn check_order(argument: &str, degree: usize, knots: &[f64]) -> Result<()> {
    let is_right = |t: &f64| t.abs() <= MAX_COORDINATE;
    if let Some(i) = knots.iter().position(|t| !is_right(t)) {
        return Err(fault(argument, format!("knot {i} is not finite, or exceeds {MAX_COORDINATE:e}")));
    }
    for (i, pair) in knots.windows(2).enumerate() {
        let step = pair[1] - pair[0];
        if step < 0.0 {
            return Err(fault(argument, format!("knot {} is less than knot {i}", i + 1)));
        }
        if step > 0.0 && step < MIN_SPAN {
            return Err(fault(argument, format!("knots {i} and {} differ by less than {MIN_SPAN:e}", i + 1)));
        }
    }
    match knots.windows(degree + 2).position(|run| run[0] == run[degree + 1]) {
        Some(i) => Err(fault(argument, format!("more than degree + 1 knots equal knot {i}"))),
        None => Ok(()),
    }
}
