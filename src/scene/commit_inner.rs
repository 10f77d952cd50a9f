//! The commit of scenes in a scene: where they stand, and the states of what is in them.

use super::draft::{Draft, DraftArray, DraftState};
use super::edit::Scene;
use super::frame::bounds_of_scene;
use super::given::Given;
use super::inner::{Counts, Inner, PlacedScene, PlacedSceneArray, Prototype};
use super::model::Model;
use super::placement::Placement;
use super::state::{SceneArrayStates, SceneState, States};
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::math::DBounds;
use std::collections::HashSet;
use std::sync::Arc;

/// Number of placed trees and of instances that a scene must not reach, with all in it.
const MOST_OCCURRENCES: u64 = 1 << 63;

/// The scenes in a scene, as they were committed last.
#[derive(Default)]
pub(super) struct InnerScenes {
    singles: Vec<Arc<SceneState>>,
    /// The prototypes of each array.
    arrays: Vec<Vec<Arc<SceneState>>>,
}

impl InnerScenes {
    pub fn of(draft: &Draft) -> Self {
        let arrays = draft.scene_arrays.iter().map(|it| it.prototypes.iter().map(|scene| scene.state()).collect());
        Self { singles: draft.scenes.values().map(|it| it.scene.state()).collect(), arrays: arrays.collect() }
    }

    /// Single ones, then the prototypes of arrays.
    pub fn all(&self) -> impl Iterator<Item = &Arc<SceneState>> {
        self.singles.iter().chain(self.arrays.iter().flatten())
    }

    /// True if they are those of a placement.
    pub fn are_in(&self, placed: &Placement) -> bool {
        self.all().count() == placed.inner_scenes().count()
            && self.all().zip(placed.inner_scenes()).all(|(it, placed)| Arc::ptr_eq(it, placed))
    }

    /// True if they are those of a placement, as far as places go: their states may differ.
    pub fn stand_in(&self, placed: &Placement) -> bool {
        let is_same = |a: &SceneState, b: &SceneState| {
            let same_models =
                || a.models.len() == b.models.len() && a.models.iter().zip(&b.models).all(|(a, b)| a.same(b));
            std::ptr::eq(a, b) || Arc::ptr_eq(&a.placement.top, &b.placement.top) && same_models()
        };
        self.all().count() == placed.inner_scenes().count()
            && self.all().zip(placed.inner_scenes()).all(|(it, placed)| is_same(it, placed))
    }

    /// The placement with these scenes in the places of others, which they [stand in](Self::stand_in).
    pub fn in_places_of(&self, placed: &Placement) -> Placement {
        let mut all = self.all();
        let mut next = |of: &Prototype| Prototype { scene: all.next().unwrap_or(&of.scene).clone(), ..of.clone() };
        let single = |it: &PlacedScene| PlacedScene { of: next(&it.of), ..*it };
        let singles = placed.scenes.iter().map(single).collect();
        let array = |it: &PlacedSceneArray| {
            let prototypes = it.prototypes.iter().map(&mut next).collect();
            PlacedSceneArray { prototypes, ..it.clone() }
        };
        let arrays = placed.scene_arrays.iter().map(array).collect();
        Placement { scenes: Arc::new(singles), scene_arrays: Arc::new(arrays), ..placed.clone() }
    }

    /// Number of the members that they make of a top tree.
    pub fn members(&self, draft: &Draft) -> usize {
        self.singles.len() + draft.scene_arrays.iter().map(|it| it.array.len() as usize).sum::<usize>()
    }

    /// What is in them, and in `own`. Fails with `BadArgument` if that is too much.
    pub fn counts(&self, draft: &Draft, own: Counts) -> Result<Counts> {
        let singles = self.singles.iter().fold(own, |all, it| all.plus(it.placement.count, 1));
        let arrays = draft.scene_arrays.iter().zip(&self.arrays);
        let all = arrays.fold(singles, |all, (it, scenes)| all.plus(PlacedSceneArray::counts(&it.array, scenes), 1));
        if all.placed.max(all.instances) >= MOST_OCCURRENCES {
            let why = "a scene must have fewer than 2^63 placed trees, those of scenes in it included";
            return Err(Error::bad_argument(why));
        }
        Ok(all)
    }

    /// Bytes of their placements, without the tree over all.
    pub fn bytes(&self, draft: &Draft) -> usize {
        let of_singles = self.singles.iter().map(|it| size_of::<PlacedScene>() + it.models.len() * size_of::<u32>());
        let arrays = draft.scene_arrays.iter().zip(&self.arrays);
        let of_arrays = arrays.map(|(it, scenes)| PlacedSceneArray::bytes(it.array.len(), scenes) as usize);
        of_singles.sum::<usize>() + of_arrays.sum::<usize>()
    }

    /// Bytes of states of what is in them that are not theirs alone.
    pub fn state_bytes(&self, draft: &Draft) -> u64 {
        let of = |it: &SceneState| it.states.bytes(&mut HashSet::new());
        let singles = draft.scenes.values().zip(&self.singles).filter(|(it, _)| !it.state.is_plain());
        let of_array = |(it, scenes): (&DraftArray<Scene>, &Vec<Arc<SceneState>>)| {
            let common: u64 = if it.common.is_plain() { 0 } else { scenes.iter().map(|it| of(it)).sum() };
            let own = it.own.keys().map(|member| of(&scenes[it.array.prototype_of(*member) as usize]));
            common + own.sum::<u64>()
        };
        singles.map(|(_, scene)| of(scene)).sum::<u64>()
            + draft.scene_arrays.iter().zip(&self.arrays).map(of_array).sum::<u64>()
            + Given::bytes(draft)
    }

    /// Adds the states of what is in them. Those of `before`, of the last commit, are used again where they are the
    /// same: to make them anew takes time in proportion to all that is in the scene.
    pub fn add_states(&self, draft: &Draft, before: &States, states: &mut States) {
        let under = |inner: &SceneState, state: &DraftState, known: Option<&Arc<States>>| {
            let inner = &inner.states;
            if state.is_plain() {
                return Arc::clone(inner);
            }
            let outer = state.committed();
            match known.filter(|it| it.is_of(inner, &outer)) {
                Some(known) => Arc::clone(known),
                None => Arc::new(inner.under(&outer)),
            }
        };
        let singles = self.singles.iter().zip(draft.scenes.values()).enumerate();
        states.scenes = singles.map(|(i, (inner, it))| under(inner, &it.state, before.scenes.get(i))).collect();
        let arrays = draft.scene_arrays.iter().zip(&self.arrays).enumerate().map(|(i, (it, scenes))| {
            let known = before.scene_arrays.get(i);
            let common = scenes.iter().enumerate().map(|(i, scene)| {
                let known = known.and_then(|it| it.common.get(i));
                under(scene, &it.common, known)
            });
            let own = it.own.iter().map(|(&member, state)| {
                let scene = &scenes[it.array.prototype_of(member) as usize];
                (member, under(scene, state, known.and_then(|it| it.own.get(&member))))
            });
            SceneArrayStates { common: common.collect(), own: own.collect() }
        });
        states.scene_arrays = arrays.collect();
        states.given = Given::of(draft);
    }

    /// True if their states let rays through: by their own looks, or by those of the scenes here.
    pub fn see_through(&self, draft: &Draft) -> bool {
        let of_arrays = draft.scene_arrays.iter().flat_map(|it| it.own.values().chain([&it.common]));
        let mut states = draft.scenes.values().map(|it| &it.state).chain(of_arrays);
        states.any(|it| it.look.see_through()) || self.all().any(|it| it.see_through)
    }

    /// Adds them to a placement and its members to `hits`. `index_of`: the index of a model in the scene.
    pub fn place(
        &self,
        draft: &Draft,
        placement: &mut Placement,
        hits: &mut Vec<(u32, DBounds)>,
        mut index_of: impl FnMut(&Model) -> u32,
    ) -> Result<()> {
        let what = "the placed trees of a scene";
        let mut prototype = |it: &Arc<SceneState>| {
            let models = it.models.iter().map(&mut index_of).collect();
            Prototype { scene: Arc::clone(it), models }
        };
        let mut first = Counts { placed: placement.own.into(), instances: placement.own_instances() };
        let mut singles: Vec<PlacedScene> = room(self.singles.len(), what)?;
        for (it, scene) in draft.scenes.values().zip(&self.singles) {
            let (id, world_from_scene, of) = (it.id, it.world_from_scene, prototype(scene));
            singles.push(PlacedScene { id, first, of, world_from_scene });
            first = first.plus(scene.placement.count, 1);
        }
        let mut arrays = room(self.arrays.len(), what)?;
        let mut first_member = placement.own + singles.len() as u32;
        for (it, scenes) in draft.scene_arrays.iter().zip(&self.arrays) {
            let prototypes = scenes.iter().map(&mut prototype).collect();
            arrays.push(PlacedSceneArray::new(Arc::clone(&it.array), first, first_member, prototypes)?);
            first = first.plus(PlacedSceneArray::counts(&it.array, scenes), 1);
            first_member += it.array.len();
        }
        (placement.scenes, placement.scene_arrays) = (Arc::new(singles), Arc::new(arrays));
        let mut position_error = placement.position_error;
        for it in placement.inners() {
            hits.push((hits.len() as u32, checked_bounds(&it)?));
            position_error = position_error.max(it.position_error());
        }
        placement.position_error = position_error;
        Ok(())
    }
}

/// Bounds of all that rays may hit in a scene in another. Fails with `BadArgument` if its transform and those in it are
/// singular together.
pub(super) fn checked_bounds(it: &Inner) -> Result<DBounds> {
    if !it.factors().are_sound() {
        let why = format!("scene {}: all transforms down to an instance are singular, or nearly so", it.id);
        return Err(Error::bad_argument(why));
    }
    Ok(bounds_of_scene(it.scene, &it.world_from_scene()))
}
