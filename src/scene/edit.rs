//! A scene: instances, lights and looks of parts. Edits are free at any time; jobs see them only after a commit.

use super::array::{Array, Instances};
use super::context::Context;
use super::light::{Background, Light};
use super::looks::{self, Look, PartLooks, PartsShown};
use super::model::Model;
use super::placed::check_transform;
use super::state::{InstanceState, SceneState};
use crate::base::error::{Error, Result};
use crate::residency::Kept;
use arc_swap::{ArcSwap, Guard};
use glam::DAffine3;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A scene that collects edits until [`Scene::commit`]. Jobs in flight keep the state that they began with.
/// Thread-safe. A scene keeps its models alive.
pub struct Scene {
    context: Context,
    draft: Mutex<Draft>,
    /// The state changes under the lock of the draft. Each query call reads it without the lock.
    committed: ArcSwap<SceneState>,
}

/// The content of the next commit.
pub(super) struct Draft {
    /// In the order added; removed instances leave `None` until the next commit.
    pub(super) instances: Vec<Option<Draftee>>,
    /// Index in `instances` of each id.
    index: HashMap<u64, usize>,
    pub(super) arrays: Vec<DraftArray>,
    pub(super) lights: Vec<Light>,
    pub(super) background: Background,
    /// True if an instance was moved, added or removed since the last commit.
    pub(super) moved: bool,
    /// The looks of instances whose parts look as in the file.
    plain: Arc<PartsShown>,
    /// Number of instances that `memory` pays for.
    paid: usize,
    memory: Kept,
    /// Bytes of looks of parts that were edited since the last commit, and their charge.
    edited: u64,
    edits: Kept,
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

/// An array of instances in the next commit.
pub(super) struct DraftArray {
    pub array: Arc<Array>,
    pub models: Vec<Model>,
    /// The state of members that have none of their own.
    pub common: DraftState,
    pub own: HashMap<u32, DraftState>,
    /// For the array, and for the states of its own.
    memory: Kept,
}

impl Scene {
    /// An empty scene with a headlight.
    pub fn new(context: &Context) -> Self {
        let lights = vec![Light::HEADLIGHT];
        let background = Background::default();
        let committed = ArcSwap::from_pointee(SceneState {
            see_through: false,
            hides_parts: false,
            context: context.clone(),
            models: Vec::new(),
            singles: Vec::new(),
            arrays: Vec::new(),
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
            lights,
            background,
            moved: false,
            plain: Arc::default(),
            paid: 0,
            memory: Kept::default(),
            edited: 0,
            edits: Kept::default(),
        };
        Self { context: context.clone(), draft: Mutex::new(draft), committed }
    }

    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Adds `model`, transformed by `world_from_model`, as instance `id` (chosen by the caller, unique in the scene).
    /// Cheap.
    ///
    /// Fails with `BadArgument` if the id is taken, the model belongs to another context, or the transform is singular
    /// or not finite, and with `OverBudget` if there is no room for another instance.
    pub fn add_instance(&self, model: &Model, id: u64, world_from_model: DAffine3) -> Result<()> {
        if !model.context().same(&self.context) {
            return Err(Error::bad_argument("the model belongs to another context"));
        }
        check_transform(&world_from_model)?;
        let mut draft = self.draft();
        draft.check_new(id, 1)?;
        draft.pay_for_another(&self.context)?;
        let (state, at) = (DraftState::plain(&draft.plain), draft.instances.len());
        draft.instances.push(Some(Draftee { id, model: model.clone(), world_from_model, state }));
        draft.index.insert(id, at);
        draft.moved = true;
        Ok(())
    }

    /// Adds many instances of a few models, with consecutive ids. Each takes the memory of its transform and of its
    /// place in the tree over all; what only some of them have, such as a look, takes more for these alone. Their
    /// transforms are checked, which takes a fraction of a microsecond each.
    ///
    /// Fails with `BadArgument` if an id is taken, a model belongs to another context, an index or a transform is wrong
    /// (the error names the first), and with `OverBudget`. After a failure nothing was added.
    pub fn add_instances(&self, instances: &Instances) -> Result<()> {
        if !instances.prototypes.iter().all(|model| model.context().same(&self.context)) {
            return Err(Error::bad_argument("a prototype belongs to another context"));
        }
        let array = Arc::new(Array::new(instances)?);
        let memory = self.context.residency().keep("an array of instances", array.bytes())?;
        let mut draft = self.draft();
        draft.check_new(array.first_id, array.len().into())?;
        let common = DraftState { mask: instances.mask, ..DraftState::plain(&draft.plain) };
        let models = instances.prototypes.clone();
        draft.arrays.push(DraftArray { array, models, common, own: HashMap::new(), memory });
        draft.moved = true;
        Ok(())
    }

    /// Removes all instances that were added together, the first with the id `first_id`. Fails with `BadArgument` if
    /// there are none. Cheap.
    pub fn remove_instances(&self, first_id: u64) -> Result<()> {
        let removed = {
            let mut draft = self.draft();
            let at = draft.arrays.iter().position(|it| it.array.first_id == first_id);
            let at = at.ok_or_else(|| Error::bad_argument(format!("no array of instances begins with {first_id}")))?;
            draft.moved = true;
            draft.arrays.remove(at)
        };
        drop(removed);
        Ok(())
    }

    /// Removes an instance; fails with `BadArgument` if there is none, or if it is of an array. Cheap.
    pub fn remove_instance(&self, id: u64) -> Result<()> {
        // The last reference of a model closes its source: functions of the host are called without the lock.
        let removed = {
            let mut draft = self.draft();
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
        match draft.member(id) {
            Some((array, member)) => Arc::make_mut(&mut draft.arrays[array].array).set(member, world_from_model)?,
            None => draft.instance(id)?.world_from_model = world_from_model,
        }
        draft.moved = true;
        Ok(())
    }

    /// Sets the mask of an instance: it is visible to rays with a common bit in their masks. By default all bits are
    /// set. Cheap.
    pub fn set_instance_mask(&self, id: u64, mask: u32) -> Result<()> {
        self.draft().state(&self.context, id)?.mask = mask;
        Ok(())
    }

    /// Sets the look of an instance. Looks of its parts have precedence, except that a part is hidden if either look
    /// hides it. Cheap.
    pub fn set_instance_look(&self, id: u64, look: Look) -> Result<()> {
        check_look(&look)?;
        self.draft().state(&self.context, id)?.look = look;
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
        let (count, state) = (model.parts().len(), draft.state(&self.context, instance)?);
        let copied = if state.has_new_looks() { 0 } else { state.parts.bytes() };
        let more = copied + state.parts.growth(&chosen, count, colours);
        draft.pay_for_edit(&self.context, more)?;
        let state = draft.state(&self.context, instance)?;
        edit(Arc::make_mut(&mut state.parts), &mut chosen.into_iter(), count as u32);
        Ok(())
    }

    /// Resets the looks of all parts of an instance. Cheap.
    pub fn clear_part_looks(&self, instance: u64) -> Result<()> {
        let mut draft = self.draft();
        let plain = Arc::clone(&draft.plain.looks);
        draft.state(&self.context, instance)?.parts = plain;
        Ok(())
    }

    /// Exchanges the model of an instance, for example after it was built anew. The instance keeps its transform, mask
    /// and look, and each part the look of the part with the same id; looks of parts that the new model lacks are lost.
    /// Fails like [`Scene::add_instance`] and [`Scene::set_parts_look`].
    pub fn set_model(&self, instance: u64, model: &Model) -> Result<()> {
        if !model.context().same(&self.context) {
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
        draft.pay_for_edit(&self.context, looks.bytes())?;
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
    /// number of instances; a commit reads no disk.
    ///
    /// Fails with `BadArgument` if there are more than 2³¹ placed trees, and with `OverBudget` if the budget has no
    /// room for the placed trees, or for the looks of parts. Jobs then see the state before.
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
                Ok(self.committed.swap(Arc::new(state)))
            }
            Err(error) => {
                // There may be no room any more.
                let _ = draft.pay_for_edit(&self.context, 0);
                Err(error)
            }
        }
    }

    /// The state of the last commit (an empty scene before the first). Cheap.
    pub fn state(&self) -> Arc<SceneState> {
        self.committed.load_full()
    }

    /// [`Scene::state`] without an update of the shared reference count, for the duration of a call.
    pub(crate) fn shown(&self) -> Guard<Arc<SceneState>> {
        self.committed.load()
    }

    fn draft(&self) -> MutexGuard<'_, Draft> {
        // Every step of an edit leaves a valid draft, so a poisoned lock is safe to use.
        self.draft.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl DraftArray {
    /// True if each member has one tree.
    pub fn has_one_each(&self) -> bool {
        self.models.iter().all(|model| model.placements().count() == 1)
    }
}

impl DraftState {
    fn plain(plain: &Arc<PartsShown>) -> Self {
        let (shown, parts) = (Arc::clone(plain), Arc::clone(&plain.looks));
        Self { mask: u32::MAX, look: Look::default(), parts, shown }
    }

    pub fn committed(&self) -> InstanceState {
        InstanceState { mask: self.mask, look: self.look, parts: Arc::clone(&self.shown) }
    }

    /// True if looks of parts were edited since the last commit.
    pub fn has_new_looks(&self) -> bool {
        !Arc::ptr_eq(&self.parts, &self.shown.looks)
    }
}

/// Bytes of the state of a member of its own. The table may be half empty.
const OWN: usize = 2 * (size_of::<(u32, DraftState)>() + size_of::<(u32, InstanceState)>() + 2);

impl Draft {
    pub(super) fn draftees(&self) -> impl Iterator<Item = &Draftee> + Clone {
        self.instances.iter().flatten()
    }

    /// All states, with the models of those that have looks of parts of their own.
    pub(super) fn states(&mut self) -> impl Iterator<Item = (&Model, &mut DraftState)> {
        let singles = self.instances.iter_mut().flatten().map(|it| (&it.model, &mut it.state));
        let members = self.arrays.iter_mut().flat_map(|it| {
            let DraftArray { array, models, own, .. } = it;
            own.iter_mut().map(|(&member, state)| (&models[array.prototype_of(member) as usize], state))
        });
        singles.chain(members)
    }

    /// Fails if one of `count` ids from `first` on is taken.
    fn check_new(&self, first: u64, count: u64) -> Result<()> {
        let last = first + (count - 1);
        let of_array = |it: &DraftArray| {
            let from = it.array.first_id;
            let to = from + u64::from(it.array.len() - 1);
            (from <= last && first <= to).then_some(from.max(first))
        };
        let single = || {
            if count <= self.index.len() as u64 {
                return (first..=last).find(|id| self.index.contains_key(id));
            }
            self.index.keys().copied().filter(|id| (first..=last).contains(id)).min()
        };
        match self.arrays.iter().find_map(of_array).or_else(single) {
            Some(id) => Err(Error::bad_argument(format!("instance {id} already exists"))),
            None => Ok(()),
        }
    }

    /// The array that an id is of, and its member.
    fn member(&self, id: u64) -> Option<(usize, u32)> {
        self.arrays.iter().enumerate().find_map(|(i, it)| Some((i, it.array.member(id)?)))
    }

    fn refuse_member(&self, id: u64, what: &str) -> Result<()> {
        match self.member(id) {
            Some(_) => Err(Error::bad_argument(format!("instance {id} is of an array, and cannot be {what}"))),
            None => Ok(()),
        }
    }

    /// The model of an instance.
    fn model(&mut self, id: u64) -> Result<&Model> {
        if let Some((array, member)) = self.member(id) {
            let it = &self.arrays[array];
            return Ok(&it.models[it.array.prototype_of(member) as usize]);
        }
        Ok(&self.instance(id)?.model)
    }

    /// The state of an instance, to be edited. A member of an array gets one of its own.
    fn state(&mut self, context: &Context, id: u64) -> Result<&mut DraftState> {
        let Some((array, member)) = self.member(id) else { return Ok(&mut self.instance(id)?.state) };
        let it = &mut self.arrays[array];
        if !it.own.contains_key(&member) {
            let bytes = it.array.bytes() + ((it.own.len() + 1) * OWN) as u64;
            it.memory.grow_to(context.residency(), looks::WHAT, bytes)?;
        }
        Ok(it.own.entry(member).or_insert_with(|| it.common.clone()))
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
    fn pay_for_another(&mut self, context: &Context) -> Result<()> {
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
    fn pay_for_edit(&mut self, context: &Context, more: u64) -> Result<()> {
        self.edits.grow_to(context.residency(), looks::WHAT, self.edited + more)?;
        self.edited += more;
        Ok(())
    }

    fn instance(&mut self, id: u64) -> Result<&mut Draftee> {
        let at = self.index.get(&id);
        at.and_then(|&at| self.instances[at].as_mut()).ok_or_else(|| no_instance(id))
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

fn no_instance(id: u64) -> Error {
    Error::bad_argument(format!("instance {id} does not exist"))
}

fn check_look(state: &Look) -> Result<()> {
    let good = |c: &f32| c.is_finite() && *c >= 0.0;
    match state.colour {
        Some(colour) if !(colour.iter().all(good) && colour[3] <= 1.0) => {
            Err(Error::bad_argument("a colour must be finite and 0 or more, and its alpha at most 1"))
        }
        _ => Ok(()),
    }
}
