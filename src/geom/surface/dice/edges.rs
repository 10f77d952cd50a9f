//! The points on the edges and corners of a surface, which all quads around share.

use super::{Dicing, Quads, Side, levels};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use glam::DVec3;

/// The vertices of a surface, and the levels and quads of its edges.
pub struct Edges {
    vertices: Vec<DVec3>,
    levels: Vec<u8>,
    /// Index of the first use of each edge, and their number.
    firsts: Vec<u32>,
    uses: Vec<Use>,
}

/// A side of a quad, as a use of an edge.
#[derive(Clone, Copy, Default)]
struct Use {
    quad: u32,
    which: u8,
    is_reversed: bool,
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

impl Use {
    /// The points at parameters of the edge.
    fn curve<Q: Quads>(self, surface: &Q) -> impl Fn(f64) -> DVec3 {
        let sample = surface.sampler(self.quad as usize);
        move |t| {
            let (u, v) = on_side(self.which.into(), if self.is_reversed { 1.0 - t } else { t });
            sample(u, v).position
        }
    }
}

impl Edges {
    /// Those of all quads, and the dicing that their coordinates allow. Fails with `Cancelled`.
    pub fn of<Q: Quads>(surface: &Q, dicing: Dicing, cancel: &Cancel) -> Result<(Self, Dicing)> {
        let vertices = means_of_corners(surface, cancel)?;
        // Distances below some roundings of the coordinates are noise that no level makes smaller.
        let greatest = vertices.iter().map(|it| it.abs().max_element()).fold(0.0, f64::max);
        let dicing = dicing.at_least(ROUNDINGS * f64::EPSILON * greatest);
        let mut firsts = vec![0u32; surface.edges() + 1];
        each_side(surface, cancel, |_, _, side| firsts[side.edge as usize + 1] += 1)?;
        for i in 1..firsts.len() {
            firsts[i] += firsts[i - 1];
        }
        let mut next = firsts.clone();
        let mut uses = vec![Use::default(); firsts.last().copied().unwrap_or(0) as usize];
        each_side(surface, cancel, |quad, which, side| {
            let at = &mut next[side.edge as usize];
            uses[*at as usize] = Use { quad: quad as u32, which: which as u8, is_reversed: side.is_reversed };
            *at += 1;
        })?;
        let mut edges = Self { vertices, levels: vec![0; surface.edges()], firsts, uses };
        edges.find_levels(surface, dicing, cancel)?;
        Ok((edges, dicing))
    }

    /// Finds the level of each edge: the highest that any of its quads requires.
    fn find_levels<Q: Quads>(&mut self, surface: &Q, dicing: Dicing, cancel: &Cancel) -> Result<()> {
        for edge in 0..self.levels.len() as u32 {
            cancel.check()?;
            let of_use = |it: &Use| {
                let [from, to] = ENDS[usize::from(it.which)].map(|end| surface.corners(it.quad as usize)[end]);
                if from == to {
                    return 0;
                }
                let least = surface.least_level(it.quad as usize);
                levels::of_edge(&it.curve(surface), least, dicing)
            };
            self.levels[edge as usize] = self.uses_of(edge).iter().map(of_use).max().unwrap_or(0) as u8;
        }
        Ok(())
    }

    fn uses_of(&self, edge: u32) -> &[Use] {
        &self.uses[self.firsts[edge as usize] as usize..self.firsts[edge as usize + 1] as usize]
    }

    /// The level of an edge.
    pub fn level(&self, edge: u32) -> u32 {
        u32::from(self.levels[edge as usize])
    }

    /// The points number `first` to `last` of a side's 2^level segments, in the direction of the quad's parameter.
    /// Those at the ends, which are the vertices `ends`, are the means of all quads around; those between them are the
    /// means of the quads at the edge. All are summed in the order of these quads, hence have the same bits for each of
    /// them.
    pub fn points<Q: Quads>(
        &self,
        surface: &Q,
        side: Side,
        ends: [u32; 2],
        [first, last]: [usize; 2],
    ) -> impl Iterator<Item = DVec3> {
        let count = 1usize << self.level(side.edge);
        let curves: Vec<_> = self.uses_of(side.edge).iter().map(|it| it.curve(surface)).collect();
        (first..=last).map(move |i| match i {
            0 => self.vertices[ends[0] as usize],
            i if i == count => self.vertices[ends[1] as usize],
            i => {
                let t = (if side.is_reversed { count - i } else { i }) as f64 / count as f64;
                curves.iter().map(|at| at(t)).sum::<DVec3>() / curves.len() as f64
            }
        })
    }
}

/// Number of roundings of the greatest coordinate below which distances are noise.
const ROUNDINGS: f64 = 16.0;

fn each_side<Q: Quads>(surface: &Q, cancel: &Cancel, mut each: impl FnMut(usize, usize, Side)) -> Result<()> {
    for quad in 0..surface.count() {
        cancel.check()?;
        surface.sides(quad).into_iter().enumerate().for_each(|(which, side)| each(quad, which, side));
    }
    Ok(())
}

fn means_of_corners<Q: Quads>(surface: &Q, cancel: &Cancel) -> Result<Vec<DVec3>> {
    let mut all = vec![(DVec3::ZERO, 0u32); surface.vertices()];
    for quad in 0..surface.count() {
        cancel.check()?;
        let (sample, places) = (surface.sampler(quad), [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]);
        for (vertex, [u, v]) in surface.corners(quad).into_iter().zip(places) {
            let (sum, count) = &mut all[vertex as usize];
            *sum += sample(u, v).position;
            *count += 1;
        }
    }
    Ok(all.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect())
}
