//! The groups of members of a top tree that may stand in, under the states of a commit. The cells of a placement show
//! members as they are in their files. A member with another look keeps the cells above it from standing in.

use super::inner::Inner;
use super::placement::{Holder, Placement, hit_bounds};
use super::state::{ArrayStates, InstanceState, SceneState, States};
use super::top::TopTree;
use super::{frame::bounds_of_scene, placement::Member};
use crate::base::error::Result;
use crate::math::DBounds;
use crate::residency::Kept;
use std::sync::Arc;

/// If more than one in so many members has a look of its own, no group stands in.
const MOST_OWN: usize = 4;

/// See the module.
#[derive(Default)]
pub(super) struct Groups {
    /// The top tree, if it differs from that of the placement.
    top: Option<TopTree>,
    /// True if cells of the top tree may stand in.
    pub stand_in: bool,
    _memory: Kept,
}

impl Groups {
    /// The groups of a scene. Fails with `OverBudget`.
    pub fn of(scene: &SceneState) -> Result<Self> {
        let top = &scene.placement.top;
        let mut own = scene.states.own_members(&scene.placement);
        if !top.has_cells() || own.len() * MOST_OWN > top.count() {
            return Ok(Self::default());
        }
        if own.is_empty() {
            return Ok(Self { stand_in: true, ..Self::default() });
        }
        own.sort_unstable();
        own.dedup();
        let bounds = own.into_iter().map(|member| (member, scene.bounds_of_member(member)));
        let Some(top) = top.without_cells_above(bounds.filter(|it| !it.1.is_empty())) else {
            return Ok(Self::default());
        };
        let memory = scene.context().residency().keep("the groups of a scene", top.changed_bytes())?;
        Ok(Self { top: Some(top), stand_in: true, _memory: memory })
    }
}

impl SceneState {
    /// The top tree, in which the cells above members with looks of their own do not stand in.
    #[inline]
    pub(super) fn top(&self) -> &TopTree {
        self.groups.top.as_ref().unwrap_or(&self.placement.top)
    }

    /// Bounds of all that rays may hit in a member of the top tree.
    fn bounds_of_member(&self, member: u32) -> DBounds {
        match self.placement.member(member) {
            Member::Placed(number) => hit_bounds(&self.placed(number.into()), &self.models),
            Member::Scene(it) => bounds_of_scene(it.scene, &it.world_from_scene()),
        }
    }
}

impl States {
    /// True if single occurrences in a scene in this one have looks of their own.
    pub fn has_occurrence_of(&self, it: &Inner) -> bool {
        let last = it.first_instance.saturating_add(it.scene.placement.instance_count());
        !self.occurrences.is_empty() && self.occurrences.range(it.first_instance..last).next().is_some()
    }

    /// The members of the top tree that look otherwise than they were committed or are in their files.
    fn own_members(&self, placement: &Placement) -> Vec<u32> {
        let mut own: Vec<u32> = Vec::new();
        let is_own = |state: &InstanceState| !state.is_plain();
        for (instance, _) in self.singles.iter().enumerate().filter(|(_, state)| is_own(state)) {
            let (first, next) = (placement.firsts[instance], placement.firsts.get(instance + 1));
            own.extend(first..next.copied().unwrap_or(placement.singles.len() as u32));
        }
        for (array, ArrayStates { common, own: states }) in placement.arrays.iter().zip(&self.arrays) {
            if is_own(common) {
                own.extend((0..array.array.len()).flat_map(|member| array.numbers_of(member)));
            } else {
                let members = states.iter().filter(|it| is_own(it.1)).map(|it| *it.0);
                own.extend(members.flat_map(|member| array.numbers_of(member)));
            }
        }
        // Scenes that look otherwise than when the tree was built.
        let mut looked = placement.looked.iter();
        let mut is_changed = |scene: &SceneState| {
            // What was not known is in no cell.
            let Some(before) = looked.next().and_then(Option::as_ref) else { return false };
            !scene.appearance().is_some_and(|(now, _)| Arc::ptr_eq(before, &now))
        };
        let are_others = |states: &Arc<States>, scene: &SceneState| !Arc::ptr_eq(states, &scene.states);
        for (at, it) in placement.scenes.iter().enumerate() {
            let is_own = is_changed(&it.of.scene) || are_others(&self.scenes[at], &it.of.scene);
            own.extend(is_own.then_some(placement.own + at as u32));
        }
        for (it, states) in placement.scene_arrays.iter().zip(&self.scene_arrays) {
            let of = |member: u32| it.array.prototype_of(member) as usize;
            let prototypes = states.common.iter().zip(it.prototypes.iter());
            let common: Vec<bool> = prototypes.map(|(a, b)| is_changed(&b.scene) || are_others(a, &b.scene)).collect();
            if common.contains(&true) {
                own.extend((0..it.array.len()).filter(|member| common[of(*member)]).map(|at| it.first_member + at));
            }
            let members = states.own.iter().filter(|(member, a)| are_others(a, &it.prototypes[of(**member)].scene));
            own.extend(members.map(|(member, _)| it.first_member + member));
        }
        own.extend(self.occurrences.keys().filter_map(|&instance| match placement.holder_of_instance(instance).0 {
            Holder::Scene(it) => Some(placement.member_of(&it)),
            Holder::Array(_) => None,
        }));
        own
    }
}
