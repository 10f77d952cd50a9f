//! The masks and looks that were given to scenes in a scene. States hold them only together with those of what is in
//! these scenes; a file of the scene needs them alone.

use super::draft::{Draft, DraftState};
use super::looks::Look;

/// The index of a scene among the single ones, or of a member in its array, with the mask and the look that it was
/// given.
pub(super) type Given1 = (u32, u32, Look);

/// What scenes in a scene were given at a commit.
#[derive(Default)]
pub(super) struct Given {
    /// Single scenes with a mask or a look.
    pub scenes: Vec<Given1>,
    /// For each array of scenes the mask of all, and the members with a state of their own, ascending.
    pub arrays: Vec<(u32, Vec<Given1>)>,
}

impl Given {
    pub fn of(draft: &Draft) -> Self {
        let of = |(index, it): (u32, &DraftState)| (index, it.mask, it.look);
        let scenes = (0..).zip(draft.scenes.values().map(|it| &it.state)).filter(|(_, it)| !it.is_plain());
        let arrays = draft.scene_arrays.iter().map(|it| {
            let mut own: Vec<Given1> = it.own.iter().map(|(&member, state)| of((member, state))).collect();
            own.sort_unstable_by_key(|it| it.0);
            (it.common.mask, own)
        });
        Self { scenes: scenes.map(of).collect(), arrays: arrays.collect() }
    }

    /// Bytes of memory.
    pub fn bytes(draft: &Draft) -> u64 {
        let scenes = draft.scenes.values().filter(|it| !it.state.is_plain()).count();
        let own: usize = draft.scene_arrays.iter().map(|it| it.own.len()).sum();
        let arrays = draft.scene_arrays.len() * size_of::<(u32, Vec<Given1>)>();
        ((scenes + own) * size_of::<Given1>() + arrays) as u64
    }
}
