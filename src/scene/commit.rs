//! The commit of a scene: the placement of all trees, and the states of all instances.

use super::appearances::MemberLooks;
use super::array::Array;
use super::commit_inner::InnerScenes;
use super::draft::{Draft, DraftArray, DraftScene, DraftState};
use super::edit::Scene;
use super::groups::Groups;
use super::inner::Counts;
use super::looks::PartsShown;
use super::measures::Measures;
use super::model::Model;
use super::placed::Placed;
use super::placement::{PlacedArray, PlacedIds, Placement, Prototype, hit_bounds};
use super::state::{ArrayStates, Instance, InstanceState, SceneState, States};
use super::top::TopTree;
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::math::DBounds;
use crate::residency::{UNCOUNTED, counted};
use glam::DMat3;
use std::sync::{Arc, OnceLock};

/// Greatest number of levels of scenes in scenes: functions that follow them call themselves.
pub(super) const MOST_LEVELS: u32 = 64;

/// Bytes of the entries of a scene in the maps of the draft, which may be half empty.
const INDEX: usize = 64;

impl Scene {
    pub(super) fn next_state(&self, draft: &mut Draft) -> Result<SceneState> {
        draft.close_gaps();
        // Scenes in this one, as they are now.
        let scenes = InnerScenes::of(draft);
        let levels = 1 + scenes.all().map(|it| it.levels).max().unwrap_or(0);
        if levels > MOST_LEVELS {
            return Err(Error::bad_argument(format!("scenes are in each other at more than {MOST_LEVELS} levels")));
        }
        let before = self.state();
        draft.moved |= !scenes.stand_in(&before.placement);
        // Scenes in this one may have new states in the places of the last commit.
        let has_new_states = !draft.moved && !scenes.are_in(&before.placement);
        draft.moved |= has_new_states && !draft.shifted.is_empty();
        let of_singles = draft.instances.len() * (size_of::<Instance>() + size_of::<InstanceState>());
        let of_scenes = draft.scenes.len() * (size_of::<DraftScene>() + INDEX);
        let bytes = (of_singles + of_scenes) as u64 + scenes.state_bytes(draft);
        let refitted = if draft.moved { None } else { self.refitted(draft)? };
        draft.moved |= !draft.shifted.is_empty() && refitted.is_none();
        let placing = if draft.moved { Placing::of(draft, &scenes)? } else { Placing::default() };
        let of_looks = |model: &Model, it: &DraftState| {
            if it.has_new_looks() { PartsShown::bytes(model, &it.parts) } else { it.shown.took }
        };
        let (mut all_looks, mut new_looks) = (0, 0);
        draft.states().for_each(|(model, it)| {
            let bytes = of_looks(model, it);
            all_looks += bytes;
            new_looks += if it.has_new_looks() { bytes } else { 0 };
        });
        // Only little memory is not counted.
        let counts = all_looks > UNCOUNTED;
        // The sum of all, so that the error names a budget that suffices for the whole commit.
        let counted_looks = if counts { new_looks } else { 0 };
        let needs = counted_looks + counted(bytes) + counted(placing.bytes);
        self.context().residency().check_room("a scene", needs)?;
        // Blocks are searched anew only where looks of parts have changed.
        for (model, it) in draft.states().filter(|(_, it)| it.has_new_looks()) {
            it.shown = Arc::new(PartsShown::of(model, &it.parts, counts)?);
        }
        let mut models: Vec<Model> = Vec::new();
        let mut index_of = |model: &Model| {
            let known = models.iter().position(|m| m.same(model));
            known.unwrap_or_else(|| {
                models.push(model.clone());
                models.len() - 1
            }) as u32
        };
        let memory = self.context().residency().keep("the instances of a scene", bytes)?;
        let mut singles = room(draft.instances.len(), "the instances of a scene")?;
        let mut states =
            States { singles: room(draft.instances.len(), "the instances of a scene")?, ..States::default() };
        for it in draft.draftees() {
            singles.push(Instance { id: it.id, model: index_of(&it.model), world_from_model: it.world_from_model });
            states.singles.push(it.state.committed());
        }
        let of_array = |it: &DraftArray<Model>| it.prototypes.iter().map(&mut index_of).collect::<Vec<u32>>();
        let models_of: Vec<Vec<u32>> = draft.arrays.iter().map(of_array).collect();
        let of_members = |it: &DraftArray<Model>| {
            let own = it.own.iter().map(|(&member, state)| (member, state.committed())).collect();
            ArrayStates { common: it.common.committed(), own }
        };
        states.arrays = draft.arrays.iter().map(of_members).collect();
        // Models of scenes come after those of instances.
        scenes.all().flat_map(|it| &it.models).for_each(|model| {
            index_of(model);
        });
        let placement = if draft.moved {
            Arc::new(placing.place(self, draft, &singles, &models, models_of, &scenes)?)
        } else {
            match refitted {
                Some(refitted) => Arc::new(refitted),
                None if has_new_states => Arc::new(scenes.in_places_of(&before.placement)),
                None => Arc::clone(&before.placement),
            }
        };
        let see_through = models.iter().any(Model::see_through)
            || states.own().any(|it| it.look.see_through() || it.parts.looks.see_through())
            || scenes.see_through(draft)
            || placement.own_arrays().any(Array::has_clear);
        let has_tints = placement.own_arrays().any(Array::has_tints) || scenes.all().any(|it| it.has_tints);
        let hides_parts = states.own().any(|it| !it.parts.trees.is_empty()) || scenes.all().any(|it| it.hides_parts);
        scenes.add_states(draft, &before.states, &mut states);
        states.find_seen_by();
        let mut state = SceneState {
            see_through,
            levels,
            hides_parts,
            has_tints,
            context: self.context().clone(),
            models,
            singles,
            states: Arc::new(states),
            placement,
            groups: Groups::default(),
            lights: draft.lights.clone(),
            background: draft.background,
            _memory: memory,
        };
        let occurrences = draft.occurrences.states(&state);
        state.see_through |= occurrences.values().any(|it| it.look.see_through());
        match Arc::get_mut(&mut state.states) {
            Some(states) => states.occurrences = occurrences,
            None => return Err(Error::Internal("the states of a commit are shared".into())),
        }
        state.groups = Groups::of(&state, &before);
        Ok(state)
    }
}

/// The trees to be placed: those of the instances' models and of these models' own assemblies.
#[derive(Default)]
struct Placing {
    /// Number of the trees of single instances.
    singles: usize,
    /// Number of these and of the trees of arrays.
    own: usize,
    /// Number of members of the top tree.
    members: usize,
    /// What is in the scene, with all in scenes in it.
    count: Counts,
    /// Bytes of memory while the trees are placed.
    bytes: u64,
}

impl Placing {
    /// Bytes for each member while the tree over all is built.
    const BUILD: usize = size_of::<(u32, DBounds)>() + TopTree::BYTES_EACH;

    /// Counts the trees.
    fn of(draft: &Draft, scenes: &InnerScenes) -> Result<Self> {
        let singles: usize = draft.draftees().map(|it| it.model.placements().count()).sum();
        let mut bytes = singles * size_of::<Placed>() + size_of::<u32>() * draft.instances.len();
        let mut count = singles;
        for it in &draft.arrays {
            let of_models: Vec<usize> = it.prototypes.iter().map(|model| model.placements().count()).collect();
            let trees: usize = if it.has_one_each() {
                it.array.len() as usize
            } else {
                it.array.prototypes().map(|at| of_models[at]).sum()
            };
            let starts = if it.has_one_each() { 0 } else { it.array.len() as usize + 1 };
            let prototypes: u64 = it.prototypes.iter().map(Prototype::bytes).sum();
            bytes += trees * size_of::<Measures>() + starts * size_of::<u32>() + prototypes as usize;
            count += trees;
        }
        let of_arrays = draft.arrays.iter().map(|it| it.array.len() as usize);
        let instances = of_arrays.fold(draft.instances.len(), usize::saturating_add);
        let members = count.saturating_add(scenes.members(draft));
        if members.max(instances) >= 1 << 31 {
            let why = "a scene must have fewer than 2^31 instances, placed trees and scenes of its own";
            return Err(Error::bad_argument(why));
        }
        let of_own = Counts { placed: count as u64, instances: instances as u64 };
        bytes += scenes.bytes(draft);
        let all = scenes.counts(draft, of_own)?;
        Ok(Self { singles, own: count, members, count: all, bytes: (bytes + members * Self::BUILD) as u64 })
    }

    /// Places the trees, and builds the top tree over them.
    fn place(
        &self,
        scene: &Scene,
        draft: &Draft,
        instances: &[Instance],
        models: &[Model],
        models_of: Vec<Vec<u32>>,
        scenes: &InnerScenes,
    ) -> Result<Placement> {
        let what = "the placed trees of a scene";
        let mut memory = scene.context().residency().keep(what, self.bytes)?;
        let mut hits: Vec<(u32, DBounds)> = room(self.members, what)?;
        let (mut singles, mut firsts) = (room(self.singles, what)?, room(instances.len(), what)?);
        let (mut around, mut position_error) = (DBounds::EMPTY, 0.0f64);
        // Bytes of measures that are not stored.
        let mut left = 0;
        let mut add = |placed: &Placed, hits: &mut Vec<(u32, DBounds)>| {
            hits.push((hits.len() as u32, hit_bounds(placed, models)));
            around = around.union(placed.bounds);
            position_error = position_error.max(placed.position_error);
        };
        for (i, (draftee, instance)) in draft.draftees().zip(instances).enumerate() {
            firsts.push(singles.len() as u32);
            for (tree, first_part, model_from_mesh) in draftee.model.placements() {
                let ids = PlacedIds { model: instance.model, tree, instance: i as u64, first_part };
                let stored = &draftee.model.trees()[tree as usize];
                let placed = Placed::new(stored, ids, &(draftee.world_from_model * model_from_mesh));
                add(&placed, &mut hits);
                singles.push(placed);
            }
        }
        let (singles, firsts) = (Arc::new(singles), Arc::new(firsts));
        let (own, count) = (self.own as u32, self.count);
        let mut placement = Placement { own, count, singles, firsts, ..Placement::default() };
        for (it, of) in draft.arrays.iter().zip(models_of) {
            let first_instance = placement.own_instances() as u32;
            let (array, count) = placed_array(it, &of, [hits.len() as u32, first_instance])?;
            for number in array.first..array.first + count {
                add(&array.placed(number, models), &mut hits);
            }
            left += (count as usize - array.measures.len()) * size_of::<Measures>();
            placement.arrays.push(array);
        }
        placement.position_error = position_error;
        placement.bounds = if scenes.all().next().is_none() { around.into() } else { OnceLock::new() };
        let index_of = |model: &Model| models.iter().position(|it| it.same(model)).unwrap_or(0) as u32;
        scenes.place(draft, &mut placement, &mut hits, index_of)?;
        let position_error = placement.position_error;
        let looks = MemberLooks::of(&placement, models);
        let top = TopTree::build(hits, position_error, |member| looks.look(member))?;
        let looked = looks.of_scenes();
        (placement.top, placement.looked) = (Arc::new(top), Arc::new(looked));
        memory.shrink_to(self.bytes - (self.members * Self::BUILD + left) as u64 + placement.top.bytes());
        placement.memory = Arc::new(memory);
        Ok(placement)
    }
}

/// The measures of `count` maps; none if all change all lengths alike.
fn all_measures<I: Iterator<Item = DMat3>>(count: usize, linear: impl Fn() -> I) -> Result<Vec<Measures>> {
    let are_known = linear().all(|linear| Measures::of_similarity(&linear).is_some());
    let mut measures = room(if are_known { 0 } else { count }, "the placed trees of a scene")?;
    if !are_known {
        measures.extend(linear().map(|linear| Measures::of(&linear)));
    }
    Ok(measures)
}

/// The placed trees of an array, and their number. `models`: the indices of its models; `first`: the numbers of its
/// first tree and instance.
fn placed_array(
    it: &DraftArray<Model>,
    models: &[u32],
    [first, first_instance]: [u32; 2],
) -> Result<(PlacedArray, u32)> {
    let what = "the placed trees of a scene";
    let prototype = |(&model, it): (&u32, &Model)| Prototype { model, places: it.placements().collect() };
    let prototypes: Arc<[Prototype]> = models.iter().zip(&it.prototypes).map(prototype).collect();
    let array = Arc::clone(&it.array);
    let (mut starts, mut count) = (Vec::new(), array.len() as usize);
    if !it.has_one_each() {
        starts = room(array.len() as usize + 1, what)?;
        count = 0;
        for at in array.prototypes() {
            starts.push(count as u32);
            count += prototypes[at].places.len();
        }
        starts.push(count as u32);
    }
    let of_member = |(member, at): (u32, usize)| {
        let world_from_model = array.transform(member);
        prototypes[at].places.iter().map(move |place| (world_from_model * place.2).matrix3)
    };
    let measures = all_measures(count, || (0..).zip(array.prototypes()).flat_map(of_member))?;
    let (starts, measures) = (Arc::new(starts), Arc::new(measures));
    Ok((PlacedArray { array, first, first_instance, prototypes, starts, measures }, count as u32))
}
