//! One uniform step of subdivision.

use super::level::Cage;
use super::masks::Row;
use super::rules::{INFINITE, decremented};
use super::topology::Topology;
use crate::base::error::{Error, Result};
use std::ops::{Add, Mul};

/// The greatest number of corners of a refined level.
const MAX_CORNERS: usize = (u32::MAX / 4) as usize;

impl Cage {
    /// The next level: each face of n corners becomes n quads. Child `h` is the quad at corner `h`, counted over all
    /// faces in order, see [`Cage::parent`]. Its vertices are one a vertex, then one a face, then one an edge of this
    /// level.
    ///
    /// The corner of a child of a quad that is its parent's vertex keeps its number, so that u and v keep their
    /// directions. A child of any other face begins at that vertex.
    ///
    /// # Errors
    /// [`Error::OverLimit`] if the numbers of the level would not fit 32 bits.
    pub fn refine(&self) -> Result<Cage> {
        let corners = self.topology.corners.len();
        if corners > MAX_CORNERS / 4 {
            let most = MAX_CORNERS as u64;
            return Err(Error::OverLimit { what: "corners of a refined cage", most, limit: "32-bit numbers" });
        }
        Ok(self.refined())
    }

    /// [`refine`](Self::refine) for cages that are known to be small.
    pub(super) fn refined(&self) -> Cage {
        let corners = self.topology.corners.len() as u32;
        let vertices = (0..corners).flat_map(|h| self.child_quad(h)).collect();
        let starts = (0..=corners).map(|face| 4 * face).collect();
        let topology = Topology::new(starts, vertices, self.child_count());
        let mut vertex_sharpness: Vec<f32> = self.vertex_sharpness.iter().copied().map(decremented).collect();
        vertex_sharpness.resize(self.child_of_edge(0) as usize, 0.0);
        // Both halves of an edge from a vertex to itself become one: its point stays, as between two creases.
        let to_itself = |ends: &[u32; 2]| if ends[0] == ends[1] { INFINITE } else { 0.0 };
        vertex_sharpness.extend(self.topology.edges.iter().map(to_itself));
        Cage {
            edge_sharpness: topology.edges.iter().map(|&ends| self.sharpness_of_child_edge(ends)).collect(),
            vertex_sharpness,
            holes: self.topology.corner_face.iter().map(|&face| self.holes[face as usize]).collect(),
            creasing: self.creasing,
            triangles: self.triangles,
            topology,
        }
    }

    fn child_quad(&self, h: u32) -> [u32; 4] {
        let topology = &self.topology;
        let face = topology.corner_face[h as usize];
        let edge = |h: u32| self.child_of_edge(topology.corner_edge[h as usize]);
        let mut quad = [topology.corners[h as usize], edge(h), self.child_of_face(face), edge(topology.prev(h))];
        if topology.face_size(face) == 4 {
            quad.rotate_right((h - topology.face_start[face as usize]) as usize);
        }
        quad
    }

    /// Edges from the child of a vertex to the child of an edge are halves of that edge; the others are new and smooth.
    fn sharpness_of_child_edge(&self, [low, high]: [u32; 2]) -> f32 {
        let first_of_edges = self.child_of_edge(0);
        if (low as usize) < self.vertex_count() && high >= first_of_edges {
            self.child_edge_sharpness(high - first_of_edges, low)
        } else {
            0.0
        }
    }

    /// The face of this level and its corner whose child is face `child` of the next level.
    pub fn parent(&self, child: u32) -> (u32, u32) {
        let face = self.topology.corner_face[child as usize];
        (face, child - self.topology.face_start[face as usize])
    }

    /// Points of the next level by those of this one: one a vertex, in any vector space (positions, UVs).
    ///
    /// # Errors
    /// [`Error::BadArgument`] unless there is one point a vertex.
    pub fn refine_points<P>(&self, points: &[P]) -> Result<Vec<P>>
    where
        P: Copy + Add<Output = P> + Mul<f64, Output = P>,
    {
        if points.len() != self.vertex_count() {
            let (given, wanted) = (points.len(), self.vertex_count());
            return Err(Error::bad_argument(format!("{given} points for a cage of {wanted} vertices")));
        }
        let mut row = Row::new();
        let mut out: Vec<P> = points.to_vec();
        let first_of_edges = self.child_of_edge(0);
        // Children of faces first: the others refer to them.
        for child in points.len() as u32..first_of_edges {
            self.mask(child, &mut row);
            out.push(combination(&row, |i| points[i as usize]));
        }
        let value = |out: &[P], i: u32| if (i as usize) < points.len() { points[i as usize] } else { out[i as usize] };
        for child in 0..points.len() as u32 {
            self.mask(child, &mut row);
            out[child as usize] = combination(&row, |i| value(&out, i));
        }
        for child in first_of_edges..self.child_count() as u32 {
            self.mask(child, &mut row);
            out.push(combination(&row, |i| value(&out, i)));
        }
        Ok(out)
    }
}

/// The sum of weighted points. Rows are never empty.
fn combination<P: Copy + Add<Output = P> + Mul<f64, Output = P>>(row: &Row, point: impl Fn(u32) -> P) -> P {
    let term = |&(i, weight): &(u32, f64)| point(i) * weight;
    let first = term(&row[0]);
    row[1..].iter().map(term).fold(first, |sum, p| sum + p)
}
