//! What the system is told about a file's pages: that they are read out of order, and once. What is read is kept
//! decoded, under a budget; a second copy in the page cache would come on top.

use std::fs::File;

/// Asks the system not to read ahead. A hint: does nothing where there is no such call.
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
        // No length would mean up to the end.
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
