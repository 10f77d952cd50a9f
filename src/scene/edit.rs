//! A scene: instances, lights, states of parts; edited freely, seen by jobs only at a commit.

use super::context::Context;
use super::light::{Background, Light};
use super::model::Model;
use super::state::{SceneState, State};
use crate::base::error::{Error, Result};
use glam::DAffine3;
use std::sync::Arc;

/// Edits collect until [`Scene::commit`]; jobs in flight keep the state that they began with.
/// Thread-safe. A scene keeps its models alive.
pub struct Scene {
    context: Context,
}

impl Scene {
    /// An empty scene with a headlight.
    pub fn new(context: &Context) -> Self {
        Self { context: context.clone() }
    }

    /// The context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Adds `model`, seen through `world_from_model`, as instance `id` (the caller's own, unique in the
    /// scene). Cheap.
    ///
    /// Fails with `BadArgument` if the id is taken, the model is of another context, or the transform
    /// is singular or not finite.
    pub fn add_instance(&self, model: &Model, id: u64, world_from_model: DAffine3) -> Result<()> {
        let _ = (model, id, world_from_model);
        Err(Error::BadState("Scene::add_instance: being built".into()))
    }

    /// Removes an instance; `BadArgument` if there is none. Cheap.
    pub fn remove_instance(&self, id: u64) -> Result<()> {
        let _ = id;
        Err(Error::BadState("Scene::remove_instance: being built".into()))
    }

    /// Moves an instance. Fails like [`Scene::add_instance`]. Cheap.
    pub fn set_transform(&self, id: u64, world_from_model: DAffine3) -> Result<()> {
        let _ = (id, world_from_model);
        Err(Error::BadState("Scene::set_transform: being built".into()))
    }

    /// Which rays may see an instance: those with a common bit in their mask (all, by default). Cheap.
    pub fn set_instance_mask(&self, id: u64, mask: u32) -> Result<()> {
        let _ = (id, mask);
        Err(Error::BadState("Scene::set_instance_mask: being built".into()))
    }

    /// How an instance is shown; its parts' own states come before it, hidden is hidden in both. Cheap.
    pub fn set_instance_state(&self, id: u64, state: State) -> Result<()> {
        let _ = (id, state);
        Err(Error::BadState("Scene::set_instance_state: being built".into()))
    }

    /// How the part with id `part` of an instance is shown, the parts below it not included. Cheap.
    /// `BadArgument` if there is no such instance or part.
    pub fn set_part_state(&self, instance: u64, part: u64, state: State) -> Result<()> {
        let _ = (instance, part, state);
        Err(Error::BadState("Scene::set_part_state: being built".into()))
    }

    /// Forgets the states of all parts of an instance. Cheap.
    pub fn clear_part_states(&self, instance: u64) -> Result<()> {
        let _ = instance;
        Err(Error::BadState("Scene::clear_part_states: being built".into()))
    }

    /// Replaces all lights; none leaves the ambient term only. `BadArgument` for a bad one. Cheap.
    pub fn set_lights(&self, lights: Vec<Light>) -> Result<()> {
        let _ = lights;
        Err(Error::BadState("Scene::set_lights: being built".into()))
    }

    /// Replaces the background. Cheap.
    pub fn set_background(&self, background: Background) -> Result<()> {
        let _ = background;
        Err(Error::BadState("Scene::set_background: being built".into()))
    }

    /// Makes the edits since the last commit visible to jobs that begin from now on, all at once.
    /// Costs time by the number of instances; reads no disk.
    pub fn commit(&self) -> Result<()> {
        Err(Error::BadState("Scene::commit: being built".into()))
    }

    /// The state of the last commit (an empty scene before the first). Cheap.
    pub fn state(&self) -> Arc<SceneState> {
        Arc::new(SceneState::empty(&self.context))
    }
}
