//! The looks of stand-ins: one enum of all kinds, and the samples that a ray sees of each. A further kind is a file in
//! this room and a variant here.

use super::coded::Coded;
use super::proxy::{self, Looks};
use glam::Vec3;

/// The look of a stand-in. A sample is two words, see `coded.rs`.
#[derive(Debug, Clone, Copy)]
pub enum Look<'a> {
    /// A sample that all rays see, of a voxel or a curtain.
    One([u32; 2]),
    /// A sample of surfaces that face along the axes.
    AlongAxes([u32; 2]),
    /// The samples of a voxel's sides: low x, y, z, high x, y, z.
    Sides(&'a [u32]),
    /// A proxy's samples of eighteen directions.
    Proxy(&'a Looks),
}

/// The samples of a look that a ray sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// First words: normal and likeness.
    pub firsts: [u32; 3],
    /// Second words: colour and cover.
    pub seconds: [u32; 3],
    /// Shares of the samples.
    pub shares: Shares,
}

/// The shares of samples in a look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shares {
    /// Only the first sample counts.
    One,
    /// The samples are those of three sides of a box, across x, y and z. [`shares`](super::shares) computes their
    /// shares.
    OfSides,
    /// The shares, which add up to 1.
    Given([f32; 3]),
}

impl Look<'_> {
    /// Returns the samples that a ray sees; `dir` is its direction in the tree's frame.
    #[inline(always)]
    pub fn seen(&self, dir: Vec3) -> Seen {
        match *self {
            Self::One([first, second]) => Seen { firsts: [first; 3], seconds: [second; 3], shares: Shares::One },
            Self::AlongAxes([first, second]) => {
                let (firsts, seconds) = Coded::along_axes(first, second);
                Seen { firsts, seconds, shares: Shares::OfSides }
            }
            Self::Sides(words) => {
                // A ray in the positive direction of an axis faces the low side.
                let at: [usize; 3] = std::array::from_fn(|axis| 2 * if dir[axis] >= 0.0 { axis } else { axis + 3 });
                let (firsts, seconds) = (at.map(|at| words[at]), at.map(|at| words[at + 1]));
                Seen { firsts, seconds, shares: Shares::OfSides }
            }
            Self::Proxy(looks) => {
                let (firsts, seconds, shares) = proxy::seen(looks, -dir);
                Seen { firsts, seconds, shares: Shares::Given(shares) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_see_the_sides_that_face_them() {
        let words: Vec<u32> = (0..12).collect();
        let seen = Look::Sides(&words).seen(Vec3::new(1.0, -1.0, 0.0));
        // Low x, high y, low z.
        assert_eq!(seen, Seen { firsts: [0, 8, 4], seconds: [1, 9, 5], shares: Shares::OfSides });
    }

    #[test]
    fn one_sample_is_seen_from_everywhere() {
        for dir in [Vec3::X, -Vec3::ONE] {
            let seen = Look::One([7, 8]).seen(dir);
            assert_eq!((seen.firsts[0], seen.seconds[0], seen.shares), (7, 8, Shares::One));
        }
    }
}
