//! Triangles that rays hit, and the rays that hit the same triangle: arrays with one column for each triangle, filled
//! by the structure of the tree.

use super::hit::Triangle;
use glam::Vec3;

/// Up to `N` rays, grouped by the triangle that they hit. Reusable.
#[derive(Debug)]
pub struct Groups<const N: usize> {
    /// Rays that hit cells.
    pub cells: u32,
    /// Number of groups, one for each triangle that was hit. If it is not known which rays hit the same triangle, each
    /// ray is a group.
    pub count: usize,
    /// Rays of each group.
    pub rays: [u32; N],
}

impl<const N: usize> Groups<N> {
    /// No hits.
    pub const NONE: Self = Self { cells: 0, count: 0, rays: [0; N] };
}

/// Up to `N` triangles as stored, one column each. Reusable: columns beyond hold arbitrary values.
#[derive(Debug)]
pub struct Surfaces<const N: usize> {
    /// Coordinates of each corner relative to the tree's origin: corner, axis, column.
    pub corners: [[[f32; N]; 3]; 3],
    /// Local parts.
    pub part: [u32; N],
}

impl<const N: usize> Surfaces<N> {
    /// No triangles.
    pub const NONE: Self = Self { corners: [[[0.0; N]; 3]; 3], part: [0; N] };

    /// Fills `count` columns, at most `N`. Returns those without a triangle (bit `i`: column `i`).
    #[inline(always)]
    pub(super) fn fill(&mut self, count: usize, triangle: impl Fn(usize) -> Option<Triangle>) -> u32 {
        let mut gone = 0;
        for column in 0..count.min(N) {
            match triangle(column) {
                Some(triangle) => self.set(column, &triangle.vertices, triangle.part),
                None => gone |= 1 << column,
            }
        }
        gone
    }

    /// Stores a triangle in a column.
    #[inline(always)]
    pub fn set(&mut self, column: usize, corners: &[Vec3; 3], part: u32) {
        for (rows, corner) in self.corners.iter_mut().zip(corners) {
            for axis in 0..3 {
                rows[axis][column] = corner[axis];
            }
        }
        self.part[column] = part;
    }

    /// The corners of the triangle in a column.
    #[inline(always)]
    pub fn corners_of(&self, column: usize) -> [Vec3; 3] {
        let [a, b, c] = &self.corners;
        [
            Vec3::new(a[0][column], a[1][column], a[2][column]),
            Vec3::new(b[0][column], b[1][column], b[2][column]),
            Vec3::new(c[0][column], c[1][column], c[2][column]),
        ]
    }
}
