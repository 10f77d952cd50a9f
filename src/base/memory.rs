//! Allocations whose size the caller or a model determines. If the system cannot provide the memory, the result is an
//! error instead of the end of the process.

use super::error::{Error, Result};
use bytemuck::{Zeroable, allocation::try_zeroed_slice_box};

/// Returns `count` zeros in memory that is not yet touched. Fails with [`Error::NoMemory`], which says `what` they were
/// for.
pub fn zeroed<T: Zeroable>(count: usize, what: &str) -> Result<Vec<T>> {
    let refused = |()| refused::<T>(count, what);
    try_zeroed_slice_box(count).map(Vec::from).map_err(refused)
}

/// Returns an empty vector with room for `count` elements. Fails like [`zeroed`].
pub fn room<T>(count: usize, what: &str) -> Result<Vec<T>> {
    let mut all = Vec::new();
    all.try_reserve_exact(count).map_err(|_| refused::<T>(count, what))?;
    Ok(all)
}

/// Makes room in a vector for `more` elements, and for as many as it has if it grows. Fails like [`zeroed`].
pub fn make_room<T>(all: &mut Vec<T>, more: usize, what: &str) -> Result<()> {
    all.try_reserve(more).map_err(|_| refused::<T>(all.len().saturating_add(more), what))
}

fn refused<T>(count: usize, what: &str) -> Error {
    Error::NoMemory { what: what.into(), bytes: (count as u64).saturating_mul(size_of::<T>() as u64) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_that_the_system_lacks_is_an_error() {
        for error in [zeroed::<u64>(1 << 58, "a picture").unwrap_err(), room::<u64>(1 << 58, "a picture").unwrap_err()]
        {
            assert_eq!(error.to_string(), "a picture: the system cannot provide 2305843009213693952 bytes of memory");
        }
        assert!(zeroed::<u64>(usize::MAX, "x").is_err() && room::<u64>(usize::MAX, "x").is_err());
        assert_eq!(zeroed::<u32>(3, "x").unwrap(), [0; 3]);
        assert!(room::<u32>(3, "x").unwrap().capacity() >= 3);
    }
}
