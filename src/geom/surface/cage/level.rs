//! A cage: topology and sharpness of one level of subdivision, checked once.

use super::desc::{Boundary, CageDesc, Creasing, MAX_VALENCE, TriangleRule};
use super::rules::{INFINITE, Rule};
use super::topology::Topology;
use crate::base::error::{Error, Result};

/// The greatest number of corners or vertices: numbers of a refined level still fit `u32` in sums.
const MAX_COUNT: usize = (u32::MAX / 4) as usize;

/// Topology and sharpness of a polygon mesh, which is the control mesh of a Catmull-Clark surface, or a level of its
/// subdivision. It has no positions, so that key frames share it.
///
/// Invariants: faces have 3 to [`MAX_VALENCE`] corners; sharpness is 0 to [`INFINITE`]; boundary and
/// non-manifold features are infinitely sharp already.
#[derive(Debug, Clone)]
pub struct Cage {
    pub(super) topology: Topology,
    pub(super) edge_sharpness: Vec<f32>,
    pub(super) vertex_sharpness: Vec<f32>,
    /// One a face.
    pub(super) holes: Vec<bool>,
    pub(super) creasing: Creasing,
    pub(super) triangles: TriangleRule,
}

impl Cage {
    /// The cage of a description with `vertices` vertices.
    ///
    /// Non-manifold edges (of more than two faces, of two faces of opposite orientation, twice in a face, or from a
    /// vertex to itself) and vertices are infinitely sharp.
    ///
    /// # Errors
    /// [`Error::BadArgument`] names the face, edge or vertex: a face of fewer than 3 or more than [`MAX_VALENCE`]
    /// corners, or with a vertex out of range; a vertex with more than [`MAX_VALENCE`] faces or
    /// edges; a crease on no edge; sharpness that is negative or no number; a hole that is no face; counts that differ
    /// or are too large.
    pub fn new(desc: &CageDesc, vertices: usize) -> Result<Cage> {
        let face_start = face_starts(desc, vertices)?;
        check_faces(desc.indices, &face_start, vertices)?;
        let topology = Topology::new(face_start, desc.indices.to_vec(), vertices);
        check_valences(&topology)?;
        let mut cage = Cage {
            edge_sharpness: vec![0.0; topology.edges.len()],
            vertex_sharpness: vec![0.0; vertices],
            holes: vec![false; topology.faces()],
            creasing: desc.creasing,
            triangles: desc.triangles,
            topology,
        };
        cage.set_creases(desc)?;
        cage.set_corners_and_holes(desc)?;
        if desc.boundary == Boundary::None {
            cage.make_boundary_faces_holes();
        }
        cage.sharpen_edges();
        cage.sharpen_vertices(desc.boundary);
        Ok(cage)
    }

    fn set_creases(&mut self, desc: &CageDesc) -> Result<()> {
        for &(a, b, sharpness) in desc.creases {
            let Some(edge) = self.topology.find_edge(a, b) else {
                return Err(Error::bad_argument(format!("crease {a} to {b}: no face has this edge")));
            };
            self.edge_sharpness[edge as usize] =
                checked_sharpness(sharpness).ok_or_else(|| bad_sharpness(format!("crease {a} to {b}"), sharpness))?;
        }
        Ok(())
    }

    fn set_corners_and_holes(&mut self, desc: &CageDesc) -> Result<()> {
        let vertices = self.vertex_sharpness.len();
        for &(vertex, sharpness) in desc.corners {
            let slot = self.vertex_sharpness.get_mut(vertex as usize);
            *slot.ok_or_else(|| {
                Error::bad_argument(format!("corner at vertex {vertex}: the cage has {vertices} vertices"))
            })? = checked_sharpness(sharpness)
                .ok_or_else(|| bad_sharpness(format!("corner at vertex {vertex}"), sharpness))?;
        }
        let faces = self.holes.len();
        for &face in desc.holes {
            *self
                .holes
                .get_mut(face as usize)
                .ok_or_else(|| Error::bad_argument(format!("hole {face}: the cage has {faces} faces")))? = true;
        }
        Ok(())
    }

    /// Without a boundary rule, faces at a boundary edge that the caller has not made infinitely sharp have no limit.
    fn make_boundary_faces_holes(&mut self) {
        let topology = &self.topology;
        for vertex in 0..topology.vertices() as u32 {
            let open = |&edge: &u32| {
                topology.corners_of_edge(edge).len() == 1 && self.edge_sharpness[edge as usize] < INFINITE
            };
            if topology.edges_at(vertex).iter().any(open) {
                for &h in topology.corners_at(vertex) {
                    self.holes[topology.corner_face[h as usize] as usize] = true;
                }
            }
        }
    }

    fn sharpen_edges(&mut self) {
        for edge in 0..self.topology.edges.len() as u32 {
            if self.topology.corners_of_edge(edge).len() < 2 || self.topology.edge_is_non_manifold(edge) {
                self.edge_sharpness[edge as usize] = INFINITE;
            }
        }
    }

    /// Vertices of one face are sharp under one of the boundary rules, non-manifold ones always: except on the crease
    /// of two non-manifold edges at which further faces end, which is smooth along its length.
    fn sharpen_vertices(&mut self, boundary: Boundary) {
        let topology = &self.topology;
        let mut walk = Vec::new();
        for vertex in 0..topology.vertices() as u32 {
            let (faces, edges) = (topology.corners_at(vertex).len(), topology.edges_at(vertex));
            let single = faces == 1 && edges.len() == 2;
            let non_manifold = edges.iter().filter(|&&edge| topology.edge_is_non_manifold(edge)).count();
            let open = edges.iter().any(|&edge| topology.corners_of_edge(edge).len() < 2);
            let on_crease = non_manifold == 2 && !open && faces > edges.len();
            let sharp = !topology.vertex_is_manifold(vertex, &mut walk) && !on_crease;
            if sharp || single && boundary == Boundary::EdgeAndCorner {
                self.vertex_sharpness[vertex as usize] = INFINITE;
            }
        }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.topology.vertices()
    }

    /// Number of faces, holes included.
    pub fn face_count(&self) -> usize {
        self.topology.faces()
    }

    /// Vertices of a face below [`face_count`](Self::face_count), from its first corner.
    pub fn face(&self, face: u32) -> &[u32] {
        self.topology.face(face)
    }

    /// True if the face has no surface.
    pub fn is_hole(&self, face: u32) -> bool {
        self.holes[face as usize]
    }

    /// Number of edges.
    pub fn edge_count(&self) -> usize {
        self.topology.edges.len()
    }

    /// Sharpness of the edge between two vertices, or `None` if there is no such edge. Boundaries are
    /// [`INFINITE`].
    pub fn edge_sharpness(&self, a: u32, b: u32) -> Option<f32> {
        self.topology.find_edge(a, b).map(|edge| self.edge_sharpness[edge as usize])
    }

    /// Sharpness of a vertex below [`vertex_count`](Self::vertex_count).
    pub fn vertex_sharpness(&self, vertex: u32) -> f32 {
        self.vertex_sharpness[vertex as usize]
    }

    /// The rule for semi-sharp edges.
    pub fn creasing(&self) -> Creasing {
        self.creasing
    }

    /// The rule for triangles.
    pub fn triangles(&self) -> TriangleRule {
        self.triangles
    }

    /// Quads that the surface of a face is parametrised by: one for a quad, else one a corner.
    pub fn quads_of(&self, face: u32) -> u32 {
        match self.topology.face_size(face) {
            4 => 1,
            size => size,
        }
    }

    pub(super) fn sharpness_around(&self, vertex: u32) -> impl Iterator<Item = f32> + Clone + '_ {
        self.topology.edges_at(vertex).iter().map(|&edge| self.edge_sharpness[edge as usize])
    }

    pub(super) fn rule_of(&self, vertex: u32) -> Rule {
        Rule::of(self.vertex_sharpness[vertex as usize], self.sharpness_around(vertex))
    }
}

fn face_starts(desc: &CageDesc, vertices: usize) -> Result<Vec<u32>> {
    if desc.indices.len() > MAX_COUNT || vertices > MAX_COUNT {
        let (corners, most) = (desc.indices.len(), MAX_COUNT);
        return Err(Error::bad_argument(format!("{corners} corners, {vertices} vertices: {most} at most")));
    }
    let mut face_start = vec![0];
    let mut sum = 0u64;
    for (face, &size) in desc.face_sizes.iter().enumerate() {
        if !(3..=MAX_VALENCE as u32).contains(&size) {
            return Err(Error::bad_argument(format!(
                "face {face} has {size} corners: 3 to {MAX_VALENCE} are possible"
            )));
        }
        sum += u64::from(size);
        if sum > desc.indices.len() as u64 {
            return Err(Error::bad_argument(format!("face {face} ends after the last of the indices")));
        }
        face_start.push(sum as u32);
    }
    if sum != desc.indices.len() as u64 {
        let (faces, given) = (desc.face_sizes.len(), desc.indices.len());
        return Err(Error::bad_argument(format!("{faces} faces have {sum} corners, but {given} indices are given")));
    }
    Ok(face_start)
}

fn check_faces(indices: &[u32], face_start: &[u32], vertices: usize) -> Result<()> {
    for (face, ends) in face_start.windows(2).enumerate() {
        let corners = &indices[ends[0] as usize..ends[1] as usize];
        if let Some(vertex) = corners.iter().find(|&&vertex| vertex as usize >= vertices) {
            let why = format!("face {face}: vertex {vertex}, but the cage has {vertices} vertices");
            return Err(Error::bad_argument(why));
        }
    }
    Ok(())
}

fn check_valences(topology: &Topology) -> Result<()> {
    for vertex in 0..topology.vertices() as u32 {
        let (faces, edges) = (topology.corners_at(vertex).len(), topology.edges_at(vertex).len());
        if faces.max(edges) > MAX_VALENCE {
            let why = format!("vertex {vertex} has {faces} faces and {edges} edges: {MAX_VALENCE} are possible");
            return Err(Error::bad_argument(why));
        }
    }
    Ok(())
}

/// Sharpness from 0 to [`INFINITE`]; `None` if it is negative or no number.
fn checked_sharpness(sharpness: f32) -> Option<f32> {
    (sharpness >= 0.0).then(|| sharpness.min(INFINITE))
}

fn bad_sharpness(of: String, sharpness: f32) -> Error {
    Error::bad_argument(format!("{of}: sharpness {sharpness} is no number from 0"))
}
