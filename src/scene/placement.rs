//! The placement of all trees of a scene. Single instances have their placed trees stored. Those of arrays are made
//! from the arrays' transforms when they are asked for, and those of scenes in it from the placed trees there.

use super::array::Array;
use super::measures::Measures;
use super::model::Model;
use super::placed::Placed;
use super::state::SceneState;
use super::top::TopTree;
use crate::math::DBounds;
use crate::residency::Kept;
use glam::{DAffine3, DMat3};
use std::sync::{Arc, OnceLock};

/// The placed trees of a scene, by number: those of single instances in the order added, each with its trees in the
/// model's own order; then those of arrays, member by member; then those of scenes in this one, in their
/// own order. States that differ only in looks share it.
pub(crate) struct Placement {
    /// Those of single instances.
    pub(super) singles: Arc<Vec<Placed>>,
    /// Number of the first placed tree of each single instance.
    pub(super) firsts: Arc<Vec<u32>>,
    pub(super) arrays: Vec<PlacedArray>,
    pub(super) scenes: Arc<Vec<PlacedScene>>,
    /// Number of all placed trees.
    pub(super) count: u32,
    /// The top tree over the boxes of all that rays may hit.
    pub top: TopTree,
    /// Bounds of all triangles, unless they must be computed anew since something has moved.
    pub(super) bounds: OnceLock<DBounds>,
    /// Greatest distance of stored vertices from those of the input, in the world, or more.
    pub position_error: f64,
    /// That of the last placement of all, which placements after moves share.
    pub(super) memory: Arc<Kept>,
    pub(super) _changed: Kept,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            singles: Arc::default(),
            firsts: Arc::default(),
            arrays: Vec::new(),
            scenes: Arc::default(),
            count: 0,
            top: TopTree::default(),
            bounds: OnceLock::new(),
            position_error: 0.0,
            memory: Arc::default(),
            _changed: Kept::default(),
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

/// The placed trees of a scene in another.
pub(super) struct PlacedScene {
    /// The caller's id.
    pub id: u64,
    /// The number of its first placed tree.
    pub first: u32,
    /// The number of its first instance.
    pub first_instance: u32,
    /// As it was at the commit.
    pub scene: Arc<SceneState>,
    pub world_from_scene: DAffine3,
    /// The index, in the outer scene, of each of its models.
    pub models: Vec<u32>,
    /// Of each placed tree; empty if all maps change all lengths alike.
    pub measures: Vec<Measures>,
}

/// The measures of placed tree `at` of an array or a scene.
#[inline]
fn measures(stored: &[Measures], at: u32, linear: &DMat3) -> Measures {
    stored.get(at as usize).copied().unwrap_or_else(|| Measures::of(linear))
}

impl PlacedScene {
    /// A placed tree.
    pub fn placed(&self, number: u32) -> Placed {
        let inner = self.scene.placed(number - self.first);
        let stored = &self.scene.models[inner.model as usize].trees()[inner.tree as usize];
        let world_from_mesh = self.world_from_scene * inner.world_from_mesh();
        let measures = measures(&self.measures, number - self.first, &world_from_mesh.matrix3);
        Placed::measured(stored, self.outer(**inner), &world_from_mesh, measures)
    }

    fn ids_of(&self, number: u32) -> PlacedIds {
        self.outer(self.scene.ids_of(number - self.first))
    }

    fn outer(&self, inner: PlacedIds) -> PlacedIds {
        let (model, instance) = (self.models[inner.model as usize], self.first_instance + inner.instance);
        PlacedIds { model, instance, ..inner }
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

    /// The map from the mesh of a placed tree to its model.
    pub fn place_of(&self, number: u32) -> DAffine3 {
        let Of { member, nth } = self.of(number);
        self.prototype(member).places[nth as usize].2
    }

    /// The numbers of the placed trees of a member.
    pub fn numbers_of(&self, member: u32) -> std::ops::Range<u32> {
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
    fn ids_of(&self, number: u32) -> PlacedIds {
        let Of { member, nth } = self.of(number);
        let prototype = self.prototype(member);
        let (tree, first_part, _) = prototype.places[nth as usize];
        PlacedIds { model: prototype.model, tree, instance: self.first_instance + member, first_part }
    }

    /// A placed tree; `models`: those of the scene.
    pub fn placed(&self, number: u32, models: &[Model]) -> Placed {
        let Of { member, nth } = self.of(number);
        let prototype = self.prototype(member);
        let (tree, first_part, model_from_mesh) = prototype.places[nth as usize];
        let ids = PlacedIds { model: prototype.model, tree, instance: self.first_instance + member, first_part };
        let stored = &models[prototype.model as usize].trees()[tree as usize];
        let world_from_mesh = self.array.transform(member) * model_from_mesh;
        let measures = measures(&self.measures, number - self.first, &world_from_mesh.matrix3);
        Placed::measured(stored, ids, &world_from_mesh, measures)
    }
}

/// See [`Placed::hit_bounds`]; `models`: those of the scene.
pub(super) fn hit_bounds(placed: &Placed, models: &[Model]) -> DBounds {
    placed.hit_bounds(&models[placed.model as usize].trees()[placed.tree as usize])
}

/// What holds placed trees that are not of single instances.
#[derive(Clone, Copy)]
pub(super) enum Holder<'a> {
    Array(&'a PlacedArray),
    Scene(&'a PlacedScene),
}

/// The tree, model, instance and parts of a placed tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct PlacedIds {
    /// Index of the model in the scene.
    pub model: u32,
    /// Index of the tree in the model.
    pub tree: u32,
    /// Number of the instance.
    pub instance: u32,
    /// The model's part that is the tree's local part 0 here.
    pub first_part: u32,
}

impl Placement {
    /// The array or scene that holds a placed tree which is not of a single instance.
    #[inline]
    fn holder_of(&self, number: u32) -> Holder<'_> {
        if let Some(after) = self.scenes.partition_point(|it| it.first <= number).checked_sub(1) {
            return Holder::Scene(&self.scenes[after]);
        }
        let after = self.arrays.partition_point(|array| array.first <= number);
        Holder::Array(&self.arrays[after - 1])
    }

    /// The placed tree of a single instance; `None`: it is an array's.
    #[inline(always)]
    pub(super) fn single(&self, number: u32) -> Option<&Placed> {
        self.singles.get(number as usize)
    }

    /// A placed tree that is not of a single instance; `models`: those of the scene.
    #[inline(never)]
    pub(super) fn made(&self, number: u32, models: &[Model]) -> Placed {
        match self.holder_of(number) {
            Holder::Array(array) => array.placed(number, models),
            Holder::Scene(scene) => scene.placed(number),
        }
    }

    /// See [`PlacedIds`].
    #[inline(always)]
    pub fn ids_of(&self, number: u32) -> PlacedIds {
        if let Some(placed) = self.singles.get(number as usize) {
            return **placed;
        }
        match self.holder_of(number) {
            Holder::Array(array) => array.ids_of(number),
            Holder::Scene(scene) => scene.ids_of(number),
        }
    }

    /// The index of a placed tree among those of its instance.
    pub(super) fn index_in_instance(&self, number: u32) -> u32 {
        match self.single(number) {
            Some(placed) => number - self.firsts[placed.instance as usize],
            None => match self.holder_of(number) {
                Holder::Array(array) => array.of(number).nth,
                Holder::Scene(it) => it.scene.placement.index_in_instance(number - it.first),
            },
        }
    }

    /// The array or the scene of an instance that is not a single one, its index, and the number of the instance there.
    pub(super) fn holder_of_instance(&self, instance: u32) -> (Holder<'_>, usize, u32) {
        if let Some(at) = self.scenes.partition_point(|it| it.first_instance <= instance).checked_sub(1) {
            return (Holder::Scene(&self.scenes[at]), at, instance - self.scenes[at].first_instance);
        }
        let at = self.arrays.partition_point(|it| it.first_instance <= instance) - 1;
        (Holder::Array(&self.arrays[at]), at, instance - self.arrays[at].first_instance)
    }

    /// The number of the instance with an id, if it is of an array.
    pub(super) fn member_with(&self, id: u64) -> Option<u32> {
        self.arrays.iter().find_map(|it| it.array.member(id).map(|member| it.first_instance + member))
    }

    /// Number of all instances.
    pub fn instance_count(&self) -> usize {
        if let Some(it) = self.scenes.last() {
            return it.first_instance as usize + it.scene.instance_count();
        }
        self.arrays.last().map_or(self.firsts.len(), |it| (it.first_instance + it.array.len()) as usize)
    }

    /// Number of all placed trees.
    pub fn len(&self) -> usize {
        self.count as usize
    }
}
