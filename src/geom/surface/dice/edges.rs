//! The points on the edges and corners of a surface, which all quads around share.

use super::{Dicing, Quads, Side, levels};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use glam::DVec3;

/// See the module.
pub struct Edges {
    vertices: Vec<DVec3>,
    levels: Vec<u8>,
    /// Index of the first inner point of each edge.
    firsts: Vec<usize>,
    /// The inner points of all edges.
    points: Vec<DVec3>,
}

/// The corners at the ends of each side.
pub const ENDS: [[usize; 2]; 4] = [[0, 1], [2, 3], [0, 2], [1, 3]];

/// A parameter along side `side` of a quad, as (u, v).
pub fn on_side(side: usize, t: f64) -> (f64, f64) {
    match side {
        0 => (t, 0.0),
        1 => (t, 1.0),
        2 => (0.0, t),
        _ => (1.0, t),
    }
}

impl Edges {
    /// Those of all quads. Fails with `Cancelled`.
    pub fn of<Q: Quads>(surface: &Q, dicing: Dicing, cancel: &Cancel) -> Result<Self> {
        let levels = levels_of(surface, dicing, cancel)?;
        let mut firsts = Vec::with_capacity(levels.len() + 1);
        let mut count = 0;
        for level in &levels {
            firsts.push(count);
            count += (1usize << level) - 1;
        }
        let mut edges =
            Self { vertices: means_of_corners(surface, cancel)?, levels, firsts, points: vec![DVec3::ZERO; count] };
        let mut shares = vec![0u32; edges.levels.len()];
        each_side(surface, cancel, |_, _, side| shares[side.edge as usize] += 1)?;
        each_side(surface, cancel, |quad, which, side| {
            let (first, count) = edges.inner(side.edge);
            for i in 0..count {
                let t = parameter(side, i + 1, count + 1);
                let (u, v) = on_side(which, t);
                edges.points[first + i] += surface.sample(quad, u, v).position / f64::from(shares[side.edge as usize]);
            }
        })?;
        Ok(edges)
    }

    /// The level of an edge.
    pub fn level(&self, edge: u32) -> u32 {
        u32::from(self.levels[edge as usize])
    }

    /// The mean of the points that quads have at a vertex.
    pub fn vertex(&self, vertex: u32) -> DVec3 {
        self.vertices[vertex as usize]
    }

    /// Inner point `i`, from 1 on, along a quad's side.
    pub fn point(&self, side: Side, i: usize) -> DVec3 {
        let (first, count) = self.inner(side.edge);
        self.points[first + if side.is_reversed { count - i } else { i - 1 }]
    }

    /// Index of the first inner point, and their number.
    fn inner(&self, edge: u32) -> (usize, usize) {
        (self.firsts[edge as usize], (1 << self.level(edge)) - 1)
    }
}

/// The parameter of a quad at point `i` of `count` segments of an edge.
fn parameter(side: Side, i: usize, count: usize) -> f64 {
    (if side.is_reversed { count - i } else { i }) as f64 / count as f64
}

fn each_side<Q: Quads>(surface: &Q, cancel: &Cancel, mut each: impl FnMut(usize, usize, Side)) -> Result<()> {
    for quad in 0..surface.count() {
        cancel.check()?;
        surface.sides(quad).into_iter().enumerate().for_each(|(which, side)| each(quad, which, side));
    }
    Ok(())
}

/// The level of each edge, by the first quad that has it.
fn levels_of<Q: Quads>(surface: &Q, dicing: Dicing, cancel: &Cancel) -> Result<Vec<u8>> {
    const UNKNOWN: u8 = u8::MAX;
    let mut levels = vec![UNKNOWN; surface.edges()];
    each_side(surface, cancel, |quad, which, side| {
        let level = &mut levels[side.edge as usize];
        if *level == UNKNOWN {
            let [from, to] = ENDS[which].map(|end| surface.corners(quad)[end]);
            if from == to {
                *level = 0;
                return;
            }
            let at = |t: f64| {
                let (u, v) = on_side(which, t);
                surface.sample(quad, u, v).position
            };
            *level = levels::of_edge(&at, surface.least_level(quad), dicing) as u8;
        }
    })?;
    // Edges of no quad.
    levels.iter_mut().filter(|it| **it == UNKNOWN).for_each(|it| *it = 0);
    Ok(levels)
}

fn means_of_corners<Q: Quads>(surface: &Q, cancel: &Cancel) -> Result<Vec<DVec3>> {
    let mut all = vec![(DVec3::ZERO, 0u32); surface.vertices()];
    for quad in 0..surface.count() {
        cancel.check()?;
        for (vertex, [u, v]) in surface.corners(quad).into_iter().zip([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
        {
            let (sum, count) = &mut all[vertex as usize];
            *sum += surface.sample(quad, u, v).position;
            *count += 1;
        }
    }
    Ok(all.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect())
}
