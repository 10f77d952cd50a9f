//! The placement after moves of members of arrays: that of the last commit with these members placed anew. All else is
//! shared, so that the time grows with the number of moves.

use super::commit_inner::checked_bounds;
use super::draft::{ArrayKey, Draft};
use super::edit::Scene;
use super::frame::bounds_of_scene;
use super::measures::Measures;
use super::placement::{Placement, hit_bounds};
use crate::base::error::Result;
use crate::math::DBounds;
use std::sync::{Arc, OnceLock};

impl Scene {
    /// The placement after the moves of the draft; `None` if there are none, or if all must be placed anew. Fails with
    /// `OverBudget`.
    pub(super) fn refitted(&self, draft: &Draft) -> Result<Option<Placement>> {
        let state = self.state();
        let before = &state.placement;
        let count: usize = draft.shifted.iter().map(|it| it.1.len()).sum();
        if count == 0 || !before.top.may_move(count) {
            return Ok(None);
        }
        let mut shifted: Vec<(ArrayKey, u32)> =
            draft.shifted.iter().flat_map(|(at, members)| members.clone().map(|member| (*at, member))).collect();
        shifted.sort_unstable();
        shifted.dedup();
        let mut after = Placement {
            bounds: OnceLock::new(),
            factors: OnceLock::new(),
            changed: Arc::default(),
            ..Placement::clone(before)
        };
        let (mut moves, has_cells) = (Vec::with_capacity(shifted.len()), before.top.has_cells());
        let mut bounds = before.bounds.get().copied().filter(|_| before.has_no_scenes());
        for (at, member) in shifted {
            let at = match at {
                ArrayKey::Models(at) => at,
                ArrayKey::Scenes(at) => {
                    let arrays = Arc::make_mut(&mut after.scene_arrays);
                    arrays[at].array = Arc::clone(&draft.scene_arrays[at].array);
                    let [old, new] = [&before.scene_arrays, &after.scene_arrays].map(|all| all[at].inner(at, member));
                    after.position_error = after.position_error.max(new.position_error());
                    let number = before.scene_arrays[at].first_member + member;
                    let bounds = [bounds_of_scene(old.scene, &old.world_from_scene()), checked_bounds(&new)?];
                    // A scene with nothing in it is not in the tree.
                    moves.extend((!bounds[0].is_empty()).then_some((number, bounds)));
                    continue;
                }
            };
            let (array, was) = (&mut after.arrays[at], &before.arrays[at]);
            array.array = Arc::clone(&draft.arrays[at].array);
            let [old, new] = [&was.array, &array.array].map(|it| it.transform(member));
            if new == old {
                // Cells above it may show something else.
                if has_cells && !array.array.shows_as(&was.array, member) {
                    let bounds = |number| hit_bounds(&was.placed(number, &state.models), &state.models);
                    moves.extend(array.numbers_of(member).map(|number| (number, [bounds(number); 2])));
                }
                continue;
            }
            let linear = new.matrix3;
            for number in array.numbers_of(member) {
                if !array.measures.is_empty() {
                    let place = array.place_of(number);
                    Arc::make_mut(&mut array.measures)[(number - array.first) as usize] =
                        Measures::of(&(linear * place.matrix3));
                }
                let [old, new] = [&before.arrays[at], array].map(|it| it.placed(number, &state.models));
                moves.push((number, [&old, &new].map(|it| hit_bounds(it, &state.models))));
                after.position_error = after.position_error.max(new.position_error);
                // Where it was at the edge, the rest may end earlier.
                bounds = bounds.filter(|all| is_inside(&old.bounds, all)).map(|all| all.union(new.bounds));
            }
        }
        if moves.is_empty() {
            after.changed = Arc::clone(&before.changed);
            return Ok(Some(after));
        }
        let Some(top) = before.top.moved(&moves, after.position_error) else { return Ok(None) };
        let copies = after.arrays.iter().zip(&before.arrays);
        let copies = copies.filter(|(it, was)| !Arc::ptr_eq(&it.measures, &was.measures));
        let copied: usize = copies.map(|(it, _)| size_of_val(&it.measures[..])).sum();
        let bytes = top.changed_bytes() + copied as u64;
        after.changed = Arc::new(self.context().residency().keep("the placed trees of a scene", bytes)?);
        after.top = Arc::new(top);
        after.bounds = bounds.map_or_else(OnceLock::new, OnceLock::from);
        Ok(Some(after))
    }
}

/// True if a box ends before the box around it does, on all sides.
fn is_inside(b: &DBounds, around: &DBounds) -> bool {
    b.min.cmpgt(around.min).all() && b.max.cmplt(around.max).all()
}
