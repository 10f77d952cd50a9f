//! A scene: instances, lights and looks of parts. Edits are free at any time; jobs see them only after a commit.

use super::context::Context;
use super::light::{Background, Light};
use super::looks::{self, Look, PartLooks, PartsShown};
use super::model::Model;
use super::placed::{Placed, check_transform};
use super::state::{Instance, Placement, SceneState};
use super::top::TopTree;
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::math::DBounds;
use crate::residency::{Kept, UNCOUNTED, counted};
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
struct Draft {
    /// In the order added; removed instances leave `None` until the next commit.
    instances: Vec<Option<Draftee>>,
    /// Index in `instances` of each id.
    index: HashMap<u64, usize>,
    lights: Vec<Light>,
    background: Background,
    /// True if an instance was moved, added or removed since the last commit.
    moved: bool,
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
struct Draftee {
    id: u64,
    model: Model,
    world_from_model: DAffine3,
    mask: u32,
    look: Look,
    parts: Arc<PartLooks>,
    /// Of the last commit.
    shown: Arc<PartsShown>,
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
            instances: Vec::new(),
            placement: Arc::default(),
            lights: lights.clone(),
            background,
            _memory: Kept::default(),
        });
        let (instances, index) = (Vec::new(), HashMap::new());
        let draft = Draft {
            instances,
            index,
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
        if draft.index.contains_key(&id) {
            return Err(Error::bad_argument(format!("instance {id} already exists")));
        }
        draft.pay_for_another(&self.context)?;
        let (mask, look, shown) = (u32::MAX, Look::default(), Arc::clone(&draft.plain));
        let parts = Arc::clone(&shown.looks);
        let at = draft.instances.len();
        draft.instances.push(Some(Draftee { id, model: model.clone(), world_from_model, mask, look, parts, shown }));
        draft.index.insert(id, at);
        draft.moved = true;
        Ok(())
    }

    /// Removes an instance; fails with `BadArgument` if there is none. Cheap.
    pub fn remove_instance(&self, id: u64) -> Result<()> {
        // The last reference of a model closes its source: functions of the host are called without the lock.
        let removed = {
            let mut draft = self.draft();
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
        draft.instance(id)?.world_from_model = world_from_model;
        draft.moved = true;
        Ok(())
    }

    /// Sets the mask of an instance: it is visible to rays with a common bit in their masks. By default all bits are
    /// set. Cheap.
    pub fn set_instance_mask(&self, id: u64, mask: u32) -> Result<()> {
        self.draft().instance(id)?.mask = mask;
        Ok(())
    }

    /// Sets the look of an instance. Looks of its parts have precedence, except that a part is hidden if either look
    /// hides it. Cheap.
    pub fn set_instance_look(&self, id: u64, look: Look) -> Result<()> {
        check_look(&look)?;
        self.draft().instance(id)?.look = look;
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
        let model = self.draft().instance(instance)?.model.clone();
        let chosen = choose(&model, parts, scope)?;
        if hides {
            model.part_sets()?;
        }
        let mut draft = self.draft();
        let draftee = draft.instance(instance)?;
        if !draftee.model.same(&model) {
            return Err(Error::BadState(format!("the model of instance {instance} was exchanged meanwhile")));
        }
        let count = model.parts().len();
        let copied = if draftee.has_new_looks() { 0 } else { draftee.parts.bytes() };
        let more = copied + draftee.parts.growth(&chosen, count, colours);
        draft.pay_for_edit(&self.context, more)?;
        let draftee = draft.instance(instance)?;
        edit(Arc::make_mut(&mut draftee.parts), &mut chosen.into_iter(), count as u32);
        Ok(())
    }

    /// Resets the looks of all parts of an instance. Cheap.
    pub fn clear_part_looks(&self, instance: u64) -> Result<()> {
        let mut draft = self.draft();
        let plain = Arc::clone(&draft.plain.looks);
        draft.instance(instance)?.parts = plain;
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
        let draftee = draft.instance(instance)?;
        let (before, old) = (draftee.model.clone(), Arc::clone(&draftee.parts));
        drop(draft);
        let looks = old.carried(&before, model);
        if !looks.hidden.is_empty() {
            model.part_sets()?;
        }
        let mut draft = self.draft();
        let plain = Arc::clone(&draft.plain.looks);
        if !Arc::ptr_eq(&draft.instance(instance)?.parts, &old) {
            return Err(Error::BadState(format!("the looks of instance {instance} were edited meanwhile")));
        }
        draft.pay_for_edit(&self.context, looks.bytes())?;
        let draftee = draft.instance(instance)?;
        draftee.parts = if looks.is_empty() { plain } else { Arc::new(looks) };
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

    fn next_state(&self, draft: &mut Draft) -> Result<SceneState> {
        draft.close_gaps();
        let bytes = (draft.instances.len() * size_of::<Instance>()) as u64;
        let placing = if draft.moved { Placing::of(draft.draftees())? } else { Placing::default() };
        let of_looks = |it: &Draftee| {
            if it.has_new_looks() { PartsShown::bytes(&it.model, &it.parts) } else { it.shown.took }
        };
        // Only little memory is not counted.
        let counts = draft.draftees().map(of_looks).sum::<u64>() > UNCOUNTED;
        // The sum of all, so that the error names a budget that suffices for the whole commit.
        let new_looks: u64 = draft.draftees().filter(|it| counts && it.has_new_looks()).map(of_looks).sum();
        let needs = new_looks + counted(bytes) + counted(placing.bytes(draft.instances.len()));
        self.context.residency().check_room("a scene", needs)?;
        // Blocks are searched anew only where looks of parts have changed.
        for it in draft.instances.iter_mut().flatten().filter(|it| it.has_new_looks()) {
            it.shown = Arc::new(PartsShown::of(&it.model, &it.parts, counts)?);
        }
        let kept = || draft.draftees();
        let mut models: Vec<Model> = Vec::new();
        let memory = self.context.residency().keep("the instances of a scene", bytes)?;
        let mut instances = room(draft.instances.len(), "the instances of a scene")?;
        for it in kept() {
            let known = models.iter().position(|m| m.same(&it.model));
            let model = known.unwrap_or_else(|| {
                models.push(it.model.clone());
                models.len() - 1
            }) as u32;
            let Draftee { id, world_from_model, mask, look, .. } = *it;
            let parts = Arc::clone(&it.shown);
            instances.push(Instance { id, model, world_from_model, mask, look, parts });
        }
        let placement = if draft.moved {
            Arc::new(placing.place(&self.context, kept(), &instances)?)
        } else {
            Arc::clone(&self.committed.load().placement)
        };
        let see_through = models.iter().any(Model::see_through)
            || instances.iter().any(|i| i.look.see_through() || i.parts.looks.see_through());
        let hides_parts = instances.iter().any(|i| !i.parts.trees.is_empty());
        Ok(SceneState {
            see_through,
            hides_parts,
            context: self.context.clone(),
            models,
            instances,
            placement,
            lights: draft.lights.clone(),
            background: draft.background,
            _memory: memory,
        })
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

impl Draftee {
    /// True if looks of parts were edited since the last commit.
    fn has_new_looks(&self) -> bool {
        !Arc::ptr_eq(&self.parts, &self.shown.looks)
    }
}

impl Draft {
    fn draftees(&self) -> impl Iterator<Item = &Draftee> + Clone {
        self.instances.iter().flatten()
    }

    /// Removes the gaps that removed instances left.
    fn close_gaps(&mut self) {
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

/// The trees to be placed: those of the instances' models and of these models' own assemblies.
#[derive(Default)]
struct Placing {
    /// Number of trees.
    count: usize,
}

impl Placing {
    /// Bytes of a placed tree.
    const BYTES_EACH: usize = size_of::<Placed>() + size_of::<DBounds>() + TopTree::BYTES_EACH;

    /// Counts the trees.
    fn of<'a>(draftees: impl Iterator<Item = &'a Draftee>) -> Result<Self> {
        let count: usize = draftees.map(|draftee| draftee.model.placements().count()).sum();
        if count >= 1 << 31 {
            return Err(Error::bad_argument("a scene must have fewer than 2^31 placed trees"));
        }
        Ok(Self { count })
    }

    /// Bytes of memory for the trees of so many instances.
    fn bytes(&self, instances: usize) -> u64 {
        if self.count == 0 { 0 } else { (self.count * Self::BYTES_EACH + size_of::<u32>() * instances) as u64 }
    }

    /// Places the trees, and builds the top tree over them.
    fn place<'a>(
        &self,
        context: &Context,
        draftees: impl Iterator<Item = &'a Draftee>,
        instances: &[Instance],
    ) -> Result<Placement> {
        let (what, count) = ("the placed trees of a scene", self.count);
        let mut memory = context.residency().keep(what, self.bytes(instances.len()))?;
        let (mut placed, mut hits, mut firsts) = (room(count, what)?, room(count, what)?, room(instances.len(), what)?);
        for (i, (draftee, instance)) in draftees.zip(instances).enumerate() {
            firsts.push(placed.len() as u32);
            let trees = draftee.model.trees();
            for (tree, first_part, model_from_mesh) in draftee.model.placements() {
                let ids = [instance.model, tree, i as u32, first_part];
                let it = Placed::new(&trees[tree as usize], ids, &(draftee.world_from_model * model_from_mesh));
                hits.push(it.hit_bounds(&trees[tree as usize]));
                placed.push(it);
            }
        }
        let around = placed.iter().fold(DBounds::EMPTY, |all, p| all.union(p.bounds));
        let top = TopTree::build(&hits)?;
        drop(hits);
        // The boxes are needed for the tree only.
        memory.shrink_to(self.bytes(instances.len()) - (count * size_of::<DBounds>()) as u64);
        Ok(Placement { bounds: around, top, placed, firsts, _memory: memory })
    }
}
