//! The commit of a scene: the placement of all trees, and the states of all instances.

use super::edit::{Draft, DraftArray, DraftState, Scene};
use super::looks::PartsShown;
use super::model::Model;
use super::placed::{Measures, Placed};
use super::placement::{PlacedArray, PlacedIds, Placement, Prototype};
use super::state::{ArrayStates, Instance, SceneState};
use super::top::TopTree;
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::math::DBounds;
use crate::residency::{UNCOUNTED, counted};
use std::sync::Arc;

impl Scene {
    pub(super) fn next_state(&self, draft: &mut Draft) -> Result<SceneState> {
        draft.close_gaps();
        let bytes = (draft.instances.len() * size_of::<Instance>()) as u64;
        let placing = if draft.moved { Placing::of(draft)? } else { Placing::default() };
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
        let needs = if counts { new_looks } else { 0 } + counted(bytes) + counted(placing.bytes);
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
        for it in draft.draftees() {
            let (model, state) = (index_of(&it.model), it.state.committed());
            singles.push(Instance { id: it.id, model, world_from_model: it.world_from_model, state });
        }
        let of_array = |it: &DraftArray| it.models.iter().map(&mut index_of).collect::<Vec<u32>>();
        let models_of: Vec<Vec<u32>> = draft.arrays.iter().map(of_array).collect();
        let states = |it: &DraftArray| {
            let own = it.own.iter().map(|(&member, state)| (member, state.committed())).collect();
            ArrayStates { common: it.common.committed(), own }
        };
        let arrays: Vec<ArrayStates> = draft.arrays.iter().map(states).collect();
        let placement = if draft.moved {
            Arc::new(placing.place(self, draft, &singles, &models, models_of)?)
        } else {
            Arc::clone(&self.state().placement)
        };
        let of_members = || arrays.iter().flat_map(|it| it.own.values().chain([&it.common]));
        let all_states = || singles.iter().map(|it| &it.state).chain(of_members());
        let see_through = models.iter().any(Model::see_through)
            || all_states().any(|it| it.look.see_through() || it.parts.looks.see_through());
        let hides_parts = all_states().any(|it| !it.parts.trees.is_empty());
        Ok(SceneState {
            see_through,
            hides_parts,
            context: self.context().clone(),
            models,
            singles,
            arrays,
            placement,
            lights: draft.lights.clone(),
            background: draft.background,
            _memory: memory,
        })
    }
}

/// The trees to be placed: those of the instances' models and of these models' own assemblies.
#[derive(Default)]
struct Placing {
    /// Number of the trees of single instances.
    singles: usize,
    /// Number of all trees.
    count: usize,
    /// Bytes of memory while the trees are placed.
    bytes: u64,
}

impl Placing {
    /// Bytes for each placed tree while the tree over all is built.
    const BUILD: usize = size_of::<DBounds>() + TopTree::BYTES_EACH;

    /// Counts the trees.
    fn of(draft: &Draft) -> Result<Self> {
        let singles: usize = draft.draftees().map(|it| it.model.placements().count()).sum();
        let mut bytes = singles * size_of::<Placed>() + size_of::<u32>() * draft.instances.len();
        let mut count = singles;
        for it in &draft.arrays {
            let of_models: Vec<usize> = it.models.iter().map(|model| model.placements().count()).collect();
            let trees: usize = if it.has_one_each() {
                it.array.len() as usize
            } else {
                it.array.models().map(|at| of_models[at]).sum()
            };
            let starts = if it.has_one_each() { 0 } else { it.array.len() as usize + 1 };
            let prototypes: u64 = it.models.iter().map(Prototype::bytes).sum();
            bytes += trees * size_of::<Measures>() + starts * size_of::<u32>() + prototypes as usize;
            count += trees;
        }
        if count >= 1 << 31 {
            return Err(Error::bad_argument("a scene must have fewer than 2^31 placed trees"));
        }
        Ok(Self { singles, count, bytes: (bytes + count * Self::BUILD) as u64 })
    }

    /// Places the trees, and builds the top tree over them.
    fn place(
        &self,
        scene: &Scene,
        draft: &Draft,
        instances: &[Instance],
        models: &[Model],
        models_of: Vec<Vec<u32>>,
    ) -> Result<Placement> {
        let what = "the placed trees of a scene";
        let mut memory = scene.context().residency().keep(what, self.bytes)?;
        let mut hits: Vec<DBounds> = room(self.count, what)?;
        let (mut singles, mut firsts) = (room(self.singles, what)?, room(instances.len(), what)?);
        let (mut around, mut position_error) = (DBounds::EMPTY, 0.0f64);
        let mut add = |placed: &Placed, hits: &mut Vec<DBounds>| {
            hits.push(placed.hit_bounds(&models[placed.model as usize].trees()[placed.tree as usize]));
            around = around.union(placed.bounds);
            position_error = position_error.max(placed.position_error);
        };
        for (i, (draftee, instance)) in draft.draftees().zip(instances).enumerate() {
            firsts.push(singles.len() as u32);
            for (tree, first_part, model_from_mesh) in draftee.model.placements() {
                let ids = PlacedIds { model: instance.model, tree, instance: i as u32, first_part };
                let stored = &draftee.model.trees()[tree as usize];
                let placed = Placed::new(stored, ids, &(draftee.world_from_model * model_from_mesh));
                add(&placed, &mut hits);
                singles.push(placed);
            }
        }
        let mut placement = Placement { count: self.count as u32, singles, firsts, ..Placement::default() };
        for (it, of) in draft.arrays.iter().zip(models_of) {
            let first_instance = placement.instance_count() as u32;
            let array = placed_array(it, &of, [hits.len() as u32, first_instance])?;
            for number in array.first..array.first + array.measures.len() as u32 {
                add(&array.placed(number, models), &mut hits);
            }
            placement.arrays.push(array);
        }
        placement.top = TopTree::build(&hits)?;
        drop(hits);
        // The boxes are needed for the tree only.
        memory.shrink_to(self.bytes - (self.count * size_of::<DBounds>()) as u64);
        (placement.bounds, placement.position_error, placement._memory) = (around, position_error, memory);
        Ok(placement)
    }
}

/// The placed trees of an array. `models`: the indices of its models; `first`: the numbers of its first tree and
/// instance.
fn placed_array(it: &DraftArray, models: &[u32], [first, first_instance]: [u32; 2]) -> Result<PlacedArray> {
    let what = "the placed trees of a scene";
    let prototype = |(&model, it): (&u32, &Model)| Prototype { model, places: it.placements().collect() };
    let prototypes: Vec<Prototype> = models.iter().zip(&it.models).map(prototype).collect();
    let array = Arc::clone(&it.array);
    let (mut starts, mut count) = (Vec::new(), array.len() as usize);
    if !it.has_one_each() {
        starts = room(array.len() as usize + 1, what)?;
        count = 0;
        for at in array.models() {
            starts.push(count as u32);
            count += prototypes[at].places.len();
        }
        starts.push(count as u32);
    }
    let mut measures = room(count, what)?;
    for (member, at) in (0..).zip(array.models()) {
        let world_from_model = array.transform(member);
        for (.., model_from_mesh) in &prototypes[at].places {
            measures.push(Measures::of(&(world_from_model * *model_from_mesh).matrix3));
        }
    }
    Ok(PlacedArray { array, first, first_instance, prototypes, starts, measures })
}
