//! The grid of one quad, and its triangles.

use super::edges::{Edges, on_side};
use super::{Dicing, Micro, Quads, Sample, levels};

/// The points of a quad, row by row along u.
#[derive(Default)]
pub struct Grid {
    /// Segments along each side.
    count: usize,
    points: Vec<Sample>,
    /// Levels of the quad's sides below that of the grid.
    coarser: [u32; 4],
    triangles: Micro,
}

impl Grid {
    /// Evaluates the points of a quad, and makes its triangles.
    pub fn fill<Q: Quads>(&mut self, surface: &Q, quad: usize, dicing: Dicing, edges: &Edges) {
        let sides = surface.sides(quad);
        let of_sides = sides.map(|side| edges.level(side.edge));
        let least = of_sides.into_iter().fold(0, u32::max);
        let level = levels::of_quad(surface, quad, least, dicing);
        self.count = 1 << level;
        self.coarser = of_sides.map(|it| level - it);
        let place = |i: usize| i as f64 / self.count as f64;
        let row = |j: usize| (0..=self.count).map(move |i| (i, j));
        self.points.clear();
        self.points.extend((0..=self.count).flat_map(row).map(|(i, j)| surface.sample(quad, place(i), place(j))));
        for (which, side) in sides.into_iter().enumerate() {
            let step = 1 << self.coarser[which];
            for i in (step..self.count).step_by(step) {
                let at = self.on(which, i);
                self.points[at].position = edges.point(side, i / step);
            }
        }
        let ends = [0, self.count, (self.count + 1) * self.count, (self.count + 1) * (self.count + 1) - 1];
        for (vertex, at) in surface.corners(quad).into_iter().zip(ends) {
            self.points[at].position = edges.vertex(vertex);
        }
        self.make_triangles();
    }

    /// The triangles.
    pub fn triangles(&self) -> &Micro {
        &self.triangles
    }

    /// Index of point `i` along a side.
    fn on(&self, side: usize, i: usize) -> usize {
        let (u, v) = on_side(side, i as f64);
        let [u, v] = [u as usize, v as usize];
        match side {
            1 => self.count * (self.count + 1) + u,
            3 => v * (self.count + 1) + self.count,
            _ => v * (self.count + 1) + u,
        }
    }

    /// The point that stands for point (i, j): one of the edge's own where it is on a coarser edge.
    fn own(&self, mut i: usize, mut j: usize) -> usize {
        let nearest = |at: usize, coarser: u32| (at + (1 << coarser) / 2) >> coarser << coarser;
        let inside = |at: usize| at > 0 && at < self.count;
        if inside(i) && !inside(j) {
            i = nearest(i, self.coarser[usize::from(j > 0)]);
        } else if inside(j) && !inside(i) {
            j = nearest(j, self.coarser[2 + usize::from(i > 0)]);
        }
        j * (self.count + 1) + i
    }

    fn make_triangles(&mut self) {
        let mut made = std::mem::take(&mut self.triangles);
        made.positions.clear();
        made.normals.clear();
        for j in 0..self.count {
            for i in 0..self.count {
                let [a, b, c, d] = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| self.own(i + x, j + y));
                for corners in [[a, b, d], [a, d, c]] {
                    // Points coincide at poles and at coarser edges.
                    let [p, q, r] = corners.map(|at| self.points[at].position);
                    if p != q && q != r && r != p {
                        made.positions.push([p, q, r]);
                        made.normals.push(corners.map(|at| self.points[at].normal.as_vec3()));
                    }
                }
            }
        }
        self.triangles = made;
    }
}
