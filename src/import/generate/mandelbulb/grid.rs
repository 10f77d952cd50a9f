//! The field sampled on a uniform grid, one slab of bricks at a time, near the surface only.
//!
//! The value at a grid point depends only on the grid: it is the field's value, or a constant where a bound shows that
//! the surface is far. All cells therefore agree about their shared corners, whatever is skipped, and the resulting
//! mesh is closed.

use super::super::rng::Rng;
use super::field::Field;
use crate::base::error::Result;
use crate::base::progress::Cancel;
use rayon::prelude::*;

/// Grid points along a brick's edge.
pub const BRICK: usize = 8;
/// Grid points in a brick.
pub const BRICK_POINTS: usize = BRICK * BRICK * BRICK;
/// Bricks along the edge of a tile, the coarsest block that is skipped as a whole.
const TILE: usize = 8;
/// Radius around the origin that contains the set; beyond it every orbit escapes (2^(1/7)).
const RADIUS: f64 = 1.1041;
/// Value of the distance estimate at the surface, in cells.
const ISO_CELLS: f64 = 1.0;

/// A cube of cells of edge `h` around the origin.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Edge of a cell.
    pub h: f64,
    /// Bricks along each edge of the cube.
    pub bricks: usize,
    origin: f64,
    field: Field,
}

/// Position of a block of grid points relative to the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Block {
    Outside,
    Inside,
    Unknown,
}

impl Grid {
    /// Creates a grid of cells of edge `h` that contains the whole surface with a margin.
    pub fn new(h: f64, phase: f64) -> Self {
        let field = Field::new(h, ISO_CELLS, phase);
        let cells = 2.0 * (RADIUS + 4.0 * ISO_CELLS * h) / h + 4.0;
        let bricks = (cells / BRICK as f64).ceil() as usize;
        let origin = -0.5 * h * (bricks * BRICK - 1) as f64;
        Self { h, bricks, origin, field }
    }

    /// Returns the coordinate of the grid line `i`, which is the same along each axis.
    pub fn line(&self, i: usize) -> f64 {
        self.origin + self.h * i as f64
    }

    /// Classifies a block of `size`³ points by the bounds, given the field's value at its centre.
    fn block(&self, center: [f32; 3], value: f32, size: usize) -> Block {
        let radius = (0.5 * self.h * (size - 1) as f64 * 3f64.sqrt()) as f32;
        if self.field.ball_is_outside(value, radius) {
            Block::Outside
        } else if value < 0.0 && self.field.ball_is_inside(center, radius) {
            Block::Inside
        } else {
            Block::Unknown
        }
    }

    /// Returns the centre of the block of `size`³ points that begins at `low`.
    fn middle(&self, low: [usize; 3], size: usize) -> [f32; 3] {
        low.map(|i| (self.line(i) + 0.5 * self.h * (size - 1) as f64) as f32)
    }

    /// Returns the value of points that are outside and far from the surface.
    fn far_outside(&self) -> f32 {
        self.h as f32
    }

    /// Returns the value of points that are inside.
    fn inside(&self) -> f32 {
        -self.field.iso
    }

    /// Samples one brick. If all its points are on one side of the surface, returns that side as the error.
    fn sample_brick(&self, brick: [usize; 3]) -> std::result::Result<Box<[f32; BRICK_POINTS]>, Block> {
        let mut values = Box::new([0.0; BRICK_POINTS]);
        self.sample_block(brick.map(|b| b * BRICK), [0; 3], BRICK / 2, &mut values);
        let inside = values.iter().filter(|v| **v < 0.0).count();
        match inside {
            0 => Err(Block::Outside),
            BRICK_POINTS => Err(Block::Inside),
            _ => Ok(values),
        }
    }

    /// Samples the eight blocks of `size`³ points from `at`, and halves them until the bounds classify them.
    fn sample_block(&self, low: [usize; 3], at: [usize; 3], size: usize, values: &mut [f32; BRICK_POINTS]) {
        let part = |octant: usize| -> [usize; 3] { std::array::from_fn(|a| at[a] + size * (octant >> a & 1)) };
        let middles: [[f32; 3]; 8] = std::array::from_fn(|octant| {
            let p = part(octant);
            self.middle(std::array::from_fn(|a| low[a] + p[a]), size)
        });
        let found = self.field.values(&middles);
        for octant in 0..8 {
            let part = part(octant);
            if size == 1 {
                values[point_index(part)] = found[octant].min(self.far_outside());
                continue;
            }
            let known = match self.block(middles[octant], found[octant], size) {
                Block::Unknown => {
                    self.sample_block(low, part, size / 2, values);
                    continue;
                }
                Block::Outside => self.far_outside(),
                Block::Inside => self.inside(),
            };
            for i in 0..size * size * size {
                let p = [part[0] + i % size, part[1] + i / size % size, part[2] + i / size / size];
                values[point_index(p)] = known;
            }
        }
    }

    /// Finds the bricks of `layer` in one tile that the bounds do not classify, and those that are inside.
    fn scan_tile(&self, low: [usize; 3], size: usize, layer: usize, found: &mut Vec<([usize; 2], Block)>) {
        if low[0] >= self.bricks || low[1] >= self.bricks {
            return;
        }
        let middle = self.middle(low.map(|b| b * BRICK), size * BRICK);
        let known = self.block(middle, self.field.value(middle), size * BRICK);
        if known == Block::Outside {
            return;
        }
        if known == Block::Inside || size == 1 {
            let range = |a: usize| low[a]..(low[a] + size).min(self.bricks);
            for y in range(1) {
                found.extend(range(0).map(|x| ([x, y], known)));
            }
            return;
        }
        let half = size / 2;
        let z = if layer < low[2] + half { low[2] } else { low[2] + half };
        for q in 0..4 {
            self.scan_tile([low[0] + half * (q & 1), low[1] + half * (q >> 1), z], half, layer, found);
        }
    }

    /// Returns the bricks of `layer` that the bounds do not classify as outside, in a fixed order.
    fn scan(&self, layer: usize, cancel: &Cancel) -> Vec<([usize; 2], Block)> {
        let tiles = self.bricks.div_ceil(TILE);
        (0..tiles * tiles)
            .into_par_iter()
            .flat_map_iter(|t| {
                let mut found = Vec::new();
                let low = [t % tiles * TILE, t / tiles * TILE, layer / TILE * TILE];
                if !cancel.is_cancelled() {
                    self.scan_tile(low, TILE, layer, &mut found);
                }
                found
            })
            .collect()
    }

    /// Counts the grid edges that the surface crosses, inside a sample of about one in `one_in` of the layer's bricks.
    pub fn crossed_edges(&self, layer: usize, one_in: u64, cancel: &Cancel) -> Result<u64> {
        let chosen = |b: &[usize; 2]| {
            let place = ((layer as u64) << 42) | ((b[1] as u64) << 21) | b[0] as u64;
            Rng::new(place).below(one_in) == 0
        };
        let crossed = self
            .scan(layer, cancel)
            .into_par_iter()
            .filter(|(b, known)| *known == Block::Unknown && chosen(b) && !cancel.is_cancelled())
            .map(|([x, y], _)| self.sample_brick([x, y, layer]).map_or(0, |v| crossed_inside(&v)))
            .sum();
        cancel.check()?;
        Ok(crossed)
    }

    /// Samples the bricks at height `layer`, in bricks. The result does not depend on the number of threads.
    pub fn slab(&self, layer: usize, cancel: &Cancel) -> Result<Slab> {
        let n = self.bricks;
        let mut slab = Slab {
            bricks: n,
            kinds: vec![Slab::OUTSIDE; n * n],
            values: Vec::new(),
            outside: self.far_outside(),
            inside: self.inside(),
        };
        if layer >= n {
            return Ok(slab);
        }
        let found = self.scan(layer, cancel);
        let sampled: Vec<_> = found
            .into_par_iter()
            .map(|([x, y], known)| match known {
                Block::Unknown if !cancel.is_cancelled() => ([x, y], self.sample_brick([x, y, layer])),
                side => ([x, y], Err(side)),
            })
            .collect();
        cancel.check()?;
        for ([x, y], brick) in sampled {
            slab.kinds[y * n + x] = match brick {
                Ok(values) => {
                    slab.values.push(values);
                    slab.values.len() as u32 - 1
                }
                Err(Block::Inside) => Slab::INSIDE,
                Err(_) => Slab::OUTSIDE,
            };
        }
        Ok(slab)
    }
}

/// Returns the index of a point in its brick.
fn point_index(p: [usize; 3]) -> usize {
    (p[2] * BRICK + p[1]) * BRICK + p[0]
}

/// Counts the grid edges between points of one brick that the surface crosses.
fn crossed_inside(values: &[f32; BRICK_POINTS]) -> u64 {
    let inside = |p| values[point_index(p)] < 0.0;
    let crossed = |i: usize| {
        let p = [i % BRICK, i / BRICK % BRICK, i / BRICK / BRICK];
        (0..3)
            .filter(|&a| {
                let mut next = p;
                next[a] += 1;
                next[a] < BRICK && inside(next) != inside(p)
            })
            .count() as u64
    };
    (0..BRICK_POINTS).map(crossed).sum()
}

/// One layer of bricks.
pub struct Slab {
    bricks: usize,
    /// Kind of each brick: an index into `values`, or one of the two constants.
    kinds: Vec<u32>,
    #[allow(clippy::vec_box)] // 2 KB each, made in parallel: boxes are moved, not copied
    values: Vec<Box<[f32; BRICK_POINTS]>>,
    outside: f32,
    inside: f32,
}

impl Slab {
    const OUTSIDE: u32 = u32::MAX;
    const INSIDE: u32 = u32::MAX - 1;

    /// Returns the kind of a brick; bricks beyond the grid are outside.
    pub fn kind(&self, x: usize, y: usize) -> u32 {
        if x < self.bricks && y < self.bricks { self.kinds[y * self.bricks + x] } else { Self::OUTSIDE }
    }

    /// True if all values of bricks of this kind are the same constant.
    pub fn is_uniform(kind: u32) -> bool {
        kind >= Self::INSIDE
    }

    /// Returns the value at point `p` of a brick of this kind.
    pub fn value(&self, kind: u32, p: [usize; 3]) -> f32 {
        match kind {
            Self::OUTSIDE => self.outside,
            Self::INSIDE => self.inside,
            index => self.values[index as usize][point_index(p)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_points_have_the_sign_of_the_field() {
        for (h, phase) in [(0.03, 0.0), (0.012, 2.0)] {
            let grid = Grid::new(h, phase);
            let mut wrong = 0;
            for layer in 0..grid.bricks {
                let slab = grid.slab(layer, &Cancel::new()).unwrap();
                let bad = |i: usize| {
                    let (x, y) = (i % grid.bricks, i / grid.bricks);
                    let kind = slab.kind(x, y);
                    (0..BRICK_POINTS)
                        .filter(|&p| {
                            let p = [p % BRICK, p / BRICK % BRICK, p / BRICK / BRICK];
                            let at = [x * BRICK + p[0], y * BRICK + p[1], layer * BRICK + p[2]];
                            let value = grid.field.value(at.map(|i| grid.line(i) as f32));
                            (value < 0.0) != (slab.value(kind, p) < 0.0)
                        })
                        .count()
                };
                wrong += (0..grid.bricks * grid.bricks).into_par_iter().map(bad).sum::<usize>();
            }
            assert_eq!(wrong, 0, "at h = {h}");
        }
    }
}
