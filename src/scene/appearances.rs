//! What the members of a top tree look like as a whole: trees of models, and scenes. The cells of the tree are made of
//! that (`structure::Members::build_described`).

use super::inner::Prototype as ScenePrototype;
use super::measures::Measures;
use super::model::Model;
use super::placement::{Member, PlacedArray, Placement, Prototype};
use super::state::SceneState;
use crate::residency::Kept;
use crate::structure::{Appearance, MemberChild, MemberLook, Visit};
use glam::{DAffine3, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// A tree of a model, and the colours of the parts that cover most of the children of its root: placements of a shared
/// mesh differ in colours.
type Key = (u32, [[u32; 3]; 8]);

/// The appearances of a model's trees, once they were needed.
#[derive(Default)]
pub(super) struct Appearances {
    known: HashMap<Key, Option<Arc<Appearance>>>,
    bytes: u64,
    /// True if there was no memory for one: no other is computed in this commit.
    is_full: bool,
    memory: Kept,
}

impl Model {
    /// What a tree looks like where its local part 0 is the model's part `first_part`. `None` if it is see-through, its
    /// root is not in memory, or there is no memory for the answer.
    pub(super) fn appearance(&self, tree: u32, first_part: u32) -> Option<Arc<Appearance>> {
        if self.see_through() {
            return None;
        }
        let parts = self.parts();
        let colour = |part: u32| {
            let [r, g, b, _] = parts.get(first_part.saturating_add(part) as usize).map_or([0.6; 4], |it| it.colour);
            Vec3::new(r, g, b)
        };
        // The charge for the answer may have to wait until blocks are free: the snapshot is gone then.
        let (key, new) = {
            let snapshot = self.blocks().snapshot();
            let view = self.tree_in(tree, &snapshot, Visit::default());
            let roots = view.root_parts()?;
            let key = (tree, roots.map(|it| it.map_or([0; 3], |(part, _)| colour(part).to_array().map(f32::to_bits))));
            let all = self.appearances();
            if all.is_full {
                return None;
            }
            if let Some(known) = all.known.get(&key) {
                return known.clone();
            }
            drop(all);
            (key, view.appearance(&colour).map(Arc::new))
        };
        let mut all = self.appearances();
        let bytes = all.bytes + (2 * size_of::<(Key, usize)>()) as u64 + new.as_ref().map_or(0, |it| it.bytes());
        if all.memory.grow_to(self.context().residency(), "the looks of trees as a whole", bytes).is_err() {
            all.is_full = true;
            return None;
        }
        all.bytes = bytes;
        all.known.entry(key).or_insert(new).clone()
    }

    /// Tries again to find memory for appearances, if there was none.
    pub(super) fn retry_appearances(&self) {
        self.appearances().is_full = false;
    }
}

/// An appearance, and the map from its frame to the scene.
type Placed = (Arc<Appearance>, DAffine3);

impl SceneState {
    /// What all of it looks like; `None` if that is not known, or some of it has a look of its own.
    pub(super) fn appearance(&self) -> Option<Placed> {
        let top = self.top();
        if !self.groups.stand_in && top.count() > 1 {
            return None;
        }
        match top.root()? {
            MemberChild::Node(_) => top.appearance(),
            // An appearance has no tint.
            MemberChild::Member(member) => match self.placement.member(member) {
                it if self.placement.tint_in_cells(&it) != Some(Vec3::ONE) => None,
                Member::Placed(number) => {
                    let (stand, number) = (self.stand(number.into()), u64::from(number));
                    let placed = self.placed(number);
                    let model = &self.models[stand.ids.model as usize];
                    let look = || model.appearance(stand.ids.tree, stand.ids.first_part);
                    stand.is_plain().then(look).flatten().map(|it| (it, placed.frame()))
                }
                Member::Scene(it) => {
                    let is_plain = std::ptr::eq(self.states.in_scene(&self.placement, &it), &*it.scene.states)
                        && !self.states.has_occurrence_of(&it);
                    let inner = is_plain.then(|| it.scene.appearance()).flatten();
                    inner.map(|(look, map)| (look, it.world_from_scene() * map))
                }
            },
        }
    }
}

/// The looks of the members of a placement, while the tree over them is built.
pub(super) struct MemberLooks<'a> {
    placement: &'a Placement,
    models: &'a [Model],
    /// Of each placed tree of single instances.
    singles: Vec<Option<Arc<Appearance>>>,
    /// For each array and prototype, of each of its trees.
    arrays: Vec<Vec<Vec<Option<Arc<Appearance>>>>>,
    scenes: HashMap<*const SceneState, Option<Placed>>,
}

impl<'a> MemberLooks<'a> {
    pub fn of(placement: &'a Placement, models: &'a [Model]) -> Self {
        models.iter().for_each(Model::retry_appearances);
        // Single instances of a model often follow each other.
        let mut last = None;
        let mut of_tree = |model: u32, tree: u32, first_part: u32| {
            let key = (model, tree, first_part);
            match &last {
                Some((of, look)) if *of == key => Option::clone(look),
                _ => {
                    let look = models[model as usize].appearance(tree, first_part);
                    last = Some((key, look.clone()));
                    look
                }
            }
        };
        let singles = placement.singles.iter().map(|it| of_tree(it.model, it.tree, it.first_part)).collect();
        let mut of_array = |it: &PlacedArray| {
            let mut of_prototype = |it: &Prototype| {
                it.places.iter().map(|&(tree, first_part, _)| of_tree(it.model, tree, first_part)).collect()
            };
            it.prototypes.iter().map(&mut of_prototype).collect()
        };
        let arrays = placement.arrays.iter().map(&mut of_array).collect();
        let of_arrays = placement.scene_arrays.iter().flat_map(|it| it.prototypes.iter());
        let prototypes = placement.scenes.iter().map(|it| &it.of).chain(of_arrays);
        let mut scenes: HashMap<_, _> = HashMap::new();
        prototypes.for_each(|ScenePrototype { scene, .. }| {
            scenes.entry(Arc::as_ptr(scene)).or_insert_with(|| scene.appearance());
        });
        Self { placement, models, singles, arrays, scenes }
    }

    /// Those of [`Placement::inner_scenes`].
    pub fn of_scenes(&self) -> Vec<Option<Arc<Appearance>>> {
        let of = |it: &Arc<SceneState>| self.scenes.get(&Arc::as_ptr(it))?.as_ref().map(|it| Arc::clone(&it.0));
        self.placement.inner_scenes().map(of).collect()
    }

    /// That of a member, in the scene.
    pub fn look(&self, member: u32) -> Option<MemberLook<'_>> {
        let member = self.placement.member(member);
        let tint = self.placement.tint_in_cells(&member)?;
        match member {
            Member::Placed(number) => {
                if let Some(placed) = self.placement.single(number.into()) {
                    let appearance = self.singles[number as usize].as_ref()?;
                    return Some(MemberLook { appearance, map: placed.frame(), stretch: placed.stretch, tint });
                }
                let at = self.placement.arrays.partition_point(|array| array.first <= number) - 1;
                let (array, of) = (&self.placement.arrays[at], &self.arrays[at]);
                let (prototype, nth) = array.prototype_and_tree(number);
                let appearance = of[prototype as usize][nth as usize].as_ref()?;
                let placed = array.placed(number, self.models);
                Some(MemberLook { appearance, map: placed.frame(), stretch: placed.stretch, tint })
            }
            Member::Scene(it) => {
                let (appearance, map) = self.scenes.get(&std::ptr::from_ref(it.scene))?.as_ref()?;
                let map = it.world_from_scene() * *map;
                Some(MemberLook { appearance, map, stretch: Measures::of(&map.matrix3).stretch, tint })
            }
        }
    }
}
