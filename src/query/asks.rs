//! Which blocks rays wait for, and which of them are fetched together.

use crate::scene::walk::{Need, Snapshots};
use std::collections::{BTreeMap, BTreeSet};

/// The blocks that a ray has asked for last.
///
/// A step of a walk needs one block, but for one: of two hits at the same distance the lower primitive id wins, which
/// takes the block and the ids of each. So four are enough to go on, and four are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Asks {
    /// The last one first.
    last: [Need; 4],
    count: u8,
    /// It asks for one that it had: it needs several at once.
    in_circles: bool,
}

impl Asks {
    /// For a block.
    pub fn of(need: Need) -> Self {
        Self { last: [need; 4], count: 1, in_circles: false }
    }

    /// Then for another.
    pub fn push(&mut self, need: Need) {
        let known = self.last[..usize::from(self.count)].iter().position(|n| *n == need);
        self.in_circles = known.is_some();
        let end = known.unwrap_or(usize::from(self.count).min(self.last.len() - 1));
        self.last.copy_within(..end, 1);
        self.last[0] = need;
        self.count = self.count.max(end as u8 + 1);
    }

    /// What is to be there when the ray goes on.
    pub fn needs(&self) -> &[Need] {
        &self.last[..if self.in_circles { usize::from(self.count) } else { 1 }]
    }

    /// Whether that is there.
    pub fn are_in(&self, snapshots: &Snapshots) -> bool {
        self.needs().iter().all(|&need| snapshots.has(need))
    }
}

/// The blocks to fetch for rays that wait: what most of them wait for first, up to `room` bytes; all that a ray waits for
/// or nothing of it, and at least what one of them waits for. Ascending.
pub(super) fn plan<'a>(asks: impl Iterator<Item = &'a Asks>, room: u64, bytes: impl Fn(Need) -> u64) -> Vec<Need> {
    let mut rays = BTreeMap::<&[Need], usize>::new();
    asks.for_each(|asks| *rays.entry(asks.needs()).or_default() += 1);
    let mut sets: Vec<_> = rays.into_iter().collect();
    sets.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
    let (mut chosen, mut sum) = (BTreeSet::new(), 0);
    for (needs, _) in sets {
        let more: u64 = needs.iter().filter(|need| !chosen.contains(*need)).map(|&need| bytes(need)).sum();
        if chosen.is_empty() || sum + more <= room {
            chosen.extend(needs);
            sum += more;
        }
    }
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    fn need(block: u32) -> Need {
        Need { model: 0, block: BlockId(block) }
    }

    #[test]
    fn a_ray_asks_for_one_block_until_it_goes_in_circles() {
        let mut asks = Asks::of(need(1));
        asks.push(need(2));
        assert_eq!(asks.needs(), [need(2)]);
        asks.push(need(1));
        assert_eq!(asks.needs(), [need(1), need(2)]);
        asks.push(need(3));
        assert_eq!(asks.needs(), [need(3)]);
        asks.push(need(2));
        assert_eq!(asks.needs(), [need(2), need(3), need(1)]);
        [4, 5, 4].iter().for_each(|&n| asks.push(need(n)));
        assert_eq!(asks.needs(), [need(4), need(5), need(2), need(3)]);
        asks.push(need(3));
        assert_eq!(asks.needs(), [need(3), need(4), need(5), need(2)]);
    }

    #[test]
    fn most_wanted_first_and_whole_sets_only() {
        let mut both = Asks::of(need(8));
        [9, 8].iter().for_each(|&n| both.push(need(n)));
        let asks = [Asks::of(need(3)), Asks::of(need(5)), Asks::of(need(3)), both];
        let plan = |room| plan(asks.iter(), room, |_| 10).iter().map(|n| n.block.0).collect::<Vec<_>>();
        assert_eq!(plan(0), [3]);
        assert_eq!(plan(29), [3, 5]);
        assert_eq!(plan(40), [3, 5, 8, 9]);
    }
}
