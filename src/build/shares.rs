//! What a memory budget is spent on.

use crate::base::error::{Error, Result};

/// Bytes that a triangle takes while the tree of its chunk is built, at most: corners, part, id and colour
/// (48), references with room for splits (64), nodes with their voxels, leaves and blocks on their way to the
/// file (144 where it is split, 60 where it is not).
const BYTES_PER_TRIANGLE: u64 = 256;

/// For what does not depend on the size of the input: buffers of the output, batches being coded.
const FIXED: u64 = 16 << 20;

/// The least budget that anything can be built in.
pub const LEAST: u64 = 32 << 20;

/// Bytes of a triangle as it was read.
const BYTES_KEPT: u64 = 44;

/// Bytes of a triangle that waits in the buffer of a chunk; as much again while that grows.
const BYTES_WAITING: u64 = 48;

/// Shares of a budget. They, and so the file, depend on nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shares {
    /// Bytes of input kept in memory while it is read; what is more goes to a scratch file.
    pub spool: u64,
    /// Bytes of vertices that a reader keeps; 0: no limit.
    pub reader: u64,
    /// Triangles built at once.
    pub chunk: u64,
    /// Triangles that wait, over all chunks, while a mesh is distributed.
    pub waiting: u64,
    /// Bytes of blocks that wait for their place in the file, each of up to three kinds.
    pub aside: usize,
}

impl Shares {
    /// Of a budget in bytes; 0: no limit. Fails with `OverBudget` below the least.
    pub fn of(budget: u64) -> Result<Self> {
        if budget == 0 {
            return Ok(Self { spool: u64::MAX, reader: 0, chunk: u64::MAX, waiting: u64::MAX, aside: usize::MAX });
        }
        if budget < LEAST {
            return Err(Error::OverBudget { what: "building a model".into(), need: LEAST, have: budget });
        }
        let free = budget - FIXED;
        Ok(Self {
            // What is in memory when all has been read, and no more than that, is built in memory.
            spool: free / BYTES_PER_TRIANGLE * BYTES_KEPT,
            reader: free / 4,
            // Not all: the upper nodes of chunks that are done, and their blocks, stay.
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
