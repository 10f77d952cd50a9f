//! Data of hits, read from blocks: rows of cells and of triangles, filled for many rays at once so that memory accesses
//! overlap.

use super::stand_in::place_of;
use super::{TreeView, TriHit};
use crate::base::ids::BlockId;
use crate::lod::{Look, OrientedSlabs, is_loose};
use crate::math::bits;
use crate::simd::prefetch;
use crate::structure::bvh::layout::{Block, Node, StoredVoxel};
use crate::structure::cell::Cells;
use glam::{DVec3, Vec3};

impl<'a> TreeView<'a> {
    /// Fills the columns of `rays`; `hit` returns the hit of a ray, which is a cell. Returns the rays for which the
    /// block has left the snapshot: their columns are undefined.
    ///
    /// `dir` returns the direction of a ray in the tree's frame. With `is_whole` the boxes and levels of all cells are
    /// filled in. Curtains that may show a part with a bit in `unseen` are left out.
    #[inline(always)]
    pub fn cells<const N: usize>(
        &self,
        rays: u32,
        hit: impl Fn(usize) -> TriHit,
        dir: impl Fn(usize) -> DVec3,
        (is_whole, unseen): (bool, u32),
        out: &mut Cells<N>,
    ) -> u32 {
        let mut at: [Option<(StoredVoxel, &Node)>; N] = [None; N];
        let mut gone = 0;
        out.clear();
        for i in bits(rays) {
            let hit = hit(i);
            at[i] = self.cell_at(&hit).map(|(voxel, node, _)| (voxel, node));
            gone |= u32::from(at[i].is_none()) << i;
            if let (Some((voxel, ..)), Some(cell)) = (&at[i], hit.stand_in()) {
                prefetch(voxel.words().as_ptr());
                if cell.is_missing {
                    out.missing |= 1 << i;
                    out.inside |= u32::from(cell.is_inside) << i;
                }
            }
        }
        let whole = if is_whole { u32::MAX } else { out.inside };
        for i in bits(rays & !gone) {
            let (Some((voxel, node)), Some(cell)) = (&at[i], hit(i).stand_in()) else { continue };
            let (_, slot) = place_of(cell);
            (out.part[i], _) = voxel.part();
            out.coloured |= u32::from(voxel.has_colours()) << i;
            out.loose |= u32::from(is_loose(voxel.words()[0])) << i;
            let has_sides = voxel.has_sides();
            let is_whole = whole >> i & 1 == 1;
            if is_whole {
                // The level is in the other cache line of the node.
                out.level[i] = node.level(slot);
            }
            if is_whole || has_sides || voxel.is_along_axes() {
                for row in 0..6 {
                    out.bounds[row][i] = node.stored_plane(row, slot);
                }
            }
            if voxel.shown().is_some_and(|shown| shown & unseen == 0) {
                out.curtained |= 1 << i;
            }
            if has_sides {
                let sides = voxel.sides();
                prefetch(sides.as_ptr());
                prefetch(&sides[sides.len() - 1]);
            }
        }
        for i in bits(out.curtained) {
            let Some((voxel, ..)) = &at[i] else { continue };
            let to_eye = -dir(i).as_vec3().normalize_or_zero();
            let Some((sample, part)) = voxel.curtain(to_eye) else {
                out.curtained &= !(1 << i);
                continue;
            };
            out.set_look(i, &Look::One(sample), Vec3::ZERO);
            out.part[i] = part;
            out.coloured |= 1 << i;
        }
        for i in bits(rays & !gone & !out.curtained) {
            let Some((voxel, ..)) = &at[i] else { continue };
            out.set_look(i, &voxel.look(), dir(i).as_vec3());
        }
        if self.proxies.is_some() {
            self.look_at_proxies(rays & !gone & !out.curtained, hit, dir, out);
        }
        gone
    }

    /// Prefetches the memory that [`TreeView::cells`] reads for the cell of a hit: first the words of its voxel and, in
    /// a second call with `of_sides` once those have arrived, the samples of its sides.
    #[inline]
    pub fn prefetch_cell(&self, hit: &TriHit, of_sides: bool) {
        let Some((voxel, ..)) = self.cell_at(hit) else { return };
        if !of_sides {
            prefetch(voxel.words().as_ptr());
        } else if voxel.has_sides() {
            let sides = voxel.sides();
            prefetch(sides.as_ptr());
            prefetch(&sides[sides.len() - 1]);
        }
    }

    /// Returns the oriented slabs of the cell of a hit, or `None` if its block has left the snapshot.
    pub fn oriented_slabs(&self, hit: &TriHit) -> Option<OrientedSlabs<f32>> {
        self.cell_at(hit).map(|(_, node, slot)| node.stored_oriented_slabs(slot))
    }

    #[inline(always)]
    fn cell_at(&self, hit: &TriHit) -> Option<(StoredVoxel<'a>, &'a Node, usize)> {
        let cell = hit.stand_in()?;
        let block = Block::new(self.snapshot.block(BlockId(hit.block))?);
        let (node, slot) = place_of(cell);
        Some((block.voxel(node, slot), block.node(node), slot))
    }
}
