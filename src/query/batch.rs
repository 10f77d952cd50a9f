//! Batches of rays.

use super::hit::{Hit, Want};
use crate::base::error::{Error, Result};
use crate::math::Ray;
use crate::scene::SceneState;
use std::sync::Arc;
use std::time::Duration;

/// A ray, and which instances it may see: those with a common bit in their mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayWithMask {
    /// The ray.
    pub ray: Ray,
    /// Its mask; all ones sees everything, 0 nothing.
    pub mask: u32,
}

/// Where a batch reads its rays: called from any worker, also several at once, each ray once.
pub trait Rays: Sync {
    /// Number of rays.
    fn count(&self) -> usize;
    /// Writes rays `first..first + out.len()`, all below `count`, to `out`.
    fn read(&self, first: usize, out: &mut [RayWithMask]);
}

/// Where a batch writes its answers: called from any worker, also several at once, each index once.
pub trait Hits: Sync {
    /// Takes the answers to rays `first..first + hits.len()`. For [`Query::any`] only `kind` counts.
    fn write(&self, first: usize, hits: &[Hit]);
}

/// What to do about data that is not in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Policy {
    /// Read it: the answer does not depend on what was in memory.
    #[default]
    Exact = 0,
    /// Answer at once; the hit says [`super::HitKind::Missing`].
    Now = 1,
}

/// Options of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueryOptions {
    /// Neighbouring rays are alike (of neighbouring pixels, say): they are traced in packets of 16.
    /// The answers are the same.
    pub coherent: bool,
    /// What to fill.
    pub want: Want,
    /// What to do about data that is not in memory.
    pub policy: Policy,
}

impl Default for QueryOptions {
    fn default() -> Self {
        Self { coherent: false, want: Want::ALL, policy: Policy::Exact }
    }
}

/// State of a [`Query`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum QueryState {
    /// Being answered.
    Running = 1,
    /// All answers are written.
    Done = 2,
    /// Cancelled; the answers are not to be used.
    Cancelled = 3,
    /// Failed; the answers are not to be used.
    Failed = 4,
}

/// How far a [`Query`] is.
#[derive(Debug, Clone)]
pub struct QueryStatus {
    /// Its state.
    pub state: QueryState,
    /// Fraction done, from 0 to 1, never going back.
    pub fraction: f64,
    /// Rays answered.
    pub done: u64,
    /// Rays asked.
    pub total: u64,
    /// Why it failed.
    pub error: Option<Arc<Error>>,
}

/// A batch in flight. Dropping it cancels and waits until nobody reads its rays or writes its hits.
pub struct Query {
    _private: (),
}

impl Query {
    /// Begins to find the closest hit of each ray; returns at once.
    pub fn closest(
        scene: &Arc<SceneState>,
        rays: Arc<dyn Rays + Send + Sync>,
        hits: Arc<dyn Hits + Send + Sync>,
        options: QueryOptions,
    ) -> Result<Self> {
        let _ = (scene, rays, hits, options);
        Err(Error::BadState("Query::closest: being built".into()))
    }

    /// Begins to find whether each ray hits anything: its `kind` is `Miss` or not. Returns at once.
    pub fn any(
        scene: &Arc<SceneState>,
        rays: Arc<dyn Rays + Send + Sync>,
        hits: Arc<dyn Hits + Send + Sync>,
        options: QueryOptions,
    ) -> Result<Self> {
        let _ = (scene, rays, hits, options);
        Err(Error::BadState("Query::any: being built".into()))
    }

    /// How far it is. Never blocks.
    pub fn poll(&self) -> QueryStatus {
        QueryStatus { state: QueryState::Failed, fraction: 0.0, done: 0, total: 0, error: None }
    }

    /// Waits until it has ended, `timeout` at most. Works itself where the context has no threads.
    pub fn wait(&self, timeout: Duration) -> QueryStatus {
        let _ = timeout;
        self.poll()
    }

    /// Asks it to end; takes effect within a chunk of rays.
    pub fn cancel(&self) {}

    /// Calls `wake` once when it ends (done, cancelled or failed), from any thread, never under a lock of
    /// ours; at once, here, if it has ended. Replaces an earlier one. `None`: nobody is called.
    pub fn set_wake(&self, wake: Option<Arc<dyn Fn() + Send + Sync>>) {
        let _ = wake;
    }
}

impl SceneState {
    /// Finds the closest hit of each ray. Blocks; may read the disk. Thread-safe.
    ///
    /// A ray whose direction is zero or not finite, or whose origin is not finite, misses.
    /// Fails with `BadArgument` if the lengths differ, or with what reading the disk gave; then `hits` are
    /// not to be used.
    pub fn closest(&self, rays: &[Ray], options: QueryOptions, hits: &mut [Hit]) -> Result<()> {
        let _ = (rays, options, hits);
        Err(Error::BadState("SceneState::closest: being built".into()))
    }

    /// Writes 1 for each ray that hits anything within its interval, else 0. Like
    /// [`SceneState::closest`] otherwise.
    pub fn any(&self, rays: &[Ray], options: QueryOptions, hits: &mut [u8]) -> Result<()> {
        let _ = (rays, options, hits);
        Err(Error::BadState("SceneState::any: being built".into()))
    }

    /// [`SceneState::closest`] from any source of rays to any taker of hits, without copies. Blocks.
    pub fn closest_batch(&self, rays: &dyn Rays, hits: &dyn Hits, options: QueryOptions) -> Result<()> {
        let _ = (rays, hits, options);
        Err(Error::BadState("SceneState::closest_batch: being built".into()))
    }

    /// [`SceneState::any`] from any source of rays to any taker of hits, without copies. Blocks.
    pub fn any_batch(&self, rays: &dyn Rays, hits: &dyn Hits, options: QueryOptions) -> Result<()> {
        let _ = (rays, hits, options);
        Err(Error::BadState("SceneState::any_batch: being built".into()))
    }
}
