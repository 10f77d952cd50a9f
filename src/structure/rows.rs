//! Children and triangles of a place in rows of eight, one column each: what walks read that open many places. Those
//! that measure distances compute with them in double precision.

use super::hit::TriHit;
use super::place::Place;
use glam::DAffine3;

/// Columns of a row.
pub const COLUMNS: usize = 8;
/// Greatest number of vertices of a leaf in rows.
pub const VERTICES: usize = 16;

/// A number for each column, in double precision.
pub type Lanes = [f64; COLUMNS];

/// The children of a place, or its triangles. Columns outside of the mask are arbitrary.
#[derive(Debug, Clone)]
pub struct Rows {
    /// Bit `i`: column `i` is a child or a triangle. Triangles have the first columns.
    pub mask: u32,
    /// True if these are triangles.
    pub is_leaf: bool,
    /// The children.
    pub places: [Place; COLUMNS],
    /// Children with only triangles below them (bit `i`: child `i`).
    pub leaves: u32,
    /// Boxes of the children: low x, y, z, high x, y, z. They hold all triangles below, but not more than one rounding.
    pub bounds: [[f32; COLUMNS]; 6],
    /// The parts below each child, if they were asked for.
    pub below: [PartsBelow; COLUMNS],
    /// Coordinates of the triangles' vertices, by axis.
    pub vertices: [[f32; VERTICES]; 3],
    /// The vertex of each corner of each triangle.
    pub corners: [[u8; COLUMNS]; 3],
    /// The local part of each triangle.
    pub parts: [u32; COLUMNS],
    /// The hit of the first triangle; those of the others follow it by `tri`.
    pub first: TriHit,
}

impl Default for Rows {
    fn default() -> Self {
        let nowhere = Place { block: u32::MAX, item: 0 };
        Self {
            mask: 0,
            is_leaf: false,
            places: [nowhere; COLUMNS],
            leaves: 0,
            bounds: [[0.0; COLUMNS]; 6],
            below: [PartsBelow::UNKNOWN; COLUMNS],
            vertices: [[0.0; VERTICES]; 3],
            corners: [[0; COLUMNS]; 3],
            parts: [0; COLUMNS],
            first: TriHit::none(0.0),
        }
    }
}

impl Rows {
    /// The boxes of the children.
    #[inline(always)]
    pub fn boxes(&self) -> [Lanes; 6] {
        let mut out = [[0.0; COLUMNS]; 6];
        for (out, row) in out.iter_mut().zip(&self.bounds) {
            out.iter_mut().zip(row).for_each(|(out, x)| *out = f64::from(*x));
        }
        out
    }

    /// The corners of the triangles, by corner and axis, placed by a map. `is_shift`: the map only moves.
    #[inline(always)]
    pub fn placed(&self, map: &DAffine3, is_shift: bool) -> [[Lanes; 3]; 3] {
        let (m, t, v) = (&map.matrix3, map.translation, &self.vertices);
        // Vertices are placed once, before triangles share them.
        let mut vertices = [[0.0; VERTICES]; 3];
        for axis in 0..3 {
            let [x, y, z] = [m.x_axis[axis], m.y_axis[axis], m.z_axis[axis]];
            for i in 0..VERTICES {
                let v = [f64::from(v[0][i]), f64::from(v[1][i]), f64::from(v[2][i])];
                let turned = if is_shift { v[axis] } else { x * v[0] + y * v[1] + z * v[2] };
                vertices[axis][i] = turned + t[axis];
            }
        }
        let mut out = [[[0.0; COLUMNS]; 3]; 3];
        for corner in 0..3 {
            for axis in 0..3 {
                for i in 0..COLUMNS {
                    out[corner][axis][i] = vertices[axis][usize::from(self.corners[corner][i]) % VERTICES];
                }
            }
        }
        out
    }

    /// True if only triangles are below a child.
    #[inline(always)]
    pub fn is_leaf_below(&self, column: usize) -> bool {
        self.leaves >> column & 1 == 1
    }

    /// A triangle as a hit.
    #[inline(always)]
    pub fn hit(&self, column: usize) -> TriHit {
        TriHit { tri: self.first.tri + column as u32, ..self.first }
    }
}

/// The parts of the triangles below a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartsBelow {
    /// The local part of all of them; [`PartsBelow::SEVERAL`] if there may be others.
    pub part: u32,
    /// The bits (`lod::summary_bit`) of all their parts; more bits may be set.
    pub bits: u32,
}

impl PartsBelow {
    /// The part of places with several.
    pub const SEVERAL: u32 = u32::MAX;
    /// Any parts.
    pub const UNKNOWN: Self = Self { part: Self::SEVERAL, bits: u32::MAX };

    /// The part, if it is one.
    #[inline(always)]
    pub fn one(&self) -> Option<u32> {
        (self.part != Self::SEVERAL).then_some(self.part)
    }
}
