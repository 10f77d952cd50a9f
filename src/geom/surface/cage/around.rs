//! The faces around a face: all that its part of the limit surface depends on.
//!
//! A child of a face and the faces around it are children of the face and of the faces around it, and all their rules
//! refer to edges and vertices of the face. So neighbourhoods can be subdivided alone, at any depth.

use super::desc::{Creasing, TriangleRule};
use super::level::Cage;
use super::topology::Topology;

/// The neighbourhood of one quad of a surface as numbers: equal numbers have equal plans, whatever their points.
///
/// Faces begin with the quad's own face, from the quad's corner; vertices are numbered as they occur.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Neighbourhood {
    /// Bit 0: [`Creasing::Chaikin`]; bit 1: [`TriangleRule::Smooth`].
    pub(super) rules: u32,
    pub(super) vertices: u32,
    pub(super) sizes: Vec<u32>,
    pub(super) corners: Vec<u32>,
    /// Bits of the sharpness of each corner's edge, if it has a vertex of the first face, else 0.
    pub(super) edges: Vec<u32>,
    /// Bits of the sharpness of the vertices at the first face's corners.
    pub(super) sharpness: Vec<u32>,
}

impl Neighbourhood {
    /// The cage of the neighbourhood. Its rim has no boundary rules: no point of the quad depends on them.
    pub(super) fn cage(&self) -> Cage {
        let mut sum = 0;
        let mut starts = vec![0];
        starts.extend(self.sizes.iter().map(|size| {
            sum += size;
            sum
        }));
        let topology = Topology::new(starts, self.corners.clone(), self.vertices as usize);
        let mut edge_sharpness = vec![0.0; topology.edges.len()];
        for (&edge, &bits) in topology.corner_edge.iter().zip(&self.edges) {
            edge_sharpness[edge as usize] = f32::from_bits(bits);
        }
        let mut vertex_sharpness = vec![0.0; self.vertices as usize];
        for (&vertex, &bits) in self.corners.iter().zip(&self.sharpness) {
            vertex_sharpness[vertex as usize] = f32::from_bits(bits);
        }
        Cage {
            edge_sharpness,
            vertex_sharpness,
            holes: vec![false; self.sizes.len()],
            creasing: if self.rules & 1 == 0 { Creasing::Uniform } else { Creasing::Chaikin },
            triangles: if self.rules & 2 == 0 { TriangleRule::CatmullClark } else { TriangleRule::Smooth },
            topology,
        }
    }
}

/// Not yet numbered.
const NONE: u32 = u32::MAX;

/// Finds neighbourhoods in a cage; keeps its working memory, 4 bytes a vertex and a face.
#[derive(Debug)]
pub struct Finder<'a> {
    cage: &'a Cage,
    number_of_vertex: Vec<u32>,
    seen: Vec<bool>,
    faces: Vec<u32>,
    walk: Vec<u32>,
}

impl<'a> Finder<'a> {
    /// A finder for a cage.
    pub fn new(cage: &'a Cage) -> Self {
        let number_of_vertex = vec![NONE; cage.vertex_count()];
        Finder { cage, number_of_vertex, seen: vec![false; cage.face_count()], faces: Vec::new(), walk: Vec::new() }
    }

    /// The neighbourhood of a quad (a face, and its corner: 0 for a face of four corners), and the vertices of the cage
    /// in its order. Both are overwritten. `face` and `corner` are in range.
    pub fn find(&mut self, face: u32, corner: u32, found: &mut Neighbourhood, vertices: &mut Vec<u32>) {
        found.sizes.clear();
        found.corners.clear();
        vertices.clear();
        let topology = &self.cage.topology;
        let size = topology.face_size(face);
        let first = topology.face_start[face as usize] + corner;
        self.add(first, found, vertices);
        for step in 0..size {
            let h = topology.ahead(first, step);
            let mut walk = std::mem::take(&mut self.walk);
            topology.sector(h, |_| false, &mut walk);
            walk.iter().for_each(|&h| self.add(h, found, vertices));
            self.walk = walk;
            if self.walk.len() < topology.corners_at(topology.corners[h as usize]).len() {
                topology.corners_at(topology.corners[h as usize]).iter().for_each(|&h| self.add(h, found, vertices));
            }
        }
        found.vertices = vertices.len() as u32;
        found.rules = u32::from(self.cage.creasing == Creasing::Chaikin)
            | u32::from(self.cage.triangles == TriangleRule::Smooth) << 1;
        self.add_sharpness(first, found);
        vertices.iter().for_each(|&vertex| self.number_of_vertex[vertex as usize] = NONE);
        self.faces.drain(..).for_each(|h| self.seen[topology.corner_face[h as usize] as usize] = false);
    }

    /// Adds the face of a corner, from that corner.
    fn add(&mut self, h: u32, found: &mut Neighbourhood, vertices: &mut Vec<u32>) {
        let topology = &self.cage.topology;
        let face = topology.corner_face[h as usize];
        if std::mem::replace(&mut self.seen[face as usize], true) {
            return;
        }
        self.faces.push(h);
        let size = topology.face_size(face);
        found.sizes.push(size);
        for step in 0..size {
            let vertex = topology.corners[topology.ahead(h, step) as usize];
            let number = &mut self.number_of_vertex[vertex as usize];
            if *number == NONE {
                *number = vertices.len() as u32;
                vertices.push(vertex);
            }
            found.corners.push(*number);
        }
    }

    fn add_sharpness(&self, first: u32, found: &mut Neighbourhood) {
        let topology = &self.cage.topology;
        let own = |step: u32| topology.corners[topology.ahead(first, step) as usize];
        let size = topology.face_size(topology.corner_face[first as usize]);
        found.sharpness.clear();
        found.sharpness.extend((0..size).map(|step| self.cage.vertex_sharpness[own(step) as usize].to_bits()));
        // The first face's vertices have the first numbers.
        let last = found.corners[..size as usize].iter().copied().max().unwrap_or(0);
        found.edges.clear();
        for &first in &self.faces {
            for step in 0..topology.face_size(topology.corner_face[first as usize]) {
                let edge = topology.corner_edge[topology.ahead(first, step) as usize];
                let ends = topology.edges[edge as usize];
                let matters = ends.iter().any(|&end| self.number_of_vertex[end as usize] <= last);
                found.edges.push(if matters { self.cage.edge_sharpness[edge as usize].to_bits() } else { 0 });
            }
        }
    }
}

impl Cage {
    /// The cage of some faces, in order, and of all faces around them; and the vertices of this one in its order.
    pub(super) fn around(&self, faces: &[u32]) -> (Cage, Vec<u32>) {
        let topology = &self.topology;
        let mut seen = vec![false; topology.faces()];
        let mut chosen = Vec::new();
        let near = faces.iter().flat_map(|&face| topology.face(face)).flat_map(|&vertex| topology.corners_at(vertex));
        for face in faces.iter().copied().chain(near.map(|&h| topology.corner_face[h as usize])) {
            if !std::mem::replace(&mut seen[face as usize], true) {
                chosen.push(face);
            }
        }
        let mut number = vec![NONE; topology.vertices()];
        let (mut vertices, mut starts, mut corners, mut sharpness) = (Vec::new(), vec![0], Vec::new(), Vec::new());
        for &face in &chosen {
            for &vertex in topology.face(face) {
                if number[vertex as usize] == NONE {
                    number[vertex as usize] = vertices.len() as u32;
                    vertices.push(vertex);
                }
                corners.push(number[vertex as usize]);
            }
            let own = topology.face_start[face as usize]..topology.face_start[face as usize + 1];
            sharpness.extend(own.map(|h| self.edge_sharpness[topology.corner_edge[h as usize] as usize]));
            starts.push(corners.len() as u32);
        }
        let part = Topology::new(starts, corners, vertices.len());
        let mut edge_sharpness = vec![0.0; part.edges.len()];
        part.corner_edge.iter().zip(&sharpness).for_each(|(&edge, &s)| edge_sharpness[edge as usize] = s);
        let cage = Cage {
            edge_sharpness,
            vertex_sharpness: vertices.iter().map(|&vertex| self.vertex_sharpness[vertex as usize]).collect(),
            holes: vec![false; chosen.len()],
            creasing: self.creasing,
            triangles: self.triangles,
            topology: part,
        };
        (cage, vertices)
    }
}
