//! Batches as jobs in rounds: rays that meet a missing block are parked with their walks, the blocks
//! fetched, the rays resumed. The answer does not depend on what was in memory.

use super::batch::{Hits, Policy, QueryOptions, Rays};
use super::chunk::{CHUNK, Chunk, Group, Task};
use super::hit::{Hit, Want};
use crate::base::error::Result;
use crate::base::tasks::{Ending, Work};
use crate::scene::SceneState;
use crate::scene::walk::{Need, SceneView, Snapshots, fetch};
use crate::structure::bvh::trace::PACKET;
use std::borrow::Borrow;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Called when a batch has ended.
pub(super) type Wake = Arc<dyn Fn() + Send + Sync>;

/// What is known of a batch from outside.
#[derive(Default)]
pub(super) struct Shared {
    answered: AtomicU64,
    end: Mutex<(Option<Ending>, Option<Wake>)>,
}

impl Shared {
    /// Rays answered so far.
    pub fn answered(&self) -> u64 {
        self.answered.load(Relaxed)
    }

    /// How it ended; `None` while it runs.
    pub fn ending(&self) -> Option<Ending> {
        self.end().0.clone()
    }

    /// Whom to call at the end; at once if that was before.
    pub fn set_wake(&self, wake: Option<Wake>) {
        let mut end = self.end();
        if end.0.is_none() {
            end.1 = wake;
        } else if let Some(wake) = wake {
            drop(end);
            wake();
        }
    }

    fn ended(&self, ending: &Ending) {
        let wake = {
            let mut end = self.end();
            end.0 = Some(ending.clone());
            end.1.take()
        };
        if let Some(wake) = wake {
            wake();
        }
    }

    fn end(&self) -> MutexGuard<'_, (Option<Ending>, Option<Wake>)> {
        self.end.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A batch of closest hits, or of any hits if `ANY`.
pub(super) struct Batch<S, R, H, const ANY: bool> {
    pub scene: S,
    rays: R,
    hits: H,
    options: QueryOptions,
    count: usize,
    shared: Arc<Shared>,
    rounds: Mutex<Rounds>,
}

struct Rounds {
    snapshots: Arc<Snapshots>,
    /// Of the present round: groups to resume; empty in the first, where items are chunks of rays.
    resuming: Vec<Option<Group>>,
    first: bool,
    /// For the next round.
    parked: Vec<Group>,
    needs: Vec<Need>,
}

impl<S, R, H, const ANY: bool> Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    /// Of `rays`, answers to `hits`.
    pub fn new(scene: S, rays: R, hits: H, options: QueryOptions) -> Self {
        let rounds = Rounds {
            snapshots: Arc::new(Snapshots::take(scene.borrow())),
            resuming: Vec::new(),
            first: true,
            parked: Vec::new(),
            needs: Vec::new(),
        };
        let count = rays.count();
        Self { scene, rays, hits, options, count, shared: Arc::default(), rounds: Mutex::new(rounds) }
    }

    /// Items of the first round.
    pub fn items(&self) -> usize {
        self.count.div_ceil(CHUNK)
    }

    /// Rays.
    pub fn total(&self) -> u64 {
        self.count as u64
    }

    /// What is counted.
    pub fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    fn rounds(&self) -> MutexGuard<'_, Rounds> {
        self.rounds.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn task(&self) -> Task {
        let want = if ANY { Want::NOTHING } else { self.options.want };
        Task { coherent: self.options.coherent, policy: self.options.policy, want, any: ANY }
    }

    /// A chunk of rays not yet begun.
    fn run_chunk(&self, item: usize, view: &SceneView, chunk: &mut Chunk) {
        let first = item * CHUNK;
        let count = (self.count - first).min(CHUNK);
        chunk.run(view, self.task(), first, count, &self.rays, &self.hits);
        let parked: usize = chunk.parked.iter().map(|group| group.count()).sum();
        self.shared.answered.fetch_add((count - parked) as u64, Relaxed);
        if parked > 0 {
            let mut rounds = self.rounds();
            rounds.needs.append(&mut chunk.needs);
            rounds.parked.append(&mut chunk.parked);
        }
    }

    /// Takes a parked group as far as it comes.
    fn resume(&self, view: &SceneView, mut group: Group) {
        let mut needs = Vec::new();
        let mut hits = [Hit::MISS; PACKET];
        match group.resume(view, self.task(), &mut hits, &mut needs) {
            Some(hits) => {
                self.hits.write(group.first(), hits);
                self.shared.answered.fetch_add(group.count() as u64, Relaxed);
            }
            None => {
                let mut rounds = self.rounds();
                rounds.needs.append(&mut needs);
                rounds.parked.push(group);
            }
        }
    }
}

impl<S, R, H, const ANY: bool> Work for Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    fn run(&self, item: usize) -> Result<()> {
        let (first, resumed, snapshots) = {
            let mut rounds = self.rounds();
            let resumed = rounds.resuming.get_mut(item).and_then(Option::take);
            (rounds.first, resumed, Arc::clone(&rounds.snapshots))
        };
        let scene = self.scene.borrow();
        let view = SceneView { scene, snapshots: &snapshots, never_waits: self.options.policy == Policy::Now };
        if first {
            let mut chunk = scene.context().take_scratch::<Chunk>();
            self.run_chunk(item, &view, &mut chunk);
            scene.context().give_scratch(chunk);
        } else if let Some(group) = resumed {
            self.resume(&view, group);
        }
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        let needs = std::mem::take(&mut self.rounds().needs);
        if needs.is_empty() {
            return Ok(0);
        }
        fetch(self.scene.borrow(), needs)?;
        let mut rounds = self.rounds();
        rounds.snapshots = Arc::new(Snapshots::take(self.scene.borrow()));
        rounds.first = false;
        rounds.resuming = std::mem::take(&mut rounds.parked).into_iter().map(Some).collect();
        Ok(rounds.resuming.len())
    }

    fn ended(&self, ending: &Ending) {
        self.shared.ended(ending);
    }
}
