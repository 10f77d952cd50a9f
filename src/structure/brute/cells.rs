//! Data of hits, read from blocks: rows for stand-ins, and triangles.

use super::layout::Row;
use super::trace::TreeView;
use crate::lod::{Coded, Look, OrientedSlabs};
use crate::math::bits;
use crate::structure::cell::Cells;
use crate::structure::hit::{StandIn, TriHit};
use glam::DVec3;

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
            let Some((cell, row)) = self.cell_at(&hit(i)) else {
                gone |= 1 << i;
                continue;
            };
            out.missing |= u32::from(cell.is_missing) << i;
            out.inside |= u32::from(cell.is_inside) << i;
            let (bounds, voxel) = (row.bounds(), row.voxel());
            for axis in 0..3 {
                (out.bounds[axis][i], out.bounds[axis + 3][i]) = (bounds.min[axis], bounds.max[axis]);
            }
            (out.part[i], _) = Coded::part(voxel[2]);
            // Walks test boxes instead of oriented slabs, so nothing is known of the distance to the content.
            out.level[i] = 0;
            out.coloured |= u32::from(Coded::has_colours(voxel[0])) << i;
            let look = row.sides().map_or(Look::One([voxel[0], voxel[1]]), Look::Sides);
            out.set_look(i, &look, dir(i).as_vec3());
        }
        gone
    }

    /// Returns the oriented slabs that bound the content of a cell that was hit; `None` if its block has left the
    /// snapshot.
    pub fn oriented_slabs(&self, hit: &TriHit) -> Option<OrientedSlabs<f32>> {
        self.cell_at(hit).map(|(_, row)| row.slabs())
    }

    /// See [`crate::structure::Tree::prefetch_cell`]. This structure prefetches nothing.
    pub fn prefetch_cell(&self, _: &TriHit, _: bool) {}

    fn cell_at(&self, hit: &TriHit) -> Option<(StandIn, Row<'a>)> {
        let cell = hit.stand_in()?;
        Some((cell, self.row_of(hit.block, cell)?))
    }
}
