//! The limit surface of a cage.

use super::super::point::SurfacePoint;
use super::around::{Finder, Neighbourhood};
use super::bicubics::bicubic;
use super::bounds::bounds;
use super::evaluate::evaluate;
use super::level::Cage;
use super::plan::{Plan, Plans};
use crate::base::error::{Error, Result};
use crate::geom::surface::dice::BicubicPatch;
use crate::math::DBounds;
use glam::DVec3;
use std::sync::Arc;

/// The quads of a cage, each with its plan and points: about 100 bytes for a regular one, some kilobytes near irregular
/// vertices, up to some hundred kilobytes along edges of high sharpness. A [`QuadSurface`](super::QuadSurface) at a
/// time takes less memory.
#[derive(Debug, Clone)]
pub struct CagePatches {
    positions: Vec<DVec3>,
    /// First quad of each face, and their number.
    first: Vec<u32>,
    quads: Vec<Quad>,
    /// Vertices of regular quads, in the order of their neighbourhoods.
    vertices: Vec<u32>,
    /// Points of all other quads.
    points: Vec<DVec3>,
}

#[derive(Debug, Clone)]
struct Quad {
    plan: Arc<Plan>,
    /// First of its vertices if it is regular, else of its points.
    first: usize,
}

impl CagePatches {
    /// The surface of a cage with one position a vertex. Holes have patches too.
    ///
    /// # Errors
    /// [`Error::BadArgument`] unless there is one position a vertex.
    pub fn new(cage: &Cage, positions: &[DVec3]) -> Result<Self> {
        if positions.len() != cage.vertex_count() {
            let (given, wanted) = (positions.len(), cage.vertex_count());
            return Err(Error::bad_argument(format!("{given} positions for a cage of {wanted} vertices")));
        }
        let positions = positions.to_vec();
        let (first, quads, vertices, points) = (vec![0], Vec::new(), Vec::new(), Vec::new());
        let mut made = CagePatches { positions, first, quads, vertices, points };
        let (mut finder, mut plans) = (Finder::new(cage), Plans::new());
        let (mut found, mut vertices) = (Neighbourhood::default(), Vec::new());
        for face in 0..cage.face_count() as u32 {
            for corner in 0..cage.quads_of(face) {
                finder.find(face, corner, &mut found, &mut vertices);
                made.add(plans.plan(&found)?, &vertices)?;
            }
            made.first.push(made.quads.len() as u32);
        }
        Ok(made)
    }

    fn add(&mut self, plan: Arc<Plan>, vertices: &[u32]) -> Result<()> {
        let first = if plan.points() == plan.control_points() { self.vertices.len() } else { self.points.len() };
        if plan.points() == plan.control_points() {
            self.vertices.extend_from_slice(vertices);
        } else {
            let control = vertices.iter().map(|&vertex| self.positions[vertex as usize]);
            self.points.extend(plan.points_for(control)?);
        }
        self.quads.push(Quad { plan, first });
        Ok(())
    }

    fn quad(&self, face: u32, corner: u32) -> Option<&Quad> {
        let (first, end) = (*self.first.get(face as usize)?, *self.first.get(face as usize + 1)?);
        self.quads[first as usize..end as usize].get(corner as usize)
    }

    /// The point of a face, see [`QuadSurface::evaluate`](super::QuadSurface::evaluate). A face of four corners has
    /// `corner` 0 and u, v from its first corner, u along its first edge. A face of n corners is n quads, of which
    /// `corner` is one: u runs along the edge from this corner to the middle, v along the edge that ends there, (1, 1)
    /// is the middle of the face, as in Ptex. All zeros if there is no such face or corner.
    pub fn evaluate(&self, face: u32, corner: u32, u: f64, v: f64) -> SurfacePoint {
        let Some(quad) = self.quad(face, corner) else { return SurfacePoint::default() };
        if quad.plan.points() == quad.plan.control_points() {
            evaluate(&quad.plan, self.vertex_of(quad), u, v)
        } else {
            evaluate(&quad.plan, self.point_of(quad), u, v)
        }
    }

    /// A box around a part of a quad, see [`QuadSurface::bounds`](super::QuadSurface::bounds). Empty if there is no
    /// such face or corner.
    pub fn bounds(&self, face: u32, corner: u32, level: u32, i: u32, j: u32) -> DBounds {
        let Some(quad) = self.quad(face, corner) else { return DBounds::EMPTY };
        if quad.plan.points() == quad.plan.control_points() {
            bounds(&quad.plan, self.vertex_of(quad), level, i, j)
        } else {
            bounds(&quad.plan, self.point_of(quad), level, i, j)
        }
    }

    /// The bicubic patch that a square of a quad is a part of; `None` if there is no such face or corner, or if the
    /// square is not within one patch, as beside irregular vertices. `place`: level, column and row of the square.
    pub fn bicubic(&self, face: u32, corner: u32, place: [u32; 3]) -> Option<BicubicPatch> {
        let quad = self.quad(face, corner)?;
        if quad.plan.points() == quad.plan.control_points() {
            bicubic(&quad.plan, self.vertex_of(quad), place)
        } else {
            bicubic(&quad.plan, self.point_of(quad), place)
        }
    }

    /// Bytes of memory, without those of plans, which quads share.
    pub fn memory(&self) -> usize {
        let vectors = (self.positions.capacity() + self.points.capacity()) * size_of::<DVec3>();
        vectors + self.quads.capacity() * size_of::<Quad>() + (self.first.capacity() + self.vertices.capacity()) * 4
    }

    fn vertex_of(&self, quad: &Quad) -> impl Fn(u32) -> DVec3 + '_ {
        let vertices = &self.vertices[quad.first..quad.first + quad.plan.points()];
        |i| self.positions[vertices[i as usize] as usize]
    }

    fn point_of(&self, quad: &Quad) -> impl Fn(u32) -> DVec3 + '_ {
        let points = &self.points[quad.first..quad.first + quad.plan.points()];
        |i| points[i as usize]
    }
}
