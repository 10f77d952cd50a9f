//! The parts in and below each geometry block (FORMAT.md, section 5). A scene with hidden parts derives from them which
//! blocks it does not need.

use crate::base::bytes::{Checked, Malformed, PutBytes, ensure, push_varint, take_varint};
use crate::base::error::Result;
use crate::base::memory::room;

/// Sets of local parts, one for each geometry block, in the order of the blocks.
///
/// A set holds all parts of the triangles in the block and in the blocks below it. An empty set says nothing about its
/// block: it may hold any part. A model in which no tree has several parts has no sets.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PartSets {
    /// Offset in `lists` at which each set ends.
    ends: Vec<u32>,
    /// The parts of each set, ascending: the first one, then the differences to the one before, less 1. Varints.
    lists: Vec<u8>,
}

/// Number of bytes that are encoded at a time.
const TOGETHER: usize = 64 << 10;

/// Bytes of a row of the section: the end of a set.
pub(super) const ROW_LEN: usize = 4;

/// Use of the memory of sets, in errors.
const WHAT: &str = "the lists of parts";

impl PartSets {
    /// Number of sets.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// True if there are no sets.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Bytes of memory.
    pub fn memory(&self) -> u64 {
        (ROW_LEN * self.ends.capacity() + self.lists.capacity()) as u64
    }

    /// Adds a set of parts, which ascend without repetition. Fails if the sets take more than 4 GiB.
    pub fn push(&mut self, parts: impl IntoIterator<Item = u32>) -> Checked<()> {
        let mut next = 0u32;
        for part in parts {
            push_varint(&mut self.lists, part.wrapping_sub(next));
            next = part.wrapping_add(1);
        }
        self.end()
    }

    /// Adds all sets of `other`.
    pub fn append(&mut self, other: &Self) -> Checked<()> {
        let mut start = 0;
        for &end in &other.ends {
            self.lists.extend_from_slice(&other.lists[start..end as usize]);
            start = end as usize;
            self.end()?;
        }
        Ok(())
    }

    fn end(&mut self) -> Checked<()> {
        let end = u32::try_from(self.lists.len()).map_err(|_| Malformed::new("the lists of parts are too long"))?;
        self.ends.push(end);
        Ok(())
    }

    /// The parts of the set of block `index`, ascending; none if there is no such set.
    pub fn of(&self, index: usize) -> Parts<'_> {
        let end = self.ends.get(index).map_or(0, |&end| end as usize);
        let start = index.checked_sub(1).and_then(|i| self.ends.get(i)).map_or(0, |&start| start as usize);
        Parts { bytes: self.lists.get(start..end).unwrap_or_default(), next: 0 }
    }

    /// Calls `take` with the bytes of the section, some at a time: a row for each set, then the lists.
    pub(super) fn encode(&self, take: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut out = Vec::new();
        for some in self.ends.chunks(TOGETHER / ROW_LEN) {
            out.clear();
            some.iter().for_each(|&end| out.put_u32(end));
            take(&out)?;
        }
        self.lists.chunks(TOGETHER).try_for_each(take)
    }

    /// Reads a section of `count` sets; `most` returns the number of local parts that block `index` may refer to.
    /// Fails with `NoMemory`.
    pub(super) fn decode(bytes: &[u8], count: u64, most: impl Fn(usize) -> u32) -> Result<Checked<Self>> {
        let rows_len = usize::try_from(count).ok().and_then(|n| n.checked_mul(ROW_LEN));
        let Some((rows, lists)) = rows_len.and_then(|n| bytes.split_at_checked(n)) else {
            return Ok(Err(Malformed::new("unexpected end of data")));
        };
        let mut sets = Self { ends: room(rows.len() / ROW_LEN, WHAT)?, lists: room(lists.len(), WHAT)? };
        let ends = rows.as_chunks::<ROW_LEN>().0;
        sets.ends.extend(ends.iter().map(|bytes| u32::from_le_bytes(*bytes)));
        sets.lists.extend_from_slice(lists);
        Ok(sets.check(most).map(|()| sets))
    }

    fn check(&self, most: impl Fn(usize) -> u32) -> Checked<()> {
        let is_ascending = self.ends.is_sorted() && self.ends.last().map_or(0, |&end| end as usize) == self.lists.len();
        ensure(is_ascending, "the ends of the lists are inconsistent")?;
        for index in 0..self.len() {
            let (parts, most) = (self.of(index), u64::from(most(index)));
            ensure(parts.are_sound(most), "a list of parts is malformed, or names a part that its tree lacks")?;
        }
        Ok(())
    }
}

/// The parts of a set.
#[derive(Debug, Clone)]
pub struct Parts<'a> {
    bytes: &'a [u8],
    /// The least part that may follow.
    next: u64,
}

impl Parts<'_> {
    /// True if all bytes are varints in their shortest form, and all parts are below `most`.
    fn are_sound(&self, most: u64) -> bool {
        let mut rest = self.clone();
        while !rest.bytes.is_empty() {
            let before = rest.bytes;
            let Some(part) = rest.next() else { return false };
            let used = before.len() - rest.bytes.len();
            if u64::from(part) >= most || used > 1 && before[used - 1] == 0 {
                return false;
            }
        }
        true
    }
}

impl Iterator for Parts<'_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        let step = take_varint(&mut self.bytes)?;
        let part = self.next + u64::from(step);
        self.next = part + 1;
        u32::try_from(part).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn encoded(sets: &PartSets) -> Vec<u8> {
        let mut all = Vec::new();
        let taken = sets.encode(&mut |some| {
            all.extend_from_slice(some);
            Ok(())
        });
        taken.expect("memory");
        all
    }

    fn sets(all: &[Vec<u32>]) -> PartSets {
        let mut sets = PartSets::default();
        all.iter().for_each(|set| sets.push(set.iter().copied()).expect("small"));
        sets
    }

    proptest! {
        #[test]
        fn sets_come_back(all in prop::collection::vec(prop::collection::btree_set(any::<u32>(), 0..20), 0..20)) {
            let parts = |set: std::collections::BTreeSet<u32>| set.into_iter().filter(|&p| p < u32::MAX).collect();
            let all: Vec<Vec<u32>> = all.into_iter().map(parts).collect();
            let own = sets(&all);
            let back = PartSets::decode(&encoded(&own), all.len() as u64, |_| u32::MAX);
            let back = back.expect("memory").expect("sound");
            prop_assert_eq!(&back, &own);
            for (i, set) in all.iter().enumerate() {
                prop_assert_eq!(&back.of(i).collect::<Vec<_>>(), set);
            }
            let mut twice = own.clone();
            twice.append(&own).expect("small");
            prop_assert_eq!(twice, sets(&[all.clone(), all].concat()));
        }

        #[test]
        fn damage_is_refused_or_harmless(bytes in prop::collection::vec(any::<u8>(), 0..40), count in 0u64..8) {
            if let Ok(sets) = PartSets::decode(&bytes, count, |_| 100).expect("memory") {
                prop_assert_eq!(encoded(&sets), bytes);
                prop_assert!((0..sets.len()).all(|i| sets.of(i).all(|part| part < 100)));
            }
        }
    }

    #[test]
    fn parts_that_a_tree_lacks_are_refused() {
        let bytes = encoded(&sets(&[vec![0, 5], vec![7]]));
        let is_sound =
            |count, most: &dyn Fn(usize) -> u32| PartSets::decode(&bytes, count, most).expect("memory").is_ok();
        assert!(is_sound(2, &|_| 8));
        assert!(!is_sound(2, &|i| if i == 0 { 8 } else { 7 }));
        assert!(!is_sound(2, &|i| if i == 0 { 5 } else { 8 }));
        assert!(!is_sound(u64::MAX, &|_| 8));
        assert_eq!(sets(&[]).of(0).next(), None);
    }
}
