//! Cells that stand in for what a tree holds, as rays see them: rows of numbers, a column for each ray, filled by the
//! structure that the tree is of. What they promise, and how they look in the world, is worked out from these alone
//! (`query::answers`).

use crate::math::Bounds;
use glam::Vec3;

/// The cells that up to `N` rays hit, a column for each ray. Reusable: columns of other rays hold anything.
#[derive(Debug)]
pub struct Cells<const N: usize> {
    /// Boxes in the tree's frame, as walks see them: low x, y, z, high x, y, z. (Those of cells of one sample only when
    /// asked for, or if the ray begins inside.)
    pub bounds: [[f32; N]; 6],
    /// Words of samples (`lod::Coded`): of the sides across x, y and z that face the ray; where there is one sample,
    /// that of all is the first.
    pub firsts: [[u32; N]; 3],
    /// The second words, see `firsts`.
    pub seconds: [[u32; N]; 3],
    /// The tree's local part of which most is seen.
    pub part: [u32; N],
    /// How near all of the region in which a cell is met is to its content (`lod::limit`). (Only when asked for.)
    pub level: [u32; N],
    /// Rays whose cells stand in for what is not in memory; of these, rays that begin in their cells.
    pub missing: u32,
    /// See `missing`.
    pub inside: u32,
    /// Rays whose cells have a sample for each of three sides.
    pub have_three: u32,
    /// Rays whose cells show colours of their own, not those of their parts.
    pub coloured: u32,
}

impl<const N: usize> Cells<N> {
    /// No cells.
    pub const NONE: Self = Self {
        bounds: [[0.0; N]; 6],
        firsts: [[0; N]; 3],
        seconds: [[0; N]; 3],
        part: [0; N],
        level: [0; N],
        missing: 0,
        inside: 0,
        have_three: 0,
        coloured: 0,
    };

    /// The box of the cell of ray `i`.
    #[inline(always)]
    pub fn bounds_of(&self, i: usize) -> Bounds {
        let b = &self.bounds;
        Bounds { min: Vec3::new(b[0][i], b[1][i], b[2][i]), max: Vec3::new(b[3][i], b[4][i], b[5][i]) }
    }
}
