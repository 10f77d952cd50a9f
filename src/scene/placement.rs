//! The placement of all trees of a scene. Single instances have their placed trees stored. Those of arrays are made
//! from the arrays' transforms when they are asked for.

use super::array::Array;
use super::model::Model;
use super::placed::{Measures, Placed};
use super::top::TopTree;
use crate::math::DBounds;
use crate::residency::Kept;
use glam::DAffine3;
use std::sync::Arc;

/// The placed trees of a scene, by number: those of single instances in the order added, each with its trees in the
/// model's own order; then those of arrays, member by member. States that differ only in looks share it.
pub(crate) struct Placement {
    /// Those of single instances.
    pub(super) singles: Vec<Placed>,
    /// Number of the first placed tree of each single instance.
    pub(super) firsts: Vec<u32>,
    pub(super) arrays: Vec<PlacedArray>,
    /// Number of all placed trees.
    pub(super) count: u32,
    /// The top tree over the boxes of all that rays may hit.
    pub top: TopTree,
    /// Bounds of all triangles.
    pub bounds: DBounds,
    /// Greatest distance of stored vertices from those of the input, in the world.
    pub position_error: f64,
    pub(super) _memory: Kept,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            singles: Vec::new(),
            firsts: Vec::new(),
            arrays: Vec::new(),
            count: 0,
            top: TopTree::default(),
            bounds: DBounds::EMPTY,
            position_error: 0.0,
            _memory: Kept::default(),
        }
    }
}

/// The placed trees of an array of instances.
pub(super) struct PlacedArray {
    pub array: Arc<Array>,
    /// The number of its first placed tree.
    pub first: u32,
    /// The number of its first instance.
    pub first_instance: u32,
    pub prototypes: Vec<Prototype>,
    /// The placed trees before each member, from `first` on. Empty if each member has one.
    pub starts: Vec<u32>,
    /// Of each placed tree.
    pub measures: Vec<Measures>,
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

    #[inline]
    fn prototype(&self, member: u32) -> &Prototype {
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
        Placed::measured(stored, ids, &world_from_mesh, self.measures[(number - self.first) as usize])
    }
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
    /// The array that holds a placed tree which is not of a single instance.
    #[inline]
    fn array_of(&self, number: u32) -> &PlacedArray {
        let after = self.arrays.partition_point(|array| array.first <= number);
        &self.arrays[after - 1]
    }

    /// The placed tree of a single instance; `None`: it is an array's.
    #[inline(always)]
    pub(super) fn single(&self, number: u32) -> Option<&Placed> {
        self.singles.get(number as usize)
    }

    /// A placed tree of an array; `models`: those of the scene.
    #[inline(never)]
    pub(super) fn made(&self, number: u32, models: &[Model]) -> Placed {
        self.array_of(number).placed(number, models)
    }

    /// See [`PlacedIds`].
    #[inline(always)]
    pub fn ids_of(&self, number: u32) -> PlacedIds {
        if let Some(placed) = self.singles.get(number as usize) {
            return **placed;
        }
        self.array_of(number).ids_of(number)
    }

    /// The index of a placed tree among those of its instance.
    pub(super) fn index_in_instance(&self, number: u32) -> u32 {
        match self.single(number) {
            Some(placed) => number - self.firsts[placed.instance as usize],
            None => self.array_of(number).of(number).nth,
        }
    }

    /// The array of an instance that is not a single one, and its member.
    pub(super) fn member_of(&self, instance: u32) -> (usize, u32) {
        let after = self.arrays.partition_point(|array| array.first_instance <= instance);
        (after - 1, instance - self.arrays[after - 1].first_instance)
    }

    /// The caller's id of an instance of an array.
    pub(super) fn id_of_member(&self, instance: u32) -> u64 {
        let (array, member) = self.member_of(instance);
        self.arrays[array].array.first_id + u64::from(member)
    }

    /// The index of the model of an instance of an array.
    pub(super) fn model_of_member(&self, instance: u32) -> u32 {
        let (array, member) = self.member_of(instance);
        self.arrays[array].prototype(member).model
    }

    /// The map to the world of an instance of an array.
    pub(super) fn transform_of_member(&self, instance: u32) -> DAffine3 {
        let (array, member) = self.member_of(instance);
        self.arrays[array].array.transform(member)
    }

    /// The number of the instance with an id, if it is of an array.
    pub(super) fn member_with(&self, id: u64) -> Option<u32> {
        self.arrays.iter().find_map(|it| it.array.member(id).map(|member| it.first_instance + member))
    }

    /// Number of all instances.
    pub fn instance_count(&self) -> usize {
        self.arrays.last().map_or(self.firsts.len(), |it| (it.first_instance + it.array.len()) as usize)
    }

    /// Number of all placed trees.
    pub fn len(&self) -> usize {
        self.count as usize
    }
}
