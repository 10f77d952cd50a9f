//! Groups of rays that wait for blocks, indexed by these blocks. A round resumes few of the many waiting groups. The
//! time to plan a round and to find its groups grows with the number of resumed groups and of distinct blocks. (It also
//! grows with the number of waiting groups where many wait for the same few blocks and some of these resume for another
//! block.)

use super::asks::Asks;
use super::rounds::WaitList;
use crate::scene::walk::Need;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, HashMap};

/// A group of rays that may wait for blocks.
pub(super) trait Waits {
    /// The blocks that each of its waiting rays requested.
    fn asks(&self) -> impl Iterator<Item = &Asks>;
    /// Bytes of its memory.
    fn bytes(&self) -> u64;
}

/// Blocks that a ray needs in memory at the same time, the most recently requested first.
type Needs = Box<[Need]>;

/// A group with the sets of blocks that it waits for, and the number of rays that wait for each set.
pub(super) struct Parking<G> {
    group: G,
    needs: Vec<(Needs, usize)>,
}

impl<G: Waits> Parking<G> {
    pub fn new(group: G) -> Self {
        let mut all: Vec<&[Need]> = group.asks().map(Asks::needs).collect();
        all.sort_unstable();
        let needs = all.chunk_by(|a, b| a == b).map(|alike| (alike[0].into(), alike.len())).collect();
        Self { group, needs }
    }
}

/// The groups that wait.
pub(super) struct Parked<G> {
    /// In arbitrary order; `None` where a group was removed.
    groups: Vec<Option<Parking<G>>>,
    free: Vec<usize>,
    waiting: HashMap<Needs, Waiters>,
}

/// The groups that wait for the same set of blocks.
#[derive(Default)]
struct Waiters {
    rays: usize,
    /// Indices of the groups, each once.
    groups: Vec<usize>,
}

impl<G> Default for Parked<G> {
    fn default() -> Self {
        Self { groups: Vec::new(), free: Vec::new(), waiting: HashMap::new() }
    }
}

/// Bytes of the entries for the blocks that a ray waits for, if no other ray waits for the same ones.
const ENTRY: u64 = (2 * size_of::<(Needs, usize)>() + 2 * size_of::<(Needs, Waiters)>() + 4 * size_of::<Need>()) as u64;

impl<G: Send + Waits> WaitList for Parked<G> {
    type Piece = G;
    type Parked = Parking<G>;

    fn bytes(group: &G) -> u64 {
        size_of::<Option<Parking<G>>>() as u64 + group.bytes() + group.asks().count() as u64 * ENTRY
    }

    fn piece(parking: &Parking<G>) -> &G {
        &parking.group
    }

    fn is_empty(&self) -> bool {
        self.groups.len() == self.free.len()
    }

    fn push(&mut self, parking: Parking<G>) {
        let at = self.free.pop().unwrap_or(self.groups.len());
        for (needs, rays) in &parking.needs {
            let add = |waiters: &mut Waiters| {
                waiters.rays += rays;
                waiters.groups.push(at);
            };
            match self.waiting.get_mut(needs) {
                Some(waiters) => add(waiters),
                None => add(self.waiting.entry(needs.clone()).or_default()),
            }
        }
        if at == self.groups.len() {
            self.groups.push(Some(parking));
        } else {
            self.groups[at] = Some(parking);
        }
    }

    /// Removes the groups in which at least one ray has all blocks that it waits for.
    fn take(&mut self, is_there: impl Fn(Need) -> bool) -> Vec<G> {
        // The lists of waiters are removed whole. A search for each group in the list of all groups that wait for the
        // same block would take time quadratic in their number.
        let ready = self.waiting.extract_if(|needs, _| needs.iter().all(|&need| is_there(need)));
        let mut places: Vec<usize> = ready.flat_map(|(_, waiters)| waiters.groups).collect();
        places.sort_unstable();
        places.dedup();
        places.into_iter().filter_map(|at| self.take_at(at)).collect()
    }

    /// Plans the sets of blocks with the most waiting rays first, up to the first set without room. A set is planned
    /// whole or not at all, and the first set always.
    fn plan(&self, room: u64, bytes: impl Fn(Need) -> u64) -> (Vec<Need>, bool) {
        let mut sets: BinaryHeap<_> =
            self.waiting.iter().map(|(needs, waiters)| (waiters.rays, Reverse(needs))).collect();
        let (mut order, mut chosen, mut sum) = (Vec::new(), BTreeSet::<Need>::new(), 0);
        while let Some((_, Reverse(needs))) = sets.pop() {
            let more: Vec<Need> = needs.iter().copied().filter(|need| !chosen.contains(need)).collect();
            sum += more.iter().map(|&need| bytes(need)).sum::<u64>();
            if !chosen.is_empty() && sum > room {
                return (order, false);
            }
            chosen.extend(&more);
            order.extend(more);
        }
        (order, true)
    }
}

impl<G> Parked<G> {
    fn take_at(&mut self, at: usize) -> Option<G> {
        let Parking { group, needs } = self.groups[at].take()?;
        self.free.push(at);
        for (needs, rays) in &needs {
            let Some(waiters) = self.waiting.get_mut(needs) else { continue };
            waiters.rays -= rays;
            if let Some(place) = waiters.groups.iter().position(|&of| of == at) {
                waiters.groups.swap_remove(place);
            }
            if waiters.groups.is_empty() {
                self.waiting.remove(needs);
            }
        }
        Some(group)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    fn need(block: u32) -> Need {
        Need { model: 0, block: BlockId(block) }
    }

    struct Asking(Vec<Asks>);

    impl Waits for Asking {
        fn asks(&self) -> impl Iterator<Item = &Asks> {
            self.0.iter()
        }

        fn bytes(&self) -> u64 {
            0
        }
    }

    fn for_one(blocks: &[u32]) -> Parking<Asking> {
        Parking::new(Asking(blocks.iter().map(|&block| Asks::of(need(block))).collect()))
    }

    /// The requests of a ray that waits for blocks 8 and 9 at once.
    fn for_both() -> Asks {
        let mut both = Asks::of(need(8));
        [9, 8].iter().for_each(|&n| both.push(need(n)));
        both
    }

    fn count(parked: &Parked<Asking>) -> usize {
        parked.groups.len() - parked.free.len()
    }

    fn plan(parked: &Parked<Asking>, room: u64) -> (Vec<u32>, bool) {
        let (needs, is_all) = parked.plan(room, |_| 10);
        (needs.iter().map(|n| n.block.0).collect(), is_all)
    }

    #[test]
    fn most_wanted_first_and_whole_sets_only() {
        let mut parked = Parked::default();
        parked.push(for_one(&[5, 3]));
        parked.push(Parking::new(Asking(vec![Asks::of(need(3)), for_both()])));
        assert_eq!(plan(&parked, 0), (vec![3], false));
        assert_eq!(plan(&parked, 39), (vec![3, 5], false));
        assert_eq!(plan(&parked, 40), (vec![3, 5, 8, 9], true));
        // Block 9, which other rays wait for too, is read once.
        parked.push(for_one(&[9, 9, 9]));
        assert_eq!(plan(&parked, 40), (vec![9, 3, 5, 8], true));
    }

    #[test]
    fn groups_with_all_blocks_of_a_ray_go_on_and_are_no_longer_counted() {
        let mut parked = Parked::default();
        parked.push(for_one(&[1, 2, 2]));
        parked.push(Parking::new(Asking(vec![for_both()])));
        parked.push(for_one(&[2, 7]));
        let taken = parked.take(|need| [7, 8].contains(&need.block.0));
        assert_eq!((taken.len(), taken[0].0[0].needs()), (1, &[need(2)][..]));
        assert_eq!((count(&parked), plan(&parked, 100).0), (2, vec![2, 1, 8, 9]));
        // The next group takes the free index.
        parked.push(for_one(&[1, 1]));
        assert_eq!((parked.groups.len(), plan(&parked, 10).0), (3, vec![1]));
        assert_eq!(parked.take(|_| true).len(), 3);
        assert!(parked.is_empty() && parked.waiting.is_empty() && plan(&parked, 100) == (vec![], true));
    }
}
