//! The committed, immutable state of a scene, which jobs read.

use super::context::Context;
use super::light::{Background, Light};
use super::looks::{Look, PartsShown};
use super::model::Model;
use super::placed::Placed;
use super::placement::{PlacedIds, Placement};
use crate::math::DBounds;
use crate::residency::Kept;
use crate::structure::ShownBlocks;
use glam::DAffine3;
use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

/// The state of an instance as it was at the commit.
#[derive(Clone)]
pub(crate) struct InstanceState {
    pub mask: u32,
    pub look: Look,
    /// The looks of its parts.
    pub parts: Arc<PartsShown>,
}

/// A single instance as it was at the commit.
#[derive(Clone)]
pub(super) struct Instance {
    /// The caller's id.
    pub id: u64,
    /// Index of its model.
    pub model: u32,
    pub world_from_model: DAffine3,
    pub state: InstanceState,
}

/// The states of an array's members as they were at the commit.
#[derive(Clone)]
pub(super) struct ArrayStates {
    /// That of members which have none of their own.
    pub common: InstanceState,
    pub own: HashMap<u32, InstanceState>,
}

/// A scene as it was at a commit: immutable, shared by the jobs that began with it. Thread-safe.
pub struct SceneState {
    pub(crate) context: Context,
    pub(crate) models: Vec<Model>,
    /// Single instances have the first numbers, in the order added; then come the members of arrays.
    pub(super) singles: Vec<Instance>,
    pub(super) arrays: Vec<ArrayStates>,
    pub(crate) placement: Arc<Placement>,
    /// True if anything may be transparent. Otherwise any surface that a shadow ray hits blocks it.
    pub(crate) see_through: bool,
    /// True if parts are hidden.
    pub(crate) hides_parts: bool,
    pub(crate) lights: Vec<Light>,
    pub(crate) background: Background,
    pub(crate) _memory: Kept,
}

impl SceneState {
    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Number of instances.
    pub fn instance_count(&self) -> usize {
        self.placement.instance_count()
    }

    /// A placed tree.
    #[inline(always)]
    pub(crate) fn placed(&self, number: u32) -> Cow<'_, Placed> {
        match self.placement.single(number) {
            Some(placed) => Cow::Borrowed(placed),
            None => Cow::Owned(self.placement.made(number, &self.models)),
        }
    }

    /// All placed trees, by number.
    pub(crate) fn all_placed(&self) -> impl Iterator<Item = Cow<'_, Placed>> {
        (0..self.placement.len() as u32).map(|number| self.placed(number))
    }

    /// See [`PlacedIds`].
    #[inline(always)]
    pub(crate) fn ids_of(&self, number: u32) -> PlacedIds {
        self.placement.ids_of(number)
    }

    /// The state of an instance.
    #[inline(always)]
    pub(crate) fn state_of(&self, instance: u32) -> &InstanceState {
        match self.singles.get(instance as usize) {
            Some(single) => &single.state,
            None => self.state_of_member(instance),
        }
    }

    #[inline(never)]
    fn state_of_member(&self, instance: u32) -> &InstanceState {
        let (array, member) = self.placement.member_of(instance);
        let states = &self.arrays[array];
        states.own.get(&member).unwrap_or(&states.common)
    }

    /// The caller's id of an instance.
    #[inline]
    pub(crate) fn instance_id(&self, instance: u32) -> u64 {
        match self.singles.get(instance as usize) {
            Some(single) => single.id,
            None => self.placement.id_of_member(instance),
        }
    }

    /// The model of an instance.
    pub(crate) fn model_of_instance(&self, instance: u32) -> &Model {
        let index = match self.singles.get(instance as usize) {
            Some(single) => single.model,
            None => self.placement.model_of_member(instance),
        };
        &self.models[index as usize]
    }

    /// The map of an instance to the world.
    pub(crate) fn world_from_model(&self, instance: u32) -> DAffine3 {
        match self.singles.get(instance as usize) {
            Some(single) => single.world_from_model,
            None => self.placement.transform_of_member(instance),
        }
    }

    /// The number of the instance with an id.
    pub(crate) fn instance_with(&self, id: u64) -> Option<u32> {
        let single = || self.singles.iter().position(|single| single.id == id).map(|at| at as u32);
        self.placement.member_with(id).or_else(single)
    }

    /// Bounds of all instances, hidden ones too, in world space; empty if there are none.
    pub fn bounds(&self) -> DBounds {
        self.placement.bounds
    }

    /// Bounds in world space of all that rays can hit: stand-ins may extend beyond [`SceneState::bounds`].
    pub(crate) fn bounds_of_hits(&self) -> DBounds {
        *self.placement.top.around()
    }

    /// The blocks of a placed tree that walks pass by, if parts are hidden there.
    #[inline]
    pub(crate) fn shown_blocks(&self, placed: u32) -> Option<&ShownBlocks> {
        if !self.hides_parts {
            return None;
        }
        let instance = self.ids_of(placed).instance;
        self.state_of(instance).parts.trees.get(self.placement.index_in_instance(placed) as usize)
    }

    /// The mask of the rays that see the placed tree.
    #[inline]
    pub(super) fn seen_by(&self, placed: u32) -> u32 {
        let instance = self.state_of(self.ids_of(placed).instance);
        // A tree of hidden parts alone is not entered.
        let is_hidden = self.shown_blocks(placed).is_some_and(|shown| shown.lacks(shown.first_block));
        if instance.look.visible && !is_hidden { instance.mask } else { 0 }
    }

    /// Bytes of its models' blocks in memory.
    pub(crate) fn resident_bytes(&self) -> u64 {
        self.models.iter().map(|m| m.memory().resident).sum()
    }
}
