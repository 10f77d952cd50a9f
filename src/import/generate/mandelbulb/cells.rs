//! Vertices of the cells, one slab of bricks at a time. A cell has a vertex for each polygon that the surface forms in
//! it.

use super::grid::{BRICK, BRICK_POINTS, Grid, Slab};
use super::table::{CASES, CellCase, NONE, edge_corners};
use rayon::prelude::*;

/// Points along the edge of a brick, including the first points of its upper neighbours.
const HALO: usize = BRICK + 1;

/// The cells of a brick that the surface crosses.
pub struct CellBrick {
    /// Signs of each cell's corners; 0 and 255 have no vertices.
    pub masks: Box<[u8; BRICK_POINTS]>,
    /// Index of each cell's first vertex in the brick.
    first: Box<[u16; BRICK_POINTS]>,
    /// Vertices of the brick.
    positions: Vec<[f32; 3]>,
    /// Index in the slab of the brick's first vertex.
    base: u32,
}

/// The cells of one layer of bricks.
pub struct CellSlab {
    bricks: usize,
    /// Index into `cells` for each brick, or `u32::MAX`.
    index: Vec<u32>,
    /// Coordinates of the bricks of `cells`.
    pub at: Vec<[usize; 2]>,
    /// Cells of the bricks, in the order of `at`.
    pub cells: Vec<CellBrick>,
}

impl CellSlab {
    /// Creates an empty slab, which precedes the first layer.
    pub fn empty() -> Self {
        Self { bricks: 0, index: Vec::new(), at: Vec::new(), cells: Vec::new() }
    }

    /// Creates the cells of `slab`; the uppermost ones reach the first points of `above`.
    pub fn new(grid: &Grid, layer: usize, slab: &Slab, above: &Slab) -> Self {
        let n = grid.bricks;
        let at: Vec<[usize; 2]> =
            (0..n * n).map(|i| [i % n, i / n]).filter(|&[x, y]| may_hold_surface(slab, above, x, y)).collect();
        let mut cells: Vec<CellBrick> =
            at.par_iter().map(|&[x, y]| brick_cells(grid, [x, y, layer], slab, above)).collect();
        let mut base = 0;
        for c in &mut cells {
            c.base = base;
            base += c.positions.len() as u32;
        }
        let mut index = vec![u32::MAX; n * n];
        for (i, [x, y]) in at.iter().enumerate() {
            index[y * n + x] = i as u32;
        }
        Self { bricks: n, index, at, cells }
    }

    /// Returns the vertices of all bricks in order.
    pub fn positions(&self) -> Vec<[f32; 3]> {
        self.cells.iter().flat_map(|c| c.positions.iter().copied()).collect()
    }

    /// Returns the cell at grid point `(x, y)` and height `z` inside this slab, if its brick has cells: its case and
    /// the index of its first vertex in the slab.
    pub fn cell(&self, x: usize, y: usize, z: usize) -> Option<(&'static CellCase, u32)> {
        let brick = *self.index.get(y / BRICK * self.bricks + x / BRICK)?;
        let b = self.cells.get(brick as usize)?;
        let i = (z * BRICK + y % BRICK) * BRICK + x % BRICK;
        Some((&CASES[usize::from(b.masks[i])], b.base + u32::from(b.first[i])))
    }
}

/// True if the signs of the brick and its seven upper neighbours can differ.
fn may_hold_surface(slab: &Slab, above: &Slab, x: usize, y: usize) -> bool {
    let own = slab.kind(x, y);
    !Slab::is_uniform(own)
        || (1..8).any(|o| {
            let from = if o & 4 == 0 { slab } else { above };
            from.kind(x + (o & 1), y + (o >> 1 & 1)) != own
        })
}

/// Returns the brick's values together with the first points of its upper neighbours.
fn gather(x: usize, y: usize, slab: &Slab, above: &Slab) -> Box<[f32; HALO * HALO * HALO]> {
    let mut values = Box::new([0.0; HALO * HALO * HALO]);
    for octant in 0..8 {
        let from = if octant & 4 == 0 { slab } else { above };
        let kind = from.kind(x + (octant & 1), y + (octant >> 1 & 1));
        let range = |bit: usize| if octant >> bit & 1 == 0 { 0..BRICK } else { BRICK..HALO };
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    values[(k * HALO + j) * HALO + i] = from.value(kind, [i % BRICK, j % BRICK, k % BRICK]);
                }
            }
        }
    }
    values
}

fn brick_cells(grid: &Grid, brick: [usize; 3], slab: &Slab, above: &Slab) -> CellBrick {
    let values = gather(brick[0], brick[1], slab, above);
    let mut out = CellBrick {
        masks: Box::new([0; BRICK_POINTS]),
        first: Box::new([0; BRICK_POINTS]),
        positions: Vec::new(),
        base: 0,
    };
    for cell in 0..BRICK_POINTS {
        let p = [cell % BRICK, cell / BRICK % BRICK, cell / BRICK / BRICK];
        let corners: [f32; 8] =
            std::array::from_fn(|c| values[((p[2] + (c >> 2)) * HALO + p[1] + (c >> 1 & 1)) * HALO + p[0] + (c & 1)]);
        let mask = (0..8).fold(0u8, |m, c| m | (u8::from(corners[c] < 0.0) << c));
        out.masks[cell] = mask;
        if mask != 0 && mask != 255 {
            out.first[cell] = out.positions.len() as u16;
            let low: [f64; 3] = std::array::from_fn(|a| grid.line(brick[a] * BRICK + p[a]));
            place_vertices(&CASES[usize::from(mask)], &corners, low, grid.h, &mut out.positions);
        }
    }
    out
}

/// Returns the point at which the field is zero on an edge, in cells from the cell's low corner.
fn crossing(edge: usize, corners: &[f32; 8]) -> [f64; 3] {
    let (a, b) = edge_corners(edge);
    let (fa, fb) = (f64::from(corners[a]), f64::from(corners[b]));
    let mut p: [f64; 3] = std::array::from_fn(|axis| (a >> axis & 1) as f64);
    p[edge / 4] += fa / (fa - fb);
    p
}

/// Adds the vertices of a cell. The vertex of a polygon, or of a segment of an ambiguous face, is the mean of its
/// crossings.
fn place_vertices(case: &CellCase, corners: &[f32; 8], low: [f64; 3], h: f64, out: &mut Vec<[f32; 3]>) {
    let mut mean = |belongs: &dyn Fn(usize) -> bool| {
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for e in (0..12).filter(|&e| belongs(e)) {
            let p = crossing(e, corners);
            sum = [sum[0] + p[0], sum[1] + p[1], sum[2] + p[2]];
            n += 1.0;
        }
        out.push(std::array::from_fn(|a| (low[a] + h * sum[a] / n) as f32));
    };
    for polygon in 0..case.polygons {
        mean(&|e| case.edge_polygon[e] == polygon);
    }
    for axis in (0..3).filter(|&a| case.face_vertex[a] != NONE) {
        for segment in 0..2 {
            mean(&|e| case.face_segment[axis][e] == segment);
        }
    }
}
