//! Batches of rays: sources of rays, takers of hits, options, and the calls that start a batch.

use super::answer::{Batch, answer, answer_few};
use super::hit::{Hit, HitKind, Want};
use super::rounds::{Quest, Rounds};
use crate::base::error::{Error, Result};
use crate::base::tasks::{Ending, Job};
use crate::math::{Ray, bits};
use crate::scene::SceneState;
use crate::simd::prefetch_l2;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

pub use crate::math::PACKET;

/// The source of a batch's rays. Any worker calls it, and several may do so at once.
pub trait Rays: Sync {
    /// Number of rays.
    fn count(&self) -> usize;
    /// Writes rays `first..first + out.len()`, all below `count`, to `out`. A batch may read the same rays several
    /// times.
    fn read(&self, first: usize, out: &mut [Ray]);
    /// Returns rays `first..first + PACKET`, all below `count`, in place, if the source can: they must equal the rays
    /// that [`Rays::read`] writes, which the batch calls otherwise. The batch usually reads the rays [`AHEAD`] of these
    /// soon, so an implementation may prefetch them.
    fn packet(&self, first: usize) -> Option<&[Ray; PACKET]> {
        let _ = first;
        None
    }
}

/// The taker of a batch's answers. Any worker calls it, several may do so at once, and each index comes once.
pub trait Hits: Sync {
    /// Takes the answers to rays `first..first + hits.len()`. For [`Query::any`] only `kind` is meaningful.
    fn write(&self, first: usize, hits: &[Hit]);
    /// Takes the answers of [`Query::any`] to rays `first..first + count`, at most 32: those of `met` (bit `i`: ray
    /// `first + i`) hit something. The batch calls either this or [`Hits::write`].
    fn write_any(&self, first: usize, count: usize, met: u32) {
        let mut hits = [Hit::MISS; PACKET];
        bits(met).for_each(|i| hits[i].kind = HitKind::Exact);
        self.write(first, &hits[..count]);
    }
}

/// The treatment of data that is not in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Policy {
    /// Read it: the answer does not depend on the blocks in memory.
    #[default]
    Exact = 0,
    /// Answer at once; the hit says [`super::HitKind::Missing`].
    Now = 1,
}

/// Options of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QueryOptions {
    /// True if neighbouring rays are alike, for instance those of neighbouring pixels: they are traced in packets
    /// of 32. The answers are the same. Coherent rays are recognised without this option if they enter few placed
    /// trees.
    pub coherent: bool,
    /// The fields to fill.
    pub want: Want,
    /// The treatment of data that is not in memory.
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
    /// The batch is being answered.
    Running = 1,
    /// All answers are written.
    Done = 2,
    /// The batch was cancelled; its answers must not be used.
    Cancelled = 3,
    /// The batch failed; its answers must not be used.
    Failed = 4,
}

/// Progress of a [`Query`].
#[derive(Debug, Clone)]
pub struct QueryStatus {
    /// State of the query.
    pub state: QueryState,
    /// Fraction done, from 0 to 1; it never decreases.
    pub fraction: f64,
    /// Number of rays answered.
    pub done: u64,
    /// Number of rays in the batch.
    pub total: u64,
    /// The error of a failed query.
    pub error: Option<Arc<Error>>,
}

/// A batch in flight. Dropping it cancels it and waits until no thread reads its rays, writes its hits or calls its
/// wake function. If one of these calls itself drops the query, the drop does not wait for that call. Thread-safe.
pub struct Query {
    job: Job,
    /// Number of rays answered so far.
    answered: Arc<AtomicU64>,
    total: u64,
    /// Set when the query is cancelled, so that walks end.
    stop: Arc<AtomicBool>,
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
        let (answered, total, items, stop) = (batch.answered(), batch.total(), batch.items(), batch.stop());
        let context = batch.scene().context().clone();
        let job = context.pool().submit(items, Arc::new(Rounds::new(batch)));
        Self { job, answered, total, stop }
    }

    /// Returns the query's progress. Never blocks.
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
            // A batch without rays ends before a caller can observe it running.
            _ => done as f64 / self.total.max(1) as f64,
        };
        QueryStatus { state, fraction, done, total: self.total, error }
    }

    /// Waits at most `timeout` until the query has ended and a wake function in another thread has returned. If
    /// `timeout` expires first, the query counts as running. In a context without threads the caller itself works.
    pub fn wait(&self, timeout: Duration) -> QueryStatus {
        self.status(self.job.wait(timeout))
    }

    /// Requests the end of the query. Each walk ends at the next block that it enters.
    pub fn cancel(&self) {
        // In this order: walks that are stopped have wrong results, which a job that is not cancelled would use.
        self.job.cancel();
        self.stop.store(true, Relaxed);
    }

    /// Calls `wake` once when the query ends (done, cancelled or failed), from any thread, never under a lock of the
    /// library. If the query has ended, the call happens here at once. Replaces an earlier function; `None` removes it.
    pub fn set_wake(&self, wake: Option<Arc<dyn Fn() + Send + Sync>>) {
        self.job.set_wake(wake);
    }
}

impl Drop for Query {
    fn drop(&mut self) {
        self.cancel();
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
    fn write_any(&self, first: usize, count: usize, met: u32) {
        (**self).write_any(first, count, met);
    }
}

impl Hits for Arc<dyn Hits + Send + Sync> {
    fn write(&self, first: usize, hits: &[Hit]) {
        (**self).write(first, hits);
    }
    fn write_any(&self, first: usize, count: usize, met: u32) {
        (**self).write_any(first, count, met);
    }
}

/// Distance, in rays, of the prefetch into the L2 cache. (Nanoseconds per ray of a small model, one thread of a Zen 4:
/// 25.4 without prefetch; 25.1 into the L1 at any distance, as the L1 has fewer outstanding lines than a packet; into
/// the L2 22.3 at two packets ahead, 22.1 at four, 23.2 at eight.)
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

/// A slice that takes answers, cut into runs with a lock each: one writer at a time locks a run.
struct Runs<'s, 'a, T>(&'s [Mutex<&'a mut [T]>]);

/// Rays per run: a multiple of the rays that a batch writes at once.
const RUN: usize = 1024;

impl<T> Runs<'_, '_, T> {
    /// Calls `put` with the room for the answers to rays `first..first + count`.
    fn put(&self, first: usize, count: usize, put: impl FnOnce(&mut [T])) {
        debug_assert!(first % RUN + count <= RUN);
        let mut run = self.0[first / RUN].lock().unwrap_or_else(PoisonError::into_inner);
        put(&mut run[first % RUN..][..count]);
    }
}

impl Hits for Runs<'_, '_, Hit> {
    fn write(&self, first: usize, hits: &[Hit]) {
        self.put(first, hits.len(), |out| out.copy_from_slice(hits));
    }
}

impl Hits for Runs<'_, '_, u8> {
    fn write(&self, first: usize, hits: &[Hit]) {
        self.put(first, hits.len(), |out| {
            out.iter_mut().zip(hits).for_each(|(out, hit)| *out = u8::from(hit.kind != HitKind::Miss));
        });
    }
    fn write_any(&self, first: usize, count: usize, met: u32) {
        self.put(first, count, |out| out.iter_mut().enumerate().for_each(|(i, out)| *out = (met >> i & 1) as u8));
    }
}

/// Calls `ask` with a taker that writes to the slice.
fn into_slice<T>(out: &mut [T], ask: impl FnOnce(&Runs<T>) -> Result<()>) -> Result<()> {
    if out.len() <= RUN {
        // Small batches are frequent: this path allocates no list of runs.
        return ask(&Runs(&[Mutex::new(out)]));
    }
    let runs: Vec<_> = out.chunks_mut(RUN).map(Mutex::new).collect();
    ask(&Runs(&runs))
}

fn same_length(rays: usize, hits: usize) -> Result<()> {
    let text = || format!("there are {rays} rays, but room for {hits} hits");
    if rays == hits { Ok(()) } else { Err(Error::BadArgument(text())) }
}

impl SceneState {
    /// Finds the closest hit of each ray. Blocks; may read the disk. Thread-safe.
    ///
    /// A ray misses if its direction is zero (denormals count as zero) or not finite, or if its origin is not finite.
    /// Fails with `BadArgument` if the lengths differ, or with the error of a disk read. After a failure `hits` must
    /// not be used.
    pub fn closest(&self, rays: &[Ray], options: QueryOptions, hits: &mut [Hit]) -> Result<()> {
        same_length(rays.len(), hits.len())?;
        if answer_few::<false>(self, rays, options, |i, hit| hits[i] = *hit)? {
            return Ok(());
        }
        into_slice(hits, |hits| self.closest_batch(&rays, hits, options))
    }

    /// Writes 1 for each ray that hits anything within its interval, else 0. Otherwise like [`SceneState::closest`]. On
    /// slivers that a ray meets edge-on, the interval is that of distances in single precision.
    pub fn any(&self, rays: &[Ray], options: QueryOptions, hits: &mut [u8]) -> Result<()> {
        same_length(rays.len(), hits.len())?;
        if answer_few::<true>(self, rays, options, |i, hit| hits[i] = u8::from(hit.kind != HitKind::Miss))? {
            return Ok(());
        }
        into_slice(hits, |hits| self.any_batch(&rays, hits, options))
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
