//! Batches of rays: what they read, what they write, and how they are asked.

use super::answer::{Batch, answer};
use super::hit::{Hit, HitKind, Want};
use super::rounds::{Quest, Rounds};
use crate::base::error::{Error, Result};
use crate::base::tasks::{Ending, Job};
use crate::math::Ray;
use crate::scene::SceneState;
use crate::simd::prefetch_l2;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

pub use crate::math::PACKET;

/// Where a batch reads its rays: called from any worker, also several at once.
pub trait Rays: Sync {
    /// Number of rays.
    fn count(&self) -> usize;
    /// Writes rays `first..first + out.len()`, all below `count`, to `out`. The same rays may be asked for again.
    fn read(&self, first: usize, out: &mut [Ray]);
    /// Rays `first..first + PACKET`, all below `count`, where they are, if that is possible: those that [`Rays::read`]
    /// writes, which is asked for them otherwise. Those [`AHEAD`] of them, if there are any, mostly come soon: their
    /// memory may be asked for.
    fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
        let _ = first;
        None
    }
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
    /// Neighbouring rays are alike (of neighbouring pixels, say): they are traced in packets of 32.
    /// The answers are the same. Such rays are recognised without it where they enter few placed trees.
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

/// A batch in flight. Dropping it cancels it, and waits until no thread reads its rays, writes its hits or calls its
/// wake function (but for the call that it is dropped in). Thread-safe.
pub struct Query {
    job: Job,
    /// Rays answered so far.
    answered: Arc<AtomicU64>,
    total: u64,
}

impl Query {
    /// Begins to find the closest hit of each ray; returns at once.
    pub fn closest(
        scene: &Arc<SceneState>,
        rays: Arc<dyn Rays + Send + Sync>,
        hits: Arc<dyn Hits + Send + Sync>,
        options: QueryOptions,
    ) -> Result<Self> {
        Ok(Self::begin(Batch::<_, _, _, false>::new(Arc::clone(scene), rays, hits, options)))
    }

    /// Begins to find whether each ray hits anything: its `kind` is `Miss` or not. Returns at once.
    pub fn any(
        scene: &Arc<SceneState>,
        rays: Arc<dyn Rays + Send + Sync>,
        hits: Arc<dyn Hits + Send + Sync>,
        options: QueryOptions,
    ) -> Result<Self> {
        Ok(Self::begin(Batch::<_, _, _, true>::new(Arc::clone(scene), rays, hits, options)))
    }

    fn begin<const ANY: bool>(batch: OwnedBatch<ANY>) -> Self {
        let (answered, total, items) = (batch.answered(), batch.total(), batch.items());
        let context = batch.scene().context().clone();
        let job = context.pool().submit(items, Arc::new(Rounds::new(batch)));
        Self { job, answered, total }
    }

    /// How far it is. Never blocks.
    pub fn poll(&self) -> QueryStatus {
        self.status(self.job.ending())
    }

    fn status(&self, ending: Option<Ending>) -> QueryStatus {
        let (state, error) = match ending {
            None => (QueryState::Running, None),
            Some(Ending::Finished) => (QueryState::Done, None),
            Some(Ending::Cancelled) => (QueryState::Cancelled, None),
            Some(Ending::Failed(error)) => (QueryState::Failed, Some(error)),
        };
        let done = self.answered.load(Relaxed).min(self.total);
        let fraction = match state {
            QueryState::Done => 1.0,
            // A batch without rays is done before it can be seen running.
            _ => done as f64 / self.total.max(1) as f64,
        };
        QueryStatus { state, fraction, done, total: self.total, error }
    }

    /// Waits until it has ended and a wake function that another thread calls has returned, `timeout` at most; after
    /// that time it still counts as running. Works itself where the context has no threads.
    pub fn wait(&self, timeout: Duration) -> QueryStatus {
        self.status(self.job.wait(timeout))
    }

    /// Asks it to end; takes effect within a chunk of rays.
    pub fn cancel(&self) {
        self.job.cancel();
    }

    /// Calls `wake` once when it ends (done, cancelled or failed), from any thread, never under a lock of
    /// ours; at once, here, if it has ended. Replaces an earlier one. `None`: nothing is called.
    pub fn set_wake(&self, wake: Option<Arc<dyn Fn() + Send + Sync>>) {
        self.job.set_wake(wake);
    }
}

impl Drop for Query {
    fn drop(&mut self) {
        self.job.cancel();
        self.job.wait_to_the_end();
    }
}

type OwnedBatch<const ANY: bool> =
    Batch<Arc<SceneState>, Arc<dyn Rays + Send + Sync>, Arc<dyn Hits + Send + Sync>, ANY>;

impl<T: Rays + ?Sized> Rays for &T {
    fn count(&self) -> usize {
        (**self).count()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        (**self).read(first, out);
    }
    fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
        (**self).packet(first)
    }
}

impl Rays for Arc<dyn Rays + Send + Sync> {
    fn count(&self) -> usize {
        (**self).count()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        (**self).read(first, out);
    }
    fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
        (**self).packet(first)
    }
}

impl<T: Hits + ?Sized> Hits for &T {
    fn write(&self, first: usize, hits: &[Hit]) {
        (**self).write(first, hits);
    }
}

impl Hits for Arc<dyn Hits + Send + Sync> {
    fn write(&self, first: usize, hits: &[Hit]) {
        (**self).write(first, hits);
    }
}

/// How many rays ahead memory is asked for, into the L2. (Nanoseconds a ray of a small model, one thread of a Zen 4:
/// 25.4 without, 25.1 into the L1 at any distance, for there is room there for fewer lines under way than a packet has;
/// into the L2 two packets ahead 22.3, four 22.1, eight 23.2.)
pub const AHEAD: usize = 4 * PACKET;

impl Rays for [Ray] {
    fn count(&self) -> usize {
        self.len()
    }
    fn read(&self, first: usize, out: &mut [Ray]) {
        out.copy_from_slice(&self[first..first + out.len()]);
    }
    fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
        let later = self.get(first + AHEAD..).unwrap_or(&[]);
        later.iter().take(PACKET).for_each(|ray| prefetch_l2(ray));
        self.get(first..)?.first_chunk()
    }
}

/// Answers to a slice, cut into runs that are written apart: each run is locked by one writer at a time.
struct Slices<'s, 'a, T, F: Fn(&[Hit], &mut [T])> {
    runs: &'s [Mutex<&'a mut [T]>],
    put: F,
}

/// Rays of a run: a whole number of what a batch writes at once.
const RUN: usize = 1024;

impl<T: Send, F: Fn(&[Hit], &mut [T]) + Sync> Hits for Slices<'_, '_, T, F> {
    fn write(&self, first: usize, hits: &[Hit]) {
        debug_assert!(first % RUN + hits.len() <= RUN);
        let mut run = self.runs[first / RUN].lock().unwrap_or_else(PoisonError::into_inner);
        (self.put)(hits, &mut run[first % RUN..][..hits.len()]);
    }
}

/// Has `ask` write to a slice, as `put` says.
fn into_slice<T: Send>(
    out: &mut [T],
    put: impl Fn(&[Hit], &mut [T]) + Sync,
    ask: impl FnOnce(&dyn Hits) -> Result<()>,
) -> Result<()> {
    if out.len() <= RUN {
        // Few are asked for often: without a list.
        return ask(&Slices { runs: &[Mutex::new(out)], put });
    }
    let runs: Vec<_> = out.chunks_mut(RUN).map(Mutex::new).collect();
    ask(&Slices { runs: &runs, put })
}

fn same_length(rays: usize, hits: usize) -> Result<()> {
    let text = || format!("there are {rays} rays and room for {hits} hits");
    if rays == hits { Ok(()) } else { Err(Error::BadArgument(text())) }
}

impl SceneState {
    /// Finds the closest hit of each ray. Blocks; may read the disk. Thread-safe.
    ///
    /// A ray whose direction is zero (denormals count as zero) or not finite, or whose origin is not finite, misses.
    /// Fails with `BadArgument` if the lengths differ, or with what reading the disk gave; then `hits` are
    /// not to be used.
    pub fn closest(&self, rays: &[Ray], options: QueryOptions, hits: &mut [Hit]) -> Result<()> {
        same_length(rays.len(), hits.len())?;
        into_slice(hits, |hits, out| out.copy_from_slice(hits), |hits| self.closest_batch(&rays, hits, options))
    }

    /// Writes 1 for each ray that hits anything within its interval, else 0. Like
    /// [`SceneState::closest`] otherwise.
    pub fn any(&self, rays: &[Ray], options: QueryOptions, hits: &mut [u8]) -> Result<()> {
        same_length(rays.len(), hits.len())?;
        let put = |hits: &[Hit], out: &mut [u8]| {
            out.iter_mut().zip(hits).for_each(|(out, hit)| *out = u8::from(hit.kind != HitKind::Miss));
        };
        into_slice(hits, put, |hits| self.any_batch(&rays, hits, options))
    }

    /// [`SceneState::closest`] from any source of rays to any taker of hits, without copies. Blocks.
    pub fn closest_batch(&self, rays: &dyn Rays, hits: &dyn Hits, options: QueryOptions) -> Result<()> {
        answer::<false>(self, rays, hits, options)
    }

    /// [`SceneState::any`] from any source of rays to any taker of hits, without copies. Blocks.
    pub fn any_batch(&self, rays: &dyn Rays, hits: &dyn Hits, options: QueryOptions) -> Result<()> {
        answer::<true>(self, rays, hits, options)
    }
}
