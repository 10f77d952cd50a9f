//! Scenes in a scene, as they stand there: single ones, and members of arrays.

use super::array::Array;
use super::measures::{Factors, Measures};
use super::placement::PlacedIds;
use super::state::SceneState;
use super::tints::{NO_TINT, Tint};
use crate::base::error::Result;
use crate::base::memory::room;
use glam::DAffine3;
use std::sync::Arc;

/// A scene in another. Also stands for a member of an array of scenes.
#[derive(Clone, Copy)]
pub(super) struct Inner<'a> {
    /// The caller's id.
    pub id: u64,
    /// The number of its first placed tree in the outer scene.
    pub first: u64,
    /// The number of its first instance in the outer scene.
    pub first_instance: u64,
    pub scene: &'a SceneState,
    map: Map<'a>,
    /// The index, in the outer scene, of each of its models.
    models: &'a [u32],
    pub key: InnerKey,
}

/// The map from a scene to the outer one. That of a member is made when it is asked for.
#[derive(Clone, Copy)]
enum Map<'a> {
    Stored(&'a DAffine3),
    Member(&'a Array, u32),
}

/// Which scene in another it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum InnerKey {
    /// The index of a single one.
    Single(usize),
    /// The index of an array, and the member.
    Member(usize, u32),
}

impl Inner<'_> {
    /// The map to the outer scene.
    #[inline]
    pub fn world_from_scene(&self) -> DAffine3 {
        match self.map {
            Map::Stored(map) => *map,
            Map::Member(array, member) => array.transform(member),
        }
    }

    /// The mask of a member, without that of all in its array.
    #[inline]
    pub fn mask(&self) -> u32 {
        match self.map {
            Map::Stored(_) => u32::MAX,
            Map::Member(array, member) => array.mask(member),
        }
    }

    /// The tint of a member.
    #[inline]
    pub fn tint(&self) -> Tint {
        match self.map {
            Map::Stored(_) => NO_TINT,
            Map::Member(array, member) => array.tint(member),
        }
    }

    /// The ids in the outer scene of a placed tree.
    pub fn outer(&self, inner: PlacedIds) -> PlacedIds {
        let (model, instance) = (self.models[inner.model as usize], self.first_instance + inner.instance);
        PlacedIds { model, instance, ..inner }
    }

    /// Those of all maps to placed trees in it, or wider.
    pub fn factors(&self) -> Factors {
        self.scene.placement.factors().under(&self.world_from_scene().matrix3)
    }

    /// The greatest distance of its stored vertices from those of the input, or more.
    pub fn position_error(&self) -> f64 {
        Measures::of(&self.world_from_scene().matrix3).stretch * self.scene.placement.position_error
    }
}

/// A scene that is placed in another, once or by an array.
#[derive(Clone)]
pub(super) struct Prototype {
    /// As it was at the commit.
    pub scene: Arc<SceneState>,
    /// The index, in the outer scene, of each of its models.
    pub models: Vec<u32>,
}

/// Numbers of placed trees and of instances.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub placed: u64,
    pub instances: u64,
}

impl Counts {
    /// The sum of these and so many times the others; at most the greatest number.
    pub fn plus(self, other: Self, times: u64) -> Self {
        Self {
            placed: self.placed.saturating_add(other.placed.saturating_mul(times)),
            instances: self.instances.saturating_add(other.instances.saturating_mul(times)),
        }
    }
}

/// A single scene in another.
#[derive(Clone)]
pub(super) struct PlacedScene {
    pub id: u64,
    pub first: Counts,
    pub of: Prototype,
    pub world_from_scene: DAffine3,
}

impl PlacedScene {
    pub fn inner(&self, index: usize) -> Inner<'_> {
        let Self { id, first, of, world_from_scene } = self;
        Inner {
            id: *id,
            first: first.placed,
            first_instance: first.instances,
            scene: &of.scene,
            map: Map::Stored(world_from_scene),
            models: &of.models,
            key: InnerKey::Single(index),
        }
    }
}

/// An array of scenes in another.
#[derive(Clone)]
pub(super) struct PlacedSceneArray {
    pub array: Arc<Array>,
    /// Of its first member.
    pub first: Counts,
    /// The number of its first member in the top tree.
    pub first_member: u32,
    pub prototypes: Arc<[Prototype]>,
    /// What is before each member, from `first` on. Empty if all prototypes have equally many.
    pub(super) starts: Arc<Vec<Counts>>,
}

impl PlacedSceneArray {
    /// Places an array: see its fields.
    pub fn new(array: Arc<Array>, first: Counts, first_member: u32, prototypes: Arc<[Prototype]>) -> Result<Self> {
        let mut starts = Vec::new();
        if !are_alike(prototypes.iter().map(|it| &*it.scene)) {
            starts = room(array.len() as usize, "the placed trees of a scene")?;
            let mut before = Counts::default();
            for at in array.prototypes() {
                starts.push(before);
                before = before.plus(prototypes[at].scene.placement.count, 1);
            }
        }
        Ok(Self { array, first, first_member, prototypes, starts: Arc::new(starts) })
    }

    /// Bytes of memory, in addition to the array's, with these prototypes.
    pub fn bytes(members: u32, scenes: &[Arc<SceneState>]) -> u64 {
        let of_models: usize = scenes.iter().map(|it| it.models.len() * size_of::<u32>()).sum();
        let starts = if are_alike(scenes.iter().map(|it| &**it)) { 0 } else { members as usize * size_of::<Counts>() };
        (of_models + starts) as u64
    }

    /// What is in all members.
    pub fn counts(array: &Array, scenes: &[Arc<SceneState>]) -> Counts {
        let none = Counts::default();
        if are_alike(scenes.iter().map(|it| &**it)) {
            return scenes.first().map_or(none, |it| none.plus(it.placement.count, array.len().into()));
        }
        array.prototypes().fold(none, |all, at| all.plus(scenes[at].placement.count, 1))
    }

    /// What is before a member.
    fn start(&self, member: u32) -> Counts {
        match self.starts.get(member as usize) {
            Some(start) => self.first.plus(*start, 1),
            None => self.first.plus(self.prototypes[0].scene.placement.count, member.into()),
        }
    }

    /// The member that holds the number which `of` chooses of the counts.
    pub fn with(&self, number: u64, of: fn(&Counts) -> u64) -> u32 {
        let at = number - of(&self.first);
        if self.starts.is_empty() {
            return (at / of(&self.prototypes[0].scene.placement.count).max(1)) as u32;
        }
        // Members with nothing in them begin where the next one does.
        self.starts.partition_point(|start| of(start) <= at) as u32 - 1
    }

    /// A member; `index`: that of the array.
    pub fn inner(&self, index: usize, member: u32) -> Inner<'_> {
        let (of, start) = (&self.prototypes[self.array.prototype_of(member) as usize], self.start(member));
        Inner {
            id: self.array.first_id + u64::from(member),
            first: start.placed,
            first_instance: start.instances,
            scene: &of.scene,
            map: Map::Member(&self.array, member),
            models: &of.models,
            key: InnerKey::Member(index, member),
        }
    }
}

/// True if all scenes have equally many placed trees and instances.
fn are_alike<'a>(mut scenes: impl Iterator<Item = &'a SceneState>) -> bool {
    let Some(first) = scenes.next() else { return true };
    scenes.all(|it| it.placement.count == first.placement.count)
}
