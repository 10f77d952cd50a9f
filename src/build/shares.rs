//! The division of a memory budget.

use crate::base::error::{Error, Result};

/// Maximum number of bytes per triangle while the tree of its chunk is built: corners, part, id and colour (48),
/// references with room for splits (64), and nodes with their stand-ins, leaves and encoded blocks (144 with splits, 60
/// without).
const BYTES_PER_TRIANGLE: u64 = 256;

/// Number of bytes for everything that does not depend on the size of the input: buffers of the output, batches being
/// encoded.
const FIXED: u64 = 16 << 20;

/// Number of bytes for textures in any budget. They take no memory any more when trees are built.
const TEXTURES: u64 = 8 << 20;

/// Least budget of any build, in bytes.
pub const LEAST: u64 = 32 << 20;

/// Number of bytes of a triangle of the input.
const BYTES_KEPT: u64 = 44;

/// Number of bytes of a triangle in the buffer of a chunk. The buffer takes twice as many while it grows.
const BYTES_WAITING: u64 = 48;

/// The shares of a budget. They depend on nothing but the budget, and so does the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shares {
    /// Bytes of input that are kept in memory while it is read. Input beyond that goes to a scratch file.
    pub spool: u64,
    /// Bytes of vertices that a reader keeps; 0: no limit.
    pub reader: u64,
    /// Bytes of decoded textures, and of decoding one; 0: no limit.
    pub textures: u64,
    /// Maximum number of triangles whose tree is built at once.
    pub chunk: u64,
    /// Maximum number of triangles that wait, over all chunks, while a mesh is distributed.
    pub waiting: u64,
    /// Maximum number of bytes of blocks that wait for their place in the file, for each of up to three kinds.
    pub aside: usize,
}

impl Shares {
    /// The shares of a budget in bytes; 0: no limit. Fails with `OverBudget` below the least budget.
    pub fn of(budget: u64) -> Result<Self> {
        if budget == 0 {
            return Ok(Self {
                spool: u64::MAX,
                reader: 0,
                textures: 0,
                chunk: u64::MAX,
                waiting: u64::MAX,
                aside: usize::MAX,
            });
        }
        if budget < LEAST {
            return Err(Error::OverBudget { what: "building a model".into(), need: LEAST, have: budget });
        }
        let free = budget - FIXED;
        Ok(Self {
            // Exactly the input that stays in memory while it is read is built in memory.
            spool: free / BYTES_PER_TRIANGLE * BYTES_KEPT,
            reader: free / 4,
            textures: TEXTURES + free / 4,
            // A part of the budget is left for the upper nodes of completed chunks, and for their blocks.
            chunk: free / 8 * 5 / BYTES_PER_TRIANGLE,
            waiting: free / 4 / BYTES_WAITING,
            aside: usize::try_from(free / 32).unwrap_or(usize::MAX),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_names_the_least() {
        match Shares::of(LEAST - 1) {
            Err(Error::OverBudget { need, have, .. }) => assert_eq!((need, have), (LEAST, LEAST - 1)),
            other => panic!("{other:?}"),
        }
        assert!(Shares::of(LEAST).unwrap().chunk > 10_000);
        assert_eq!(Shares::of(0).unwrap().chunk, u64::MAX);
    }

    #[test]
    fn shares_fit_their_budget() {
        for budget in [LEAST, 100 << 20, 512 << 20, 1 << 40] {
            let s = Shares::of(budget).unwrap();
            assert!(s.chunk * BYTES_PER_TRIANGLE + FIXED + 3 * s.aside as u64 <= budget);
            assert!(s.spool + s.reader + FIXED <= budget && s.spool + 2 * s.waiting * BYTES_WAITING + FIXED <= budget);
        }
    }
}
