//! A survey of all triangles of a mesh that is built in chunks: the numbers of kept and dropped triangles, the parts,
//! and a histogram over a grid.

use super::batch::Batch;
use super::edges::Edges;
use super::origin::{self, Fates};
use crate::base::error::Result;
use crate::base::memory;
use crate::base::progress::Cancel;
use crate::math::Bounds;
use crate::structure::Par;
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Number of cells of the grid along each axis.
pub const SIDE: usize = 64;

/// Number of batches that are processed in parallel. It is not the number of threads, on which the order of the written
/// batches would then depend.
pub const TOGETHER: usize = 8;

/// Approximate number of triangles that are sampled to judge their shape.
const SAMPLES: u64 = 1 << 16;

/// The batches of a mesh, or of a part of it.
pub trait Batches: Sync {
    /// Number of batches.
    fn len(&self) -> usize;
    /// Returns a batch.
    fn batch(&self, index: usize) -> Result<Cow<'_, Batch>>;
    /// Total number of triangles.
    fn triangles(&self) -> u64;
    /// The point that stored positions are relative to.
    fn origin(&self) -> DVec3;
    /// Bounds, relative to the origin, that contain the middles of all triangles.
    fn bounds(&self) -> Bounds;
}

/// A grid of cubes over a box.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    low: Vec3,
    /// Number of cells per unit of length, on all axes.
    scale: f32,
}

impl Grid {
    /// A grid over `bounds`.
    pub fn over(bounds: &Bounds) -> Self {
        // Halves first: the difference of two finite numbers may be infinite.
        let half = (bounds.max * 0.5 - bounds.min * 0.5).max_element();
        let scale = if half > 0.0 { (SIDE as f32 * 0.5 / half).min(f32::MAX) } else { 0.0 };
        Self { low: bounds.min, scale }
    }

    /// The cell of a point, on each axis. A point outside of the grid belongs to the nearest cell.
    #[inline]
    pub fn cell(&self, point: Vec3) -> [usize; 3] {
        let at = (point - self.low) * self.scale;
        at.to_array().map(|x| (x as usize).min(SIDE - 1))
    }
}

/// Index of a cell.
#[inline]
pub fn index([x, y, z]: [usize; 3]) -> usize {
    (z * SIDE + y) * SIDE + x
}

/// The middle of a triangle's box.
#[inline]
pub fn middle([a, b, c]: &[Vec3; 3]) -> Vec3 {
    a.min(*b).min(*c) * 0.5 + a.max(*b).max(*c) * 0.5
}

/// Bounds, number and edges of the triangles of one part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OfPart {
    /// Bounds relative to the origin.
    pub bounds: Bounds,
    /// Number of triangles.
    pub count: u64,
    /// Edges, also of dropped triangles without area.
    pub edges: Edges,
}

impl OfPart {
    /// No triangles.
    pub const NONE: Self = Self { bounds: Bounds::EMPTY, count: 0, edges: Edges::NONE };

    /// Dropped triangles without area, of which only the edges count.
    pub fn flat(edges: Edges) -> Self {
        Self { edges, ..Self::NONE }
    }

    /// Adds this to the entry of `part` in `all`.
    pub fn add_to(self, all: &mut BTreeMap<u32, OfPart>, part: u32) {
        let sum = all.entry(part).or_insert(OfPart::NONE);
        sum.bounds = sum.bounds.union(self.bounds);
        sum.count += self.count;
        sum.edges.add(self.edges);
    }
}

/// Result of a survey.
pub struct Survey {
    /// Numbers of kept and dropped triangles.
    pub fates: Fates,
    /// Entries of the parts that have triangles.
    pub parts: BTreeMap<u32, OfPart>,
    /// The grid.
    pub grid: Grid,
    /// Number of triangles in each cell.
    pub histogram: Vec<u32>,
    /// Some triangles, evenly distributed over the input.
    pub samples: Vec<[Vec3; 3]>,
}

/// Result for one batch.
struct Found {
    fates: Fates,
    parts: Vec<(u32, OfPart)>,
    cells: Vec<u32>,
    samples: Vec<[Vec3; 3]>,
}

/// Surveys all triangles of `source`. Calls `seen` with the number of triangles so far.
pub fn survey(source: &dyn Batches, par: &Par, cancel: &Cancel, mut seen: impl FnMut(u64)) -> Result<Survey> {
    let grid = Grid::over(&source.bounds());
    let mut all = Survey {
        fates: Fates::default(),
        parts: BTreeMap::new(),
        grid,
        histogram: vec![0; SIDE * SIDE * SIDE],
        samples: Vec::new(),
    };
    let step = (source.triangles() / SAMPLES).max(1) as usize;
    let mut before = 0;
    for first in (0..source.len()).step_by(TOGETHER) {
        cancel.check()?;
        let found = par.map(TOGETHER.min(source.len() - first), |i| -> Result<Found> {
            Ok(look(&*source.batch(first + i)?, source.origin(), &grid, step))
        });
        for found in found {
            let found = found?;
            before += found.fates.kept + found.fates.degenerate + found.fates.out_of_range;
            all.add(found)?;
        }
        seen(before);
    }
    Ok(all)
}

fn look(batch: &Batch, origin: DVec3, grid: &Grid, step: usize) -> Found {
    let (mut parts, mut cells, mut samples): (Vec<(u32, OfPart)>, _, _) = (Vec::new(), Vec::new(), Vec::new());
    let mut flat = origin::Flat::new();
    let keep = |i: usize, triangle: [Vec3; 3]| {
        let part = batch.parts[i];
        let here = Bounds::of(&triangle);
        let edges = Edges::of(origin, triangle.map(Vec3::as_dvec3));
        match parts.last_mut() {
            Some((last, of)) if *last == part => {
                of.bounds = of.bounds.union(here);
                of.count += 1;
                of.edges.add(edges);
            }
            _ => parts.push((part, OfPart { bounds: here, count: 1, edges })),
        }
        cells.push(index(grid.cell(middle(&triangle))) as u32);
        if (batch.prims[i] as usize).is_multiple_of(step) {
            samples.push(triangle);
        }
    };
    let fates = origin::visit_all(batch, origin, keep, |i, triangle| {
        flat.entry(batch.parts[i]).or_default().add(Edges::of(origin, triangle.map(Vec3::as_dvec3)));
    });
    parts.extend(flat.into_iter().map(|(part, edges)| (part, OfPart::flat(edges))));
    Found { fates, parts, cells, samples }
}

impl Survey {
    fn add(&mut self, found: Found) -> Result<()> {
        memory::make_room(&mut self.samples, found.samples.len(), "samples of the triangles")?;
        self.fates = self.fates.and(&found.fates);
        found.parts.into_iter().for_each(|(part, of)| of.add_to(&mut self.parts, part));
        found.cells.iter().for_each(|&cell| self.histogram[cell as usize] += 1);
        self.samples.extend(found.samples);
        Ok(())
    }
}
