//! A scene: instances, lights and looks of parts. Edits are free at any time; jobs see them only after a commit.

use super::context::Context;
use super::light::{Background, Light};
use super::model::Model;
use super::placed::{Placed, check_transform};
use super::state::{Instance, Look, PartLooks, Placement, SceneState};
use super::top::TopTree;
use crate::base::error::{Error, Result};
use crate::math::DBounds;
use arc_swap::{ArcSwap, Guard};
use glam::{DAffine3, DMat3, DVec3};
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
}

#[derive(Clone)]
struct Draftee {
    id: u64,
    model: Model,
    world_from_model: DAffine3,
    mask: u32,
    look: Look,
    parts: Arc<PartLooks>,
}

impl Scene {
    /// An empty scene with a headlight.
    pub fn new(context: &Context) -> Self {
        let lights = vec![Light::HEADLIGHT];
        let background = Background::default();
        let committed = ArcSwap::from_pointee(SceneState {
            see_through: false,
            context: context.clone(),
            models: Vec::new(),
            instances: Vec::new(),
            placement: Arc::default(),
            lights: lights.clone(),
            background,
        });
        let (instances, index) = (Vec::new(), HashMap::new());
        let draft = Draft { instances, index, lights, background, moved: false };
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
    /// or not finite.
    pub fn add_instance(&self, model: &Model, id: u64, world_from_model: DAffine3) -> Result<()> {
        if !model.context().same(&self.context) {
            return Err(Error::bad_argument("the model belongs to another context"));
        }
        check_transform(&world_from_model)?;
        let mut draft = self.draft();
        if draft.index.contains_key(&id) {
            return Err(Error::bad_argument(format!("instance {id} already exists")));
        }
        let (mask, look, parts) = (u32::MAX, Look::default(), Arc::default());
        let at = draft.instances.len();
        draft.instances.push(Some(Draftee { id, model: model.clone(), world_from_model, mask, look, parts }));
        draft.index.insert(id, at);
        draft.moved = true;
        Ok(())
    }

    /// Removes an instance; fails with `BadArgument` if there is none. Cheap.
    pub fn remove_instance(&self, id: u64) -> Result<()> {
        let mut draft = self.draft();
        let at = draft.index.remove(&id).ok_or_else(|| no_instance(id))?;
        draft.instances[at] = None;
        draft.moved = true;
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

    /// Sets the look of an instance's part with id `part`, without the parts below it. Where several parts share the
    /// id, it applies to the first. Cheap. Fails with `BadArgument` if there is no such instance or part.
    pub fn set_part_look(&self, instance: u64, part: u64, look: Look) -> Result<()> {
        check_look(&look)?;
        let mut draft = self.draft();
        let instance = draft.instance(instance)?;
        let index = instance.model.part_index(part);
        let index = index.ok_or_else(|| Error::bad_argument(format!("the model has no part {part}")))?;
        Arc::make_mut(&mut instance.parts).set(index, look);
        Ok(())
    }

    /// Resets the looks of all parts of an instance. Cheap.
    pub fn clear_part_looks(&self, instance: u64) -> Result<()> {
        self.draft().instance(instance)?.parts = Arc::default();
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
    /// Fails with `BadArgument`, and changes nothing, if there are more than 2³¹ placed trees.
    pub fn commit(&self) -> Result<()> {
        let mut draft = self.draft();
        let draft = &mut *draft;
        draft.instances.retain(Option::is_some);
        let kept = || draft.instances.iter().flatten();
        draft.index = kept().enumerate().map(|(i, instance)| (instance.id, i)).collect();
        let mut models: Vec<Model> = Vec::new();
        let mut instances = Vec::with_capacity(draft.instances.len());
        for it in kept() {
            let known = models.iter().position(|m| m.same(&it.model));
            let model = known.unwrap_or_else(|| {
                models.push(it.model.clone());
                models.len() - 1
            }) as u32;
            let Draftee { id, world_from_model, mask, look, .. } = *it;
            let parts = Arc::clone(&it.parts);
            instances.push(Instance { id, model, world_from_model, mask, look, parts });
        }
        let placement = if draft.moved {
            Arc::new(place(kept(), &instances)?)
        } else {
            Arc::clone(&self.committed.load().placement)
        };
        let see_through = models.iter().any(Model::see_through)
            || instances.iter().any(|i| i.look.see_through() || i.parts.see_through());
        self.committed.store(Arc::new(SceneState {
            see_through,
            context: self.context.clone(),
            models,
            instances,
            placement,
            lights: draft.lights.clone(),
            background: draft.background,
        }));
        draft.moved = false;
        Ok(())
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

impl Draft {
    fn instance(&mut self, id: u64) -> Result<&mut Draftee> {
        let at = self.index.get(&id);
        at.and_then(|&at| self.instances[at].as_mut()).ok_or_else(|| no_instance(id))
    }
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

/// Flattens instances and their models' own assemblies, and builds the top tree over them.
fn place<'a>(draftees: impl Iterator<Item = &'a Draftee>, instances: &[Instance]) -> Result<Placement> {
    let (mut placed, mut hits) = (Vec::new(), Vec::new());
    for (i, (draftee, instance)) in draftees.zip(instances).enumerate() {
        let trees = draftee.model.trees();
        let mut add = |tree: u32, first_part: u32, world_from_mesh: &DAffine3| {
            let ids = [instance.model, tree, i as u32, first_part];
            if let Some(t) = trees.get(tree as usize).filter(|t| !t.bounds.is_empty()) {
                let it = Placed::new(t, ids, world_from_mesh);
                hits.push(it.hit_bounds(t));
                placed.push(it);
            }
        };
        add(0, 0, &draftee.world_from_model);
        for row in draftee.model.assembly() {
            let m = &row.world_from_mesh;
            let column = |c: usize| DVec3::new(m[3 * c], m[3 * c + 1], m[3 * c + 2]);
            let linear = DMat3::from_cols(column(0), column(1), column(2));
            let model_from_mesh = DAffine3 { matrix3: linear, translation: column(3) };
            add(row.tree, row.first_part, &(draftee.world_from_model * model_from_mesh));
        }
    }
    if placed.len() >= 1 << 31 {
        return Err(Error::bad_argument("a scene must have fewer than 2^31 placed trees"));
    }
    let around = placed.iter().fold(DBounds::EMPTY, |all, p| all.union(p.bounds));
    Ok(Placement { bounds: around, top: TopTree::build(&hits), placed })
}
