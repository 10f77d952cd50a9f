//! `mandelbulb`: a closed mesh with detail at every scale.
//!
//! **Field.** For a point c the orbit z ← z⁸ + c begins at z = c, where in spherical coordinates
//! z⁸ = r⁸ (sin 8θ cos(8φ + s), sin 8θ sin(8φ + s), cos 8θ), with θ measured from the z axis.
//! The derivative follows d ← 8 r⁷ d + 1, beginning with d = 1. When r exceeds 8, the distance to the set is about
//! DE = ½ r ln r / d. If r stays below 8 for 12 steps, or d exceeds 1000 / h, DE = 0. The phase s is 0 for seed 0 (the
//! well-known bulb), else a number in (0, 2π) from the seed.
//!
//! **Surface.** The surface is the set DE = h, for a grid of cubes of edge h: a finer grid shows finer detail, as in
//! the models of Áfra, "Interactive Ray Tracing of Large Models Using Voxel Hierarchies", 2012, which are isosurfaces
//! of the same fractal made by another program. The number of triangles grows as h to the power of about −2.5. Z is up;
//! the bulb is within 1.3 of the origin.
//!
//! **Mesh.** The method is dual contouring without normals. Each cell has one vertex for each polygon that the surface
//! forms in it, the mean of the crossings of its edges. Each crossed grid edge becomes a quadrilateral of the four
//! cells around it. Each of the two segments of a face with alternating signs gets a vertex of its own. By this
//! construction every edge of the mesh has exactly two triangles; Nielson, "Dual Marching Cubes", 2004, has edges with
//! four there. A quadrilateral is split along the diagonal that minimises its larger half. If that half exceeds 0.53
//! h², the quadrilateral becomes a fan around its centre, and triangles that are still too large are divided into
//! three, which keeps their edges.
//!
//! **Speed and memory.** The grid is sampled in layers of 8 grid planes. Whole blocks, down to 2³ points, are skipped
//! if the distance estimate or ball arithmetic proves their side. Two layers are in memory at a time.
//!
//! **Count.** h is solved for by counting coarser meshes, then a sample of the bricks of the target mesh.

mod cells;
mod count;
mod faces;
mod field;
mod grid;
mod lanes;
mod table;

use super::{GenerateOptions, Target, rng::Rng};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::import::{MaterialDesc, PartDesc, UpAxis};
use cells::CellSlab;
use faces::{Joiner, SlabMesh};
use grid::Grid;

/// Generates the mesh into `target` as one part.
pub(super) fn generate(options: &GenerateOptions, cancel: &Cancel, target: &mut dyn Target) -> Result<()> {
    let phase = phase(options.seed);
    let h = count::cell_size(options.triangles, phase, cancel)?;
    target.units(None, UpAxis::Z)?;
    let material = target
        .material(MaterialDesc { colour: [0.55, 0.33, 0.18], opacity: 1.0, metalness: 0.0, roughness: 0.5 }, "bulb")?;
    let part = PartDesc { id: Some(1), name: "mandelbulb".into(), parent: None, material: Some(material) };
    let part = target.part(part)?;
    let grid = Grid::new(h, phase);
    let mut below = SlabMesh::default();
    each_slab(&grid, 0..grid.bricks, cancel, |mesh| {
        if mesh.end() > u64::from(u32::MAX >> 1) {
            return Err(Error::bad_argument("mandelbulb: the model has more than 2^31 vertices"));
        }
        let at = |v: u32| {
            let from = if u64::from(v) < mesh.base { &below } else { &mesh };
            from.vertices[(u64::from(v) - from.base) as usize]
        };
        target.indexed(part, &mesh.vertices, &mesh.faces, &at)?;
        below = mesh;
        Ok(())
    })
}

/// Returns the phase of the azimuth for a seed.
fn phase(seed: u64) -> f64 {
    if seed == 0 { 0.0 } else { Rng::new(seed).unit() * std::f64::consts::TAU }
}

/// Meshes the given layers in ascending order and calls `each` with each layer's mesh.
fn each_slab(
    grid: &Grid,
    layers: std::ops::Range<usize>,
    cancel: &Cancel,
    mut each: impl FnMut(SlabMesh) -> Result<()>,
) -> Result<()> {
    let mut slab = grid.slab(layers.start, cancel)?;
    let mut cells_below = CellSlab::empty();
    let mut below = SlabMesh::default();
    for layer in layers {
        let above = grid.slab(layer + 1, cancel)?;
        let cells = CellSlab::new(grid, layer, &slab, &above);
        let joiner = Joiner { cells: &cells, cells_below: &cells_below, below: &below, h: grid.h };
        let mesh = joiner.mesh();
        below = SlabMesh { base: mesh.base, vertices: mesh.vertices.clone(), faces: Vec::new() };
        each(mesh)?;
        (slab, cells_below) = (above, cells);
    }
    Ok(())
}
