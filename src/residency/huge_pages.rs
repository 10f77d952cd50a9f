//! Huge pages for blocks.
//!
//! Rays visit blocks all over memory, and the processor must look up the address of each page that they reach in the
//! system's tables. With pages of 4 KB, a model of hundreds of megabytes has more pages than a processor can cache. So
//! once all blocks of a model are in memory, where they then mostly stay, the system is asked to collapse 2 MB of
//! addresses that they fill into a huge page (`MADV_COLLAPSE`, Linux 6.1). The content and its addresses stay as they
//! are. Memory grows by the other parts of these 2 MB, a sixteenth at most. Systems that never collapse a page are not
//! asked again.

use std::collections::BTreeMap;
use std::ops::Range;

/// Bytes of a huge page, if pages have 4 KB.
const PAGE: usize = 2 << 20;

/// One part in this many of a huge page may hold other data than blocks.
const OTHERS: usize = 16;

/// A huge page, identified by its address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Page(usize);

/// Returns the huge pages that pieces of memory fill, ascending.
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

/// Asks the system to collapse a page into a huge page. Returns false if it does not, because it lacks contiguous
/// memory or does not support the call.
#[cfg(target_os = "linux")]
pub(super) fn put_together(page: Page) -> bool {
    /// `MADV_COLLAPSE` of `linux/mman.h`.
    const COLLAPSE: i32 = 25;
    // SAFETY: the call changes neither the bytes of a page nor its owner. If no memory is mapped there it returns an
    // error. Memory that was given back to the system may be mapped again, as zeros.
    unsafe { libc::madvise(page.0 as *mut _, PAGE, COLLAPSE) == 0 }
}

/// Other systems offer no such call.
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
        // One piece over three pages. The first is full but for a sixteenth, and the last is not full.
        let one = [piece(at + PAGE / 16, 2 * PAGE + PAGE / 2)];
        assert_eq!(filled(one.into_iter()), [Page(at), Page(at + PAGE)]);
        // Many pieces with holes, in any order.
        let with = |hole: usize| (0..32).rev().map(move |i| piece(at + i * (PAGE / 32), PAGE / 32 - hole));
        assert_eq!(filled(with(PAGE / 512)), [Page(at)]);
        assert_eq!(filled(with(PAGE / 511)), []);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn collapsed_memory_is_unchanged() {
        let words: Vec<u32> = (0..3 * PAGE as u32 / 4).collect();
        let from = words.as_ptr() as usize;
        let pages = filled(std::iter::once(from..from + 3 * PAGE));
        assert!(pages.len() >= 2);
        for page in pages {
            let _ = put_together(page);
        }
        // An address without memory causes an error at most.
        let _ = put_together(Page(PAGE));
        assert!(words.iter().enumerate().all(|(i, word)| *word == i as u32));
    }
}
