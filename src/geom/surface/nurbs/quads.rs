//! A NURBS surface as quads for dicing: its Bézier patches, joined where the surface is closed or ends in a point.

use super::bezier::BezierPatch;
use super::surface::Nurbs;
use crate::geom::surface::dice::{Quads, Sample, Side};
use glam::{DVec3, DVec4};

/// Points are the same if they are nearer to each other than this share of the largest coordinate.
const SAME: f64 = 1e-12;

/// See the module. A direction of one patch in which the surface is closed has two quads, since an edge needs two ends.
pub struct NurbsQuads<'a> {
    surface: &'a Nurbs,
    pieces: Vec<BezierPatch>,
    /// Numbers of patches, and of quads along a patch, in each direction.
    patches: [usize; 2],
    halves: [usize; 2],
    /// True for directions at whose end the surface is where it began.
    is_closed: [bool; 2],
    /// True if the surface ends in a point: at the first and last v, then at the first and last u.
    is_point: [bool; 4],
}

impl<'a> NurbsQuads<'a> {
    /// The quads of a surface, or of the part of it over a rectangle of parameters, in u and in v.
    pub fn new(surface: &'a Nurbs, domain: Option<[[f64; 2]; 2]>) -> Self {
        let (patches, pieces) = pieces_in(surface, domain);
        let piece = |i: usize, j: usize| &pieces[i * patches[1] + j];
        let [last_i, last_j] = patches.map(|count| count - 1);
        let same = same(&pieces);
        let is_closed = [
            (0..patches[1]).all(|j| equal(border(piece(0, j), 2), border(piece(last_i, j), 3), same)),
            (0..patches[0]).all(|i| equal(border(piece(i, 0), 0), border(piece(i, last_j), 1), same)),
        ];
        let is_point = [
            is_one_point((0..patches[0]).flat_map(|i| border(piece(i, 0), 0)), same),
            is_one_point((0..patches[0]).flat_map(|i| border(piece(i, last_j), 1)), same),
            is_one_point((0..patches[1]).flat_map(|j| border(piece(0, j), 2)), same),
            is_one_point((0..patches[1]).flat_map(|j| border(piece(last_i, j), 3)), same),
        ];
        let halves = [0, 1].map(|axis| if is_closed[axis] && patches[axis] == 1 { 2 } else { 1 });
        Self { surface, pieces, patches, halves, is_closed, is_point }
    }

    /// Numbers of quads in both directions.
    fn cells(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.patches[axis] * self.halves[axis])
    }

    /// Numbers of lines of vertices across both directions.
    fn lines(&self) -> [usize; 2] {
        let cells = self.cells();
        [0, 1].map(|axis| cells[axis] + usize::from(!self.is_closed[axis]))
    }

    fn cell(&self, quad: usize) -> [usize; 2] {
        let [_, n] = self.cells();
        [quad / n, quad % n]
    }

    /// The vertex at a corner of cells.
    fn vertex(&self, i: usize, j: usize) -> u32 {
        let ([m, n], lines) = (self.cells(), self.lines());
        let at_point = [j == 0, j == n, i == 0, i == m].iter().zip(self.is_point).position(|(is_at, is)| *is_at && is);
        let grid = lines[0] * lines[1];
        at_point.map_or_else(|| i % lines[0] * lines[1] + j % lines[1], |point| grid + point) as u32
    }
}

/// Numbers of Bézier patches in a rectangle of parameters in both directions, and the patches. All if it is empty.
fn pieces_in(surface: &Nurbs, domain: Option<[[f64; 2]; 2]>) -> ([usize; 2], Vec<BezierPatch>) {
    let pieces: Vec<BezierPatch> = domain.map_or(Vec::new(), |domain| surface.pieces_within(domain).collect());
    let Some(first) = pieces.first() else { return (surface.piece_counts(), surface.pieces().collect()) };
    // Those of a row, in which v is fastest, have the same parameters u.
    let columns = pieces.iter().take_while(|it| it.domain()[0] == first.domain()[0]).count();
    ([pieces.len() / columns, columns], pieces)
}

/// The control points on a border of a patch, without the weights: v = first, v = last, u = first, u = last.
fn border(patch: &BezierPatch, which: usize) -> impl Iterator<Item = DVec3> + '_ {
    let ([m, n], (_, points)) = (patch.degree(), patch.control_points());
    let position = |it: &DVec4| it.truncate() / it.w;
    let (count, first, step) = match which {
        0 => (m + 1, 0, n + 1),
        1 => (m + 1, n, n + 1),
        2 => (n + 1, 0, 1),
        _ => (n + 1, m * (n + 1), 1),
    };
    (0..count).map(move |i| position(&points[first + i * step]))
}

fn same(pieces: &[BezierPatch]) -> f64 {
    let of = |patch: &BezierPatch| {
        let all = patch.control_points().1.iter().map(|it| (it.truncate() / it.w).abs().max_element());
        all.fold(0.0, f64::max)
    };
    SAME * pieces.iter().map(of).fold(0.0, f64::max)
}

fn equal(a: impl Iterator<Item = DVec3>, b: impl Iterator<Item = DVec3>, same: f64) -> bool {
    a.zip(b).all(|(a, b)| a.distance(b) <= same)
}

fn is_one_point(mut points: impl Iterator<Item = DVec3>, same: f64) -> bool {
    let Some(first) = points.next() else { return false };
    points.all(|it| it.distance(first) <= same)
}

impl Quads for NurbsQuads<'_> {
    fn count(&self) -> usize {
        let [m, n] = self.cells();
        m * n
    }

    fn vertices(&self) -> usize {
        let [m, n] = self.lines();
        m * n + self.is_point.len()
    }

    fn edges(&self) -> usize {
        let ([m, n], lines) = (self.cells(), self.lines());
        m * lines[1] + n * lines[0]
    }

    fn corners(&self, quad: usize) -> [u32; 4] {
        let [i, j] = self.cell(quad);
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| self.vertex(i + x, j + y))
    }

    fn sides(&self, quad: usize) -> [Side; 4] {
        let ([i, j], [m, n], lines) = (self.cell(quad), self.cells(), self.lines());
        let along_u = |j: usize| i * lines[1] + j % lines[1];
        let along_v = |i: usize| m * lines[1] + i % lines[0] * n + j;
        [along_u(j), along_u(j + 1), along_v(i), along_v(i + 1)]
            .map(|edge| Side { edge: edge as u32, is_reversed: false })
    }

    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample {
        let cell = self.cell(quad);
        let at = [0, 1].map(|axis| (cell[axis] / self.halves[axis], cell[axis] % self.halves[axis]));
        let patch = &self.pieces[at[0].0 * self.patches[1] + at[1].0];
        let [u, v] = [0, 1].map(|axis| {
            let ([from, to], share) = (patch.domain()[axis], [u, v][axis]);
            let share = (at[axis].1 as f64 + share) / self.halves[axis] as f64;
            if share == 1.0 { to } else { from + (to - from) * share }
        });
        let point = patch.evaluate(u, v);
        let normal = self.surface.normal_limit_of(&point, u, v);
        Sample { position: point.position, normal }
    }
}
