//! The draft of a scene: the content of its next commit.

use super::array::Array;
use super::context::Context;
use super::edit::{Scene, no_instance};
use super::light::{Background, Light};
use super::looks::{self, Look, PartLooks, PartsShown};
use super::model::Model;
use super::occurrence::OccurrenceLooks;
use super::state::InstanceState;
use crate::base::error::{Error, Result};
use crate::residency::Kept;
use glam::DAffine3;
use std::collections::{BTreeMap, HashMap};
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

/// The content of the next commit.
pub(super) struct Draft {
    /// In the order added; removed instances leave `None` until the next commit.
    pub(super) instances: Vec<Option<Draftee>>,
    /// Index in `instances` of each id.
    pub(super) index: HashMap<u64, usize>,
    pub(super) arrays: Vec<DraftArray<Model>>,
    /// Arrays of scenes.
    pub(super) scene_arrays: Vec<DraftArray<Scene>>,
    pub(super) occurrences: OccurrenceLooks,
    /// Scenes in this one, in the order added.
    pub(super) scenes: BTreeMap<u64, DraftScene>,
    /// The key in `scenes` of each id.
    pub(super) scene_at: HashMap<u64, u64>,
    pub(super) lights: Vec<Light>,
    pub(super) background: Background,
    /// True if an instance was moved, added or removed since the last commit, except for members of arrays that moved.
    pub(super) moved: bool,
    /// The members of arrays that moved: the index of the array, and the members.
    pub(super) shifted: Vec<(ArrayKey, Range<u32>)>,
    /// The looks of instances whose parts look as in the file.
    pub(super) plain: Arc<PartsShown>,
    /// Number of instances that `memory` pays for.
    pub(super) paid: usize,
    pub(super) memory: Kept,
    /// Bytes of looks of parts that were edited since the last commit, and their charge.
    pub(super) edited: u64,
    pub(super) edits: Kept,
    /// Of the scenes in this one that came with it from a file, and of their tables.
    pub(super) opened: Kept,
}

#[derive(Clone)]
pub(super) struct Draftee {
    pub id: u64,
    pub model: Model,
    pub world_from_model: DAffine3,
    pub state: DraftState,
}

/// The state of an instance in the next commit.
#[derive(Clone)]
pub(super) struct DraftState {
    pub mask: u32,
    pub look: Look,
    pub parts: Arc<PartLooks>,
    /// Of the last commit.
    pub shown: Arc<PartsShown>,
}

/// A scene in this one in the next commit.
pub(super) struct DraftScene {
    pub id: u64,
    pub scene: Scene,
    pub world_from_scene: DAffine3,
    pub state: DraftState,
}

/// An array of instances in the next commit; `P`: models, or scenes.
pub(super) struct DraftArray<P> {
    pub array: Arc<Array>,
    pub prototypes: Vec<P>,
    /// The state of members that have none of their own.
    pub common: DraftState,
    pub own: HashMap<u32, DraftState>,
    /// For the states of its own.
    pub(super) memory: Kept,
}

/// The array that an instance is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ArrayKey {
    /// The index of an array of models.
    Models(usize),
    /// The index of an array of scenes.
    Scenes(usize),
}

impl<P> DraftArray<P> {
    /// The state of a member, to be edited.
    pub(super) fn state(&mut self, context: &Context, member: u32) -> Result<&mut DraftState> {
        if !self.own.contains_key(&member) {
            self.memory.grow_to(context.residency(), looks::WHAT, ((self.own.len() + 1) * OWN) as u64)?;
        }
        Ok(self.own.entry(member).or_insert_with(|| self.common.clone()))
    }

    /// See [`Draft::unset_masks`].
    fn unset_masks(&mut self, members: Range<u32>) {
        let Self { own, common, .. } = self;
        own.iter_mut().filter(|it| members.contains(it.0)).for_each(|it| it.1.mask = common.mask);
    }
}

impl DraftArray<Model> {
    /// True if each member has one tree.
    pub fn has_one_each(&self) -> bool {
        self.prototypes.iter().all(|model| model.placements().count() == 1)
    }
}

impl DraftState {
    pub(super) fn plain(plain: &Arc<PartsShown>) -> Self {
        let (shown, parts) = (Arc::clone(plain), Arc::clone(&plain.looks));
        Self { mask: u32::MAX, look: Look::default(), parts, shown }
    }

    pub fn committed(&self) -> InstanceState {
        InstanceState { mask: self.mask, look: self.look, parts: Arc::clone(&self.shown) }
    }

    /// True if it shows all as it is.
    pub fn is_plain(&self) -> bool {
        self.mask == u32::MAX && self.look == Look::default()
    }

    /// True if looks of parts were edited since the last commit.
    pub fn has_new_looks(&self) -> bool {
        !Arc::ptr_eq(&self.parts, &self.shown.looks)
    }
}

/// The first of some ids that is a key.
fn first_in<V>(keys: &HashMap<u64, V>, mut ids: RangeInclusive<u64>) -> Option<u64> {
    if ids.end() - ids.start() < keys.len() as u64 {
        return ids.find(|id| keys.contains_key(id));
    }
    keys.keys().copied().filter(|id| ids.contains(id)).min()
}

/// Bytes of the state of a member of its own. The table may be half empty.
pub(super) const OWN: usize = 2 * (size_of::<(u32, DraftState)>() + size_of::<(u32, InstanceState)>() + 2);

impl Draft {
    pub(super) fn draftees(&self) -> impl Iterator<Item = &Draftee> + Clone {
        self.instances.iter().flatten()
    }

    /// All states, with the models of those that have looks of parts of their own.
    pub(super) fn states(&mut self) -> impl Iterator<Item = (&Model, &mut DraftState)> {
        let singles = self.instances.iter_mut().flatten().map(|it| (&it.model, &mut it.state));
        let members = self.arrays.iter_mut().flat_map(|it| {
            let DraftArray { array, prototypes, own, .. } = it;
            own.iter_mut().map(|(&member, state)| (&prototypes[array.prototype_of(member) as usize], state))
        });
        singles.chain(members)
    }

    /// Fails if one of `count` ids from `first` on is taken.
    pub(super) fn check_new(&self, first: u64, count: u64) -> Result<()> {
        let last = first + (count - 1);
        let of_array = |it: &Arc<Array>| {
            let from = it.first_id;
            let to = from + u64::from(it.len() - 1);
            (from <= last && first <= to).then_some(from.max(first))
        };
        let of_scenes = self.scene_arrays.iter().map(|it| &it.array);
        let in_arrays = self.arrays.iter().map(|it| &it.array).chain(of_scenes).find_map(of_array);
        let alone = || first_in(&self.index, first..=last).or_else(|| first_in(&self.scene_at, first..=last));
        match in_arrays.or_else(alone) {
            Some(id) => Err(Error::bad_argument(format!("instance {id} already exists"))),
            None => Ok(()),
        }
    }

    /// The array that an id is of, and its member.
    pub(super) fn member(&self, id: u64) -> Option<(ArrayKey, u32)> {
        let of = |it: &Arc<Array>, key| Some((key, it.member(id)?));
        let models = self.arrays.iter().enumerate().find_map(|(i, it)| of(&it.array, ArrayKey::Models(i)));
        let scenes = || self.scene_arrays.iter().enumerate().find_map(|(i, it)| of(&it.array, ArrayKey::Scenes(i)));
        models.or_else(scenes)
    }

    /// The content of an array.
    pub(super) fn array(&mut self, key: ArrayKey) -> &mut Arc<Array> {
        match key {
            ArrayKey::Models(at) => &mut self.arrays[at].array,
            ArrayKey::Scenes(at) => &mut self.scene_arrays[at].array,
        }
    }

    /// Gives members with states of their own the mask of all in their array.
    pub(super) fn unset_masks(&mut self, array: ArrayKey, members: Range<u32>) {
        match array {
            ArrayKey::Models(at) => self.arrays[at].unset_masks(members),
            ArrayKey::Scenes(at) => self.scene_arrays[at].unset_masks(members),
        }
    }

    pub(super) fn refuse_member(&self, id: u64, what: &str) -> Result<()> {
        match self.member(id) {
            Some(_) => Err(Error::bad_argument(format!("instance {id} is of an array, and cannot be {what}"))),
            None => Ok(()),
        }
    }

    pub(super) fn scene(&mut self, id: u64) -> Option<&mut DraftScene> {
        self.scene_at.get(&id).and_then(|key| self.scenes.get_mut(key))
    }

    pub(super) fn remove_scene(&mut self, id: u64) -> Option<DraftScene> {
        self.scene_at.remove(&id).and_then(|key| self.scenes.remove(&key))
    }

    /// The model of an instance.
    pub(super) fn model(&mut self, id: u64) -> Result<&Model> {
        let is_scene = || Err(Error::bad_argument(format!("instance {id} is a scene: its parts have looks there")));
        if self.scene_at.contains_key(&id) {
            return is_scene();
        }
        match self.member(id) {
            Some((ArrayKey::Models(array), member)) => {
                let it = &self.arrays[array];
                Ok(&it.prototypes[it.array.prototype_of(member) as usize])
            }
            Some((ArrayKey::Scenes(_), _)) => is_scene(),
            None => Ok(&self.instance(id)?.model),
        }
    }

    /// The state of an instance, to be edited. A member of an array gets one of its own.
    pub(super) fn state(&mut self, context: &Context, id: u64) -> Result<&mut DraftState> {
        if self.scene_at.contains_key(&id) {
            let it = self.scene(id).ok_or_else(|| no_instance(id))?;
            return Ok(&mut it.state);
        }
        let Some((array, member)) = self.member(id) else { return Ok(&mut self.instance(id)?.state) };
        match array {
            ArrayKey::Models(at) => self.arrays[at].state(context, member),
            ArrayKey::Scenes(at) => self.scene_arrays[at].state(context, member),
        }
    }

    /// Removes the gaps that removed instances left.
    pub(super) fn close_gaps(&mut self) {
        if self.instances.len() == self.index.len() {
            return;
        }
        self.instances.retain(Option::is_some);
        // The index keeps the memory that is paid for.
        self.index.clear();
        self.index.extend(self.instances.iter().flatten().enumerate().map(|(i, instance)| (instance.id, i)));
    }

    /// Charges the memory of another instance to the budget, for twice as many at a time.
    pub(super) fn pay_for_another(&mut self, context: &Context) -> Result<()> {
        if self.instances.len() < self.paid {
            return Ok(());
        }
        // An entry of the index takes up to twice its size, and both grow by doubling.
        let each = size_of::<Option<Draftee>>() + 2 * (size_of::<(u64, usize)>() + 1);
        let more = self.paid.max(16) * 2;
        let memory = context.residency().keep("the instances of a scene", (more * each) as u64)?;
        let no_memory = |_| Error::NoMemory { what: "the instances of a scene".into(), bytes: (more * each) as u64 };
        self.instances.try_reserve_exact(more - self.instances.len()).map_err(no_memory)?;
        self.index.try_reserve(more - self.index.len()).map_err(no_memory)?;
        (self.paid, self.memory) = (more, memory);
        Ok(())
    }

    /// Charges `more` bytes of edited looks to the budget.
    pub(super) fn pay_for_edit(&mut self, context: &Context, more: u64) -> Result<()> {
        self.edits.grow_to(context.residency(), looks::WHAT, self.edited + more)?;
        self.edited += more;
        Ok(())
    }

    pub(super) fn instance(&mut self, id: u64) -> Result<&mut Draftee> {
        let at = self.index.get(&id);
        at.and_then(|&at| self.instances[at].as_mut()).ok_or_else(|| no_instance(id))
    }
}
