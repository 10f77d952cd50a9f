//! Stand-ins that rays hit: arrays with one column for each ray, filled by the structure of the tree. `query::answers`
//! derives from these numbers alone how a stand-in looks in the world, and which error bound holds for it.

use crate::lod::{Look, Shares};
use crate::math::Bounds;
use glam::Vec3;

/// The parts in a cell, as parts of its tree.
#[derive(Debug, Clone, Copy)]
pub struct CellParts {
    /// The part that covers most of the cell.
    pub part: u32,
    /// True if there are other parts.
    pub is_mixed: bool,
    /// The bits (`lod::summary_bit`) of all parts.
    pub summary: u32,
    /// A block whose list of parts has all of them.
    pub listed_by: u32,
    /// The bits of all parts that the cell's curtains show (`lod::Curtain`); 0 if it has none.
    pub shown: u32,
}

/// Cells that up to `N` rays hit, one column for each ray. Reusable: the columns of other rays hold arbitrary values.
#[derive(Debug)]
pub struct Cells<const N: usize> {
    /// Boxes in the tree's frame, as walks test them: low x, y, z, high x, y, z. Boxes of cells with one sample are
    /// filled only if the caller requests them or the ray begins inside of the cell.
    pub bounds: [[f32; N]; 6],
    /// First words of samples (`lod::Coded`) of the three sides across x, y and z that face the ray. A cell with one
    /// sample has it in the first row.
    pub firsts: [[u32; N]; 3],
    /// Second words of the samples, see `firsts`.
    pub seconds: [[u32; N]; 3],
    /// The local part of the tree that covers most of the cell, or that the curtain shows.
    pub part: [u32; N],
    /// Level of the bound on the distance from the cell's region to its content (`lod::limit`). Filled only if the
    /// caller requests it.
    pub level: [u32; N],
    /// Rays that hit a stand-in for a block that is not in memory.
    pub missing: u32,
    /// Rays of `missing` that begin inside of the cell.
    pub inside: u32,
    /// Rays that hit a cell with a sample for each of three sides.
    pub have_three: u32,
    /// Rays of `have_three` whose samples are not those of a box's sides: `shares` has their shares.
    pub have_shares: u32,
    /// Shares of the three samples of the rays in `have_shares`.
    pub shares: [[f32; N]; 3],
    /// Rays that hit a cell with loose content, such as leaves, which transmits other rays.
    pub loose: u32,
    /// Rays that hit a cell with colours of its own, which replace the colours of its part.
    pub coloured: u32,
    /// Rays from which a curtain hides the cell (`lod::Curtain`): their sample is that of the curtain.
    pub curtained: u32,
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
        have_shares: 0,
        shares: [[0.0; N]; 3],
        loose: 0,
        coloured: 0,
        curtained: 0,
    };

    /// Removes all rays from the sets.
    #[inline(always)]
    pub fn clear(&mut self) {
        (self.missing, self.inside, self.loose, self.coloured, self.curtained) = (0, 0, 0, 0, 0);
        (self.have_three, self.have_shares) = (0, 0);
    }

    /// Fills in the samples that ray `i`, with direction `dir` in the tree's frame, sees of a look.
    #[inline(always)]
    pub fn set_look(&mut self, i: usize, look: &Look, dir: Vec3) {
        let seen = look.seen(dir);
        let count = if seen.shares == Shares::One { 1 } else { 3 };
        for side in 0..count {
            (self.firsts[side][i], self.seconds[side][i]) = (seen.firsts[side], seen.seconds[side]);
        }
        (self.have_three, self.have_shares) = (self.have_three & !(1 << i), self.have_shares & !(1 << i));
        match seen.shares {
            Shares::One => {}
            Shares::OfSides => self.have_three |= 1 << i,
            Shares::Given(shares) => {
                (self.have_three, self.have_shares) = (self.have_three | 1 << i, self.have_shares | 1 << i);
                (0..3).for_each(|side| self.shares[side][i] = shares[side]);
            }
        }
    }

    /// The box of the cell of ray `i`.
    #[inline(always)]
    pub fn bounds_of(&self, i: usize) -> Bounds {
        let b = &self.bounds;
        Bounds { min: Vec3::new(b[0][i], b[1][i], b[2][i]), max: Vec3::new(b[3][i], b[4][i], b[5][i]) }
    }
}
