//! Triangles that rays hit, and which rays hit the same: rows of numbers, a column for each triangle, filled by the
//! structure that the tree is of.

use glam::Vec3;

/// Up to `N` rays by what they hit. Reusable.
#[derive(Debug)]
pub struct Groups<const N: usize> {
    /// The rays that hit cells.
    pub cells: u32,
    /// How many triangles were hit; where it is not known which rays hit the same, one for each ray.
    pub count: usize,
    /// For each of those, the rays that hit it.
    pub rays: [u32; N],
}

impl<const N: usize> Groups<N> {
    /// No hits.
    pub const NONE: Self = Self { cells: 0, count: 0, rays: [0; N] };
}

/// Up to `N` triangles as stored, a column for each. Reusable: further columns hold anything.
#[derive(Debug)]
pub struct Surfaces<const N: usize> {
    /// Of each corner the coordinates around the tree's origin, axis by axis.
    pub corners: [[[f32; N]; 3]; 3],
    /// Local parts.
    pub part: [u32; N],
}

impl<const N: usize> Surfaces<N> {
    /// No triangles.
    pub const NONE: Self = Self { corners: [[[0.0; N]; 3]; 3], part: [0; N] };

    /// Takes over a triangle.
    #[inline(always)]
    pub fn set(&mut self, column: usize, corners: &[Vec3; 3], part: u32) {
        for (rows, corner) in self.corners.iter_mut().zip(corners) {
            for axis in 0..3 {
                rows[axis][column] = corner[axis];
            }
        }
        self.part[column] = part;
    }

    /// The corners of a triangle.
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
