//! The placement of all trees of a scene. Single instances have their placed trees stored. Those of arrays are made
//! from the arrays' transforms when they are asked for, and those of scenes in it from the placements there: a scene
//! takes the same memory in each place, however much is in it.

use super::array::Array;
use super::inner::{Counts, Inner, InnerKey, PlacedScene, PlacedSceneArray};
use super::measures::{Factors, Measures};
use super::model::Model;
use super::placed::Placed;
use super::state::{SceneState, at};
use super::top::TopTree;
use crate::math::DBounds;
use crate::residency::Kept;
use crate::structure::Appearance;
use glam::DAffine3;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// The placed trees of a scene, by number: those of single instances in the order added, each with its trees in the
/// model's own order; then those of arrays, member by member; then those of scenes in this one, in their
/// own order. States that differ only in looks share it.
///
/// The members of the top tree are the placed trees of single instances and of arrays, by the same numbers, then the
/// scenes in this one, and then the members of arrays of scenes.
#[derive(Clone)]
pub(crate) struct Placement {
    /// Those of single instances.
    pub(super) singles: Arc<Vec<Placed>>,
    /// Number of the first placed tree of each single instance.
    pub(super) firsts: Arc<Vec<u32>>,
    pub(super) arrays: Vec<PlacedArray>,
    pub(super) scenes: Arc<Vec<PlacedScene>>,
    pub(super) scene_arrays: Arc<Vec<PlacedSceneArray>>,
    /// Number of the placed trees of single instances and of arrays.
    pub(super) own: u32,
    /// Numbers of all placed trees and instances.
    pub(super) count: Counts,
    /// The top tree over the boxes of all that rays may hit. Placements that differ only in the states of scenes in
    /// them share it.
    pub top: Arc<TopTree>,
    /// What each of [`Placement::inner_scenes`] looked like when the top tree was built.
    pub(super) looked: Arc<Vec<Option<Arc<Appearance>>>>,
    /// Bounds of all triangles, unless they are still to be computed.
    pub(super) bounds: OnceLock<DBounds>,
    /// Greatest distance of stored vertices from those of the input, in the world, or more.
    pub position_error: f64,
    /// Of all maps to placed trees, once they are known.
    pub(super) factors: OnceLock<Factors>,
    /// That of the last placement of all, which placements after moves share.
    pub(super) memory: Arc<Kept>,
    pub(super) changed: Arc<Kept>,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            singles: Arc::default(),
            firsts: Arc::default(),
            arrays: Vec::new(),
            scenes: Arc::default(),
            scene_arrays: Arc::default(),
            own: 0,
            count: Counts::default(),
            top: Arc::default(),
            looked: Arc::default(),
            bounds: OnceLock::new(),
            position_error: 0.0,
            factors: OnceLock::new(),
            memory: Arc::default(),
            changed: Arc::default(),
        }
    }
}

/// The placed trees of an array of instances.
#[derive(Clone)]
pub(super) struct PlacedArray {
    pub array: Arc<Array>,
    /// The number of its first placed tree.
    pub first: u32,
    /// The number of its first instance.
    pub first_instance: u32,
    pub prototypes: Arc<[Prototype]>,
    /// The placed trees before each member, from `first` on. Empty if each member has one.
    pub starts: Arc<Vec<u32>>,
    /// Of each placed tree; empty if all maps change all lengths alike.
    pub measures: Arc<Vec<Measures>>,
}

/// A placed tree before its frame is computed.
#[derive(Clone, Copy)]
pub(super) struct PlacedMesh {
    pub ids: PlacedIds,
    pub world_from_mesh: DAffine3,
    /// Those of the map, if they are stored.
    pub measures: Option<Measures>,
}

impl PlacedMesh {
    /// The placed tree; `models`: those of the scene.
    pub fn placed(self, models: &[Model]) -> Placed {
        let Self { ids, world_from_mesh, measures } = self;
        let stored = &models[ids.model as usize].trees()[ids.tree as usize];
        let measures = measures.unwrap_or_else(|| Measures::of(&world_from_mesh.matrix3));
        Placed::measured(stored, ids, &world_from_mesh, measures)
    }
}

/// A model of an array.
pub(super) struct Prototype {
    /// Its index among the models of the scene.
    pub model: u32,
    /// Its placements: tree, first part, and the map from the mesh to the model.
    pub places: Vec<(u32, u32, DAffine3)>,
}

impl Prototype {
    /// Bytes of memory.
    pub fn bytes(model: &Model) -> u64 {
        (model.placements().count() * size_of::<(u32, u32, DAffine3)>()) as u64
    }
}

/// A placed tree of an array: the member, and the index of the tree among those of the member.
#[derive(Clone, Copy)]
struct Of {
    member: u32,
    nth: u32,
}

impl PlacedArray {
    #[inline]
    fn of(&self, number: u32) -> Of {
        let at = number - self.first;
        if self.starts.is_empty() {
            return Of { member: at, nth: 0 };
        }
        let member = self.starts.partition_point(|&start| start <= at) as u32 - 1;
        Of { member, nth: at - self.starts[member as usize] }
    }

    /// The member that a placed tree is of.
    pub fn member_of(&self, number: u32) -> u32 {
        self.of(number).member
    }

    /// The prototype of a placed tree, and the index of the tree there.
    pub fn prototype_and_tree(&self, number: u32) -> (u32, u32) {
        let Of { member, nth } = self.of(number);
        (self.array.prototype_of(member), nth)
    }

    /// The map from the mesh of a placed tree to its model.
    pub fn place_of(&self, number: u32) -> DAffine3 {
        let Of { member, nth } = self.of(number);
        self.prototype(member).places[nth as usize].2
    }

    /// The numbers of the placed trees of a member.
    pub fn numbers_of(&self, member: u32) -> Range<u32> {
        let at = |member: u32| match self.starts.get(member as usize) {
            Some(start) => self.first + start,
            None => self.first + member,
        };
        at(member)..at(member + 1)
    }

    #[inline]
    pub fn prototype(&self, member: u32) -> &Prototype {
        &self.prototypes[self.array.prototype_of(member) as usize]
    }

    #[inline]
    pub fn ids_of(&self, number: u32) -> PlacedIds {
        let Of { member, nth } = self.of(number);
        let prototype = self.prototype(member);
        let (tree, first_part, _) = prototype.places[nth as usize];
        PlacedIds { model: prototype.model, tree, instance: u64::from(self.first_instance + member), first_part }
    }

    pub(super) fn mesh(&self, number: u32) -> PlacedMesh {
        let Of { member, nth } = self.of(number);
        let prototype = self.prototype(member);
        let (tree, first_part, model_from_mesh) = prototype.places[nth as usize];
        let instance = u64::from(self.first_instance + member);
        let ids = PlacedIds { model: prototype.model, tree, instance, first_part };
        let world_from_mesh = self.array.transform(member) * model_from_mesh;
        let measures = self.measures.get((number - self.first) as usize).copied();
        PlacedMesh { ids, world_from_mesh, measures }
    }

    /// A placed tree; `models`: those of the scene.
    pub fn placed(&self, number: u32, models: &[Model]) -> Placed {
        self.mesh(number).placed(models)
    }
}

/// See [`Placed::hit_bounds`]; `models`: those of the scene.
pub(super) fn hit_bounds(placed: &Placed, models: &[Model]) -> DBounds {
    placed.hit_bounds(&models[placed.model as usize].trees()[placed.tree as usize])
}

/// A member of a top tree.
pub(super) enum Member<'a> {
    /// A placed tree, by its number.
    Placed(u32),
    Scene(Inner<'a>),
}

/// The array or scene that holds placed trees which are not of single instances.
#[derive(Clone, Copy)]
pub(super) enum Holder<'a> {
    Array(&'a PlacedArray),
    Scene(Inner<'a>),
}

/// The tree, model, instance and parts of a placed tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct PlacedIds {
    /// Index of the model in the scene.
    pub model: u32,
    /// Index of the tree in the model.
    pub tree: u32,
    /// Number of the instance.
    pub instance: u64,
    /// The model's part that is the tree's local part 0 here.
    pub first_part: u32,
}

impl Placement {
    /// The array or scene that holds a placed tree which is not of a single instance.
    #[inline]
    pub(super) fn holder_of(&self, number: u64) -> Holder<'_> {
        if number >= u64::from(self.own) {
            return Holder::Scene(self.scene_with(number));
        }
        let after = self.arrays.partition_point(|array| u64::from(array.first) <= number);
        Holder::Array(&self.arrays[after - 1])
    }

    /// The scene that holds a placed tree which is of no instance of this scene's own.
    #[inline]
    pub(super) fn scene_with(&self, number: u64) -> Inner<'_> {
        self.scene_of(number, |it| it.placed)
    }

    /// The scene that holds the placed tree or the instance with a number, as `of` chooses.
    fn scene_of(&self, number: u64, of: fn(&Counts) -> u64) -> Inner<'_> {
        // What has nothing in it begins where the next one does.
        if let Some(at) = self.scene_arrays.partition_point(|it| of(&it.first) <= number).checked_sub(1) {
            let array = &self.scene_arrays[at];
            return array.inner(at, array.with(number, of));
        }
        let at = self.scenes.partition_point(|it| of(&it.first) <= number) - 1;
        self.scenes[at].inner(at)
    }

    /// True if there is nothing but single instances and arrays of models.
    pub(super) fn has_no_scenes(&self) -> bool {
        self.scenes.is_empty() && self.scene_arrays.is_empty()
    }

    /// The arrays of models, then those of scenes.
    pub(super) fn own_arrays(&self) -> impl Iterator<Item = &Array> {
        self.arrays.iter().map(|it| &*it.array).chain(self.scene_arrays.iter().map(|it| &*it.array))
    }

    /// The single scenes in this one, then the prototypes of arrays.
    pub(super) fn inner_scenes(&self) -> impl Iterator<Item = &Arc<SceneState>> {
        let of_arrays = self.scene_arrays.iter().flat_map(|it| it.prototypes.iter());
        self.scenes.iter().map(|it| &it.of).chain(of_arrays).map(|it| &it.scene)
    }

    /// All scenes in this one, where they stand.
    pub(super) fn inners(&self) -> impl Iterator<Item = Inner<'_>> {
        let arrays = self.scene_arrays.iter().enumerate();
        let of_arrays = arrays.flat_map(|(at, it)| (0..it.array.len()).map(move |member| it.inner(at, member)));
        self.scenes.iter().enumerate().map(|(at, it)| it.inner(at)).chain(of_arrays)
    }

    /// A member of the top tree.
    #[inline]
    pub(super) fn member(&self, member: u32) -> Member<'_> {
        match member.checked_sub(self.own) {
            None => Member::Placed(member),
            Some(at) => Member::Scene(self.inner_at(member, at as usize)),
        }
    }

    /// The member that a scene in this one is.
    pub(super) fn member_of(&self, it: &Inner) -> u32 {
        match it.key {
            InnerKey::Single(at) => self.own + at as u32,
            InnerKey::Member(at, member) => self.scene_arrays[at].first_member + member,
        }
    }

    /// A scene by its member; `at`: its index among the scenes.
    fn inner_at(&self, member: u32, at: usize) -> Inner<'_> {
        if let Some(it) = self.scenes.get(at) {
            return it.inner(at);
        }
        let at = self.scene_arrays.partition_point(|it| it.first_member <= member) - 1;
        self.scene_arrays[at].inner(at, member - self.scene_arrays[at].first_member)
    }

    /// The placed tree of a single instance; `None`: it is of another.
    #[inline(always)]
    pub(super) fn single(&self, number: u64) -> Option<&Placed> {
        at(&self.singles, number)
    }

    /// A placed tree that is not of a single instance; `models`: those of the scene.
    #[inline(never)]
    pub(super) fn made(&self, number: u64, models: &[Model]) -> Placed {
        self.mesh(number).placed(models)
    }

    fn mesh(&self, number: u64) -> PlacedMesh {
        if let Some(placed) = self.single(number) {
            return PlacedMesh { ids: **placed, world_from_mesh: placed.world_from_mesh(), measures: None };
        }
        match self.holder_of(number) {
            Holder::Array(array) => array.mesh(number as u32),
            Holder::Scene(it) => {
                let inner = it.scene.placement.mesh(number - it.first);
                let world_from_mesh = it.world_from_scene() * inner.world_from_mesh;
                PlacedMesh { ids: it.outer(inner.ids), world_from_mesh, measures: None }
            }
        }
    }

    /// See [`PlacedIds`].
    #[inline(always)]
    pub fn ids_of(&self, number: u64) -> PlacedIds {
        match self.single(number) {
            Some(placed) => **placed,
            None => self.ids_of_other(number),
        }
    }

    #[inline(never)]
    fn ids_of_other(&self, number: u64) -> PlacedIds {
        match self.holder_of(number) {
            Holder::Array(array) => array.ids_of(number as u32),
            Holder::Scene(it) => it.outer(it.scene.placement.ids_of(number - it.first)),
        }
    }

    /// The index of a placed tree among those of its instance.
    pub(super) fn index_in_instance(&self, number: u64) -> u32 {
        match self.single(number) {
            Some(placed) => number as u32 - self.firsts[placed.instance as usize],
            None => match self.holder_of(number) {
                Holder::Array(array) => array.of(number as u32).nth,
                Holder::Scene(it) => it.scene.placement.index_in_instance(number - it.first),
            },
        }
    }

    /// The array or the scene of an instance that is not a single one, and the number of the instance there.
    pub(super) fn holder_of_instance(&self, instance: u64) -> (Holder<'_>, u64) {
        if instance >= self.own_instances() {
            let it = self.scene_of(instance, |it| it.instances);
            return (Holder::Scene(it), instance - it.first_instance);
        }
        let array = &self.arrays[self.array_with(instance)];
        (Holder::Array(array), instance - u64::from(array.first_instance))
    }

    /// The index of the array that has an instance.
    pub(super) fn array_with(&self, instance: u64) -> usize {
        self.arrays.partition_point(|it| u64::from(it.first_instance) <= instance) - 1
    }

    /// The numbers of the instances with an id, if they are of an array.
    pub(super) fn members_with(&self, id: u64) -> Option<Range<u64>> {
        let of_array = |it: &PlacedArray| {
            let member = u64::from(it.first_instance + it.array.member(id)?);
            Some(member..member + 1)
        };
        let of_scenes = |(at, it): (usize, &PlacedSceneArray)| {
            let inner = it.inner(at, it.array.member(id)?);
            Some(inner.first_instance..inner.first_instance + inner.scene.placement.instance_count())
        };
        let in_scenes = || self.scene_arrays.iter().enumerate().find_map(of_scenes);
        self.arrays.iter().find_map(of_array).or_else(in_scenes)
    }

    /// Number of the instances that are of no scene in this one.
    pub(super) fn own_instances(&self) -> u64 {
        self.arrays.last().map_or(self.firsts.len() as u64, |it| u64::from(it.first_instance + it.array.len()))
    }

    /// Number of all instances.
    pub fn instance_count(&self) -> u64 {
        self.count.instances
    }

    /// Those of all maps to placed trees, or wider.
    pub(super) fn factors(&self) -> Factors {
        let all = || {
            let of_own = |number| Factors::of(&self.mesh(number).world_from_mesh.matrix3);
            let own = (0..u64::from(self.own)).map(of_own).fold(Factors::NONE, Factors::union);
            self.inners().map(|it| it.factors()).fold(own, Factors::union)
        };
        *self.factors.get_or_init(all)
    }

    /// Number of all placed trees.
    pub fn len(&self) -> u64 {
        self.count.placed
    }
}
