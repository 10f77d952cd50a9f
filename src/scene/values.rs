//! Values of the members of an array, such as masks: in pages that copies share. Pages in which all members have the
//! default take no memory.

use crate::base::error::Result;
use crate::base::memory::room;
use crate::residency::{Kept, Residency};
use std::ops::Range;
use std::sync::Arc;

/// The memory of the values, for messages.
const WHAT: &str = "masks and tints of an array of instances";

/// Number of values of a page: the least that is copied for a change.
const PAGE: usize = 512;

/// A value for each member of an array. Clones share the memory.
#[derive(Clone)]
pub(super) struct Values<T> {
    default: T,
    /// `None`: all have the default.
    table: Option<Arc<Table<T>>>,
}

struct Table<T> {
    /// `None`: all there have the default.
    pages: Vec<Option<Arc<Page<T>>>>,
    _memory: Kept,
}

struct Page<T> {
    values: Box<[T]>,
    _memory: Kept,
}

impl<T: Copy + PartialEq> Values<T> {
    /// All have the default.
    pub fn all(default: T) -> Self {
        Self { default, table: None }
    }

    /// The value of a member.
    #[inline]
    pub fn get(&self, member: u32) -> T {
        let page = self.table.as_ref().and_then(|table| table.pages[member as usize / PAGE].as_ref());
        page.map_or(self.default, |page| page.values[member as usize % PAGE])
    }

    /// True if all have the default.
    pub fn are_plain(&self) -> bool {
        self.table.is_none()
    }

    /// The values with others from member `first` on, of `count` members. Those of before stay as they are. Fails with
    /// `OverBudget`.
    pub fn replaced(&self, count: usize, first: usize, by: &[T], residency: &Residency) -> Result<Self> {
        let end = first + by.len();
        let touched = first / PAGE..end.div_ceil(PAGE);
        let bytes = |members: usize| (size_of::<Page<T>>() + size_of::<usize>() * 2 + members * size_of::<T>()) as u64;
        let of_page = |at: usize| at * PAGE..count.min((at + 1) * PAGE);
        let mut pages = self.pages(count)?;
        let table = size_of_val(&pages[..]) as u64;
        // The sum of all, so that the error names a budget that suffices.
        residency.check_room(WHAT, touched.clone().map(|at| bytes(of_page(at).len())).sum::<u64>() + table)?;
        for at in touched {
            let Range { start, end: stop } = of_page(at);
            let (from, to) = (first.max(start), end.min(stop));
            let old = pages[at].take();
            let mut values: Box<[T]> =
                old.map_or_else(|| vec![self.default; stop - start].into(), |it| it.values.clone());
            values[from - start..to - start].copy_from_slice(&by[from - first..to - first]);
            if values.iter().any(|value| *value != self.default) {
                let memory = residency.keep_all(WHAT, bytes(values.len()))?;
                pages[at] = Some(Arc::new(Page { values, _memory: memory }));
            }
        }
        let is_plain = pages.iter().all(Option::is_none);
        let table = if is_plain { None } else { Some(Table { pages, _memory: residency.keep(WHAT, table)? }) };
        Ok(Self { default: self.default, table: table.map(Arc::new) })
    }

    /// The pages of `count` members.
    fn pages(&self, count: usize) -> Result<Vec<Option<Arc<Page<T>>>>> {
        let mut pages = room(count.div_ceil(PAGE), WHAT)?;
        match &self.table {
            Some(table) => pages.extend(table.pages.iter().cloned()),
            None => pages.resize(count.div_ceil(PAGE), None),
        }
        Ok(pages)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residency::ResidencyOptions;

    /// Values are replaced within a page, across pages and in all, and back to the default; copies that are held
    /// meanwhile do not change, and all memory is given back.
    #[test]
    fn ranges_of_values_are_replaced_in_copies() {
        const COUNT: usize = 1500;
        let residency = Residency::new(ResidencyOptions { budget: 1 << 30, promote: false });
        let mut values = Values::all(7);
        let all = |values: &Values<u32>| (0..COUNT as u32).map(|member| values.get(member)).collect::<Vec<_>>();
        let mut expected = vec![7; COUNT];
        let mut held = Vec::new();
        let ranges = [5..6, 511..513, 512..1024, 1499..1500, 3..700, 1000..1500, 10..1400, 0..1500, 20..20];
        for (round, range) in (0..).zip(ranges) {
            held.push((values.clone(), expected.clone()));
            let by: Vec<u32> = range.clone().map(|member| 10_000 * (round + 1) + member as u32).collect();
            expected[range.clone()].copy_from_slice(&by);
            values = values.replaced(COUNT, range.start, &by, &residency).expect("values");
            assert!(all(&values) == expected, "{range:?}");
            assert!(held.iter().all(|(values, was)| all(values) == *was), "{range:?}");
        }
        assert!(residency.used() >= 4 * COUNT as u64, "{} bytes", residency.used());
        drop(held);
        let least = residency.used();
        assert!((4 * COUNT as u64..5 * COUNT as u64).contains(&least), "{least} bytes");
        let one = values.replaced(COUNT, 0, &[7; COUNT - 1], &residency).expect("values");
        assert!(!one.are_plain() && one.get(COUNT as u32 - 1) != 7 && one.get(0) == 7);
        assert!(one.replaced(COUNT, COUNT - 1, &[7], &residency).expect("values").are_plain());
        drop((one, values));
        assert_eq!(residency.used(), 0);
    }

    /// Values that have no room leave all as it was.
    #[test]
    fn values_over_the_budget_are_refused() {
        let residency = Residency::new(ResidencyOptions { budget: 1 << 20, promote: false });
        let (many, used) = (vec![1u32; 1 << 19], residency.used());
        let error = Values::all(0).replaced(many.len(), 0, &many, &residency).err();
        let Some(crate::base::error::Error::OverBudget { need, .. }) = error else { panic!("{error:?}") };
        assert!(need >= 4 << 19, "{need}");
        assert_eq!(residency.used(), used);
    }
}
