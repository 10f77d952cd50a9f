//! Points of a diced surface: those of any block of a quad's grid, which depend on nothing but the grid.

use super::edges::{ENDS, Edges, on_side};
use super::{Dicing, Quads, Sample, levels};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use glam::{DVec3, Vec3};

/// A surface with the levels of its edges, from which threads take tiles in any order. Their points are to the bit the
/// corners of the triangles that [`dice`](super::dice) makes.
pub struct Dicer<'a, Q> {
    surface: &'a Q,
    dicing: Dicing,
    edges: Edges,
}

/// Samples of a square of a quad's grid, in rows of constant v, with u ascending within a row.
#[derive(Debug, Clone, Default)]
pub struct Tile {
    /// The points.
    pub positions: Vec<DVec3>,
    /// Their unit normals; zero where there is none. On edges they are those of the tile's own quad.
    pub normals: Vec<Vec3>,
}

/// A rectangle of a quad's grid.
pub(super) struct Block<F> {
    sample: F,
    /// Number of cells along a side of the grid.
    count: usize,
    /// First and last index in u, and in v.
    ranges: [[usize; 2]; 2],
    /// The part of each side of the grid that is in the rectangle: the means of the quads around. Else empty.
    sides: [Vec<Sample>; 4],
}

impl<'a, Q: Quads> Dicer<'a, Q> {
    /// Finds the levels of all edges, and the means at vertices. Fails with `BadArgument` as [`Dicing::check`], and
    /// with `Cancelled`.
    ///
    /// Memory: 24 bytes for each vertex, some 30 for each edge.
    pub fn new(surface: &'a Q, dicing: Dicing, cancel: &Cancel) -> Result<Self> {
        dicing.check()?;
        let (edges, dicing) = Edges::of(surface, dicing, cancel)?;
        Ok(Self { surface, dicing, edges })
    }

    /// The level of a quad's grid, 1 to [`MOST_LEVEL`](super::MOST_LEVEL). A quad that [`dice`](super::dice) takes as
    /// one cell has four: they meet its sides as they meet coarser edges.
    pub fn level(&self, quad: usize) -> u32 {
        self.level_of_rule(quad).max(1)
    }

    /// The level of a quad's grid that its edges and its inside require.
    pub(super) fn level_of_rule(&self, quad: usize) -> u32 {
        let of_edges = self.surface.sides(quad).into_iter().map(|side| self.edges.level(side.edge)).fold(0, u32::max);
        levels::of_quad(self.surface, quad, of_edges, self.dicing)
    }

    /// The surface.
    pub fn surface(&self) -> &'a Q {
        self.surface
    }

    /// By how many levels the edges at the sides of a quad's grid of a level are coarser.
    pub fn steps(&self, quad: usize, level: u32) -> [u32; 4] {
        self.surface.sides(quad).map(|side| level - self.edges.level(side.edge).min(level))
    }

    /// Fills `out` with the (2^tile_level + 1)² samples of a square of a quad's grid, whose first cell is number
    /// `i << tile_level` along u and `j << tile_level` along v. The grid has 2^level cells along each side; the tile is
    /// within it. `level` is that of [`Self::level`], which is slow to find, or a higher one.
    ///
    /// A tile evaluates its own samples alone, at edges once for each quad around. Neighbours have the same bits on
    /// their common border: positions and normals within a quad, positions between quads.
    pub fn tile(&self, quad: usize, level: u32, tile_level: u32, i: u32, j: u32, out: &mut Tile) {
        self.fill(quad, level, tile_level, [i, j], false, out);
    }

    /// Fills `out` as [`Self::tile`] does, but for the samples inside of the tile, which are zero.
    pub fn border(&self, quad: usize, level: u32, tile_level: u32, i: u32, j: u32, out: &mut Tile) {
        self.fill(quad, level, tile_level, [i, j], true, out);
    }

    fn fill(&self, quad: usize, level: u32, tile_level: u32, at: [u32; 2], is_hollow: bool, out: &mut Tile) {
        debug_assert!(tile_level <= level && at[0].max(at[1]) >> (level - tile_level) == 0, "outside of the grid");
        let ranges = at.map(|at| [at, at + 1].map(|end| (end as usize) << tile_level));
        let (block, [[left, right], [low, high]]) = (self.block(quad, level, ranges), ranges);
        out.positions.clear();
        out.normals.clear();
        for (i, j) in (low..=high).flat_map(|j| (left..=right).map(move |i| (i, j))) {
            let is_inside = i > left && i < right && j > low && j < high;
            let sample = if is_hollow && is_inside { Sample::default() } else { block.at(i, j) };
            out.positions.push(sample.position);
            out.normals.push(sample.normal.as_vec3());
        }
    }

    /// A rectangle of a quad's grid, by the first and last index in u and in v.
    pub(super) fn block(
        &self,
        quad: usize,
        level: u32,
        ranges: [[usize; 2]; 2],
    ) -> Block<impl Fn(f64, f64) -> Sample + use<'_, Q>> {
        let (sample, count) = (self.surface.sampler(quad), 1usize << level);
        let [[left, right], [low, high]] = ranges;
        let is_on = [low == 0, high == count, left == 0, right == count];
        let sides = [0, 1, 2, 3].map(|which| match is_on[which] {
            true => self.side(quad, which, level, ranges[which / 2], &sample),
            false => Vec::new(),
        });
        Block { sample, count, ranges, sides }
    }

    /// The points `first` to `last` of a grid along a side. Where the edge is coarser than the grid, the nearest points
    /// of the edge take the places of those between them.
    fn side(
        &self,
        quad: usize,
        which: usize,
        level: u32,
        [first, last]: [usize; 2],
        sample: &impl Fn(f64, f64) -> Sample,
    ) -> Vec<Sample> {
        let (side, corners) = (self.surface.sides(quad)[which], self.surface.corners(quad));
        let own = self.edges.level(side.edge);
        let step = 1usize << (level - own);
        let nearest = |i: usize| (i + step / 2) / step;
        let range = [first, last].map(nearest);
        let positions = self.edges.points(self.surface, side, ENDS[which].map(|end| corners[end]), range);
        let points: Vec<_> = (range[0]..)
            .zip(positions)
            .map(|(i, position)| {
                let (u, v) = on_side(which, i as f64 / (1usize << own) as f64);
                Sample { position, ..sample(u, v) }
            })
            .collect();
        (first..=last).map(|i| points[nearest(i) - range[0]]).collect()
    }
}

impl<F: Fn(f64, f64) -> Sample> Block<F> {
    /// The samples at index `j` in v.
    pub(super) fn row(&self, j: usize) -> impl Iterator<Item = Sample> {
        (self.ranges[0][0]..=self.ranges[0][1]).map(move |i| self.at(i, j))
    }

    fn at(&self, i: usize, j: usize) -> Sample {
        let (count, [[left, _], [low, _]]) = (self.count, self.ranges);
        match (i, j) {
            (_, 0) => self.sides[0][i - left],
            (_, j) if j == count => self.sides[1][i - left],
            (0, _) => self.sides[2][j - low],
            (i, _) if i == count => self.sides[3][j - low],
            _ => (self.sample)(i as f64 / count as f64, j as f64 / count as f64),
        }
    }
}
