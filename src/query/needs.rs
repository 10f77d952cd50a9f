//! Blocks that are needed: how many bytes they take, how many of them there is room for, and whose they are.

use crate::base::ids::BlockId;
use crate::scene::SceneState;
use crate::scene::walk::Need;
use std::collections::BTreeMap;

/// Bytes of a block in memory.
pub(crate) fn bytes_of(scene: &SceneState, need: Need) -> u64 {
    scene.models[need.model as usize].blocks().slot_bytes(need.block)
}

/// A sum against a limit: says of one count of bytes after the other, each above 0, whether all so far are `room` at most.
/// The first always fits, so that there is progress.
pub(crate) fn one_at_least(room: u64) -> impl FnMut(u64) -> bool {
    let mut sum = 0;
    move |bytes| {
        let is_first = sum == 0;
        sum += bytes;
        is_first || sum <= room
    }
}

/// Blocks of each model, in their order.
pub(crate) fn by_model(needs: &[Need]) -> BTreeMap<u32, Vec<BlockId>> {
    let mut models = BTreeMap::<u32, Vec<BlockId>>::new();
    needs.iter().for_each(|need| models.entry(need.model).or_default().push(need.block));
    models
}
