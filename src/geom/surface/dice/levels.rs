//! How fine an edge or the inside of a quad has to be.

use super::{Dicing, MOST_LEVEL, Quads};
use crate::geom::distances::point_triangle;
use glam::DVec3;

/// Part of the tolerance that sampled distances may take. The rest is for what lies between the samples, and for the
/// triangles at edges that are coarser than the quad's grid.
const SHARE: f64 = 0.7;
/// Greatest number of cells along a side of a smooth quad that are looked at, of each level.
const CELLS: usize = 8;

/// The level of an edge, `least` or more, by points along it at parameters from 0 to 1.
pub fn of_edge(at: &dyn Fn(f64) -> DVec3, least: u32, dicing: Dicing) -> u32 {
    let most = match dicing {
        Dicing::Level(level) => return level,
        Dicing::Tolerance(tolerance) => tolerance * SHARE,
    };
    let is_near = |level: u32| {
        let count = 1usize << level;
        let place = |i: usize| i as f64 / (4 * count) as f64;
        (0..count).all(|i| {
            let [from, to] = [at(place(4 * i)), at(place(4 * i + 4))];
            (1..4).all(|j| is_within(at(place(4 * i + j)), &[from, from, to], most))
        })
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
    let is_near = |level: u32| {
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
        (0..looked).all(|row| {
            let j = cell(row, 0);
            (0..looked).all(|k| is_cell_near(&at, [cell(k, row), j].map(|it| it as f64 * size), size, most))
        })
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
