//! Children and triangles of a place in rows of eight, one column each: what walks read that open many places.

use super::hit::TriHit;
use super::place::Place;

/// Columns of a row.
pub const COLUMNS: usize = 8;
/// Greatest number of vertices of a leaf in rows.
pub const VERTICES: usize = 16;

/// The children of a place, or its triangles. Columns from `count` on are arbitrary.
#[derive(Debug, Clone)]
pub struct Rows {
    /// Number of children or triangles.
    pub count: usize,
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
            count: 0,
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
