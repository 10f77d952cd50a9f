//! Blocks in huge pages of the system's memory.
//!
//! Rays go to blocks all over memory, and each page that they come to has to be looked up in the system's tables: of 4
//! KB each, a model of hundreds of megabytes has more than a processor keeps in mind. So once all of a model is in
//! memory, which is when it mostly stays, the system is asked to put together what fills 2 MB of addresses
//! (`MADV_COLLAPSE`, Linux 6.1). What is there stays as it is, and where; memory grows by what else is in these 2 MB, a
//! sixteenth at most. Systems that never do it are not asked again.

use std::collections::BTreeMap;
use std::ops::Range;

/// Bytes of a huge page, where pages have 4 KB.
const PAGE: usize = 2 << 20;

/// Of a huge page, what may be something else than blocks: one part in so many.
const OTHERS: usize = 16;

/// A huge page by its address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Page(usize);

/// The huge pages that pieces of memory fill, ascending.
pub(super) fn filled(pieces: impl Iterator<Item = Range<usize>>) -> Vec<Page> {
    let mut bytes = BTreeMap::<usize, usize>::new();
    for piece in pieces {
        let mut from = piece.start;
        while from < piece.end {
            let end = piece.end.min((from / PAGE + 1) * PAGE);
            *bytes.entry(from / PAGE).or_default() += end - from;
            from = end;
        }
    }
    let is_full = |(page, bytes): (usize, usize)| (bytes >= PAGE - PAGE / OTHERS).then_some(Page(page * PAGE));
    bytes.into_iter().filter_map(is_full).collect()
}

/// Asks the system to hold a huge page in one; false if it does not, for want of memory in one piece or because it does
/// not know how.
#[cfg(target_os = "linux")]
pub(super) fn put_together(page: Page) -> bool {
    /// `MADV_COLLAPSE` of `linux/mman.h`.
    const COLLAPSE: i32 = 25;
    // SAFETY: the call changes neither the bytes of a page nor its owner. Where no memory is mapped it returns an
    // error; memory that was given back to the system may be mapped again, as zeros.
    unsafe { libc::madvise(page.0 as *mut _, PAGE, COLLAPSE) == 0 }
}

/// Other systems do without.
#[cfg(not(target_os = "linux"))]
pub(super) fn put_together(_: Page) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_those_that_pieces_fill_but_for_a_sixteenth() {
        let piece = |from: usize, bytes: usize| from..from + bytes;
        let at = 7 * PAGE;
        assert_eq!(filled(std::iter::empty()), []);
        // One piece over four pages, of which the first is full up to a sixteenth, and the last is not.
        let one = [piece(at + PAGE / 16, 2 * PAGE + PAGE / 2)];
        assert_eq!(filled(one.into_iter()), [Page(at), Page(at + PAGE)]);
        // Many with holes, in any order.
        let with = |hole: usize| (0..32).rev().map(move |i| piece(at + i * (PAGE / 32), PAGE / 32 - hole));
        assert_eq!(filled(with(PAGE / 512)), [Page(at)]);
        assert_eq!(filled(with(PAGE / 511)), []);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn memory_that_is_put_together_stays_as_it_is() {
        let words: Vec<u32> = (0..3 * PAGE as u32 / 4).collect();
        let from = words.as_ptr() as usize;
        let pages = filled(std::iter::once(from..from + 3 * PAGE));
        assert!(pages.len() >= 2);
        for page in pages {
            let _ = put_together(page);
        }
        // Where nothing is: no more than an error.
        let _ = put_together(Page(PAGE));
        assert!(words.iter().enumerate().all(|(i, word)| *word == i as u32));
    }
}
