//! Smooth surfaces: those that a sink takes, and readers of their files. The readers return whole surfaces, in memory
//! that grows with the text alone.

pub mod bpt;
mod json;
mod meshes;
mod read;
mod rectangle;
pub mod trimmed_nurbs;
#[cfg(test)]
mod tests;

pub use crate::geom::surface::cage::{Boundary, CageDesc, Creasing, Displacement, TriangleRule};
pub use crate::geom::surface::displacement::{Heights, Wrap};
pub use crate::geom::surface::nurbs::{MAX_DEGREE, NurbsDesc};
pub use meshes::{CageMesh, Dicing, HeightMap, MOST_LEVEL, NurbsMesh, TOLERANCE};
pub(crate) use read::{Kind, read};

use glam::DVec3;

/// A surface of a file. The arrays are as in [`NurbsDesc`].
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceData {
    /// Number of the face in the file, from 0.
    pub face: u64,
    /// Degrees along u and v.
    pub degree: [u32; 2],
    /// Numbers of control points along u and v.
    pub counts: [u32; 2],
    /// Knots of u and v.
    pub knots: [Vec<f64>; 2],
    /// Control points, v fastest.
    pub points: Vec<DVec3>,
    /// Weights; `None`: all are 1.
    pub weights: Option<Vec<f64>>,
    /// The rectangle of parameters that the face consists of: the whole surface or a part of it.
    pub domain: [[f64; 2]; 2],
    /// True if the outer side of the face is opposite to `du × dv`.
    pub is_reversed: bool,
}

impl SurfaceData {
    /// The surface with borrowed arrays.
    pub fn desc(&self) -> NurbsDesc<'_> {
        let [knots_u, knots_v] = self.knots.each_ref().map(Vec::as_slice);
        let (points, weights) = (&self.points[..], self.weights.as_deref());
        NurbsDesc { degree: self.degree, counts: self.counts, knots_u, knots_v, points, weights }
    }
}
