//! Groups of neighbours that fit a block: items are divided from the top down by the surface area heuristic, as long as
//! a group is too large.
//!
//! Each division keeps to a number of groups, so that groups stay nearly full: a group is a subtree of compact extent
//! where that costs few groups more. The result is a function of the items and their order.

use crate::math::Bounds;
use glam::Vec3;
use std::ops::Range;

/// Words in the two blocks of a group: in its fine block and in its leaf block, or what else is limited.
pub type Load = [u32; 2];

/// An item of a group.
#[derive(Debug, Clone, Copy)]
pub struct Item {
    /// Its box; finite.
    pub bounds: Bounds,
    /// What it takes.
    pub load: Load,
    /// Its number.
    pub index: u32,
}

impl Item {
    /// Twice the centre of the box.
    fn centre(&self) -> Vec3 {
        self.bounds.min + self.bounds.max
    }
}

/// Ranges of more items are divided at the borders of bins, others anywhere.
const FEW: usize = 256;
/// Number of bins along an axis.
const BINS: usize = 32;

/// Sorts items so that groups are ranges of them. Each group takes at most `room`, or is one item. There are about
/// `spare` times as many groups as full ones would be, `spare` >= 1.
pub fn pack(items: &mut [Item], room: Load, spare: f32) -> Vec<Range<usize>> {
    let all = Part::of(items);
    let groups = (all.share(room) * f64::from(spare)) as u64;
    let mut ranges = Vec::new();
    if !items.is_empty() {
        divide(items, 0, room, groups, &mut ranges);
    }
    ranges
}

/// Items in one of two sides, or in a bin.
#[derive(Clone, Copy)]
struct Part {
    bounds: Bounds,
    load: [u64; 2],
}

impl Part {
    const NONE: Self = Self { bounds: Bounds::EMPTY, load: [0; 2] };

    fn of(items: &[Item]) -> Self {
        items.iter().fold(Self::NONE, |all, item| all.and(&Self::one(item)))
    }

    fn one(item: &Item) -> Self {
        Self { bounds: item.bounds, load: item.load.map(u64::from) }
    }

    fn and(&self, other: &Self) -> Self {
        let load = [self.load[0] + other.load[0], self.load[1] + other.load[1]];
        Self { bounds: self.bounds.union(other.bounds), load }
    }

    /// Groups that the items fill.
    fn share(&self, room: Load) -> f64 {
        let of = |i: usize| self.load[i] as f64 / f64::from(room[i]);
        of(0).max(of(1))
    }

    /// Fewest groups of the items, were they divisible.
    fn groups(&self, room: Load) -> u64 {
        let of = |i: usize| self.load[i].div_ceil(u64::from(room[i]));
        of(0).max(of(1))
    }

    /// Expected work of a ray that meets the box.
    fn cost(&self, room: Load) -> f64 {
        f64::from(self.bounds.half_area()) * self.share(room)
    }
}

/// Divides the items that begin at `first`, at least one, into about `groups` groups, or the fewest.
fn divide(items: &mut [Item], first: usize, room: Load, groups: u64, ranges: &mut Vec<Range<usize>>) {
    let all = Part::of(items);
    if items.len() == 1 || all.groups(room) <= 1 {
        ranges.push(first..first + items.len());
        return;
    }
    let groups = groups.max(all.groups(room));
    let middle = if items.len() <= FEW { sweep(items, room, groups) } else { by_bins(items, room, groups) };
    let (left, right) = items.split_at_mut(middle);
    let sides = [Part::of(left), Part::of(right)];
    let [least, greatest] = [sides[0].groups(room), groups.saturating_sub(sides[1].groups(room))];
    // Groups beyond the fewest go to both sides by their shares.
    let share = sides[0].share(room) / (sides[0].share(room) + sides[1].share(room)).max(f64::MIN_POSITIVE);
    let of_left = ((groups as f64 * share).round() as u64).clamp(least, greatest.max(least));
    divide(left, first, room, of_left, ranges);
    divide(right, first + middle, room, groups.saturating_sub(of_left), ranges);
}

/// A place between parts: groups beyond the limit, and cost. The least is best.
type Rank = (u64, f64);

fn is_less(a: Rank, b: Rank) -> bool {
    a.0 < b.0 || a.0 == b.0 && a.1 < b.1
}

/// The best place to divide parts in order, with at least one on each side.
fn best(parts: &[Part], room: Load, groups: u64) -> Option<(usize, Rank)> {
    let mut behind = vec![Part::NONE; parts.len()];
    let mut all = Part::NONE;
    for at in (1..parts.len()).rev() {
        all = all.and(&parts[at]);
        behind[at] = all;
    }
    let (mut all, mut found) = (Part::NONE, None);
    for at in 1..parts.len() {
        all = all.and(&parts[at - 1]);
        let rest = &behind[at];
        if all.bounds.is_empty() || rest.bounds.is_empty() {
            continue;
        }
        let beyond = (all.groups(room) + rest.groups(room)).saturating_sub(groups);
        let rank = (beyond, all.cost(room) + rest.cost(room));
        if found.is_none_or(|(_, least)| is_less(rank, least)) {
            found = Some((at, rank));
        }
    }
    found
}

/// Sorts few items, at least two. Returns the number of those on the left side.
fn sweep(items: &mut [Item], room: Load, groups: u64) -> usize {
    let by_axis = |items: &mut [Item], axis: usize| {
        items.sort_unstable_by(|a, b| a.centre()[axis].total_cmp(&b.centre()[axis]).then(a.index.cmp(&b.index)));
    };
    let (mut found, mut least) = ((0, items.len() / 2), (u64::MAX, f64::INFINITY));
    for axis in 0..3 {
        by_axis(items, axis);
        let parts: Vec<Part> = items.iter().map(Part::one).collect();
        match best(&parts, room, groups) {
            Some((at, rank)) if is_less(rank, least) => (found, least) = ((axis, at), rank),
            _ => {}
        }
    }
    by_axis(items, found.0);
    found.1
}

/// Divides many items at a border between bins. Returns the number of those on the left side.
fn by_bins(items: &mut [Item], room: Load, groups: u64) -> usize {
    let around = |all: Bounds, item: &Item| all.union(Bounds { min: item.centre(), max: item.centre() });
    let centres = items.iter().fold(Bounds::EMPTY, around);
    let scale = BINS as f32 / centres.extent();
    let bin = |item: &Item, axis: usize| {
        let at = (item.centre()[axis] - centres.min[axis]) * scale[axis];
        // Not a number if all centres are equal: then the first bin.
        (at as usize).min(BINS - 1)
    };
    let mut bins = [[Part::NONE; BINS]; 3];
    for item in items.iter() {
        for (axis, bins) in bins.iter_mut().enumerate() {
            let bin = &mut bins[bin(item, axis)];
            *bin = bin.and(&Part::one(item));
        }
    }
    let (mut found, mut least) = (None, (u64::MAX, f64::INFINITY));
    for (axis, bins) in bins.iter().enumerate() {
        match best(bins, room, groups) {
            Some((at, rank)) if is_less(rank, least) => (found, least) = (Some((axis, at)), rank),
            _ => {}
        }
    }
    let Some((axis, border)) = found else { return items.len() / 2 };
    let mut middle = 0;
    for at in 0..items.len() {
        if bin(&items[at], axis) < border {
            items.swap(at, middle);
            middle += 1;
        }
    }
    middle
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Items along a curve through a cube, of different sizes.
    fn scattered(count: u32) -> Vec<Item> {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let item = |index| {
            let min = Vec3::new(next(), next(), next());
            let bounds = Bounds { min, max: min + 0.02 * Vec3::new(next(), next(), next()) };
            Item { bounds, load: [10 + (90.0 * next()) as u32, 20], index }
        };
        (0..count).map(item).collect()
    }

    fn area(items: &[Item], ranges: &[Range<usize>]) -> f32 {
        ranges.iter().map(|range| Part::of(&items[range.clone()]).bounds.half_area()).sum()
    }

    #[test]
    fn groups_fit_and_are_nearly_full() {
        for count in [1, 2, 100, 257, 5000] {
            let (mut items, room) = (scattered(count), [1000, 1000]);
            let full = Part::of(&items).share(room);
            let ranges = pack(&mut items, room, 1.15);
            let mut at = 0;
            for range in &ranges {
                assert!(range.start == at && range.end > at);
                at = range.end;
                assert!(Part::of(&items[range.clone()]).groups(room) == 1);
            }
            assert_eq!(at, items.len());
            let met: BTreeSet<u32> = items.iter().map(|item| item.index).collect();
            assert_eq!(met.len(), count as usize);
            println!("{count}: {} groups for {full:.1}", ranges.len());
            assert!(ranges.len() as f64 <= (1.2 * full).max(full + 2.0), "{} of {full}", ranges.len());
        }
    }

    /// Boxes of groups are smaller than those of items in the order of one axis, and of full groups.
    #[test]
    fn groups_are_compact() {
        let (items, room) = (scattered(5000), [1000, 1000]);
        let mut along = items.clone();
        along.sort_by(|a, b| a.bounds.min.x.total_cmp(&b.bounds.min.x));
        let full: Vec<_> = (0..250).map(|group| 20 * group..20 * group + 20).collect();
        let of = |spare| {
            let mut items = items.clone();
            let ranges = pack(&mut items, room, spare);
            area(&items, &ranges)
        };
        let (loose, tight) = (of(1.15), of(1.0));
        println!("{loose} loose, {tight} tight, {} along an axis", area(&along, &full));
        assert!(loose < tight && 2.0 * tight < area(&along, &full));
    }

    #[test]
    fn equal_boxes_and_items_without_room_are_divided() {
        let mut items = vec![Item { load: [7, 1], ..scattered(1)[0] }; 1000];
        (0..1000).for_each(|i| items[i].index = i as u32);
        let ranges = pack(&mut items, [70, 70], 1.0);
        assert!(ranges.iter().all(|range| range.len() <= 10) && ranges.len() < 150, "{}", ranges.len());
        assert_eq!(pack(&mut items[..100], [5, 5], 1.0).len(), 100);
        assert!(pack(&mut [], [5, 5], 1.0).is_empty());
    }
}
