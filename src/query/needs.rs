//! Lists of needed blocks: their sizes, a limit of their sum, and their order by model.

use crate::base::ids::BlockId;
use crate::scene::SceneState;
use crate::scene::walk::Need;
use std::collections::{BTreeMap, BTreeSet};

/// Bytes of a block in memory.
pub(crate) fn bytes_of(scene: &SceneState, need: Need) -> u64 {
    scene.models[need.model as usize].blocks().slot_bytes(need.block)
}

/// Returns a test that adds up byte counts, each above 0, and is true while the sum is at most `room`. The first count
/// always fits, so that there is progress.
pub(crate) fn one_at_least(room: u64) -> impl FnMut(u64) -> bool {
    let mut sum = 0;
    move |bytes| {
        let is_first = sum == 0;
        sum += bytes;
        is_first || sum <= room
    }
}

/// Plans the blocks of groups, in order, while their bytes fit `room`: all of a group or none. The first group always
/// fits. The second result is true if these are all.
pub(crate) fn together<G: IntoIterator<Item = Need>>(
    groups: impl IntoIterator<Item = G>,
    room: u64,
    bytes: impl Fn(Need) -> u64,
) -> (Vec<Need>, bool) {
    let (mut chosen, mut planned, mut sum) = (BTreeSet::new(), Vec::new(), 0);
    for group in groups {
        let more: BTreeSet<Need> = group.into_iter().filter(|need| !chosen.contains(need)).collect();
        sum += more.iter().map(|&need| bytes(need)).sum::<u64>();
        if sum > room && !planned.is_empty() {
            return (planned, false);
        }
        planned.extend(&more);
        chosen.extend(more);
    }
    (planned, true)
}

/// Groups the blocks by model and keeps their order within each model.
pub(crate) fn by_model(needs: &[Need]) -> BTreeMap<u32, Vec<BlockId>> {
    let mut models = BTreeMap::<u32, Vec<BlockId>>::new();
    needs.iter().for_each(|need| models.entry(need.model).or_default().push(need.block));
    models
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_fits_and_the_next_while_there_is_room() {
        let fitting = |room, counts: &[u64]| {
            let mut fits = one_at_least(room);
            counts.iter().take_while(|&&count| fits(count)).count()
        };
        assert_eq!(
            [(0, &[5, 1][..]), (5, &[5, 1]), (6, &[5, 1, 1]), (9, &[])].map(|(room, counts)| fitting(room, counts)),
            [1, 1, 2, 0]
        );
    }

    #[test]
    fn groups_come_as_a_whole() {
        let need = |block| Need { model: 0, block: BlockId(block) };
        let groups = [vec![need(7), need(2)], vec![need(2), need(3)], vec![need(4), need(5)]];
        let plan = |room| {
            let (planned, is_all) = together(groups.clone(), room, |_| 10);
            (planned.iter().map(|need| need.block.0).collect::<Vec<_>>(), is_all)
        };
        assert_eq!(plan(0), (vec![2, 7], false));
        // A block in common counts once.
        assert_eq!(plan(30), (vec![2, 7, 3], false));
        assert_eq!(plan(49), (vec![2, 7, 3], false));
        assert_eq!(plan(50), (vec![2, 7, 3, 4, 5], true));
    }

    #[test]
    fn blocks_of_a_model_stay_in_order() {
        let needs = [(1, 9), (0, 3), (1, 4)].map(|(model, block)| Need { model, block: BlockId(block) });
        let models = [(0, vec![BlockId(3)]), (1, vec![BlockId(9), BlockId(4)])];
        assert_eq!(by_model(&needs), BTreeMap::from(models));
    }
}
