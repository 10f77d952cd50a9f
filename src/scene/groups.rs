//! The groups of members of a top tree that may stand in, under the states of a commit. The cells of a placement show
//! members as they are in their files. A member with another look keeps the cells above it from standing in.

use super::frame::bounds_of_scene;
use super::inner::Inner;
use super::placement::{Holder, Member, Placement, hit_bounds};
use super::state::{ArrayStates, InstanceState, SceneState, States};
use super::top::TopTree;
use crate::math::DBounds;
use crate::residency::Kept;
use std::sync::Arc;

/// If more than one in so many members has a look of its own, no group stands in: hardly one would be without them.
const MOST_OWN: usize = 16;

/// So many may have looks of their own in any scene.
const FEW: usize = 4;
/// Bytes of the blocks above a member, or more; a few may be larger.
const BLOCKS_EACH: u64 = 128 << 10;

/// See the module.
#[derive(Default, Clone)]
pub(super) struct Groups {
    /// The top tree, if it differs from that of the placement.
    top: Option<Arc<TopTree>>,
    /// The members with looks of their own, in ascending order.
    own: Arc<Vec<u32>>,
    /// True if cells of the top tree may stand in.
    pub stand_in: bool,
    _memory: Arc<Kept>,
}

impl Groups {
    /// The groups of a scene; `before`: the state of its last commit. Without memory for them no group stands in.
    pub fn of(scene: &SceneState, before: &SceneState) -> Self {
        let top = &scene.placement.top;
        if !top.has_cells() {
            return Self::default();
        }
        let most = (top.count() / MOST_OWN).max(FEW);
        let Some(own) = OwnMembers::of(scene, most) else { return Self::default() };
        if own.is_empty() {
            return Self { stand_in: true, ..Self::default() };
        }
        let is_known = Arc::ptr_eq(top, &before.placement.top) && *before.groups.own == own;
        if is_known && before.groups.stand_in {
            return before.groups.clone();
        }
        let of_blocks = top.bytes().min(own.len() as u64 * BLOCKS_EACH);
        let residency = scene.context().residency();
        let Ok(mut memory) = residency.keep("the groups of a scene", of_blocks + 4 * own.len() as u64) else {
            return Self::default();
        };
        let Some(top) = top.without_cells_above(&own, |member| scene.bounds_of_member(member)) else {
            return Self::default();
        };
        memory.shrink_to(top.changed_bytes() + 4 * own.len() as u64);
        Self { top: Some(Arc::new(top)), own: Arc::new(own), stand_in: true, _memory: Arc::new(memory) }
    }
}

impl Groups {
    /// Bytes of memory of what differs from the top tree of the placement.
    pub fn bytes(&self) -> u64 {
        self.top.as_ref().map_or(0, |top| top.changed_bytes()) + size_of_val(&self.own[..]) as u64
    }
}

impl SceneState {
    /// The top tree, in which the cells above members with looks of their own do not stand in.
    #[inline]
    pub(super) fn top(&self) -> &TopTree {
        self.groups.top.as_deref().unwrap_or(&self.placement.top)
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
}

/// Members of the top tree that look otherwise than in their files, or than when the tree was built.
struct OwnMembers {
    list: Vec<u32>,
    most: usize,
}

impl OwnMembers {
    /// All of a scene, in ascending order; `None` if there are more than `most`.
    fn of(scene: &SceneState, most: usize) -> Option<Vec<u32>> {
        let (placement, states) = (&*scene.placement, &*scene.states);
        let mut own = Self { list: Vec::new(), most };
        own.add_models(placement, states)?;
        own.add_scenes(placement, states)?;
        for &instance in states.occurrences.keys() {
            if let Holder::Scene(it) = placement.holder_of_instance(instance).0 {
                own.add([placement.member_of(&it)])?;
            }
        }
        own.list.sort_unstable();
        own.list.dedup();
        Some(own.list)
    }

    /// Adds members; `None` if these are too many.
    fn add(&mut self, members: impl IntoIterator<Item = u32>) -> Option<()> {
        for member in members {
            // Occurrences in one scene give it several times.
            if self.list.last() == Some(&member) {
                continue;
            }
            if self.list.len() == self.most {
                return None;
            }
            self.list.try_reserve(1).ok()?;
            self.list.push(member);
        }
        Some(())
    }

    /// Adds placed trees.
    fn add_models(&mut self, placement: &Placement, states: &States) -> Option<()> {
        let is_own = |state: &InstanceState| !state.is_plain();
        for (instance, _) in states.singles.iter().enumerate().filter(|(_, state)| is_own(state)) {
            let (first, next) = (placement.firsts[instance], placement.firsts.get(instance + 1));
            self.add(first..next.copied().unwrap_or(placement.singles.len() as u32))?;
        }
        for (array, ArrayStates { common, own }) in placement.arrays.iter().zip(&states.arrays) {
            if is_own(common) {
                self.add((0..array.array.len()).flat_map(|member| array.numbers_of(member)))?;
            } else {
                let members = own.iter().filter(|it| is_own(it.1)).map(|it| *it.0);
                self.add(members.flat_map(|member| array.numbers_of(member)))?;
            }
        }
        Some(())
    }

    /// Adds scenes.
    fn add_scenes(&mut self, placement: &Placement, states: &States) -> Option<()> {
        let mut looked = placement.looked.iter();
        let mut is_changed = |scene: &SceneState| {
            // What was not known is in no cell.
            let Some(before) = looked.next().and_then(Option::as_ref) else { return false };
            !scene.appearance().is_some_and(|(now, _)| Arc::ptr_eq(before, &now))
        };
        let are_others = |states: &Arc<States>, scene: &SceneState| !Arc::ptr_eq(states, &scene.states);
        for (at, it) in placement.scenes.iter().enumerate() {
            let is_own = is_changed(&it.of.scene) || are_others(&states.scenes[at], &it.of.scene);
            self.add(is_own.then_some(placement.own + at as u32))?;
        }
        for (it, states) in placement.scene_arrays.iter().zip(&states.scene_arrays) {
            let of = |member: u32| it.array.prototype_of(member) as usize;
            let prototypes = states.common.iter().zip(it.prototypes.iter());
            let common: Vec<bool> = prototypes.map(|(a, b)| is_changed(&b.scene) || are_others(a, &b.scene)).collect();
            if common.contains(&true) {
                self.add((0..it.array.len()).filter(|member| common[of(*member)]).map(|at| it.first_member + at))?;
            }
            let members = states.own.iter().filter(|(member, a)| are_others(a, &it.prototypes[of(**member)].scene));
            self.add(members.map(|(member, _)| it.first_member + member))?;
        }
        Some(())
    }
}
