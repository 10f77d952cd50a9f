//! The committed, immutable state of a scene, which jobs read.

use super::context::Context;
use super::frame::{Scenes, Search};
use super::groups::Groups;
use super::inner::{Inner, InnerKey};
use super::light::{Background, Light};
use super::looks::{Look, PartsShown};
use super::model::Model;
use super::placed::Placed;
use super::placement::{Holder, PlacedArray, PlacedIds, PlacedMesh, Placement};
use crate::math::DBounds;
use crate::residency::Kept;
use crate::structure::ShownBlocks;
use glam::{DAffine3, DVec3};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;
use std::sync::{Arc, Weak};

/// The state of an instance as it was at the commit.
#[derive(Clone)]
pub(crate) struct InstanceState {
    pub mask: u32,
    pub look: Look,
    /// The looks of its parts.
    pub parts: Arc<PartsShown>,
}

impl InstanceState {
    /// True if it shows all as it is in the file.
    pub fn is_plain(&self) -> bool {
        self.mask == u32::MAX && self.look == Look::default() && self.parts.looks.is_empty()
    }

    /// The mask of the rays that see it.
    fn seen_by(&self) -> u32 {
        if self.look.visible { self.mask } else { 0 }
    }
}

/// A single instance as it was at the commit.
#[derive(Clone)]
pub(super) struct Instance {
    /// The caller's id.
    pub id: u64,
    /// Index of its model.
    pub model: u32,
    pub world_from_model: DAffine3,
}

/// The states of an array's members as they were at the commit.
#[derive(Clone)]
pub(super) struct ArrayStates {
    /// That of members which have none of their own.
    pub common: InstanceState,
    pub own: HashMap<u32, InstanceState>,
}

/// The states of all instances as they were at the commit.
#[derive(Default)]
pub(super) struct States {
    /// The mask of the rays that see anything of them.
    pub seen_by: u32,
    /// What the scenes in this one were given themselves.
    pub given: super::given::Given,
    /// Of single instances.
    pub singles: Vec<InstanceState>,
    pub arrays: Vec<ArrayStates>,
    /// Of the instances of each scene in this one, under the state of that scene.
    pub scenes: Vec<Arc<States>>,
    pub scene_arrays: Vec<SceneArrayStates>,
    /// The states that these were made of, and what they are under.
    pub(super) made_of: Option<(Weak<States>, u32, Look)>,
    /// Of single occurrences: of instances in scenes in this one, by their numbers.
    pub occurrences: BTreeMap<u64, InstanceState>,
}

/// The states of what is in the members of an array of scenes.
pub(super) struct SceneArrayStates {
    /// Of each prototype, under the state of members that have none of their own.
    pub common: Vec<Arc<States>>,
    pub own: HashMap<u32, Arc<States>>,
}

/// An element of a list; `None` beyond its end.
#[inline(always)]
pub(super) fn at<T>(list: &[T], number: u64) -> Option<&T> {
    list.get(usize::try_from(number).ok()?)
}

impl States {
    /// The states under another one: visible if both are, in the colour of the inner one if it has one.
    pub fn under(self: &Arc<Self>, outer: &InstanceState) -> Self {
        let made_of = Some((Arc::downgrade(self), outer.mask, outer.look));
        Self { made_of, ..self.under_once(outer, &mut HashMap::new()) }
    }

    /// True if they are `inner` under `outer`.
    pub fn is_of(&self, inner: &Arc<Self>, outer: &InstanceState) -> bool {
        let is = |(of, mask, look): &(Weak<Self>, u32, Look)| {
            std::ptr::eq(of.as_ptr(), Arc::as_ptr(inner)) && (*mask, *look) == (outer.mask, outer.look)
        };
        self.made_of.as_ref().is_some_and(is)
    }

    /// A state under another one.
    pub fn under_one(inner: &InstanceState, outer: &InstanceState) -> InstanceState {
        let look = Look {
            visible: inner.look.visible && outer.look.visible,
            colour: inner.look.colour.or(outer.look.colour),
            selected: inner.look.selected || outer.look.selected,
        };
        InstanceState { mask: inner.mask & outer.mask, look, parts: Arc::clone(&inner.parts) }
    }

    /// [`States::under`]; `done` has those of scenes in it that were there before.
    fn under_once(&self, outer: &InstanceState, done: &mut HashMap<*const Self, Arc<Self>>) -> Self {
        let under = |inner: &InstanceState| Self::under_one(inner, outer);
        let of_array = |it: &ArrayStates| ArrayStates {
            common: under(&it.common),
            own: it.own.iter().map(|(&member, state)| (member, under(state))).collect(),
        };
        let mut scene = |it: &Arc<Self>| match done.get(&Arc::as_ptr(it)) {
            Some(known) => Arc::clone(known),
            None => {
                let new = Arc::new(it.under_once(outer, done));
                done.insert(Arc::as_ptr(it), Arc::clone(&new));
                new
            }
        };
        let scenes = self.scenes.iter().map(&mut scene).collect();
        let of_scenes = |it: &SceneArrayStates| SceneArrayStates {
            common: it.common.iter().map(&mut scene).collect(),
            own: it.own.iter().map(|(&member, it)| (member, scene(it))).collect(),
        };
        Self {
            made_of: None,
            seen_by: self.seen_by & outer.seen_by(),
            scene_arrays: self.scene_arrays.iter().map(of_scenes).collect(),
            occurrences: self.occurrences.iter().map(|(&instance, it)| (instance, under(it))).collect(),
            singles: self.singles.iter().map(under).collect(),
            arrays: self.arrays.iter().map(of_array).collect(),
            scenes,
            given: Default::default(),
        }
    }

    /// Bytes of memory, without the looks of parts, and without what `seen` has. States of scenes in it count once.
    pub fn bytes(&self, seen: &mut HashSet<*const Self>) -> u64 {
        let of_arrays = self.arrays.iter().map(|it| (1 + 2 * it.own.len()) * size_of::<ArrayStates>());
        let inner = || {
            let of_arrays = self.scene_arrays.iter().flat_map(|it| it.common.iter().chain(it.own.values()));
            self.scenes.iter().chain(of_arrays)
        };
        let of_scenes = inner().count() * size_of::<Arc<Self>>();
        let of_occurrences = 2 * self.occurrences.len() * size_of::<(u64, InstanceState)>();
        let own =
            self.singles.len() * size_of::<InstanceState>() + of_arrays.sum::<usize>() + of_scenes + of_occurrences;
        let inner: Vec<_> = inner().filter(|it| seen.insert(Arc::as_ptr(it))).collect();
        (size_of::<Self>() + own) as u64 + inner.into_iter().map(|it| it.bytes(seen)).sum::<u64>()
    }

    /// The states of the scene's own instances.
    pub fn own(&self) -> impl Iterator<Item = &InstanceState> {
        let of_arrays = self.arrays.iter().flat_map(|it| it.own.values().chain([&it.common]));
        self.singles.iter().chain(of_arrays)
    }

    /// Sets the mask of the rays that see anything of them.
    pub fn find_seen_by(&mut self) {
        let own = self.own().fold(0, |all, it| all | it.seen_by());
        let of_arrays = self.scene_arrays.iter().flat_map(|it| it.common.iter().chain(it.own.values()));
        self.seen_by = self.scenes.iter().chain(of_arrays).fold(own, |all, it| all | it.seen_by);
    }

    /// See [`Stand`].
    fn stand(&self, placement: &Placement, number: u64) -> Stand<'_> {
        if let Some(placed) = placement.single(number) {
            return Stand { number, ids: **placed, state: &self.singles[placed.instance as usize], mask: u32::MAX };
        }
        let stand = match placement.holder_of(number) {
            Holder::Array(array) => {
                let ids = array.ids_of(number as u32);
                self.of_member(placement, array, number, ids)
            }
            Holder::Scene(it) => {
                let inner = self.in_scene(placement, &it).stand(&it.scene.placement, number - it.first);
                Stand { number, ids: it.outer(inner.ids), mask: inner.mask & it.mask(), ..inner }
            }
        };
        self.of_occurrence(stand)
    }

    /// [`States::stand`], also the place of the mesh, for a placed tree that is of no single instance.
    fn with_mesh(&self, placement: &Placement, number: u64) -> (PlacedMesh, Stand<'_>) {
        if let Some(placed) = placement.single(number) {
            let mesh = PlacedMesh { ids: **placed, world_from_mesh: placed.world_from_mesh(), measures: None };
            return (mesh, self.stand(placement, number));
        }
        let (mesh, stand) = match placement.holder_of(number) {
            Holder::Array(array) => {
                let mesh = array.mesh(number as u32);
                (mesh, self.of_member(placement, array, number, mesh.ids))
            }
            Holder::Scene(it) => {
                let (inner, stand) = self.in_scene(placement, &it).with_mesh(&it.scene.placement, number - it.first);
                let (ids, world_from_mesh) = (it.outer(inner.ids), it.world_from_scene() * inner.world_from_mesh);
                let mesh = PlacedMesh { ids, world_from_mesh, measures: None };
                (mesh, Stand { number, ids, mask: stand.mask & it.mask(), ..stand })
            }
        };
        (mesh, self.of_occurrence(stand))
    }

    /// With the look of a single occurrence, if it has one.
    fn of_occurrence<'a>(&'a self, stand: Stand<'a>) -> Stand<'a> {
        match self.occurrences.is_empty() {
            true => stand,
            false => Stand { state: self.occurrences.get(&stand.ids.instance).unwrap_or(stand.state), ..stand },
        }
    }

    /// That of a placed tree of an array.
    fn of_member(&self, placement: &Placement, array: &PlacedArray, number: u64, ids: PlacedIds) -> Stand<'_> {
        let states = &self.arrays[placement.array_with(ids.instance)];
        let member = (ids.instance - u64::from(array.first_instance)) as u32;
        let state = states.own.get(&member).unwrap_or(&states.common);
        Stand { number, ids, state, mask: array.array.mask(member) }
    }

    /// The states of what is in a scene in this one.
    pub fn in_scene(&self, placement: &Placement, it: &Inner) -> &Self {
        match it.key {
            InnerKey::Single(at) => &self.scenes[at],
            InnerKey::Member(at, member) => {
                let states = &self.scene_arrays[at];
                let prototype = placement.scene_arrays[at].array.prototype_of(member);
                states.own.get(&member).unwrap_or(&states.common[prototype as usize])
            }
        }
    }

    /// The state of an instance.
    #[inline(never)]
    fn of(&self, placement: &Placement, instance: u64) -> &InstanceState {
        if let Some(single) = at(&self.singles, instance) {
            return single;
        }
        if let Some(own) = self.occurrences.get(&instance) {
            return own;
        }
        match placement.holder_of_instance(instance) {
            (Holder::Array(_), member) => {
                let states = &self.arrays[placement.array_with(instance)];
                states.own.get(&(member as u32)).unwrap_or(&states.common)
            }
            (Holder::Scene(it), inner) => self.in_scene(placement, &it).of(&it.scene.placement, inner),
        }
    }
}

/// What walks need to know of a placed tree, found together: in scenes in scenes each search goes down all levels.
#[derive(Clone, Copy)]
pub(crate) struct Stand<'a> {
    pub number: u64,
    pub ids: PlacedIds,
    pub state: &'a InstanceState,
    /// The masks of members of arrays that it is of, together.
    mask: u32,
}

/// Boxes may reach beyond bounds by this fraction of their greatest extent.
pub(super) const ROUGH: f64 = 1.0 / 1024.0;

/// A scene as it was at a commit: immutable, shared by the jobs that began with it. Thread-safe.
pub struct SceneState {
    pub(crate) context: Context,
    pub(crate) models: Vec<Model>,
    /// Single instances have the first numbers, in the order added; then come the members of arrays, then
    /// those of scenes in this one.
    pub(super) singles: Vec<Instance>,
    pub(super) states: Arc<States>,
    pub(crate) placement: Arc<Placement>,
    pub(super) groups: Groups,
    /// Number of levels of scenes in scenes, this one included.
    pub(super) levels: u32,
    /// True if anything may be transparent. Otherwise any surface that a shadow ray hits blocks it.
    pub(crate) see_through: bool,
    /// True if parts are hidden.
    pub(crate) hides_parts: bool,
    /// True if members of arrays have tints, here or in scenes in it.
    pub(super) has_tints: bool,
    pub(crate) lights: Vec<Light>,
    pub(crate) background: Background,
    pub(crate) _memory: Kept,
}

impl Stand<'_> {
    /// True if it shows all as it is in the file.
    pub fn is_plain(&self) -> bool {
        self.mask == u32::MAX && self.state.is_plain()
    }
}

impl SceneState {
    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Number of instances.
    pub fn instance_count(&self) -> usize {
        self.placement.instance_count() as usize
    }

    /// A placed tree.
    #[inline(always)]
    pub(crate) fn placed(&self, number: u64) -> Cow<'_, Placed> {
        match self.placement.single(number) {
            Some(placed) => Cow::Borrowed(placed),
            None => Cow::Owned(self.placement.made(number, &self.models)),
        }
    }

    /// [`SceneState::stand`] and [`SceneState::placed`]: found together, they take little more time than one.
    #[inline]
    pub(super) fn stand_placed(&self, number: u64) -> (Stand<'_>, Cow<'_, Placed>) {
        if let Some(placed) = self.placement.single(number) {
            return (self.stand(number), Cow::Borrowed(placed));
        }
        let (mesh, stand) = self.states.with_mesh(&self.placement, number);
        (stand, Cow::Owned(mesh.placed(&self.models)))
    }

    /// See [`PlacedIds`].
    #[inline(always)]
    pub(crate) fn ids_of(&self, number: u64) -> PlacedIds {
        self.placement.ids_of(number)
    }

    /// The state of an instance.
    #[inline(always)]
    pub(crate) fn state_of(&self, instance: u64) -> &InstanceState {
        match at(&self.states.singles, instance) {
            Some(single) => single,
            None => self.states.of(&self.placement, instance),
        }
    }

    /// The part of its model that covers most of a placed tree.
    pub(crate) fn main_part(&self, placed: u64) -> u32 {
        let ids = self.ids_of(placed);
        let tree = &self.models[ids.model as usize].trees()[ids.tree as usize];
        ids.first_part.saturating_add(tree.main_part)
    }

    /// The caller's id of an instance. That of an instance of a scene in this one is the id of that scene.
    #[inline]
    pub(crate) fn instance_id(&self, instance: u64) -> u64 {
        if let Some(single) = at(&self.singles, instance) {
            return single.id;
        }
        match self.placement.holder_of_instance(instance) {
            (Holder::Array(it), member) => it.array.first_id + member,
            (Holder::Scene(it), _) => it.id,
        }
    }

    /// The model of an instance.
    pub(crate) fn model_of_instance(&self, instance: u64) -> &Model {
        if let Some(single) = at(&self.singles, instance) {
            return &self.models[single.model as usize];
        }
        match self.placement.holder_of_instance(instance) {
            (Holder::Array(it), member) => &self.models[it.prototype(member as u32).model as usize],
            (Holder::Scene(it), inner) => it.scene.model_of_instance(inner),
        }
    }

    /// The map of an instance to the world.
    pub(crate) fn world_from_model(&self, instance: u64) -> DAffine3 {
        if let Some(single) = at(&self.singles, instance) {
            return single.world_from_model;
        }
        match self.placement.holder_of_instance(instance) {
            (Holder::Array(it), member) => it.array.transform(member as u32),
            (Holder::Scene(it), inner) => it.world_from_scene() * it.scene.world_from_model(inner),
        }
    }

    /// The way to a placed tree: the ids of the scenes around its instance, the outermost first, and that of the
    /// instance. Also returns the map from its model to the world. `None` if there is no
    /// such placed tree.
    pub fn path(&self, occurrence: u64) -> Option<(Vec<u64>, DAffine3)> {
        let instance = (occurrence < self.placement.len()).then(|| self.ids_of(occurrence).instance)?;
        Some((self.way_to(instance), self.world_from_model(instance)))
    }

    /// The ids of the scenes around an instance, the outermost first, and that of the instance.
    pub(super) fn way_to(&self, mut instance: u64) -> Vec<u64> {
        let (mut ids, mut scene) = (Vec::new(), self);
        loop {
            ids.push(scene.instance_id(instance));
            let Some(it) = scene.inner_of(instance) else { return ids };
            (scene, instance) = (it.scene, instance - it.first_instance);
        }
    }

    /// The scene in this one that an instance is of; `None` if it is in none.
    pub(super) fn inner_of(&self, instance: u64) -> Option<Inner<'_>> {
        if instance < self.placement.own_instances() {
            return None;
        }
        match self.placement.holder_of_instance(instance).0 {
            Holder::Scene(it) => Some(it),
            Holder::Array(_) => None,
        }
    }

    /// The id of the scene in this one that an instance is of; `None` if it is in none.
    pub(crate) fn scene_of(&self, instance: u64) -> Option<u64> {
        self.inner_of(instance).map(|it| it.id)
    }

    /// An index of the caller's ids, for several questions. It takes time in proportion to the instances that are of no
    /// array.
    pub(crate) fn instance_ids(&self) -> InstanceIds<'_> {
        let singles = (0..).zip(&self.singles).map(|(at, single)| (single.id, at..at + 1));
        let of_scene = |it: Inner| (it.id, it.first_instance..it.first_instance + it.scene.placement.instance_count());
        let scenes = self.placement.scenes.iter().enumerate().map(|(at, it)| of_scene(it.inner(at)));
        let index = singles.chain(scenes).collect();
        InstanceIds { placement: &self.placement, index }
    }

    /// Bounds of all instances, hidden ones too, in world space; empty if there are none. Where scenes are in it they
    /// may be larger, by up to a thousandth of their greatest extent on each side.
    pub fn bounds(&self) -> DBounds {
        let of_own = || (0..self.placement.len()).map(|number| self.placed(number).bounds);
        *self.placement.bounds.get_or_init(|| match self.placement.has_no_scenes() {
            true => of_own().fold(DBounds::EMPTY, DBounds::union),
            false => self.rough_bounds(),
        })
    }

    /// [`SceneState::bounds`], with time for few of the placed trees.
    fn rough_bounds(&self) -> DBounds {
        let (mut all, mut search) = (DBounds::EMPTY, Search::begin(self, Scenes::All));
        // Boxes hold all that rays may hit, which is a little more than the triangles. One that reaches but a little
        // beyond is taken as it is: otherwise all at the bounds would be visited.
        let mut boxes = DBounds::EMPTY;
        loop {
            let grown = DVec3::splat(all.extent().max_element() * ROUGH);
            let around = DBounds { min: all.min - grown, max: all.max + grown };
            let next = search.next(self, |b| {
                let is_within = !all.is_empty() && around.contains(b);
                if is_within {
                    boxes = boxes.union(*b);
                }
                !is_within
            });
            let Some(number) = next else { return all.union(boxes) };
            all = all.union(self.placed(number).bounds);
        }
    }

    /// Bounds in world space of all that rays can hit: stand-ins may extend beyond [`SceneState::bounds`].
    pub(crate) fn bounds_of_hits(&self) -> DBounds {
        *self.placement.top.around()
    }

    /// See [`Stand`].
    #[inline]
    pub(crate) fn stand(&self, number: u64) -> Stand<'_> {
        self.states.stand(&self.placement, number)
    }

    /// The blocks of a placed tree that walks pass by, if parts are hidden there.
    #[inline]
    pub(crate) fn shown_blocks(&self, placed: u64) -> Option<&ShownBlocks> {
        if self.hides_parts { self.shown_at(&self.stand(placed)) } else { None }
    }

    /// [`SceneState::shown_blocks`] of a stand.
    #[inline]
    pub(super) fn shown_at<'a>(&'a self, stand: &Stand<'a>) -> Option<&'a ShownBlocks> {
        if !self.hides_parts {
            return None;
        }
        stand.state.parts.trees.get(self.placement.index_in_instance(stand.number) as usize)
    }

    /// The mask of the rays that see the placed tree.
    #[inline]
    pub(super) fn seen_by(&self, placed: u64) -> u32 {
        self.seen_at(&self.stand(placed))
    }

    /// [`SceneState::seen_by`] of a stand.
    #[inline]
    pub(super) fn seen_at(&self, stand: &Stand) -> u32 {
        // A tree of hidden parts alone is not entered.
        let is_hidden = self.shown_at(stand).is_some_and(|shown| shown.lacks(shown.first_block));
        if stand.state.look.visible && !is_hidden { stand.state.mask & stand.mask } else { 0 }
    }

    /// Bytes of its models' blocks in memory.
    pub(crate) fn resident_bytes(&self) -> u64 {
        self.models.iter().map(|m| m.memory().resident).sum()
    }
}

/// The instances with each of the caller's ids.
pub(crate) struct InstanceIds<'a> {
    placement: &'a Placement,
    /// Of those that are of no array.
    index: HashMap<u64, Range<u64>>,
}

impl InstanceIds<'_> {
    /// The numbers of the instances with an id: several are of a scene in this one. Empty if there are none.
    pub fn with(&self, id: u64) -> Range<u64> {
        self.index.get(&id).cloned().or_else(|| self.placement.members_with(id)).unwrap_or(0..0)
    }
}
