//! Points of hits, with derivatives by the parameters of the face.

use super::layout::{Block, Frame, Grid, Grids, grid_of};
use super::net::Computed;
use super::trace::TreeView;
use crate::base::ids::BlockId;
use crate::geom::surface::{ShadingPoint, SurfacePoint};
use crate::structure::hit::TriHit;
use glam::{DVec3, Vec3};

impl TreeView<'_> {
    /// See [`crate::structure::Tree::shading_point`]. It needs the block of the frame too, which holds the place of the
    /// grid in the face.
    pub fn shading_point(&self, hit: &TriHit) -> Result<Option<ShadingPoint>, BlockId> {
        let grids = Grids(self.words(hit.block).ok_or(BlockId(hit.block))?);
        let Some(above) = hit.block.checked_sub(self.leaves_at) else { return Ok(None) };
        let frames = Block(self.visited(above).ok_or(BlockId(above))?);
        let number = grid_of(hit.tri);
        let (Some(grid), Some(frame)) = (grids.grid(number), frames.frame_of_grid(number)) else {
            return Ok(None);
        };
        let normals = self.normals(hit)?.map(|normals| normals.map(Vec3::as_dvec3));
        let on_triangle = point_of_triangle(hit, &grid, &frame, normals.as_ref());
        let on_patch = grid.computed.and_then(|it| point_of_patch(hit, (&grid, &it), &frame, on_triangle?.normal));
        Ok(on_patch.or(on_triangle))
    }
}

/// The point of a triangle of a grid. The normals of the grid's vertices are those of the surface.
fn point_of_triangle(hit: &TriHit, grid: &Grid, frame: &Frame, normals: Option<&[DVec3; 3]>) -> Option<ShadingPoint> {
    let corners = grid.triangle(hit.tri)?.map(Vec3::as_dvec3);
    // Parameters of vertices are exact in single precision: at most 12 bits of the place, and 5 of the grid.
    let at = |corner: [f32; 2]| grid.at(hit.tri, corner).map(|[u, v]| frame.in_face(u, v).map(f64::from));
    let parameters = [at([0.0, 0.0])?, at([1.0, 0.0])?, at([0.0, 1.0])?];
    Some(ShadingPoint::of_triangle(&corners, normals, &parameters, [hit.u, hit.v].map(f64::from)))
}

/// The point of the patch that a grid is computed from. `normal`: that of the triangle, which holds where the patch has
/// none, as at poles. `None` if a malformed file leads to numbers that are not finite.
fn point_of_patch(
    hit: &TriHit,
    (grid, computed): (&Grid, &Computed),
    frame: &Frame,
    normal: DVec3,
) -> Option<ShadingPoint> {
    let of_corner = |at: usize| computed.parameters(grid.level, at % grid.side, at / grid.side);
    let [a, b, c] = grid.corners(hit.tri)?.map(of_corner);
    let [second, third] = [hit.u, hit.v].map(f64::from);
    let [u, v] = [0, 1].map(|axis| a[axis] + second * (b[axis] - a[axis]) + third * (c[axis] - a[axis]));
    let [position, du, dv, duu, duv, dvv] = computed.net.derivatives(u, v);
    // The grid is a rectangle of the patch and a square of the face. Their sides are powers of two.
    let level = frame.place()[0] as i32;
    let [a, b] = computed.place.map(|[above, _]| 2f64.powi(level - above as i32));
    let (du, dv, duu, duv, dvv) = (du * a, dv * b, duu * (a * a), duv * (a * b), dvv * (b * b));
    let point = SurfacePoint { position, du, dv, duu, duv, dvv };
    let own = point.normal();
    let point = if frame.is_turned() {
        SurfacePoint { du: point.dv, dv: point.du, duu: point.dvv, dvv: point.duu, ..point }
    } else {
        point
    };
    let all = [point.position, point.du, point.dv, point.duu, point.duv, point.dvv];
    let is_finite = all.iter().all(|it| it.is_finite());
    is_finite.then(|| ShadingPoint::of_surface(&point, if own == DVec3::ZERO { normal } else { own }))
}
