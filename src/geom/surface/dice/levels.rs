//! How fine an edge or the inside of a quad has to be.

use super::{Dicing, MOST_LEVEL, Quads};
use crate::geom::distances::point_triangle;
use glam::DVec3;

/// Part of the tolerance that sampled distances may take. The rest is for what lies between the samples, and for the
/// triangles at edges that are coarser than the quad's grid.
const SHARE: f64 = 0.7;
/// Greatest number of cells along a side of a quad that are looked at, of each level.
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
            (1..4).all(|j| point_triangle(at(place(4 * i + j)), &[from, from, to]).squared <= most * most)
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
    let at = |u: f64, v: f64| surface.sample(quad, u, v).position;
    let is_near = |level: u32| {
        let count = 1usize << level;
        let step = count.div_ceil(CELLS);
        let cells = || (0..count).step_by(step);
        let size = 1.0 / count as f64;
        cells().all(|j| cells().all(|i| is_cell_near(&at, [i, j].map(|it| it as f64 * size), size, most)))
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
        triangles.iter().any(|triangle| point_triangle(point, triangle).squared <= most * most)
    })
}
