//! Pages of blocks that are evicted. The allocator keeps memory that is freed between memory in use. Its pages can be
//! returned to the system before.

/// Returns the whole pages of `words` to the system. Their content is then undefined: old words, or zeros. Systems
/// without such a call do nothing.
#[cfg(target_os = "linux")]
pub(super) fn give_back(words: &mut [u32]) {
    let Some(size) = page_size() else { return };
    let range = words.as_mut_ptr_range();
    let from = (range.start as usize).next_multiple_of(size);
    let end = range.end as usize / size * size;
    if from < end {
        // SAFETY: the pages lie within `words`, which is borrowed exclusively, and any bits are valid words. Pages of
        // anonymous memory are zeros when they are next used. For other memory the call fails or changes nothing.
        let _ = unsafe { libc::madvise(from as *mut _, end - from, libc::MADV_DONTNEED) };
    }
}

/// Bytes of a page, or `None` if the system does not say.
#[cfg(target_os = "linux")]
fn page_size() -> Option<usize> {
    use std::sync::OnceLock;
    static SIZE: OnceLock<Option<usize>> = OnceLock::new();
    // SAFETY: the call has no preconditions.
    *SIZE.get_or_init(|| usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).ok().filter(|size| *size > 0))
}

/// Other systems offer no such call.
#[cfg(not(target_os = "linux"))]
pub(super) fn give_back(_: &mut [u32]) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_pages_are_returned() {
        let mut words: Vec<u32> = (1..100_000).collect();
        let count = words.len();
        for (first, end) in [(0, 5), (7, 2000), (100, 60_000)] {
            give_back(&mut words[first..end]);
            let is_kept = |(i, word): (usize, &u32)| *word == i as u32 + 1 || (first..end).contains(&i) && *word == 0;
            assert!(words.iter().enumerate().all(is_kept));
            words = (1..=count as u32).collect();
        }
    }
}
