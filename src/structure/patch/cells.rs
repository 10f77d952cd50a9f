//! Data of hits, read from blocks: cells for stand-ins, and triangles.

use super::layout::{Block, Child, Frame, Grids, Voxel, bounds_of, grid_of, of_morton};
use super::trace::{Cell, TreeView, planes_of};
use crate::lod::{Coded, Look, Middle, OrientedSlab, OrientedSlabs, fields, normal_bytes, oriented_slabs, summary_bit};
use crate::math::{Bounds, bits};
use crate::structure::cell::{CellParts, Cells};
use crate::structure::hit::{InFace, StandIn, TriHit};
use glam::{DVec3, Vec3};

/// A cell that was hit.
enum Found<'a> {
    /// The child of a node: its box, its voxel, and the block below if it is another one.
    Child(Bounds, Voxel<'a>, Option<u32>),
    /// A box of a frame's quadtree.
    Frame(Frame<'a>, u32, usize),
}

impl<'a> TreeView<'a> {
    /// See [`crate::structure::Tree::cells`].
    pub fn cells<const N: usize>(
        &self,
        rays: u32,
        hit: impl Fn(usize) -> TriHit,
        dir: impl Fn(usize) -> DVec3,
        _: (bool, u32),
        out: &mut Cells<N>,
    ) -> u32 {
        let mut gone = 0;
        out.clear();
        for i in bits(rays) {
            let Some((cell, found)) = self.cell_at(&hit(i)) else {
                gone |= 1 << i;
                continue;
            };
            out.missing |= u32::from(cell.is_missing) << i;
            out.inside |= u32::from(cell.is_inside) << i;
            // Nothing is known of the distance from a cell's region to its content.
            out.level[i] = 0;
            let bounds = match found {
                Found::Child(bounds, voxel, _) => {
                    let words = voxel.0;
                    (out.part[i], _) = Coded::part(words[3]);
                    out.coloured |= u32::from(Coded::has_colours(words[1])) << i;
                    let look = voxel.sides().map_or(Look::One([words[1], words[2]]), Look::Sides);
                    out.set_look(i, &look, dir(i).as_vec3());
                    bounds
                }
                Found::Frame(frame, level, number) => {
                    out.part[i] = frame.part();
                    let (column, row) = of_morton(number);
                    let middle = |at: usize| (at as f32 + 0.5) / (1 << level) as f32;
                    let sample = frame.sample(middle(column), middle(row));
                    out.set_look(i, &Look::One(sample), dir(i).as_vec3());
                    bounds_of(&planes_of(&frame, level, number), &frame.back(), frame.centre())
                }
            };
            for axis in 0..3 {
                (out.bounds[axis][i], out.bounds[axis + 3][i]) = (bounds.min[axis], bounds.max[axis]);
            }
        }
        gone
    }

    /// Returns the oriented slabs that bound the content of a cell that was hit; `None` if its block has left the
    /// snapshot.
    pub fn oriented_slabs(&self, hit: &TriHit) -> Option<OrientedSlabs<f32>> {
        Some(match self.cell_at(hit)?.1 {
            Found::Child(bounds, voxel, _) => {
                oriented_slabs(fields(voxel.0[0]), normal_bytes(voxel.0[1]), &Middle::of(&bounds))
            }
            Found::Frame(frame, level, number) => slabs_of(&frame, level, number),
        })
    }

    /// See [`crate::structure::Tree::prefetch_cell`]. This structure prefetches nothing.
    pub fn prefetch_cell(&self, _: &TriHit, _: bool) {}

    /// See [`crate::structure::Tree::parameters`].
    pub fn parameters(&self, hit: &TriHit) -> Option<InFace> {
        if hit.stand_in().is_some() {
            let Found::Frame(frame, level, number) = self.cell_at(hit)?.1 else { return None };
            let ((column, row), size) = (of_morton(number), 1.0 / (1u32 << level) as f32);
            let at = [column, row].map(|x| (x as f32 + 0.5) * size);
            return Some(in_face(&frame, at));
        }
        let number = grid_of(hit.tri);
        let at = Grids(self.words(hit.block)?).grid(number)?.at(hit.tri, [hit.u, hit.v])?;
        let frame = Block(self.words(hit.block.checked_sub(self.leaves_at)?)?).frame_of_grid(number)?;
        Some(in_face(&frame, at))
    }

    /// See [`crate::structure::Tree::parts_in_cell`].
    pub fn parts_in_cell(&self, hit: &TriHit) -> Option<CellParts> {
        Some(match self.cell_at(hit)?.1 {
            Found::Child(_, voxel, below) => {
                let (part, is_mixed) = Coded::part(voxel.0[3]);
                let listed_by = below.unwrap_or(hit.block);
                CellParts { part, is_mixed, summary: voxel.0[4], listed_by, shown: 0 }
            }
            Found::Frame(frame, ..) => {
                let part = frame.part();
                CellParts { part, is_mixed: false, summary: summary_bit(part), listed_by: hit.block, shown: 0 }
            }
        })
    }

    /// Returns the block that the stand-in of `hit` replaces, if that block is missing.
    pub fn wanted(&self, hit: &TriHit) -> Option<u32> {
        hit.stand_in().filter(|cell| cell.is_missing)?;
        match self.cell_at(hit)?.1 {
            Found::Child(.., below) => below,
            Found::Frame(..) => Some(hit.block + self.leaves_at),
        }
    }

    fn cell_at(&self, hit: &TriHit) -> Option<(StandIn, Found<'a>)> {
        let cell = hit.stand_in()?;
        let found = match Cell::of(cell.item) {
            Cell::Child(index, slot) => {
                let (block, node) = self.node_of(hit.block, index)?;
                let below = if let Child::Block(id) = node.child(slot) { Some(id) } else { None };
                Found::Child(node.bounds(slot), block.voxel(&node, slot)?, below)
            }
            Cell::Frame(at, level, number) => Found::Frame(Block(self.words(hit.block)?).frame(at)?, level, number),
        };
        Some((cell, found))
    }
}

/// Where a point of the frame's square lies in the face.
fn in_face(frame: &Frame, [u, v]: [f32; 2]) -> InFace {
    InFace { face: frame.face(), corner: frame.corner(), uv: frame.in_face(u, v) }
}

/// The slabs of a box of a frame across its system's z and y.
fn slabs_of(frame: &Frame, level: u32, number: usize) -> OrientedSlabs<f32> {
    let (planes, map) = (planes_of(frame, level, number), frame.map().transpose());
    let centre = frame.centre().as_dvec3();
    [(2, map.z_axis), (1, map.y_axis)].map(|(axis, row)| {
        let row = row.as_dvec3();
        let size = row.abs().element_sum();
        // The axis in single precision is not quite the row: the planes give way by as much over the extent of the
        // frame.
        let along: Vec3 = (row / size).as_vec3();
        let at = row.dot(centre) / size;
        let back = frame.back();
        let reach = (back.x_axis.abs() + back.y_axis.abs() + back.z_axis.abs()).max_element();
        let slack = (centre.abs().max_element() + reach) * 4e-7;
        let plane = |i: usize| f64::from(planes[i]) / size + at;
        let (low, high) = (plane(axis) - slack, plane(axis + 3) + slack);
        OrientedSlab { axis: along.to_array(), low: low as f32, high: high as f32 }
    })
}
