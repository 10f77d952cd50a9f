//! The description of a cage, as callers give it.

/// The greatest number of corners of a face, and of faces or edges at a vertex. It bounds the neighbourhood of a face.
pub const MAX_VALENCE: usize = 4096;

/// Rule for the boundary of a cage (`Sdc::Options::VtxBoundaryInterpolation` of OpenSubdiv 3.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Boundary {
    /// Faces at a boundary have no surface, except where all boundary edges at their vertices are infinitely sharp.
    None,
    /// Boundary edges are infinitely sharp, and so are vertices of one face.
    EdgeAndCorner,
    /// Boundary edges are infinitely sharp.
    #[default]
    EdgeOnly,
}

/// Rule for the sharpness of the two children of a semi-sharp edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Creasing {
    /// One less than that of the edge.
    #[default]
    Uniform,
    /// One less than 3/4 of that of the edge and 1/4 of the mean of the other semi-sharp edges at the vertex.
    Chaikin,
}

/// Rule for smooth edges at triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum TriangleRule {
    /// The rule of all other faces.
    #[default]
    CatmullClark,
    /// Greater weights for the centres of triangles, which hides their bumps.
    Smooth,
}

/// A cage without its positions, as arrays of the caller.
#[derive(Debug, Clone, Copy, Default)]
pub struct CageDesc<'a> {
    /// Corners of each face, 3 to [`MAX_VALENCE`].
    pub face_sizes: &'a [u32],
    /// Vertices of the corners of the first face, then of the next, ..., anticlockwise seen from outside.
    pub indices: &'a [u32],
    /// Edges by their two vertices with their sharpness: 0 is smooth, [`INFINITE`](super::INFINITE) or more is a crease
    /// at all levels. The last one of an edge counts.
    pub creases: &'a [(u32, u32, f32)],
    /// Vertices with their sharpness. The last one of a vertex counts.
    pub corners: &'a [(u32, f32)],
    /// Faces without a surface, which serve their neighbours.
    pub holes: &'a [u32],
    /// Rule for boundaries.
    pub boundary: Boundary,
    /// Rule for semi-sharp edges.
    pub creasing: Creasing,
    /// Rule for triangles.
    pub triangles: TriangleRule,
}
