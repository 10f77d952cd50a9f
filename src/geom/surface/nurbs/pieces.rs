//! Decomposition of a NURBS surface to Bézier patches.

use super::basis::{Line, MOST};
use super::bezier::BezierPatch;
use super::knots::Knots;
use super::surface::Nurbs;
use glam::DVec4;

impl Nurbs {
    /// Numbers of Bézier patches along u and v: of the spans that are not empty.
    pub fn piece_counts(&self) -> [usize; 2] {
        self.knots.each_ref().map(Knots::span_count)
    }

    /// The Bézier patch of the spans `at[0]` of u and `at[1]` of v, counted from 0. Only the control points that it
    /// depends on are read. Neighbours have equal bits in the control points of their common border, unless the
    /// surface itself is torn there by degree + 1 equal knots.
    ///
    /// # Panics
    /// Panics unless `at` is less than [`Self::piece_counts`] in both directions.
    pub fn piece(&self, at: [usize; 2]) -> BezierPatch {
        let degree = self.degree();
        let [k, l] = [0, 1].map(|axis| self.knots[axis].span(at[axis]));
        // Lines along u first, of all columns that the lines along v depend on.
        let width = degree[1] + 1;
        let mut rows = vec![DVec4::ZERO; (degree[0] + 1) * width];
        for j in 0..width {
            let column = bezier(&self.knots[0], k, |i| self.points[i * self.columns + l - degree[1] + j]);
            for (i, &point) in column[..=degree[0]].iter().enumerate() {
                rows[i * width + j] = point;
            }
        }
        let mut points = Vec::with_capacity(rows.len());
        for row in rows.chunks_exact(width) {
            points.extend_from_slice(&bezier(&self.knots[1], l, |j| row[j + degree[1] - l])[..width]);
        }
        let domain = [0, 1].map(|axis| self.knots[axis].ends(self.knots[axis].span(at[axis])));
        let steps = (degree[0] + degree[1]) as u32;
        let (origin, is_rational, reach) = (self.origin, self.is_rational, self.reach);
        BezierPatch { degree, domain, origin, points, is_rational, reach, steps }
    }

    /// All Bézier patches, v fastest.
    pub fn pieces(&self) -> impl Iterator<Item = BezierPatch> + '_ {
        let [rows, columns] = self.piece_counts();
        (0..rows).flat_map(move |i| (0..columns).map(move |j| self.piece([i, j])))
    }

    /// First and last parameter of a piece in a direction.
    pub(super) fn piece_domain(&self, axis: usize, at: usize) -> [f64; 2] {
        self.knots[axis].ends(self.knots[axis].span(at))
    }

    /// The parts of all Bézier patches within a rectangle of parameters, v fastest. Those that would be empty are left
    /// out.
    pub fn pieces_within(&self, domain: [[f64; 2]; 2]) -> impl Iterator<Item = BezierPatch> + '_ {
        let overlaps = |k: &Knots, at: usize, [begin, end]: [f64; 2]| {
            let span = k.ends(k.span(at));
            span[0] < end && begin < span[1]
        };
        let [rows, columns] = [0, 1].map(|axis| {
            let spans = (0..self.knots[axis].span_count()).filter(|&at| overlaps(&self.knots[axis], at, domain[axis]));
            spans.collect::<Vec<_>>()
        });
        let all = rows.into_iter().flat_map(move |i| columns.clone().into_iter().map(move |j| [i, j]));
        all.map(move |at| self.piece(at).part(domain))
    }
}

/// The Bézier points of the span that begins at knot `k`, of a line whose control points `line` returns by their index.
fn bezier(knots: &Knots, k: usize, line: impl Fn(usize) -> DVec4) -> Line<MOST> {
    let mut out = [DVec4::ZERO; MOST];
    for (at, point) in out[..=knots.degree()].iter_mut().enumerate() {
        *point = blossom(knots, k, at, &line);
    }
    out
}

/// The blossom of the span that begins at knot `k`, at its end `ends` times and at its begin otherwise: a Bézier point
/// of the span. All interpolations are convex, and exact where a weight is 0: the last point of a span and the first of
/// the next are then made by the same interpolations of the same points, hence have equal bits.
fn blossom(knots: &Knots, k: usize, ends: usize, line: impl Fn(usize) -> DVec4) -> DVec4 {
    let (p, around, [begin, end]) = (knots.degree(), knots.around(k), knots.ends(k));
    let mut points: Line<MOST> = [DVec4::ZERO; MOST];
    for (i, point) in points[..=p].iter_mut().enumerate() {
        *point = line(k - p + i);
    }
    for level in 1..=p {
        let t = if level <= ends { end } else { begin };
        for j in (level..=p).rev() {
            let (lower, upper) = (around[j - 1], around[j + p - level]);
            let share = (t - lower) / (upper - lower);
            points[j] = points[j - 1] * ((upper - t) / (upper - lower)) + points[j] * share;
        }
    }
    points[p]
}
