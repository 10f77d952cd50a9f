//! Points of hits, with derivatives by the parameters of the face.

use super::layout::{Block, Frame, Grids, grid_of};
use super::trace::TreeView;
use crate::base::ids::BlockId;
use crate::geom::surface::ShadingPoint;
use crate::structure::hit::TriHit;
use glam::Vec3;

impl TreeView<'_> {
    /// See [`crate::structure::Tree::shading_point`]. It needs the block of the frame too, which holds the place of the
    /// grid in the face.
    pub fn shading_point(&self, hit: &TriHit) -> Result<Option<ShadingPoint>, BlockId> {
        let grids = Grids(self.words(hit.block).ok_or(BlockId(hit.block))?);
        let Some(above) = hit.block.checked_sub(self.leaves_at) else { return Ok(None) };
        let frames = Block(self.visited(above).ok_or(BlockId(above))?);
        let number = grid_of(hit.tri);
        let (Some(_), Some((_, frame))) = (grids.grid(number), frames.all_frames().nth(number)) else {
            return Ok(None);
        };
        // A grid that is made from a patch of a polynomial is evaluated here, at `frame.in_face` of `Grid::at`, by
        // `ShadingPoint::of_surface`.
        self.point_of_triangle(hit, &grids, &frame)
    }

    /// The point of a triangle of a grid. The normals of the grid's vertices are those of the surface.
    fn point_of_triangle(&self, hit: &TriHit, grids: &Grids, frame: &Frame) -> Result<Option<ShadingPoint>, BlockId> {
        let normals = self.normals(hit)?.map(|normals| normals.map(Vec3::as_dvec3));
        let weights = [hit.u, hit.v].map(f64::from);
        let of_grid = || {
            let grid = grids.grid(grid_of(hit.tri))?;
            let corners = grid.triangle(hit.tri)?.map(Vec3::as_dvec3);
            // Parameters of vertices are exact in single precision: at most 12 bits of the place, and 5 of the grid.
            let at = |corner: [f32; 2]| grid.at(hit.tri, corner).map(|[u, v]| frame.in_face(u, v).map(f64::from));
            let parameters = [at([0.0, 0.0])?, at([1.0, 0.0])?, at([0.0, 1.0])?];
            Some(ShadingPoint::of_triangle(&corners, normals.as_ref(), &parameters, weights))
        };
        Ok(of_grid())
    }
}
