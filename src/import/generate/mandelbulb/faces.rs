//! Triangles around each grid edge that the surface crosses, one slab of bricks at a time.

use super::cells::CellSlab;
use super::grid::{BRICK, BRICK_POINTS};
use super::table::NONE;
use rayon::prelude::*;

/// Largest area of a triangle in squares of a cell's edge; larger triangles are subdivided. The mean area is at least
/// 0.28, so that no triangle exceeds twice the mean (see the tests).
pub const LARGEST_AREA: f64 = 0.53;

/// Flag in the index of a vertex made in this module, until all bricks are joined.
const OWN: u32 = 1 << 31;

/// Vertices and triangles of one slab. Triangles may refer to vertices of the previous slab.
#[derive(Default)]
pub struct SlabMesh {
    /// Index of the first vertex in the whole mesh.
    pub base: u64,
    /// Vertices of the slab.
    pub vertices: Vec<[f32; 3]>,
    /// Triangles, counterclockwise from outside; indices refer to the whole mesh.
    pub faces: Vec<[u32; 3]>,
}

impl SlabMesh {
    /// Returns the index after the last vertex.
    pub fn end(&self) -> u64 {
        self.base + self.vertices.len() as u64
    }
}

/// Joins the cells of one slab with those of the slab below.
pub struct Joiner<'a> {
    /// Cells of the slab.
    pub cells: &'a CellSlab,
    /// Cells of the slab below.
    pub cells_below: &'a CellSlab,
    /// Mesh of the slab below.
    pub below: &'a SlabMesh,
    /// Edge of a cell.
    pub h: f64,
}

/// Vertices and triangles that one brick adds.
#[derive(Default)]
struct BrickFaces {
    vertices: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
}

/// The four cells around an edge, in order. Each entry has the cell, the axis of the face to the next cell (0: the
/// first axis across the edge, 1: the second), and the cell that has this face as its low face.
const AROUND: [([usize; 2], usize, [usize; 2]); 4] =
    [([0, 0], 0, [0, 0]), ([1, 0], 1, [1, 0]), ([1, 1], 0, [0, 1]), ([0, 1], 1, [0, 0])];

impl Joiner<'_> {
    /// Returns the mesh of the slab, which does not depend on the number of threads.
    pub fn mesh(&self) -> SlabMesh {
        let mut mesh = SlabMesh { base: self.below.end(), vertices: self.cells.positions(), faces: Vec::new() };
        let bricks: Vec<BrickFaces> = {
            let own = &mesh.vertices;
            (0..self.cells.at.len()).into_par_iter().map(|i| self.brick(i, mesh.base, own)).collect()
        };
        for b in bricks {
            let first = mesh.end() as u32;
            mesh.vertices.extend_from_slice(&b.vertices);
            let global = |v: u32| if v & OWN == 0 { v } else { first + (v & !OWN) };
            mesh.faces.extend(b.faces.iter().map(|f| f.map(global)));
        }
        mesh
    }

    fn brick(&self, index: usize, base: u64, own: &[[f32; 3]]) -> BrickFaces {
        let mut out = BrickFaces::default();
        let [bx, by] = self.cells.at[index];
        let masks = &self.cells.cells[index].masks;
        for cell in (0..BRICK_POINTS).filter(|&c| masks[c] != 0 && masks[c] != 255) {
            let p = [bx * BRICK + cell % BRICK, by * BRICK + cell / BRICK % BRICK, cell / BRICK / BRICK];
            let low_inside = masks[cell] & 1 == 1;
            for axis in 0..3 {
                if (masks[cell] >> (1 << axis) & 1 == 1) != low_inside {
                    let (ring, n) = self.ring(p, axis, base);
                    let mut ring = ring;
                    if !low_inside {
                        ring[..n].reverse();
                    }
                    self.fill(&ring[..n], base, own, &mut out);
                }
            }
        }
        out
    }

    /// Returns the vertices around the edge from grid point `p` along `axis`, counterclockwise seen from its upper end.
    /// If the face between two cells is ambiguous, the vertex of its segment is inserted between theirs.
    fn ring(&self, p: [usize; 3], axis: usize, base: u64) -> ([u32; 8], usize) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let lookup = |[su, sv]: [usize; 2]| {
            let mut q = p;
            q[u] = q[u].wrapping_sub(su);
            // Heights count inside the slab. The height below 0 is the top of the slab below.
            q[v] = q[v].wrapping_sub(sv);
            let (slab, from) = if q[2] == usize::MAX {
                q[2] = BRICK - 1;
                (self.cells_below, self.below.base)
            } else {
                (self.cells, base)
            };
            let edge = axis * 4 + su + 2 * sv;
            slab.cell(q[0], q[1], q[2]).map(|(case, first)| (case, from as u32 + first, edge))
        };
        let (mut ring, mut n) = ([0; 8], 0);
        for (cell, across, owner) in AROUND {
            // The points at the border of the grid are outside the surface, so all four cells exist.
            if let Some((case, first, edge)) = lookup(cell) {
                ring[n] = first + u32::from(case.edge_polygon[edge]);
                n += 1;
            }
            if let Some((case, first, edge)) = lookup(owner) {
                let face = if across == 0 { u } else { v };
                if case.face_vertex[face] != NONE {
                    ring[n] = first + u32::from(case.face_vertex[face] + case.face_segment[face][edge]);
                    n += 1;
                }
            }
        }
        (ring, n)
    }

    fn position(&self, v: u32, base: u64, own: &[[f32; 3]], out: &BrickFaces) -> [f64; 3] {
        let p = if v & OWN != 0 {
            out.vertices[(v & !OWN) as usize]
        } else if u64::from(v) < base {
            self.below.vertices[(u64::from(v) - self.below.base) as usize]
        } else {
            own[(u64::from(v) - base) as usize]
        };
        p.map(f64::from)
    }

    /// Fills a ring with triangles: two along the better diagonal if they are small enough, else a fan around the mean
    /// of the ring.
    fn fill(&self, ring: &[u32], base: u64, own: &[[f32; 3]], out: &mut BrickFaces) {
        let largest = LARGEST_AREA * self.h * self.h;
        let at: Vec<[f64; 3]> = ring.iter().map(|&v| self.position(v, base, own, out)).collect();
        if let [a, b, c, d] = *ring {
            let worst = |i: usize| {
                let far = at[(i + 2) % 4];
                area(at[i], at[(i + 1) % 4], far).max(area(at[i], far, at[(i + 3) % 4]))
            };
            let (first, second) = (worst(0), worst(1));
            if first.min(second) <= largest {
                out.faces.extend(if first <= second { [[a, b, c], [a, c, d]] } else { [[b, c, d], [b, d, a]] });
                return;
            }
        }
        let middle = push_mean(&at, out);
        for i in 0..ring.len() {
            self.fill_triangle([ring[i], ring[(i + 1) % ring.len()], middle], base, own, out);
        }
    }

    /// Adds a triangle. A triangle that is too large is divided into three around its centroid, which keeps its edges.
    fn fill_triangle(&self, t: [u32; 3], base: u64, own: &[[f32; 3]], out: &mut BrickFaces) {
        let at = t.map(|v| self.position(v, base, own, out));
        if area(at[0], at[1], at[2]) <= LARGEST_AREA * self.h * self.h {
            out.faces.push(t);
            return;
        }
        let middle = push_mean(&at, out);
        for i in 0..3 {
            self.fill_triangle([t[i], t[(i + 1) % 3], middle], base, own, out);
        }
    }
}

/// Adds the mean of `at` as a vertex. Returns its index.
fn push_mean(at: &[[f64; 3]], out: &mut BrickFaces) -> u32 {
    let mean = |axis: usize| at.iter().map(|p| p[axis]).sum::<f64>() / at.len() as f64;
    out.vertices.push([mean(0) as f32, mean(1) as f32, mean(2) as f32]);
    OWN | (out.vertices.len() as u32 - 1)
}

fn area(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let (a, b, c) = (glam::DVec3::from(a), glam::DVec3::from(b), glam::DVec3::from(c));
    0.5 * (b - a).cross(c - a).length()
}
