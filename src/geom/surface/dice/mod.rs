//! Dicing: triangles that follow a surface, without cracks.
//!
//! A surface is a set of quads, each a patch over the unit square. Each edge of a quad has its own number of segments,
//! a power of two that depends on the edge alone, so that both sides of it have the same. A quad is a grid as fine as
//! its finest edge, or finer where its inside requires it; the rows of the grid at a coarser edge collapse to the
//! points of that edge. Points on edges and corners are the mean of the points that their quads have there: both sides
//! of an edge have the same points to the last bit, also where a displacement differs between them.

mod bicubic;
mod dicer;
mod edges;
mod levels;
mod quad;
#[cfg(test)]
mod dicer_tests;
#[cfg(test)]
mod tests;

use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use glam::{DVec3, Vec3};

pub use bicubic::{BicubicPatch, Interval, intervals};
pub use dicer::{Dicer, Tile};

/// The highest [`Dicing::level`]: 4096 segments along a side.
pub const MOST_LEVEL: u32 = 12;

/// How finely surfaces are diced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dicing {
    /// Each quad has 2^level segments along each side.
    Level(u32),
    /// The sampled distance between surface and triangles is about this at most, in units of the surface, or some
    /// roundings of its coordinates. Sides have at most 2^[`MOST_LEVEL`] segments. Where the quads at an edge differ,
    /// as displaced ones do at creases, the cells beside the edge bend to the mean and are farther off.
    Tolerance(f64),
}

impl Dicing {
    /// Fails with `BadArgument` if the level or the tolerance is out of its range.
    pub fn check(&self) -> Result<()> {
        match *self {
            Self::Level(level) if level > MOST_LEVEL => {
                Err(Error::BadArgument(format!("level {level} is above {MOST_LEVEL}")))
            }
            Self::Tolerance(tolerance) if !(tolerance.is_finite() && tolerance > 0.0) => {
                Err(Error::bad_argument("tolerance must be finite and above 0"))
            }
            _ => Ok(()),
        }
    }

    /// A tolerance is at least `least`.
    fn at_least(self, least: f64) -> Self {
        match self {
            Self::Tolerance(tolerance) => Self::Tolerance(tolerance.max(least)),
            level => level,
        }
    }
}

/// An edge of a quad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Side {
    /// Number of the edge, the same for all quads that share it.
    pub edge: u32,
    /// True if the quad's parameter falls along the direction of the edge.
    pub is_reversed: bool,
}

/// A point of a surface with its unit normal; zero where there is none.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sample {
    /// The point.
    pub position: DVec3,
    /// The normal.
    pub normal: DVec3,
}

/// A surface as a set of quads over the unit square, which threads share.
pub trait Quads: Sync {
    /// Number of quads.
    fn count(&self) -> usize;
    /// Number of vertices: corners of quads that are numbered from 0.
    fn vertices(&self) -> usize;
    /// Number of edges.
    fn edges(&self) -> usize;
    /// The vertices at (0, 0), (1, 0), (0, 1) and (1, 1). A side between equal vertices is a point, as at poles.
    fn corners(&self, quad: usize) -> [u32; 4];
    /// The edges at v = 0 and v = 1, along u, and those at u = 0 and u = 1, along v.
    fn sides(&self, quad: usize) -> [Side; 4];
    /// The point at (u, v).
    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample;
    /// The points of a quad, to the bit those of [`Self::sample`]. Surfaces that prepare a quad before they evaluate it
    /// do so once.
    fn sampler(&self, quad: usize) -> impl Fn(f64, f64) -> Sample {
        move |u, v| self.sample(quad, u, v)
    }
    /// The lowest level of a quad and of its sides that a tolerance may choose.
    fn least_level(&self, _quad: usize) -> u32 {
        0
    }
    /// True if most squares of quads, small ones at least, are parts of bicubic patches.
    fn has_bicubics(&self) -> bool {
        false
    }
    /// The bicubic patch that a square of a quad is a part of, by the level, the column and the row of the square in
    /// the quad; `None` if it is not a part of one. Its points are those of [`Self::sample`] but for rounding.
    fn bicubic(&self, _quad: usize, _place: [u32; 3]) -> Option<BicubicPatch> {
        None
    }
    /// True if some cells of a quad tell nothing of those between them.
    fn is_rough(&self) -> bool {
        false
    }
}

/// Triangles of a quad.
#[derive(Debug, Default)]
pub struct Micro {
    /// Their corners.
    pub positions: Vec<[DVec3; 3]>,
    /// The normals at the corners.
    pub normals: Vec<[Vec3; 3]>,
}

impl Micro {
    fn clear(&mut self) {
        self.positions.clear();
        self.normals.clear();
    }
}

/// Dices a surface. `emit` receives the triangles of each quad, in ascending order and some thousand at a time,
/// counter-clockwise along the normals. Fails with its errors, with `BadArgument` as [`Dicing::check`], and with
/// `Cancelled`.
///
/// Memory is that of the vertices (24 bytes each), of the edges (some 30), and of the sides and two rows of a quad.
pub fn dice<Q: Quads>(
    surface: &Q,
    dicing: Dicing,
    cancel: &Cancel,
    emit: &mut dyn FnMut(usize, &Micro) -> Result<()>,
) -> Result<()> {
    let (dicer, mut micro) = (Dicer::new(surface, dicing, cancel)?, Micro::default());
    (0..surface.count()).try_for_each(|at| quad::dice(&dicer, at, cancel, &mut micro, emit))
}
