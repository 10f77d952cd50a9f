//! Groups of rays that wait for blocks, by what they wait for. A round moves few of the many that wait: what it takes to plan it, and to find who goes on, goes by
//! how many move, and by how many different blocks are waited for.

use super::asks::Asks;
use crate::scene::walk::Need;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap, HashMap};

/// What waits: each of its rays for the blocks that it has asked for.
pub(super) trait Waits {
    /// Of those of its rays that wait.
    fn asks(&self) -> impl Iterator<Item = &Asks>;
}

/// Groups that wait.
pub(super) struct Parked<G> {
    /// In no order; `None` where one has gone.
    groups: Vec<Option<G>>,
    free: Vec<usize>,
    /// By blocks that are to be there at once.
    waiting: HashMap<Box<[Need]>, Waiting>,
}

/// Who waits for some blocks.
#[derive(Default)]
struct Waiting {
    rays: usize,
    /// Places of groups, each once.
    groups: Vec<usize>,
}

impl<G> Default for Parked<G> {
    fn default() -> Self {
        Self { groups: Vec::new(), free: Vec::new(), waiting: HashMap::new() }
    }
}

impl<G: Waits> Parked<G> {
    /// Groups.
    pub fn len(&self) -> usize {
        self.groups.len() - self.free.len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Adds a group.
    pub fn push(&mut self, group: G) {
        let at = self.free.pop().unwrap_or(self.groups.len());
        for (needs, rays) in waits_of(&group) {
            if !self.waiting.contains_key(needs) {
                self.waiting.insert(needs.into(), Waiting::default());
            }
            if let Some(waiting) = self.waiting.get_mut(needs) {
                waiting.rays += rays;
                waiting.groups.push(at);
            }
        }
        if at == self.groups.len() {
            self.groups.push(Some(group));
        } else {
            self.groups[at] = Some(group);
        }
    }

    /// Takes out the groups of which some ray has all that it waits for, as `is_there` says.
    pub fn take(&mut self, is_there: impl Fn(Need) -> bool) -> Vec<G> {
        let ready = self.waiting.iter().filter(|(needs, _)| needs.iter().all(|&need| is_there(need)));
        let mut places: Vec<usize> = ready.flat_map(|(_, waiting)| waiting.groups.iter().copied()).collect();
        places.sort_unstable();
        places.dedup();
        places.into_iter().filter_map(|at| self.take_at(at)).collect()
    }

    fn take_at(&mut self, at: usize) -> Option<G> {
        let group = self.groups[at].take()?;
        self.free.push(at);
        for (needs, rays) in waits_of(&group) {
            let Some(waiting) = self.waiting.get_mut(needs) else { continue };
            waiting.rays -= rays;
            if let Some(place) = waiting.groups.iter().position(|&of| of == at) {
                waiting.groups.swap_remove(place);
            }
            if waiting.groups.is_empty() {
                self.waiting.remove(needs);
            }
        }
        Some(group)
    }

    /// The blocks to bring for rays that wait, in the order in which most of them wait for these, as many as there is `room` for in bytes: all that a ray
    /// waits for or nothing of it, and at least what one of them waits for.
    pub fn plan(&self, room: u64, bytes: impl Fn(Need) -> u64) -> Vec<Need> {
        let mut sets: BinaryHeap<_> = self.waiting.iter().map(|(needs, waiting)| (waiting.rays, Reverse(needs))).collect();
        let (mut order, mut chosen, mut sum) = (Vec::new(), BTreeSet::<Need>::new(), 0);
        while let Some((_, Reverse(needs))) = sets.pop() {
            let more: Vec<Need> = needs.iter().copied().filter(|need| !chosen.contains(need)).collect();
            sum += more.iter().map(|&need| bytes(need)).sum::<u64>();
            if !chosen.is_empty() && sum > room {
                break;
            }
            chosen.extend(&more);
            order.extend(more);
        }
        order
    }
}

/// What a group waits for, and for how many of its rays.
fn waits_of<G: Waits>(group: &G) -> impl Iterator<Item = (&[Need], usize)> {
    let mut all: Vec<&[Need]> = group.asks().map(Asks::needs).collect();
    all.sort_unstable();
    let mut at = 0;
    std::iter::from_fn(move || {
        let needs = *all.get(at)?;
        let rays = all[at..].iter().take_while(|of| **of == needs).count();
        at += rays;
        Some((needs, rays))
    })
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
    }

    fn for_one(blocks: &[u32]) -> Asking {
        Asking(blocks.iter().map(|&block| Asks::of(need(block))).collect())
    }

    /// For 8 and 9 at once.
    fn for_both() -> Asks {
        let mut both = Asks::of(need(8));
        [9, 8].iter().for_each(|&n| both.push(need(n)));
        both
    }

    #[test]
    fn most_wanted_first_and_whole_sets_only() {
        let mut parked = Parked::default();
        parked.push(for_one(&[5, 3]));
        parked.push(Asking(vec![Asks::of(need(3)), for_both()]));
        let plan = |parked: &Parked<Asking>, room| parked.plan(room, |_| 10).iter().map(|n| n.block.0).collect::<Vec<_>>();
        assert_eq!(plan(&parked, 0), [3]);
        assert_eq!(plan(&parked, 29), [3, 5]);
        assert_eq!(plan(&parked, 40), [3, 5, 8, 9]);
        // A block that others wait for too is brought once.
        parked.push(for_one(&[9, 9, 9]));
        assert_eq!(plan(&parked, 40), [9, 3, 5, 8]);
    }

    #[test]
    fn who_has_all_that_a_ray_waits_for_goes_on_and_is_not_counted_any_more() {
        let mut parked = Parked::default();
        parked.push(for_one(&[1, 2, 2]));
        parked.push(Asking(vec![for_both()]));
        parked.push(for_one(&[2, 7]));
        let taken = parked.take(|need| [7, 8].contains(&need.block.0));
        assert_eq!((taken.len(), taken[0].0[0].needs()), (1, &[need(2)][..]));
        assert_eq!((parked.len(), parked.plan(100, |_| 10).len()), (2, 4));
        // Its place is taken by the next.
        parked.push(for_one(&[1, 1]));
        assert_eq!((parked.groups.len(), parked.plan(10, |_| 10)), (3, vec![need(1)]));
        assert_eq!(parked.take(|_| true).len(), 3);
        assert!(parked.is_empty() && parked.waiting.is_empty() && parked.plan(100, |_| 10).is_empty());
    }
}
