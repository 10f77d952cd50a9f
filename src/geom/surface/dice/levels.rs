//! How fine an edge or the inside of a quad has to be.

use super::{Dicing, MOST_LEVEL, Quads};
use crate::geom::distances::point_triangle;
use glam::DVec3;

/// Part of the tolerance that sampled distances may take. The rest is for what lies between the samples, and for the
/// triangles at edges that are coarser than the quad's grid.
const SHARE: f64 = 0.7;
/// Greatest number of cells along a side of a smooth quad that are looked at, of each level.
const CELLS: usize = 8;

/// Cells from an end of an edge, or from a corner of a quad along both sides, that may be hopeless.
const RING: usize = 8;
/// The lowest level at which that is decided: there are other cells too, and they see a displacement.
const DECIDED: u32 = 6;

/// Cells near the ends of an edge or the corners of a quad that are too far off, counted level by level. At a vertex
/// where the normal has no limit a displacement jumps: around it about as many cells are off at each level, and none
/// helps.
struct Ends<const N: usize> {
    before: [usize; N],
}

impl<const N: usize> Ends<N> {
    fn new() -> Self {
        Self { before: [usize::MAX; N] }
    }

    /// True if none is off at a level, or more than half as many as before: a level takes four times as many cells.
    fn are_done(&mut self, level: u32, now: [usize; N]) -> bool {
        let is_done = |(now, before): (&usize, &usize)| *now == 0 || level > DECIDED && *now > before / 2;
        let are_done = now.iter().zip(&self.before).all(is_done);
        self.before = now;
        are_done
    }
}

/// True if a cell of `count` is near the first or the last.
fn is_near_end(cell: usize, count: usize) -> bool {
    let ring = RING.min(count / 4).max(1);
    cell < ring || cell + ring >= count
}

/// The level of an edge, `least` or more, by points along it at parameters from 0 to 1.
pub fn of_edge(at: &dyn Fn(f64) -> DVec3, least: u32, dicing: Dicing) -> u32 {
    let most = match dicing {
        Dicing::Level(level) => return level,
        Dicing::Tolerance(tolerance) => tolerance * SHARE,
    };
    let mut ends = Ends::<2>::new();
    let mut is_near = |level: u32| {
        let count = 1usize << level;
        let place = |i: usize| i as f64 / (4 * count) as f64;
        let is_off = |i: usize| {
            let [from, to] = [at(place(4 * i)), at(place(4 * i + 4))];
            !(1..4).all(|j| is_within(at(place(4 * i + j)), &[from, from, to], most))
        };
        if (0..count).any(|i| !is_near_end(i, count) && is_off(i)) {
            return false;
        }
        let mut off = [0; 2];
        (0..count).filter(|i| is_near_end(*i, count) && is_off(*i)).for_each(|i| off[2 * i / count] += 1);
        ends.are_done(level, off)
    };
    (least..MOST_LEVEL).find(|level| is_near(*level)).unwrap_or(MOST_LEVEL)
}

/// The level of a quad's grid, `least` or more.
pub fn of_quad<Q: Quads>(surface: &Q, quad: usize, least: u32, dicing: Dicing) -> u32 {
    let most = match dicing {
        Dicing::Level(level) => return level,
        Dicing::Tolerance(tolerance) => tolerance * SHARE,
    };
    let least = least.max(surface.least_level(quad));
    let sample = surface.sampler(quad);
    let at = |u: f64, v: f64| sample(u, v).position;
    let mut corners = Ends::<4>::new();
    let mut is_near = |level: u32| {
        let count = 1usize << level;
        let looked = if surface.is_rough() { count } else { count.min(CELLS) };
        // The first and the last cell, and some between them that are not the same in each row.
        let cell = |k: usize, row: usize| match k {
            0 => 0,
            k if k + 1 == looked => count - 1,
            k if looked == count => k,
            k => (k * count + row * count / looked) / looked,
        };
        let size = 1.0 / count as f64;
        let cells = || (0..looked).flat_map(|row| (0..looked).map(move |k| [cell(k, row), cell(row, 0)]));
        let is_off = |[i, j]: [usize; 2]| !is_cell_near(&at, [i as f64 * size, j as f64 * size], size, most);
        let is_at_corner = |[i, j]: [usize; 2]| is_near_end(i, count) && is_near_end(j, count);
        if cells().any(|cell| !is_at_corner(cell) && is_off(cell)) {
            return false;
        }
        let mut off = [0; 4];
        let at_corners = cells().filter(|cell| is_at_corner(*cell) && is_off(*cell));
        at_corners.for_each(|[i, j]| off[2 * i / count + 2 * (2 * j / count)] += 1);
        corners.are_done(level, off)
    };
    (least..MOST_LEVEL).find(|level| is_near(*level)).unwrap_or(MOST_LEVEL)
}

/// True if the surface is within `most` of the two triangles of a cell, at the points between its corners.
fn is_cell_near(at: &dyn Fn(f64, f64) -> DVec3, [u, v]: [f64; 2], size: f64, most: f64) -> bool {
    let [a, b, c, d] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|[i, j]| at(u + i * size, v + j * size));
    let triangles = [[a, b, d], [a, d, c]];
    let between = [[0.5, 0.5], [0.5, 0.0], [0.5, 1.0], [0.0, 0.5], [1.0, 0.5], [0.25, 0.75], [0.75, 0.25]];
    between.iter().all(|[i, j]| {
        let point = at(u + i * size, v + j * size);
        triangles.iter().any(|triangle| is_within(point, triangle, most))
    })
}

/// True if a point is no farther than `most` from a triangle, or the distance is no number: no level makes it one.
fn is_within(point: DVec3, triangle: &[DVec3; 3], most: f64) -> bool {
    let squared = point_triangle(point, triangle).squared;
    squared <= most * most || !squared.is_finite()
}
