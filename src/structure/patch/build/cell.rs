//! The content of a child: its box, and the voxel and slabs of everything below.

use crate::lod::{
    Coded, Content, Facet, Fill, Middle, OrientedSlabs, SIDES_WORDS, Voxel, fields, normal_bytes, oriented_slabs,
};
use crate::math::Bounds;
use crate::structure::patch::layout::{LONG_VOXEL, SHORT_VOXEL};
use glam::Vec3;

/// See the module.
#[derive(Debug, Clone)]
pub struct Cell {
    /// The box.
    pub bounds: Bounds,
    voxel: Voxel,
    coded: Coded,
    slabs: OrientedSlabs<f32>,
    fill: Fill,
}

impl Cell {
    fn new(bounds: Bounds, voxel: Voxel, content: &Content) -> Self {
        let cell = Middle::of(&bounds);
        let coded = Coded::of(&voxel, &cell, content, true);
        let slabs = oriented_slabs(fields(coded.slabs), normal_bytes(coded.words[0]), &cell);
        Self { bounds, voxel, coded, slabs, fill: Fill::of(content, &bounds) }
    }

    /// A cell of triangles with the indices of their corners in `points`; `facets`, at least one, give its look.
    pub fn of_triangles(points: Vec<Vec3>, triangles: Vec<[u16; 3]>, facets: &[Facet]) -> Self {
        let bounds = Bounds::of(&points);
        Self::new(bounds, Voxel::of_leaf(&bounds, facets), &Content::of_triangles(points, triangles))
    }

    /// The cell around up to eight others, at least one.
    pub fn over(cells: &[&Self]) -> Self {
        let bounds = cells.iter().fold(Bounds::EMPTY, |all, one| all.union(one.bounds));
        let voxel = Voxel::over(cells.iter().map(|cell| (&cell.bounds, &cell.voxel)));
        let pieces = cells.iter().map(|cell| (cell.bounds, cell.slabs, cell.fill)).collect();
        Self::new(bounds, voxel, &Content::of_cells(pieces))
    }

    /// Words of the voxel.
    pub fn words(&self) -> usize {
        if self.coded.sides.is_some() { LONG_VOXEL } else { SHORT_VOXEL }
    }

    /// Appends the words of the voxel.
    pub fn put(&self, out: &mut Vec<u32>) {
        out.push(self.coded.slabs);
        out.extend(self.coded.words);
        if let Some(sides) = &self.coded.sides {
            // The second word numbers the voxel in other structures.
            let second = out.len() - SHORT_VOXEL + 2;
            out[second] = 0;
            out.extend::<[u32; SIDES_WORDS]>(**sides);
        }
    }

    /// Second word of its sample: colour and cover.
    pub fn second(&self) -> u32 {
        self.coded.words[1]
    }
}
