//! Looks of single occurrences: of an instance in one of the places of the scene that it is in.

use super::edit::{Scene, check_look};
use super::looks::{Look, WHAT};
use super::state::{InstanceIds, InstanceState, SceneState, States};
use crate::base::error::{Error, Result};
use crate::residency::{Kept, Residency};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// The looks of occurrences in the next commit, by the ids on the way: these stay when numbers change.
#[derive(Default)]
pub(super) struct OccurrenceLooks {
    looks: BTreeMap<Vec<u64>, Look>,
    /// Number of ids of all ways.
    ids: usize,
    memory: Kept,
}

/// Bytes of an entry with its id, in the draft and in the state of a commit. Tables may be half empty.
const EACH: usize = 2 * (size_of::<(Vec<u64>, Look)>() + size_of::<(u64, InstanceState)>() + 2);

impl OccurrenceLooks {
    /// Sets or, if it changes nothing, removes a look.
    fn set(&mut self, path: Vec<u64>, look: Look, residency: &Residency) -> Result<()> {
        if look == Look::default() {
            if self.looks.remove(&path).is_some() {
                self.ids -= path.len();
                self.memory.shrink_to(self.bytes());
            }
            return Ok(());
        }
        let more = EACH + path.len() * size_of::<u64>();
        self.memory.grow_to(residency, WHAT, self.bytes() + more as u64)?;
        let length = path.len();
        if self.looks.insert(path, look).is_none() {
            self.ids += length;
        }
        Ok(())
    }

    fn bytes(&self) -> u64 {
        (self.looks.len() * EACH + self.ids * size_of::<u64>()) as u64
    }

    /// Forgets those that lead nowhere in a state, and returns the states of the others by the numbers of the
    /// instances.
    pub fn states(&mut self, state: &SceneState) -> BTreeMap<u64, InstanceState> {
        let (mut ways, mut all) = (Ways::default(), BTreeMap::new());
        self.looks.retain(|path, look| {
            let instance = ways.instance(state, path);
            all.extend(instance.map(|instance| (instance, state.state_of(instance).over(*look))));
            instance.is_some()
        });
        self.ids = self.looks.keys().map(Vec::len).sum();
        self.memory.shrink_to(self.bytes());
        all
    }
}

impl InstanceState {
    /// The state with a look of its own under it: the look's colour has precedence.
    fn over(&self, look: Look) -> Self {
        let own = Self { mask: u32::MAX, look, parts: Arc::clone(&self.parts) };
        States::under_one(&own, self)
    }
}

/// Finds instances by the ids on the way to them.
#[derive(Default)]
struct Ways<'a> {
    /// Of each scene on a way.
    ids: HashMap<*const SceneState, InstanceIds<'a>>,
}

impl<'a> Ways<'a> {
    /// The number of an instance; `None`: the way leads to none.
    fn instance(&mut self, state: &'a SceneState, path: &[u64]) -> Option<u64> {
        let (mut scene, mut before) = (state, 0);
        let (last, scenes) = path.split_last()?;
        for id in scenes {
            let inner = scene.inner_of(self.with(scene, *id)?)?;
            (scene, before) = (inner.scene, before + inner.first_instance);
        }
        let instance = self.with(scene, *last)?;
        scene.inner_of(instance).is_none().then_some(before + instance)
    }

    /// The first instance with an id.
    fn with(&mut self, scene: &'a SceneState, id: u64) -> Option<u64> {
        self.ids.entry(scene).or_insert_with(|| scene.instance_ids()).with(id).next()
    }
}

impl Scene {
    /// Sets the look of one occurrence of an instance, by its number since the last commit
    /// ([`crate::query::Hit::occurrence`]). It has all parts of the instance in that place, and no other place of it. A
    /// colour has precedence over those of the instance and of the scenes around it, but not over those of parts; what
    /// one of them hides or highlights stays so. The default look removes it. The ids on the way are remembered: later
    /// commits keep the look as long as they lead to an instance. For an instance that is in no other scene the call is
    /// [`Scene::set_instance_look`]. Takes effect with the next commit.
    ///
    /// Fails with `BadArgument` if the scene has no such occurrence or the look is wrong, and with `OverBudget`.
    pub fn set_occurrence_look(&self, occurrence: u64, look: Look) -> Result<()> {
        check_look(&look)?;
        let Some((path, _)) = self.state().path(occurrence) else {
            return Err(Error::BadArgument(format!("the scene has no occurrence {occurrence}")));
        };
        match path[..] {
            [id] => self.set_instance_look(id, look),
            _ => self.draft().occurrences.set(path, look, self.context().residency()),
        }
    }
}
