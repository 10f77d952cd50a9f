//! Items of many groups in two arrays: a vector for each group would take more memory than small groups themselves.

/// The indices of items by group.
#[derive(Default)]
pub struct Groups {
    /// The items of the first group, in their order, then those of the next one.
    order: Vec<u32>,
    /// Offset in `order` at which the items of each group end.
    ends: Vec<u32>,
}

impl Groups {
    /// Sorts items into `count` groups; `group_of` gives the group of each item. There are fewer than 2³² items.
    pub fn of(count: usize, group_of: impl Iterator<Item = u32> + Clone) -> Self {
        let mut next = vec![0u32; count];
        group_of.clone().for_each(|group| next[group as usize] += 1);
        let mut all = 0;
        for begin in &mut next {
            all += std::mem::replace(begin, all);
        }
        let mut order = vec![0; all as usize];
        for (item, group) in (0..).zip(group_of) {
            let at = &mut next[group as usize];
            order[*at as usize] = item;
            *at += 1;
        }
        Self { order, ends: next }
    }

    /// The items of a group, ascending; none if there is no such group.
    pub fn get(&self, group: usize) -> &[u32] {
        let end = self.ends.get(group).map_or(0, |&end| end as usize);
        let begin = group.checked_sub(1).and_then(|before| self.ends.get(before)).map_or(0, |&begin| begin as usize);
        self.order.get(begin..end).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_group_finds_its_items() {
        let groups = Groups::of(6, [3, 1, 3, 5, 1, 3].into_iter());
        let found: Vec<&[u32]> = (0..8).map(|group| groups.get(group)).collect();
        assert_eq!(found, [&[][..], &[1, 4], &[], &[0, 2, 5], &[], &[3], &[], &[]]);
        assert!(Groups::default().get(0).is_empty() && Groups::of(0, std::iter::empty()).get(0).is_empty());
    }
}
