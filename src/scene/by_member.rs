//! Edits of members of arrays with consecutive ids: transforms, masks and tints. A commit after them takes time in
//! proportion to their number.

use super::array::{Array, Transforms};
use super::draft::{ArrayKey, Draft};
use super::edit::Scene;
use crate::base::error::{Error, Result};

impl Scene {
    /// Moves instances of an array with consecutive ids, the first with the id `first_id`. The transforms have the form
    /// of the array's. Fails with `BadArgument` if they are not all of one array, or for the first transform that is
    /// wrong, and with `OverBudget`. After a failure nothing has moved.
    pub fn set_transforms(&self, first_id: u64, transforms: &Transforms) -> Result<()> {
        let mut draft = self.draft();
        let (array, member) = members(&mut draft, first_id, transforms.len(), "transforms")?;
        self.move_members(&mut draft, array, member, transforms)
    }

    /// Replaces the masks of instances of an array with consecutive ids, the first with the id `first_id`. Rays see an
    /// instance that have a bit in common with its mask and that of all in the array. A mask that
    /// [`Scene::set_instance_mask`] set is replaced too. Fails with `BadArgument` if they are not all of one array, and
    /// with `OverBudget`. After a failure no mask has changed.
    pub fn set_masks(&self, first_id: u64, masks: &[u32]) -> Result<()> {
        let mut draft = self.draft();
        let (array, member) = members(&mut draft, first_id, masks.len(), "masks")?;
        let residency = self.context().residency();
        Array::own(draft.array(array), false, residency)?.set_masks(member, masks, residency)?;
        draft.unset_masks(array, member..member + masks.len() as u32);
        self.note_change(&mut draft, array, member, masks.len());
        Ok(())
    }

    /// Replaces the tints of instances of an array with consecutive ids, the first with the id `first_id`: see
    /// [`Instances::tints`](super::Instances::tints). Fails like [`Scene::set_masks`].
    pub fn set_tints(&self, first_id: u64, tints: &[[u8; 4]]) -> Result<()> {
        let mut draft = self.draft();
        let (array, member) = members(&mut draft, first_id, tints.len(), "tints")?;
        let residency = self.context().residency();
        Array::own(draft.array(array), false, residency)?.set_tints(member, tints, residency)?;
        self.note_change(&mut draft, array, member, tints.len());
        Ok(())
    }

    /// Sets the mask of an instance: it is visible to rays with a common bit in their masks. By default all bits are
    /// set. It replaces those that an array has for a member. Cheap.
    pub fn set_instance_mask(&self, id: u64, mask: u32) -> Result<()> {
        let mut draft = self.draft();
        draft.state(self.context(), id)?;
        if let Some((array, member)) = draft.member(id)
            && draft.array(array).mask(member) != u32::MAX
        {
            let residency = self.context().residency();
            Array::own(draft.array(array), false, residency)?.set_masks(member, &[u32::MAX], residency)?;
            self.note_change(&mut draft, array, member, 1);
        }
        draft.state(self.context(), id)?.mask = mask;
        Ok(())
    }

    /// Replaces the transforms of members of an array, from `member` on.
    pub(super) fn move_members(&self, draft: &mut Draft, array: ArrayKey, member: u32, to: &Transforms) -> Result<()> {
        Array::replace(draft.array(array), member, to, self.context().residency())?;
        self.note_change(draft, array, member, to.len());
        Ok(())
    }

    /// Notes members that a commit has to place anew, or of which cells may show something else.
    fn note_change(&self, draft: &mut Draft, array: ArrayKey, member: u32, count: usize) {
        // A commit that places all needs no list.
        if !draft.moved {
            draft.shifted.push((array, member..member + count as u32));
            draft.moved = !self.shown().placement.top.may_move(draft.shifted.len());
        }
        if draft.moved {
            draft.shifted.clear();
        }
    }
}

/// The array and the first member that `count` of something are for.
fn members(draft: &mut Draft, first_id: u64, count: usize, what: &str) -> Result<(ArrayKey, u32)> {
    let Some((array, member)) = draft.member(first_id) else {
        return Err(Error::bad_argument(format!("instance {first_id} is of no array")));
    };
    let left = draft.array(array).len() - member;
    match count > left as usize {
        true => Err(Error::bad_argument(format!("{count} {what}, but {left} instances from {first_id} on"))),
        false => Ok((array, member)),
    }
}
