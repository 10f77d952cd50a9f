//! Lists of needed blocks: their sizes, a limit of their sum, and their order by model.

use crate::base::ids::BlockId;
use crate::scene::SceneState;
use crate::scene::walk::Need;
use std::collections::BTreeMap;

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
    fn blocks_of_a_model_stay_in_order() {
        let needs = [(1, 9), (0, 3), (1, 4)].map(|(model, block)| Need { model, block: BlockId(block) });
        let models = [(0, vec![BlockId(3)]), (1, vec![BlockId(9), BlockId(4)])];
        assert_eq!(by_model(&needs), BTreeMap::from(models));
    }
}
