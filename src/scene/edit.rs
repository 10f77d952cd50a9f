//! A scene: instances, lights and looks of parts. Edits are free at any time; jobs see them only after a commit.

use super::array::{Array, Instances, Prototypes};
use super::context::Context;
use super::draft::{ArrayKey, Draft, DraftArray, DraftScene, DraftState, Draftee};
use super::groups::Groups;
use super::light::{Background, Light};
use super::looks::{Look, PartLooks};
use super::measures::check_transform;
use super::model::Model;
use super::occurrence::OccurrenceLooks;
use super::state::SceneState;
use crate::base::error::{Error, Result};
use crate::residency::Kept;
use arc_swap::{ArcSwap, Guard};
use glam::DAffine3;
use std::any::Any;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A scene that collects edits until [`Scene::commit`]. Jobs in flight keep the state that they began with.
/// Thread-safe. A scene keeps its models alive.
///
/// Clones are the same scene.
#[derive(Clone)]
pub struct Scene(Arc<Inner>);

struct Inner {
    context: Context,
    draft: Mutex<Draft>,
    /// The state changes under the lock of the draft. Each query call reads it without the lock.
    committed: ArcSwap<SceneState>,
}

impl Drop for Inner {
    /// Scenes may be in scenes deeper than the stack is: a loop drops them one after the other.
    fn drop(&mut self) {
        let scenes_of = |inner: &mut Self| {
            let draft = inner.draft.get_mut().unwrap_or_else(PoisonError::into_inner);
            let of_arrays = std::mem::take(&mut draft.scene_arrays).into_iter().flat_map(|it| it.prototypes);
            std::mem::take(&mut draft.scenes).into_values().map(|it| it.scene).chain(of_arrays).collect::<Vec<Scene>>()
        };
        let mut todo: Vec<Scene> = scenes_of(self);
        while let Some(scene) = todo.pop() {
            if let Some(mut inner) = Arc::into_inner(scene.0) {
                todo.extend(scenes_of(&mut inner));
            }
        }
    }
}

impl Scene {
    /// An empty scene with a headlight.
    pub fn new(context: &Context) -> Self {
        let lights = vec![Light::HEADLIGHT];
        let background = Background::default();
        let committed = ArcSwap::from_pointee(SceneState {
            see_through: false,
            levels: 1,
            hides_parts: false,
            has_tints: false,
            context: context.clone(),
            models: Vec::new(),
            singles: Vec::new(),
            states: Arc::default(),
            groups: Groups::default(),
            placement: Arc::default(),
            lights: lights.clone(),
            background,
            _memory: Kept::default(),
        });
        let (instances, index) = (Vec::new(), HashMap::new());
        let draft = Draft {
            instances,
            index,
            arrays: Vec::new(),
            scene_arrays: Vec::new(),
            occurrences: OccurrenceLooks::default(),
            scenes: BTreeMap::new(),
            scene_at: HashMap::new(),
            lights,
            background,
            moved: false,
            shifted: Vec::new(),
            plain: Arc::default(),
            paid: 0,
            memory: Kept::default(),
            edited: 0,
            edits: Kept::default(),
            opened: Kept::default(),
        };
        Self(Arc::new(Inner { context: context.clone(), draft: Mutex::new(draft), committed }))
    }

    /// The context.
    pub fn context(&self) -> &Context {
        &self.0.context
    }

    /// Adds `model`, transformed by `world_from_model`, as instance `id` (chosen by the caller, unique in the scene).
    /// Cheap.
    ///
    /// Fails with `BadArgument` if the id is taken, the model belongs to another context, or the transform is singular
    /// or not finite, and with `OverBudget` if there is no room for another instance.
    pub fn add_instance(&self, model: &Model, id: u64, world_from_model: DAffine3) -> Result<()> {
        if !model.context().same(&self.0.context) {
            return Err(Error::bad_argument("the model belongs to another context"));
        }
        check_transform(&world_from_model)?;
        let mut draft = self.draft();
        draft.check_new(id, 1)?;
        draft.pay_for_another(&self.0.context)?;
        let (state, at) = (DraftState::plain(&draft.plain), draft.instances.len());
        draft.instances.push(Some(Draftee { id, model: model.clone(), world_from_model, state }));
        draft.index.insert(id, at);
        draft.moved = true;
        Ok(())
    }

    /// Adds many instances of a few models or scenes, with consecutive ids. Each takes the memory of its transform and
    /// of its place in the tree over all; what only some of them have, such as a look, takes more for these alone.
    /// Their transforms are checked, which takes a fraction of a microsecond each. Scenes are as [`Scene::add_scene`]
    /// says.
    ///
    /// Fails with `BadArgument` if an id is taken, a model or scene belongs to another context, a scene is this one or
    /// has it in it, an index or a transform is wrong (the error names the first), and with `OverBudget`. After a
    /// failure nothing was added.
    pub fn add_instances(&self, instances: &Instances) -> Result<()> {
        let context = &self.0.context;
        let are_of_context = match &instances.prototypes {
            Prototypes::Models(all) => all.iter().all(|model| model.context().same(context)),
            Prototypes::Scenes(all) => all.iter().all(|scene| scene.context().same(context)),
        };
        if !are_of_context {
            return Err(Error::bad_argument("a prototype belongs to another context"));
        }
        let array = Arc::new(Array::new(instances, context.residency())?);
        // Two threads might put two scenes into each other.
        let _nesting = matches!(instances.prototypes, Prototypes::Scenes(_)).then(|| context.nesting());
        if let Prototypes::Scenes(all) = &instances.prototypes
            && all.iter().any(|scene| scene.has(self))
        {
            return Err(Error::bad_argument("the scene would be in itself"));
        }
        let mut draft = self.draft();
        draft.check_new(array.first_id, array.len().into())?;
        let common = DraftState { mask: instances.mask, ..DraftState::plain(&draft.plain) };
        let (own, memory) = (HashMap::new(), Kept::default());
        match instances.prototypes.clone() {
            Prototypes::Models(prototypes) => draft.arrays.push(DraftArray { array, prototypes, common, own, memory }),
            Prototypes::Scenes(prototypes) => {
                draft.scene_arrays.push(DraftArray { array, prototypes, common, own, memory });
            }
        }
        draft.moved = true;
        Ok(())
    }

    /// Adds a scene to this one, transformed by `world_from_scene`, as instance `id`. Each commit of this scene takes
    /// the other as it was committed last; its lights and background are left out. Scenes may be in scenes, up to
    /// 64 levels, and a scene any number of times: what is in it takes memory once. Cheap.
    ///
    /// Fails with `BadArgument` if the id is taken, the scene belongs to another context, is this scene or has it in
    /// it, or the transform is singular or not finite.
    pub fn add_scene(&self, scene: &Scene, id: u64, world_from_scene: DAffine3) -> Result<()> {
        if !scene.context().same(&self.0.context) {
            return Err(Error::bad_argument("the scene belongs to another context"));
        }
        check_transform(&world_from_scene)?;
        // Two threads might put two scenes into each other.
        let _nesting = self.0.context.nesting();
        if scene.has(self) {
            return Err(Error::bad_argument("the scene would be in itself"));
        }
        let mut draft = self.draft();
        draft.check_new(id, 1)?;
        let (state, key) =
            (DraftState::plain(&draft.plain), draft.scenes.keys().next_back().map_or(0, |last| last + 1));
        draft.scenes.insert(key, DraftScene { id, scene: scene.clone(), world_from_scene, state });
        draft.scene_at.insert(id, key);
        draft.moved = true;
        Ok(())
    }

    /// True if it is `other`, or if that is in it in its next commit. Each scene is looked at once, however often it is
    /// in others.
    fn has(&self, other: &Scene) -> bool {
        let (mut todo, mut seen) = (vec![self.clone()], HashSet::new());
        while let Some(scene) = todo.pop() {
            if Arc::ptr_eq(&scene.0, &other.0) {
                return true;
            }
            if seen.insert(Arc::as_ptr(&scene.0)) {
                let draft = scene.draft();
                let of_arrays = draft.scene_arrays.iter().flat_map(|it| &it.prototypes);
                todo.extend(draft.scenes.values().map(|it| &it.scene).chain(of_arrays).cloned());
            }
        }
        false
    }

    /// Removes all instances that were added together, the first with the id `first_id`. Fails with `BadArgument` if
    /// there are none. Cheap.
    pub fn remove_instances(&self, first_id: u64) -> Result<()> {
        // The last reference of a model closes its source: functions of the host are called without the lock.
        let removed: Box<dyn Any> = {
            let mut draft = self.draft();
            let at = draft.member(first_id).filter(|(_, member)| *member == 0);
            let at = at.ok_or_else(|| Error::bad_argument(format!("no array of instances begins with {first_id}")))?;
            draft.moved = true;
            match at.0 {
                ArrayKey::Models(at) => Box::new(draft.arrays.remove(at)),
                ArrayKey::Scenes(at) => Box::new(draft.scene_arrays.remove(at)),
            }
        };
        drop(removed);
        Ok(())
    }

    /// Removes an instance; fails with `BadArgument` if there is none, or if it is of an array. Cheap.
    pub fn remove_instance(&self, id: u64) -> Result<()> {
        // The last reference of a model closes its source: functions of the host are called without the lock.
        let removed = {
            let mut draft = self.draft();
            if let Some(removed) = draft.remove_scene(id) {
                draft.moved = true;
                drop(draft);
                drop(removed);
                return Ok(());
            }
            draft.refuse_member(id, "removed alone")?;
            let at = draft.index.remove(&id).ok_or_else(|| no_instance(id))?;
            draft.moved = true;
            draft.instances[at].take()
        };
        drop(removed);
        Ok(())
    }

    /// Moves an instance. Fails like [`Scene::add_instance`]. Cheap.
    pub fn set_transform(&self, id: u64, world_from_model: DAffine3) -> Result<()> {
        check_transform(&world_from_model)?;
        let mut draft = self.draft();
        if let Some(it) = draft.scene(id) {
            it.world_from_scene = world_from_model;
        } else if let Some((array, member)) = draft.member(id) {
            let transforms = draft.array(array).in_form(&world_from_model)?;
            return self.move_members(&mut draft, array, member, &transforms);
        } else {
            draft.instance(id)?.world_from_model = world_from_model;
        }
        draft.moved = true;
        Ok(())
    }

    /// Sets the look of an instance. Looks of its parts have precedence, except that a part is hidden if either look
    /// hides it. Cheap.
    pub fn set_instance_look(&self, id: u64, look: Look) -> Result<()> {
        check_look(&look)?;
        self.draft().state(&self.0.context, id)?.look = look;
        Ok(())
    }

    /// Calls [`Scene::set_parts_look`] for one part, without the parts below it.
    pub fn set_part_look(&self, instance: u64, part: u64, look: Look) -> Result<()> {
        self.set_parts_look(instance, &[part], Scope::Own, look)
    }

    /// Sets the look of an instance's parts with the ids `parts`. Where several parts share an id, it applies to the
    /// first. The first look that hides a part of a model reads the parts of its blocks from the file; otherwise
    /// cheap.
    ///
    /// Fails with `BadArgument` if there is no such instance or part, and with `OverBudget`, `Io` or `Corrupt`. After a
    /// failure no look has changed.
    pub fn set_parts_look(&self, instance: u64, parts: &[u64], scope: Scope, look: Look) -> Result<()> {
        check_look(&look)?;
        let needs = [!look.visible, look.colour.is_some() || look.selected];
        self.edit_looks(instance, parts, scope, needs, |looks, chosen, _| {
            chosen.for_each(|part| looks.set(part, look));
        })
    }

    /// Hides all parts of an instance but `parts`, which are shown. Colours and highlights stay. Fails like
    /// [`Scene::set_parts_look`].
    pub fn isolate_parts(&self, instance: u64, parts: &[u64], scope: Scope) -> Result<()> {
        self.edit_looks(instance, parts, scope, [true, false], |looks, chosen, count| {
            looks.isolate(count, chosen);
        })
    }

    /// Passes the looks of an instance's parts, and the indices of those that `parts` and `scope` choose, to `edit`.
    /// `hides`: parts may be hidden; `colours`: they may get a colour or a highlight.
    fn edit_looks(
        &self,
        instance: u64,
        parts: &[u64],
        scope: Scope,
        [hides, colours]: [bool; 2],
        edit: impl FnOnce(&mut PartLooks, &mut dyn Iterator<Item = u32>, u32),
    ) -> Result<()> {
        let model = self.draft().model(instance)?.clone();
        let chosen = choose(&model, parts, scope)?;
        if hides {
            model.part_sets()?;
        }
        let mut draft = self.draft();
        if !draft.model(instance)?.same(&model) {
            return Err(Error::BadState(format!("the model of instance {instance} was exchanged meanwhile")));
        }
        let (count, state) = (model.parts().len(), draft.state(&self.0.context, instance)?);
        let copied = if state.has_new_looks() { 0 } else { state.parts.bytes() };
        let more = copied + state.parts.growth(&chosen, count, colours);
        draft.pay_for_edit(&self.0.context, more)?;
        let state = draft.state(&self.0.context, instance)?;
        edit(Arc::make_mut(&mut state.parts), &mut chosen.into_iter(), count as u32);
        Ok(())
    }

    /// Resets the looks of all parts of an instance. Cheap.
    pub fn clear_part_looks(&self, instance: u64) -> Result<()> {
        let mut draft = self.draft();
        draft.model(instance)?;
        let plain = Arc::clone(&draft.plain.looks);
        draft.state(&self.0.context, instance)?.parts = plain;
        Ok(())
    }

    /// Exchanges the model of an instance, for example after it was built anew. The instance keeps its transform, mask
    /// and look, and each part the look of the part with the same id; looks of parts that the new model lacks are lost.
    /// Fails like [`Scene::add_instance`] and [`Scene::set_parts_look`].
    pub fn set_model(&self, instance: u64, model: &Model) -> Result<()> {
        if !model.context().same(&self.0.context) {
            return Err(Error::bad_argument("the model belongs to another context"));
        }
        let mut draft = self.draft();
        draft.refuse_member(instance, "given another model")?;
        let draftee = draft.instance(instance)?;
        let (before, old) = (draftee.model.clone(), Arc::clone(&draftee.state.parts));
        drop(draft);
        let looks = old.carried(&before, model);
        if !looks.hidden.is_empty() {
            model.part_sets()?;
        }
        let mut draft = self.draft();
        let plain = Arc::clone(&draft.plain.looks);
        if !Arc::ptr_eq(&draft.instance(instance)?.state.parts, &old) {
            return Err(Error::BadState(format!("the looks of instance {instance} were edited meanwhile")));
        }
        draft.pay_for_edit(&self.0.context, looks.bytes())?;
        let draftee = draft.instance(instance)?;
        draftee.state.parts = if looks.is_empty() { plain } else { Arc::new(looks) };
        draftee.model = model.clone();
        draft.moved = true;
        Ok(())
    }

    /// Replaces all lights; an empty list leaves only the ambient term. Fails with `BadArgument` for an invalid light.
    /// Cheap.
    pub fn set_lights(&self, lights: Vec<Light>) -> Result<()> {
        lights.iter().try_for_each(Light::check)?;
        self.draft().lights = lights;
        Ok(())
    }

    /// Replaces the background. Cheap.
    pub fn set_background(&self, background: Background) -> Result<()> {
        background.check()?;
        self.draft().background = background;
        Ok(())
    }

    /// Makes the edits since the last commit visible at once to jobs that begin from now on. The time grows with the
    /// number of instances, or, if only some members of arrays have moved, with their number; a commit reads no disk.
    ///
    /// Fails with `BadArgument` if there are 2³¹ instances, placed trees or scenes of its own or more, 2⁶³ with what is
    /// in scenes in it, for scenes in scenes at more than 64 levels, or for transforms of scenes that are singular
    /// together, and with `OverBudget` if the budget has no room for the placed trees, or for the looks of parts. Jobs
    /// then see the state before.
    pub fn commit(&self) -> Result<()> {
        // Dropped without the lock, as in `remove_instance`.
        let before = self.commit_draft(&mut self.draft())?;
        drop(before);
        Ok(())
    }

    /// Commits the draft; returns the state before.
    fn commit_draft(&self, draft: &mut Draft) -> Result<Arc<SceneState>> {
        // The looks are charged with what walks need to know of them.
        draft.edits = Kept::default();
        match self.next_state(draft) {
            Ok(state) => {
                (draft.moved, draft.edited) = (false, 0);
                draft.shifted.clear();
                Ok(self.0.committed.swap(Arc::new(state)))
            }
            Err(error) => {
                // There may be no room any more.
                let _ = draft.pay_for_edit(&self.0.context, 0);
                Err(error)
            }
        }
    }

    /// The state of the last commit (an empty scene before the first). Cheap.
    pub fn state(&self) -> Arc<SceneState> {
        self.0.committed.load_full()
    }

    /// [`Scene::state`] without an update of the shared reference count, for the duration of a call.
    pub(crate) fn shown(&self) -> Guard<Arc<SceneState>> {
        self.0.committed.load()
    }

    pub(super) fn draft(&self) -> MutexGuard<'_, Draft> {
        // Every step of an edit leaves a valid draft, so a poisoned lock is safe to use.
        self.0.draft.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The parts that a list of ids chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// The parts themselves.
    Own,
    /// The parts and all parts below them.
    Below,
}

/// Returns the indices of the parts that `ids` choose, ascending.
pub(super) fn choose(model: &Model, ids: &[u64], scope: Scope) -> Result<Vec<u32>> {
    let index = |&id| model.part_index(id).ok_or_else(|| Error::bad_argument(format!("the model has no part {id}")));
    let mut chosen = ids.iter().map(index).collect::<Result<Vec<u32>>>()?;
    if scope == Scope::Below {
        let mut marks = vec![false; model.parts().len()];
        chosen.iter().for_each(|&part| marks[part as usize] = true);
        // A parent comes before its children.
        for (i, part) in model.parts().iter().enumerate() {
            marks[i] |= part.parent.is_some_and(|parent| marks[parent as usize]);
        }
        return Ok((0..marks.len() as u32).filter(|&part| marks[part as usize]).collect());
    }
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
}

pub(super) fn no_instance(id: u64) -> Error {
    Error::bad_argument(format!("instance {id} does not exist"))
}

pub(super) fn check_look(state: &Look) -> Result<()> {
    let good = |c: &f32| c.is_finite() && *c >= 0.0;
    match state.colour {
        Some(colour) if !(colour.iter().all(good) && colour[3] <= 1.0) => {
            Err(Error::bad_argument("a colour must be finite and 0 or more, and its alpha at most 1"))
        }
        _ => Ok(()),
    }
}
