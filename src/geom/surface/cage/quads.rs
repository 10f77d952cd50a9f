//! The limit surface of a cage as quads for dicing.

use super::level::Cage;
use super::surface::CageSurface;
use crate::base::error::Result;
use crate::geom::surface::SurfacePoint;
use crate::geom::surface::dice::{Quads, Sample, Side};
use glam::DVec3;

/// The quads of a cage that was subdivided once: then sides of faces of any number of corners meet whole. Holes have
/// none.
pub struct CageQuads<'a> {
    cage: &'a Cage,
    refined: Cage,
    surface: CageSurface,
    /// The faces of `refined` that are no holes.
    faces: Vec<u32>,
}

impl<'a> CageQuads<'a> {
    /// Those of a cage with its vertices. Fails as [`Cage::refine`] and [`CageSurface::new`].
    pub fn new(cage: &'a Cage, positions: &[DVec3]) -> Result<Self> {
        let refined = cage.refine()?;
        let surface = CageSurface::new(cage, positions)?;
        let faces = (0..refined.face_count() as u32).filter(|face| !refined.is_hole(*face)).collect();
        Ok(Self { cage, refined, surface, faces })
    }

    /// The face of the cage that a quad is of.
    pub fn face(&self, quad: usize) -> u32 {
        self.cage.parent(self.faces[quad]).0
    }

    fn at(&self, face: u32, corner: u32, u: f64, v: f64) -> SurfacePoint {
        self.surface.quad(face, corner).map_or(SurfacePoint::default(), |quad| quad.evaluate(u, v))
    }
}

impl Quads for CageQuads<'_> {
    fn count(&self) -> usize {
        self.faces.len()
    }

    fn vertices(&self) -> usize {
        self.refined.vertex_count()
    }

    fn edges(&self) -> usize {
        self.refined.edge_count()
    }

    fn corners(&self, quad: usize) -> [u32; 4] {
        let face = self.refined.face(self.faces[quad]);
        [face[0], face[1], face[3], face[2]]
    }

    fn sides(&self, quad: usize) -> [Side; 4] {
        let (face, topology) = (self.faces[quad], &self.refined.topology);
        let (vertices, first) = (self.refined.face(face), topology.face_start[face as usize]);
        // Corner `at` begins the edge; it falls from `from` to `to` if these are not in ascending order.
        [(0, 0, 1), (2, 3, 2), (3, 0, 3), (1, 1, 2)].map(|(at, from, to)| Side {
            edge: topology.corner_edge[(first + at) as usize],
            is_reversed: vertices[from] > vertices[to],
        })
    }

    fn sample(&self, quad: usize, u: f64, v: f64) -> Sample {
        let (face, corner) = self.cage.parent(self.faces[quad]);
        let point = match self.cage.quads_of(face) {
            1 => {
                let [left, low] = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]][corner as usize];
                self.at(face, 0, left + 0.5 * u, low + 0.5 * v)
            }
            _ => self.at(face, corner, u, v),
        };
        Sample { position: point.position, normal: point.normal() }
    }
}
