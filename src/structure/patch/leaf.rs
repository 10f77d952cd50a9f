//! The test of the eight triangles of a leaf of a quadtree: four cells of a grid, nine vertices.

#![allow(clippy::needless_range_loop)] // rows, columns, lanes and axes index several arrays at once

use super::layout::{Grid, of_morton};
use super::ray::Prepared;
use crate::geom::Shear;
use crate::geom::watertight::{Sheared, intersect, shear};
use crate::simd::{Lanes, Simd};

/// Triangles that are hit, and their hits.
pub struct Found {
    /// Bit `i`: triangle `i`.
    pub hits: u32,
    /// Distances.
    pub t: [f32; 8],
    /// Weights of the second vertices.
    pub u: [f32; 8],
    /// Weights of the third vertices.
    pub v: [f32; 8],
}

/// For each corner the vertex of each triangle, of three rows of three. Triangle `4 j + 2 i` is the first of cell
/// (i, j), triangle `4 j + 2 i + 1` the second.
pub const CORNERS: [[u8; 8]; 3] = {
    let mut corners = [[0; 8]; 3];
    let mut cell = 0;
    while cell < 4 {
        let at = (3 * (cell >> 1) + (cell & 1)) as u8;
        let (first, second) = ([at, at + 1, at + 4], [at, at + 4, at + 3]);
        let mut corner = 0;
        while corner < 3 {
            corners[corner][2 * cell] = first[corner];
            corners[corner][2 * cell + 1] = second[corner];
            corner += 1;
        }
        cell += 1;
    }
    corners
};

/// Tests the triangles of leaf `number` up to `t_max`.
#[inline(always)]
pub fn eight<S: Simd>(s: S, ray: &Prepared, grid: &Grid, number: usize, t_max: f32) -> Found {
    let Prepared { ray, shear: Shear { k, s: by }, .. } = ray;
    let zero = s.splat8(0.0);
    let (i, j) = of_morton(number);
    // A leaf beyond the grid, which only a malformed file has, is never hit.
    let is_there = 2 * i + 2 < grid.side && 2 * j + 2 < grid.side;
    let nine = match &grid.computed {
        Some(computed) if is_there => computed.nine(s, grid.level, number),
        _ => stored(grid, i, j, is_there),
    };
    let by = [s.splat8(by[0]), s.splat8(by[1]), s.splat8(by[2])];
    let mut corners = [Sheared { x: zero, y: zero, z: zero }; 3];
    let tables = [s.table16(&nine[k[0]]), s.table16(&nine[k[1]]), s.table16(&nine[k[2]])];
    for (corner, sheared) in corners.iter_mut().enumerate() {
        let index = s.index8(&CORNERS[corner]);
        let mut p = [zero; 3];
        for axis in 0..3 {
            p[axis] = s.lookup16(tables[axis], index) - s.splat8(ray.org[k[axis]]);
        }
        *sheared = shear(p, by);
    }
    let lanes = if is_there { 0xff } else { 0 };
    let found = intersect::<8, _>(lanes, corners, zero, s.splat8(ray.t_min), s.splat8(t_max));
    Found { hits: found.hits, t: found.t.to_array(), u: found.u.to_array(), v: found.v.to_array() }
}

/// The nine vertices of a leaf of a stored grid, by axis; zeros if it is not there.
#[inline(always)]
fn stored(grid: &Grid, i: usize, j: usize, is_there: bool) -> [[f32; 16]; 3] {
    // No closures here: they are compiled without the instruction set.
    let mut nine = [[0.0f32; 16]; 3];
    if is_there {
        let at = 3 * (2 * j * grid.side + 2 * i);
        for row in 0..3 {
            let words = &grid.vertices[at + 3 * row * grid.side..][..9];
            for column in 0..3 {
                for axis in 0..3 {
                    nine[axis][3 * row + column] = f32::from_bits(words[3 * column + axis]);
                }
            }
        }
    }
    nine
}
