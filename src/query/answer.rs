//! Answers to batches of rays.
//!
//! A blocking call answers a batch of one chunk at once, without the state of rounds, and a batch of one or two rays
//! without the state of a chunk. Only rays that lack blocks go on in [rounds](super::rounds): they are parked in groups
//! together with their walks.

use super::batch::{Hits, QueryOptions, Rays};
use super::chunk::{CHUNK, Chunk, Group, Task};
use super::hit::{Hit, Want};
use super::parked::{Parked, Parking};
use super::rounds::{Quest, Rounds};
use super::single::{self, ALONE};
use crate::base::error::Result;
use crate::base::tasks::Work;
use crate::math::{PACKET, Ray};
use crate::scene::SceneState;
use crate::scene::walk::{SceneView, Snapshots};
use std::borrow::Borrow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};

/// Answers a batch of closest hits, or of any hits if `ANY`. Blocks.
pub(super) fn answer<const ANY: bool>(
    scene: &SceneState,
    rays: &dyn Rays,
    hits: &dyn Hits,
    options: QueryOptions,
) -> Result<()> {
    let pool = scene.context().pool();
    if rays.count() == 0 {
        return Ok(());
    }
    if rays.count() > CHUNK {
        let batch = Batch::<_, _, _, ANY>::new(scene, rays, hits, options);
        let items = batch.items();
        return pool.run_scoped(items, &Rounds::new(batch)).into_result();
    }
    let task = task_of::<ANY>(options);
    if rays.count() <= ALONE && single::answer_from(scene, task, rays, hits)? {
        return Ok(());
    }
    let at_once = AtOnce { scene, rays, hits, task, parked: Mutex::default() };
    pool.run_scoped(1, &at_once).into_result()?;
    let parked = at_once.parked.into_inner().unwrap_or_else(PoisonError::into_inner);
    if parked.is_empty() {
        return Ok(());
    }
    let batch = Batch::<_, _, _, ANY>::new(scene, rays, hits, options);
    let rest = Rounds::rest(batch, parked.into_iter().map(Parking::new).collect());
    pool.run_scoped(pool.here(|| rest.round_done())?, &rest).into_result()
}

/// Answers few rays without the state of a batch. Returns false if [`answer`] must answer them.
#[inline]
pub(super) fn answer_few<const ANY: bool>(
    scene: &SceneState,
    rays: &[Ray],
    options: QueryOptions,
    put: impl FnMut(usize, &Hit),
) -> Result<bool> {
    if rays.is_empty() || rays.len() > ALONE {
        Ok(false)
    } else {
        single::answer(scene, task_of::<ANY>(options), rays, put)
    }
}

fn task_of<const ANY: bool>(options: QueryOptions) -> Task {
    let want = if ANY { Want::NOTHING } else { options.want };
    Task { coherent: options.coherent, policy: options.policy, want, any: ANY }
}

/// Answers `count` rays from `first` on; returns the groups with rays that must wait.
fn trace_chunk(
    view: &SceneView,
    task: Task,
    (first, count): (usize, usize),
    rays: &impl Rays,
    hits: &impl Hits,
) -> Vec<Box<Group>> {
    let context = view.scene.context();
    let mut chunk = context.take_scratch::<Chunk>();
    chunk.run(view, task, first, count, rays, hits);
    let parked = std::mem::take(&mut chunk.parked);
    context.give_scratch(chunk);
    parked
}

/// A batch of one chunk.
struct AtOnce<'a> {
    scene: &'a SceneState,
    rays: &'a dyn Rays,
    hits: &'a dyn Hits,
    task: Task,
    /// Groups with rays that must wait for blocks.
    parked: Mutex<Vec<Box<Group>>>,
}

impl Work for AtOnce<'_> {
    fn run(&self, _: usize) -> Result<()> {
        // Threads share the reference counts of snapshots and the stamps of blocks. So the snapshots are borrowed
        // without a count, and the stamp is not new: a new one would be written to every block that a ray visits.
        let mut snapshots = Snapshots::none();
        snapshots.lend(self.scene);
        let stamp = self.scene.context().residency().now();
        let view = self.task.view(self.scene, &snapshots, stamp);
        let parked = trace_chunk(&view, self.task, (0, self.rays.count()), &self.rays, &self.hits);
        if !parked.is_empty() {
            *self.parked.lock().unwrap_or_else(PoisonError::into_inner) = parked;
        }
        Ok(())
    }
}

/// A batch of closest hits, or of any hits if `ANY`. Its items are chunks of rays; its pieces are groups of rays.
pub(super) struct Batch<S, R, H, const ANY: bool> {
    scene: S,
    rays: R,
    hits: H,
    options: QueryOptions,
    count: usize,
    /// The last-used stamp of the blocks that the batch visits.
    stamp: u32,
    /// Number of rays answered so far.
    answered: Arc<AtomicU64>,
    /// Set once the batch is cancelled.
    stop: Arc<AtomicBool>,
}

impl<S, R, H, const ANY: bool> Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    /// A batch that reads `rays` and writes its answers to `hits`.
    pub fn new(scene: S, rays: R, hits: H, options: QueryOptions) -> Self {
        let count = rays.count();
        let stamp = scene.borrow().context().residency().stamp();
        Self { scene, rays, hits, options, count, stamp, answered: Arc::default(), stop: Arc::default() }
    }

    /// Number of items in the first round.
    pub fn items(&self) -> usize {
        self.count.div_ceil(CHUNK)
    }

    /// Number of rays.
    pub fn total(&self) -> u64 {
        self.count as u64
    }

    /// The shared count of answered rays.
    pub fn answered(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.answered)
    }

    /// The flag that ends all walks.
    pub fn stop(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }

    fn view<'a>(&'a self, snapshots: &'a Snapshots) -> SceneView<'a> {
        SceneView { stop: &self.stop, ..self.task().view(self.scene.borrow(), snapshots, self.stamp) }
    }

    fn task(&self) -> Task {
        task_of::<ANY>(self.options)
    }
}

impl<S, R, H, const ANY: bool> Quest for Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    type Waiting = Parked<Box<Group>>;
    /// Some 20 KB for each group.
    const ITEM_BYTES: u64 = (CHUNK / PACKET * 20) as u64 * 1024;
    /// A chunk takes at least some tens of microseconds.
    const RENEWAL: usize = 1;
    const FETCH: usize = 16;

    fn scene(&self) -> &SceneState {
        self.scene.borrow()
    }

    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Parking<Box<Group>>> {
        let first = item * CHUNK;
        let count = (self.count - first).min(CHUNK);
        let parked = trace_chunk(&self.view(snapshots), self.task(), (first, count), &self.rays, &self.hits);
        let waiting: usize = parked.iter().map(|group| group.count()).sum();
        self.answered.fetch_add((count - waiting) as u64, Relaxed);
        parked.into_iter().map(Parking::new).collect()
    }

    fn resume(&self, mut group: Box<Group>, snapshots: &Snapshots) -> Option<Parking<Box<Group>>> {
        let view = self.view(snapshots);
        let (first, count) = (group.first(), group.count());
        let Some(hits) = group.resume(&view, self.task()) else { return Some(Parking::new(group)) };
        self.hits.write(first, hits);
        self.answered.fetch_add(count as u64, Relaxed);
        None
    }
}
