//! A NURBS surface as quads for dicing: its Bézier patches, joined where the surface is closed or ends in a point, and
//! apart where it is torn.

use super::bezier::BezierPatch;
use super::surface::Nurbs;
use crate::geom::surface::dice::{BicubicPatch, Quads, Sample, Side, intervals};
use glam::DVec4;
use std::cell::OnceCell;

/// Points are the same if they are nearer to each other than this share of the largest coordinate.
const SAME: f64 = 1e-12;

/// See the module. A direction of one patch in which the surface is closed has two quads, since an edge needs two ends.
pub struct NurbsQuads<'a> {
    surface: &'a Nurbs,
    domain: [[f64; 2]; 2],
    /// The first patch in the domain, and the number of them, in each direction.
    firsts: [usize; 2],
    patches: [usize; 2],
    /// Numbers of quads along a patch.
    halves: [usize; 2],
    /// The lines of vertices at the beginning and end of each quad, in each direction, and their number.
    lines: [Vec<[u32; 2]>; 2],
    line_counts: [usize; 2],
    /// The vertex of a border that is a point: at the first and last v, then at the first and last u.
    points: [Option<u32>; 4],
}

impl<'a> NurbsQuads<'a> {
    /// The quads of a surface, or of the part of it over a rectangle of parameters, in u and in v. There are none if
    /// that is empty.
    pub fn new(surface: &'a Nurbs, domain: Option<[[f64; 2]; 2]>) -> Self {
        let (domain, counts) = (domain.unwrap_or(surface.domain()), surface.piece_counts());
        let along = |axis: usize| {
            let ends = |i: usize| surface.piece_domain(axis, i);
            let is_in = |i: &usize| {
                let ([from, to], [begin, end]) = (ends(*i), domain[axis]);
                from.max(begin) < to.min(end)
            };
            (0..counts[axis]).filter(is_in).collect::<Vec<_>>()
        };
        let ranges = [along(0), along(1)];
        let firsts = [0, 1].map(|axis| ranges[axis].first().copied().unwrap_or(0));
        let mut patches = [0, 1].map(|axis| ranges[axis].len());
        if patches.contains(&0) {
            patches = [0, 0];
        }
        let lines = [Vec::new(), Vec::new()];
        let (halves, line_counts, points) = ([1; 2], [0; 2], [None; 4]);
        let mut quads = Self { surface, domain, firsts, patches, halves, lines, line_counts, points };
        if quads.count() > 0 {
            quads.join();
        }
        quads
    }

    /// Finds out where patches have common vertices.
    fn join(&mut self) {
        let same = SAME * self.surface.reach;
        let borders = |axis: usize, at: usize, is_end: bool| -> Vec<DVec4> {
            let others = 0..self.patches[1 - axis];
            let patch = |other| self.patch(if axis == 0 { [at, other] } else { [other, at] });
            others.flat_map(|other| border(&patch(other), axis, is_end)).collect()
        };
        let mut joined = [Vec::new(), Vec::new()];
        let mut is_closed = [false; 2];
        for axis in [0, 1] {
            let count = self.patches[axis];
            let follows =
                |at: usize, next: usize| are_equal(&borders(axis, at, true), &borders(axis, next, false), same);
            joined[axis] = (1..count).map(|at| follows(at - 1, at)).collect();
            is_closed[axis] = follows(count - 1, 0);
        }
        let ends = [(1, false), (1, true), (0, false), (0, true)];
        let is_point = ends.map(|(axis, is_end)| {
            let at = if is_end { self.patches[axis] - 1 } else { 0 };
            is_one_point(&borders(axis, at, is_end), same)
        });
        for axis in [0, 1] {
            self.halves[axis] = if is_closed[axis] && self.patches[axis] == 1 { 2 } else { 1 };
            (self.lines[axis], self.line_counts[axis]) = lines(&joined[axis], self.halves[axis], is_closed[axis]);
        }
        let grid = (self.line_counts[0] * self.line_counts[1]) as u32;
        // Borders that meet, in a corner or where the surface is closed, are one point.
        let meets = |a: usize, b: usize| is_point[a] && is_point[b] && (a / 2 != b / 2 || is_closed[1 - a / 2]);
        for (border, is_point) in is_point.into_iter().enumerate() {
            let before = (0..border).find(|before| meets(*before, border));
            let own = is_point.then_some(grid + border as u32);
            self.points[border] = before.and_then(|before| self.points[before]).or(own);
        }
    }

    /// A patch, by its place among those in the domain.
    fn patch(&self, at: [usize; 2]) -> BezierPatch {
        let patch = self.surface.piece([0, 1].map(|axis| self.firsts[axis] + at[axis]));
        if self.domain == self.surface.domain() { patch } else { patch.part(self.domain) }
    }

    /// Numbers of quads in both directions.
    fn cells(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.patches[axis] * self.halves[axis])
    }

    fn cell(&self, quad: usize) -> [usize; 2] {
        let [_, n] = self.cells();
        [quad / n, quad % n]
    }

    /// The vertex at the beginning or end of a quad in both directions.
    fn vertex(&self, cell: [usize; 2], end: [usize; 2]) -> u32 {
        let cells = self.cells();
        let is_at = |axis: usize, last: bool| {
            if last { cell[axis] + 1 == cells[axis] && end[axis] == 1 } else { cell[axis] == 0 && end[axis] == 0 }
        };
        let borders = [is_at(1, false), is_at(1, true), is_at(0, false), is_at(0, true)];
        let point = borders.iter().zip(self.points).find_map(|(is_at, point)| point.filter(|_| *is_at));
        let [i, j] = [0, 1].map(|axis| self.lines[axis][cell[axis]][end[axis]]);
        point.unwrap_or(i * self.line_counts[1] as u32 + j)
    }
}

/// The lines of vertices at both ends of each quad along a direction, and their number. `joined`: whether each patch
/// but the first begins where the one before ends.
fn lines(joined: &[bool], halves: usize, is_closed: bool) -> (Vec<[u32; 2]>, usize) {
    let (mut all, mut next) = (Vec::new(), 0);
    for patch in 0..=joined.len() {
        for half in 0..halves {
            let is_new = half == 0 && (patch == 0 || !joined[patch - 1]);
            next += u32::from(is_new);
            all.push([next - 1, next]);
            next += 1;
        }
    }
    if let (true, Some(last)) = (is_closed, all.last_mut()) {
        last[1] = 0;
    }
    (all, next as usize)
}

/// The control points at the first or last parameter of a patch in a direction, as positions with weights.
fn border(patch: &BezierPatch, axis: usize, is_end: bool) -> Vec<DVec4> {
    let ([m, n], (_, points)) = (patch.degree(), patch.control_points());
    let (count, first, step) = match (axis, is_end) {
        (0, false) => (n + 1, 0, 1),
        (0, true) => (n + 1, m * (n + 1), 1),
        (_, false) => (m + 1, 0, n + 1),
        (_, true) => (m + 1, n, n + 1),
    };
    let with_weight = |it: DVec4| (it.truncate() / it.w).extend(it.w);
    (0..count).map(|i| with_weight(points[first + i * step])).collect()
}

/// True if two borders are the same curve: the same points, and weights that differ by a common factor.
fn are_equal(a: &[DVec4], b: &[DVec4], same: f64) -> bool {
    let (Some(first), Some(other)) = (a.first(), b.first()) else { return false };
    let factor = first.w / other.w;
    let is_equal = |(a, b): (&DVec4, &DVec4)| {
        a.truncate().distance(b.truncate()) <= same && (a.w - b.w * factor).abs() <= SAME * a.w
    };
    a.len() == b.len() && a.iter().zip(b).all(is_equal)
}

fn is_one_point(points: &[DVec4], same: f64) -> bool {
    points.iter().all(|it| it.truncate().distance(points[0].truncate()) <= same)
}

impl Quads for NurbsQuads<'_> {
    fn count(&self) -> usize {
        let [m, n] = self.cells();
        m * n
    }

    fn vertices(&self) -> usize {
        self.line_counts[0] * self.line_counts[1] + self.points.len()
    }

    fn edges(&self) -> usize {
        let [m, n] = self.cells();
        m * self.line_counts[1] + n * self.line_counts[0]
    }

    fn corners(&self, quad: usize) -> [u32; 4] {
        let cell = self.cell(quad);
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|end| self.vertex(cell, end))
    }

    fn sides(&self, quad: usize) -> [Side; 4] {
        let ([i, j], [m, n]) = (self.cell(quad), self.cells());
        let along_u = |line: u32| i * self.line_counts[1] + line as usize;
        let along_v = |line: u32| m * self.line_counts[1] + line as usize * n + j;
        let ([left, right], [low, high]) = (self.lines[0][i], self.lines[1][j]);
        [along_u(low), along_u(high), along_v(left), along_v(right)]
            .map(|edge| Side { edge: edge as u32, is_reversed: false })
    }

    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample {
        self.sampler(quad)(u, v)
    }

    fn has_bicubics(&self) -> bool {
        self.surface.degree().into_iter().all(|degree| degree <= 3)
    }

    fn bicubic(&self, quad: usize, place: [u32; 3]) -> Option<BicubicPatch> {
        if !self.has_bicubics() {
            return None;
        }
        let cell = self.cell(quad);
        let mut patch = self.patch([0, 1].map(|axis| cell[axis] / self.halves[axis]));
        let ends = [0, 1].map(|axis| {
            let ([from, to], halves) = (patch.domain()[axis], self.halves[axis]);
            let at = |i: usize| if i == halves { to } else { from + (to - from) * (i as f64 / halves as f64) };
            [at(cell[axis] % halves), at(cell[axis] % halves + 1)]
        });
        if ends != patch.domain() {
            patch = patch.part(ends);
        }
        let (degree, (origin, points)) = (patch.degree(), patch.control_points());
        let rows = degree[1] + 1;
        let point = |at: usize| {
            let (i, j) = (at % (degree[0] + 1), at / (degree[0] + 1));
            let p = points[i * rows + j];
            (p.truncate() + origin * p.w).extend(p.w)
        };
        let points: Vec<DVec4> = (0..points.len()).map(point).collect();
        BicubicPatch::elevated(&points, degree, patch.is_rational(), intervals(place))
    }

    /// The patch is made at the first point: edges of one segment evaluate none.
    fn sampler(&self, quad: usize) -> impl Fn(f64, f64) -> Sample {
        let (cell, made) = (self.cell(quad), OnceCell::new());
        move |u, v| {
            let patch = made.get_or_init(|| self.patch([0, 1].map(|axis| cell[axis] / self.halves[axis])));
            let [u, v] = [0, 1].map(|axis| {
                let ([from, to], share) = (patch.domain()[axis], [u, v][axis]);
                let share = ((cell[axis] % self.halves[axis]) as f64 + share) / self.halves[axis] as f64;
                if share == 1.0 { to } else { from + (to - from) * share }
            });
            let point = patch.evaluate(u, v);
            Sample { position: point.position, normal: self.surface.normal_limit_of(&point, u, v) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::surface::nurbs::NurbsDesc;
    use glam::DVec3;

    /// Degree 1, torn between x = 1 and x = 5: nothing joins the sheets.
    #[test]
    fn torn_surfaces_stay_apart() {
        let knots_u = [0.0, 0.0, 1.0, 1.0, 2.0, 2.0];
        let points: Vec<DVec3> =
            [0.0, 1.0, 5.0, 6.0].iter().flat_map(|x| [0.0, 1.0].map(|y| DVec3::new(*x, y, 0.0))).collect();
        let (degree, counts, knots_v) = ([1, 1], [4, 2], &[0.0, 0.0, 1.0, 1.0][..]);
        let desc = NurbsDesc { degree, counts, knots_u: &knots_u, knots_v, points: &points, weights: None };
        let surface = Nurbs::new(&desc).expect("a surface");
        let quads = NurbsQuads::new(&surface, None);
        assert_eq!((quads.count(), quads.line_counts), (2, [4, 2]));
        let used: std::collections::BTreeSet<u32> = (0..2).flat_map(|quad| quads.corners(quad)).collect();
        assert_eq!(used.len(), 8);
        // Half of the first sheet, and nothing at all.
        assert_eq!(NurbsQuads::new(&surface, Some([[0.0, 0.5], [0.0, 1.0]])).count(), 1);
        assert_eq!(NurbsQuads::new(&surface, Some([[0.5, 0.5], [0.0, 1.0]])).count(), 0);
    }

    #[test]
    fn lines_are_shared_where_patches_are_joined() {
        assert_eq!(lines(&[true, true], 1, false), (vec![[0, 1], [1, 2], [2, 3]], 4));
        assert_eq!(lines(&[true, false], 1, false), (vec![[0, 1], [1, 2], [3, 4]], 5));
        assert_eq!(lines(&[], 2, true), (vec![[0, 1], [1, 0]], 3));
    }
}
