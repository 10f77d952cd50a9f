//! The triangles of one quad, row by row: memory is that of its sides and of two rows.

use super::edges::{ENDS, Edges, on_side};
use super::{Dicing, Micro, Quads, Sample, levels};
use crate::base::error::Result;
use crate::base::progress::Cancel;

/// Least number of triangles that are handed on at a time, unless the quad has fewer.
const BATCH: usize = 4096;

/// A quad with the number of segments along each of its sides.
struct Grid<'a, Q> {
    surface: &'a Q,
    quad: usize,
    edges: &'a Edges,
    count: usize,
}

/// Dices a quad. `micro` is emptied first.
pub fn dice<Q: Quads>(
    (surface, quad): (&Q, usize),
    (dicing, edges): (Dicing, &Edges),
    cancel: &Cancel,
    micro: &mut Micro,
    emit: &mut dyn FnMut(usize, &Micro) -> Result<()>,
) -> Result<()> {
    let sides = surface.sides(quad);
    let least = sides.into_iter().map(|side| edges.level(side.edge)).fold(0, u32::max);
    let count = 1 << levels::of_quad(surface, quad, least, dicing);
    let grid = Grid { surface, quad, edges, count };
    let [mut below, top, left, right] = [0, 1, 2, 3].map(|which| grid.side(which));
    let mut above = Vec::with_capacity(count + 1);
    micro.clear();
    for j in 1..=count {
        cancel.check()?;
        above.clear();
        if j == count {
            above.extend_from_slice(&top);
        } else {
            let v = j as f64 / count as f64;
            above.push(left[j]);
            above.extend((1..count).map(|i| surface.sample(quad, i as f64 / count as f64, v)));
            above.push(right[j]);
        }
        add_row(micro, &below, &above);
        if micro.positions.len() >= BATCH {
            emit(quad, micro)?;
            micro.clear();
        }
        std::mem::swap(&mut below, &mut above);
    }
    if micro.positions.is_empty() { Ok(()) } else { emit(quad, micro) }
}

impl<Q: Quads> Grid<'_, Q> {
    /// The points of the grid along a side. Where the edge is coarser than the grid, the nearest points of the edge
    /// take the places of those between them.
    fn side(&self, which: usize) -> Vec<Sample> {
        let (side, corners) = (self.surface.sides(self.quad)[which], self.surface.corners(self.quad));
        let own = 1usize << self.edges.level(side.edge);
        let [from, to] = ENDS[which].map(|end| self.edges.vertex(corners[end]));
        let positions = [from].into_iter().chain(self.edges.points(self.surface, side)).chain([to]);
        let point = |(i, position)| {
            let (u, v) = on_side(which, i as f64 / own as f64);
            Sample { position, ..self.surface.sample(self.quad, u, v) }
        };
        let (points, step) = (positions.enumerate().map(point).collect::<Vec<_>>(), self.count / own);
        (0..=self.count).map(|i| points[(i + step / 2) / step]).collect()
    }
}

/// Adds the triangles between two rows. Those without area, where points coincide at poles and coarser edges, are none.
fn add_row(micro: &mut Micro, below: &[Sample], above: &[Sample]) {
    for (low, high) in below.windows(2).zip(above.windows(2)) {
        for corners in [[low[0], low[1], high[1]], [low[0], high[1], high[0]]] {
            let [p, q, r] = corners.map(|it| it.position);
            if p != q && q != r && r != p {
                micro.positions.push([p, q, r]);
                micro.normals.push(corners.map(|it| it.normal.as_vec3()));
            }
        }
    }
}
