//! The limit surface of a cage as quads for dicing.

use super::displaced::Displacement;
use super::level::Cage;
use super::patches::CagePatches;
use crate::base::error::Result;
use crate::geom::surface::dice::{BicubicPatch, Quads, Sample, Side};
use glam::DVec3;

/// The quads of a cage that was subdivided once: then sides of faces of any number of corners meet whole. Holes have
/// none.
pub struct CageQuads<'a> {
    cage: &'a Cage,
    refined: Cage,
    surface: CagePatches,
    displacement: Option<Displacement<'a>>,
    /// The faces of `refined` that are no holes.
    faces: Vec<u32>,
}

impl<'a> CageQuads<'a> {
    /// Those of a cage with its vertices. Fails as [`Cage::refine`] and [`CagePatches::new`], and with `BadArgument` if
    /// the displacement does not match the cage.
    pub fn new(cage: &'a Cage, positions: &[DVec3], displacement: Option<Displacement<'a>>) -> Result<Self> {
        displacement.map_or(Ok(()), |it| it.check(cage))?;
        let refined = cage.refine()?;
        let surface = CagePatches::new(cage, positions)?;
        let faces = (0..refined.face_count() as u32).filter(|face| !refined.is_hole(*face)).collect();
        Ok(Self { cage, refined, surface, displacement, faces })
    }

    /// The face of the cage that a quad is of.
    pub fn face(&self, quad: usize) -> u32 {
        self.cage.parent(self.faces[quad]).0
    }

    /// Where a quad is: the face of the cage; its corner, if the face has other than four; and level, column and row in
    /// the square of the face, or of that corner.
    pub fn place_in_face(&self, quad: usize) -> (u32, u32, [u32; 3]) {
        let (face, corner) = self.cage.parent(self.faces[quad]);
        if self.cage.quads_of(face) > 1 {
            return (face, corner, [0; 3]);
        }
        let [column, row] = [[0, 0], [1, 0], [1, 1], [0, 1]][corner as usize];
        (face, 0, [1, column, row])
    }

    /// The face of the cage and its corner that a quad is of, and the parameters there of those of the quad.
    fn place(&self, quad: usize, u: f64, v: f64) -> ([u32; 2], [f64; 2]) {
        let (face, corner) = self.cage.parent(self.faces[quad]);
        if self.cage.quads_of(face) > 1 {
            return ([face, corner], [u, v]);
        }
        let [left, low] = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]][corner as usize];
        ([face, 0], [left + 0.5 * u, low + 0.5 * v])
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
        let (of, at) = self.place(quad, u, v);
        let point = self.surface.evaluate(of[0], of[1], at[0], at[1]);
        match &self.displacement {
            Some(displacement) => displacement.sample(self.cage, of, at, &point),
            None => Sample { position: point.position, normal: point.normal() },
        }
    }

    fn is_rough(&self) -> bool {
        self.displacement.is_some()
    }

    fn has_bicubics(&self) -> bool {
        self.displacement.is_none()
    }

    fn bicubic(&self, quad: usize, [level, column, row]: [u32; 3]) -> Option<BicubicPatch> {
        if !self.has_bicubics() {
            return None;
        }
        let (face, corner, [above, i, j]) = self.place_in_face(quad);
        self.surface.bicubic(face, corner, [above + level, (i << level) + column, (j << level) + row])
    }

    fn least_level(&self, quad: usize) -> u32 {
        let ([face, corner], _) = self.place(quad, 0.0, 0.0);
        let of_face = self.displacement.map_or(0, |it| it.least_level(self.cage, face, corner));
        of_face.saturating_sub(u32::from(self.cage.quads_of(face) == 1))
    }
}
