//! The cell size for a target number of triangles.

use super::each_slab;
use super::grid::Grid;
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;

/// Largest number of triangles for which the whole mesh is counted.
const WHOLE: f64 = 400_000.0;
/// Approximate size of the sample, in triangles, of larger meshes.
const SAMPLED: f64 = 1_500_000.0;
/// Number of layers for estimating the share of quadrilaterals that are subdivided.
const SPLIT_LAYERS: usize = 3;
/// Relative deviation at which the iteration stops.
const CLOSE: f64 = 0.006;

/// Finds h such that the mesh has about `triangles` triangles, within 2 %.
pub fn cell_size(triangles: u64, phase: f64, cancel: &Cancel) -> Result<f64> {
    if !(1_000..=4_000_000_000).contains(&triangles) {
        return Err(Error::bad_argument("mandelbulb: the number of triangles must be between 1,000 and 4,000,000,000"));
    }
    let wanted = triangles as f64;
    let small = wanted.min(WHOLE);
    let (h_small, power) = solve(small, 2.6 * small.powf(-0.4), 2.4, &mut |h| whole(h, phase, cancel))?;
    if wanted <= WHOLE {
        return Ok(h_small);
    }
    let scale = whole(h_small, phase, cancel)? / sampled(h_small, phase, 1, cancel)?;
    let split_small = split(h_small, phase, cancel)?;
    let guess = h_small * (small / wanted).powf(1.0 / power);
    let one_in = (wanted / SAMPLED).ceil() as u64;
    let count = &mut |h| Ok(scale * sampled(h, phase, one_in, cancel)?);
    // Rougher meshes have more quadrilaterals that are subdivided.
    let growth = split(guess, phase, cancel)? / split_small;
    Ok(solve(wanted / growth, guess, power, count)?.0)
}

/// Solves count(h) = `wanted` by the secant method in logarithms. Returns the best h and the last slope, negated.
fn solve(wanted: f64, guess: f64, mut power: f64, count: &mut dyn FnMut(f64) -> Result<f64>) -> Result<(f64, f64)> {
    let (mut h, mut found) = (guess, count(guess)?);
    let mut best = (h, found);
    for _ in 0..4 {
        if (found / wanted - 1.0).abs() < CLOSE {
            break;
        }
        let next = h * (found / wanted).powf(1.0 / power).clamp(0.1, 10.0);
        let next_found = count(next)?;
        if (next / h).ln().abs() > 0.05 {
            power = (-(next_found / found).ln() / (next / h).ln()).clamp(1.8, 3.2);
        }
        (h, found) = (next, next_found);
        if (found / wanted).ln().abs() < (best.1 / wanted).ln().abs() {
            best = (h, found);
        }
    }
    Ok((best.0, power))
}

/// Counts the triangles of the whole mesh.
fn whole(h: f64, phase: f64, cancel: &Cancel) -> Result<f64> {
    let grid = Grid::new(h, phase);
    let mut triangles = 0;
    each_slab(&grid, 0..grid.bricks, cancel, |mesh| {
        triangles += mesh.faces.len();
        Ok(())
    })?;
    Ok(triangles.max(1) as f64)
}

/// Estimates the number of triangles per crossed grid edge inside bricks, from a few layers.
fn split(h: f64, phase: f64, cancel: &Cancel) -> Result<f64> {
    let grid = Grid::new(h, phase);
    let (mut triangles, mut edges) = (0.0, 0.0);
    for i in 1..=SPLIT_LAYERS {
        let layer = (grid.bricks * i / (SPLIT_LAYERS + 1)).max(1);
        let mut faces = 0;
        each_slab(&grid, layer - 1..layer + 1, cancel, |mesh| {
            faces = mesh.faces.len();
            Ok(())
        })?;
        triangles += faces as f64;
        edges += grid.crossed_edges(layer, 1, cancel)? as f64;
    }
    Ok(triangles / f64::max(edges, 1.0))
}

/// Estimates the number of crossed grid edges inside bricks, from one in `one_in` of the bricks.
fn sampled(h: f64, phase: f64, one_in: u64, cancel: &Cancel) -> Result<f64> {
    let grid = Grid::new(h, phase);
    let mut crossed = 0;
    for layer in 0..grid.bricks {
        crossed += grid.crossed_edges(layer, one_in, cancel)?;
    }
    Ok((crossed * one_in).max(1) as f64)
}
