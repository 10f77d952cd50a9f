//! Weights of one step of subdivision: Catmull, Clark, "Recursively generated B-spline surfaces on arbitrary
//! topological meshes", Computer-Aided Design 10(6), 1978, with the creases of `rules`.
//!
//! Children are numbered: one a vertex, in order; one a face; one an edge. Weights refer to vertices and to the
//! children of faces by these numbers, since the latter are means of corners and known before the others.

use super::desc::TriangleRule;
use super::level::Cage;
use super::rules::{Rule, child_sharpness, decremented, transition};

/// Weight of the centre of a triangle at a smooth edge under [`TriangleRule::Smooth`], 1/4 elsewhere: Stam, Loop,
/// "Quad/Triangle Subdivision", Computer Graphics Forum 22(1), 2003, in OpenSubdiv's form.
const TRIANGLE_WEIGHT: f64 = 0.470;

/// Weights of points by their numbers.
pub(super) type Row = Vec<(u32, f64)>;

impl Cage {
    /// Number of vertices one level deeper.
    pub(super) fn child_count(&self) -> usize {
        self.vertex_count() + self.face_count() + self.edge_count()
    }

    pub(super) fn child_of_face(&self, face: u32) -> u32 {
        self.vertex_count() as u32 + face
    }

    pub(super) fn child_of_edge(&self, edge: u32) -> u32 {
        (self.vertex_count() + self.face_count()) as u32 + edge
    }

    /// The weights of a child. A number can occur twice.
    pub(super) fn mask(&self, child: u32, row: &mut Row) {
        row.clear();
        let (vertices, faces) = (self.vertex_count() as u32, self.face_count() as u32);
        if child < vertices {
            self.vertex_mask(child, row);
        } else if child < vertices + faces {
            let face = self.topology.face(child - vertices);
            row.extend(face.iter().map(|&vertex| (vertex, 1.0 / face.len() as f64)));
        } else {
            self.edge_mask(child - vertices - faces, row);
        }
    }

    fn edge_mask(&self, edge: u32, row: &mut Row) {
        let ends = self.topology.edges[edge as usize];
        let corners = self.topology.corners_of_edge(edge);
        let sharpness = self.edge_sharpness[edge as usize];
        let sharp = if sharpness > 0.0 { self.crease_weight(edge, sharpness) } else { 0.0 };
        if sharp >= 1.0 || corners.len() != 2 {
            row.extend(ends.map(|vertex| (vertex, 0.5)));
            return;
        }
        let centre = |h: u32| {
            let face = self.topology.corner_face[h as usize];
            let triangle = self.topology.face_size(face) == 3 && self.triangles == TriangleRule::Smooth;
            (self.child_of_face(face), if triangle { TRIANGLE_WEIGHT } else { 0.25 })
        };
        let centres = [centre(corners[0]), centre(corners[1])];
        let face_weight = 0.5 * (centres[0].1 + centres[1].1);
        let end_weight = 0.5 * (1.0 - 2.0 * face_weight);
        row.extend(ends.map(|vertex| (vertex, 0.5 * sharp + (1.0 - sharp) * end_weight)));
        row.extend(centres.map(|(face, _)| (face, (1.0 - sharp) * face_weight)));
    }

    /// Weight of the midpoint at a sharp edge: its sharpness below 1, unless both children are still sharp.
    fn crease_weight(&self, edge: u32, sharpness: f32) -> f64 {
        let stays = |&vertex: &u32| self.child_edge_sharpness(edge, vertex) > 0.0;
        if sharpness >= 1.0 || self.topology.edges[edge as usize].iter().all(stays) { 1.0 } else { sharpness.into() }
    }

    /// Sharpness of the child of an edge at one of its vertices.
    pub(super) fn child_edge_sharpness(&self, edge: u32, vertex: u32) -> f32 {
        child_sharpness(self.edge_sharpness[edge as usize], self.sharpness_around(vertex), self.creasing)
    }

    fn vertex_mask(&self, vertex: u32, row: &mut Row) {
        let rule = self.rule_of(vertex);
        let edges = self.topology.edges_at(vertex);
        let sharpness = || edges.iter().map(|&edge| self.edge_sharpness[edge as usize]);
        if rule.is_smooth() {
            self.add_rule(vertex, rule, sharpness(), 1.0, row);
            return;
        }
        let children = || edges.iter().map(|&edge| self.child_edge_sharpness(edge, vertex));
        let own = self.vertex_sharpness[vertex as usize];
        let child_rule = Rule::of(decremented(own), children());
        let weight = if child_rule == rule {
            1.0
        } else {
            transition(own, decremented(own), sharpness().zip(children()), self.creasing)
        };
        self.add_rule(vertex, rule, sharpness(), weight, row);
        if weight < 1.0 {
            self.add_rule(vertex, child_rule, children(), 1.0 - weight, row);
        }
    }

    fn add_rule(&self, vertex: u32, rule: Rule, sharpness: impl Iterator<Item = f32>, weight: f64, row: &mut Row) {
        let edges = self.topology.edges_at(vertex);
        let corners = self.topology.corners_at(vertex);
        match rule {
            Rule::Crease => {
                row.push((vertex, 0.75 * weight));
                let sharp = edges.iter().zip(sharpness).filter(|&(_, s)| s > 0.0);
                row.extend(sharp.map(|(&edge, _)| (self.topology.other_end(edge, vertex), 0.125 * weight)));
            }
            // Other counts occur at the rim of a neighbourhood, where no child is used, and at vertices without faces.
            Rule::Smooth | Rule::Dart if corners.len() == edges.len() && !edges.is_empty() => {
                let valence = edges.len() as f64;
                row.push((vertex, weight * (valence - 2.0) / valence));
                let each = weight / (valence * valence);
                row.extend(edges.iter().map(|&edge| (self.topology.other_end(edge, vertex), each)));
                let faces = corners.iter().map(|&h| self.topology.corner_face[h as usize]);
                row.extend(faces.map(|face| (self.child_of_face(face), each)));
            }
            _ => row.push((vertex, weight)),
        }
    }
}
