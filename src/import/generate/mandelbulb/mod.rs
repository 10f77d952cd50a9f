//! `mandelbulb`: a closed mesh with detail at every scale.
//!
//! **Field.** For a point c the orbit z ← z⁸ + c begins at z = c, where in spherical coordinates
//! z⁸ = r⁸ (sin 8θ cos(8φ + s), sin 8θ sin(8φ + s), cos 8θ), θ from the z axis; its derivative runs
//! along as d ← 8 r⁷ d + 1 from d = 1. Where r passes 8, the distance to the set is about
//! DE = ½ r ln r / d; where r stays below for 12 steps, or d passes 1000 / h, DE = 0. The phase s is 0
//! for seed 0 (the well-known bulb), else a number in (0, 2π) from the seed.
//!
//! **Surface.** The set DE = h, for a grid of cubes of edge h: a finer grid shows finer detail, as in
//! the models of Áfra, "Interactive Ray Tracing of Large Models Using Voxel Hierarchies", 2012, which
//! took the isosurface of the same fractal by another program. The number of triangles grows as h to
//! the power of about −2.5. Z is up; the bulb lies within 1.3 of the origin.
//!
//! **Mesh.** Dual contouring without normals: each cell has one vertex for each polygon that the
//! surface makes in it (the mean of the crossings of its edges), each crossed grid edge a
//! quadrilateral of the four cells around. Faces with alternating signs give each of their two
//! segments a vertex of its own. So every edge of the mesh has exactly two triangles, by
//! construction (Nielson, "Dual Marching Cubes", 2004, has edges of four there). A quadrilateral is
//! cut along the diagonal with the smaller larger half; if that is above 0.53 h², it becomes a fan
//! around its middle, and what is still larger thirds: edges stay as they are.
//!
//! **Speed and memory.** Layers of 8 grid planes; in each, blocks are skipped whole where the distance
//! estimate or ball arithmetic tells their side, down to 2³ points. Two layers are held at a time.
//!
//! **Count.** h is solved for by counting coarser meshes, then a sample of the wanted one's bricks.

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

/// Pushes the mesh into `target` as one part.
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
            return Err(Error::bad_argument("mandelbulb: more than 2^31 vertices"));
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

/// The azimuth's phase for a seed.
fn phase(seed: u64) -> f64 {
    if seed == 0 { 0.0 } else { Rng::new(seed).unit() * std::f64::consts::TAU }
}

/// Meshes the given layers from below, handing out each layer's mesh.
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
