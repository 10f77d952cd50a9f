//! Hints to the system about a file's pages: they are read in no order, and once. Decoded blocks are kept under a
//! budget; copies of the same data in the page cache would take memory beyond it.

use std::fs::File;

/// Asks the system not to read ahead. Does nothing on systems without such a call.
pub(super) fn expect_random(file: &File) {
    sys::expect_random(file);
}

/// Lets the system drop the pages of `offset..offset + len` from its cache. A hint, like [`expect_random`].
pub(super) fn drop_pages(file: &File, offset: u64, len: usize) {
    sys::drop_pages(file, offset, len as u64);
}

#[cfg(target_os = "linux")]
mod sys {
    use rustix::fs::{Advice, fadvise};
    use std::fs::File;
    use std::num::NonZeroU64;

    pub fn expect_random(file: &File) {
        let _ = fadvise(file, 0, None, Advice::Random);
    }

    pub fn drop_pages(file: &File, offset: u64, len: u64) {
        // The system takes a length of zero as "to the end of the file".
        if let Some(len) = NonZeroU64::new(len) {
            let _ = fadvise(file, offset, Some(len), Advice::DontNeed);
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod sys {
    use std::fs::File;

    pub fn expect_random(_: &File) {}

    pub fn drop_pages(_: &File, _: u64, _: u64) {}
}
