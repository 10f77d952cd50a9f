//! Prefetch: reading the blocks that a box or a camera would need, before they are requested.
//!
//! A prefetch works in passes. Each is a job of the pool in small pieces. A pass follows the blocks in memory down to
//! the missing ones, and wants the most important of these: as many as fit beside the blocks that frames use. The next
//! pass begins once they have arrived. The wants of frames come first, no picture becomes coarser for a prefetch, and
//! no block that a frame uses is evicted for it: it has no pass of its own for which others would make room (see
//! [`View`]).
//!
//! Like batches of rays and overlap queries it searches again once blocks have arrived. It shares with them the handle
//! and the calculation of the number of blocks that fit (`query/needs.rs`). It does not use their engine,
//! `query/rounds.rs`. That engine answers a query, so it reads the blocks of a round itself, holds them until they are
//! used, and takes a lease if there is no room. A prefetch must not take room from other users: it only wants blocks,
//! through a [`View`]; between two passes it holds no snapshot and has no job until the view has news; and it ends if
//! blocks do not fit.

mod boxes;
mod camera;

use crate::base::error::{Error, Result};
use crate::base::handle::Handle;
use crate::base::tasks::{Ending, Work};
use crate::math::DBounds;
use crate::query::needs::{bytes_of, one_at_least};
use crate::residency::{View, ViewState, Wanted};
use crate::scene::walk::{Need, SceneView, Snapshots};
use crate::scene::{Camera, SceneState};
use boxes::InBox;
use camera::InView;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

/// State of a [`Prefetch`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum PrefetchState {
    /// The prefetch reads, or waits for more urgent reads.
    Running = 1,
    /// All needed blocks are in memory.
    Done = 2,
    /// The prefetch was cancelled.
    Cancelled = 3,
    /// Some blocks cannot be read; `error` gives the reason. The others are in memory, as far as they fit.
    Failed = 4,
    /// The most important blocks are in memory; more do not fit beside the blocks that frames use.
    Full = 5,
}

/// Status of a [`Prefetch`].
#[derive(Debug, Clone)]
pub struct PrefetchStatus {
    /// State of the prefetch.
    pub state: PrefetchState,
    /// Fraction done of the blocks that are known so far to be needed, from 0 to 1. It never decreases.
    pub fraction: f64,
    /// Number of blocks that were read for the prefetch.
    pub blocks: u64,
    /// Bytes of these blocks in memory.
    pub bytes: u64,
    /// Bytes of blocks that the prefetch wants now and that are not in memory.
    pub bytes_wanted: u64,
    /// Reason of the failure.
    pub error: Option<Arc<Error>>,
}

/// Background reading ahead of use. Dropping it ends the prefetch; blocks that were read stay until other data needs
/// the room. Thread-safe. All calls but [`Prefetch::wait`] are cheap.
pub struct Prefetch {
    inner: Arc<Inner>,
}

type End = (PrefetchState, Option<Arc<Error>>);

struct Inner {
    scene: Arc<SceneState>,
    view: View,
    /// Stamp of all visits, which tells the visited blocks from those used before.
    stamp: u32,
    walk: Mutex<Walk>,
    handle: Handle<End, Counts>,
    stop: AtomicBool,
    /// True if the job is in the pool.
    runs: AtomicBool,
    /// True if there may be more to do than at the last check.
    again: AtomicBool,
    /// True if the pass has not ended.
    more: AtomicBool,
}

/// Target of the search.
#[allow(clippy::large_enum_variant)] // one per prefetch
enum Aim {
    Box(InBox),
    View(InView),
}

/// State of the search. The job uses it while it runs.
struct Walk {
    aim: Aim,
    /// Snapshots of the current pass.
    snapshots: Option<Snapshots>,
    lacking: Lacking,
    /// Blocks that were wanted last.
    taken: Vec<Need>,
    /// Blocks that cannot be read. They are not wanted again.
    failed: Vec<Need>,
    error: Option<Error>,
}

/// Missing blocks and their weights.
#[derive(Default)]
struct Lacking(BTreeMap<Need, f32>);

impl Lacking {
    fn add(&mut self, need: Need, weight: f32) {
        let before = self.0.entry(need).or_insert(0.0);
        *before = before.max(weight);
    }

    /// Returns the blocks by descending weight. Among equals the lower ids, which are coarser, come first.
    fn sorted(&self) -> Vec<(Need, f32)> {
        let mut list: Vec<_> = self.0.iter().map(|(&need, &weight)| (need, weight)).collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1));
        list
    }
}

/// Progress so far.
#[derive(Default)]
struct Counts {
    fraction: f64,
    blocks: u64,
    bytes: u64,
}

/// Bytes wanted at a time. A small number lets more important blocks that are found on the way go first.
const AT_ONCE: u64 = 8 << 20;

/// Scale of the weights, so small that all wants of frames come first.
const SMALL: f32 = 1e-6;

impl Prefetch {
    /// Begins a prefetch of the data in the closed box `bounds`, in world space: of the blocks below cells that overlap
    /// it and are longer than `cell` (world units; 0: all of them), those below the longest cells first. Hidden parts
    /// are included.
    ///
    /// Fails with `BadArgument` for NaN, or a `cell` below 0. An empty box needs no blocks.
    pub fn of_box(scene: &Arc<SceneState>, bounds: &DBounds, cell: f64) -> Result<Self> {
        if bounds.min.is_nan() || bounds.max.is_nan() {
            return Err(Error::bad_argument("prefetch: the box contains NaN"));
        }
        if cell.is_nan() || cell < 0.0 {
            return Err(Error::bad_argument("prefetch: the cell length must be 0 or more"));
        }
        Ok(Self::begin(scene, Aim::Box(InBox::new(*bounds, cell))))
    }

    /// Begins a prefetch of the blocks that a picture of `size` pixels by `camera` needs at `poe` pixels of error. It
    /// finds them with a ray in every fourth pixel of every fourth row, without shadow rays and without the surfaces
    /// behind transparent ones.
    ///
    /// Fails with `BadArgument` for a bad camera or size, or a `poe` that is not finite or below 0.
    pub fn of_camera(scene: &Arc<SceneState>, camera: &Camera, size: (u32, u32), poe: f32) -> Result<Self> {
        super::frame::check_size(size.0, size.1)?;
        super::FrameSettings { poe, ..Default::default() }.check()?;
        let rays = camera.prepare(size.0, size.1)?;
        Ok(Self::begin(scene, Aim::View(InView::new(rays, size, poe))))
    }

    fn begin(scene: &Arc<SceneState>, aim: Aim) -> Self {
        scene.models.iter().for_each(|model| model.blocks().forget_failures());
        let residency = scene.context().residency();
        let walk = Walk {
            aim,
            snapshots: None,
            lacking: Lacking::default(),
            taken: Vec::new(),
            failed: Vec::new(),
            error: None,
        };
        let [stop, runs, again, more] = [const { AtomicBool::new(false) }; 4];
        let inner = Arc::new(Inner {
            scene: Arc::clone(scene),
            view: residency.view(),
            stamp: residency.stamp(),
            walk: Mutex::new(walk),
            handle: Handle::new(Counts::default()),
            stop,
            runs,
            again,
            more,
        });
        let weak = Arc::downgrade(&inner);
        inner.view.on_change(Some(Arc::new(move || {
            if let Some(inner) = weak.upgrade() {
                inner.news();
            }
        })));
        inner.news();
        Self { inner }
    }

    /// Returns the status. Never blocks.
    pub fn poll(&self) -> PrefetchStatus {
        self.inner.status(self.inner.handle.ending())
    }

    /// Waits until the prefetch has ended and a wake function that another thread calls has returned, `timeout` at
    /// most. After that time the state is still running. In a context without threads the caller does the work.
    pub fn wait(&self, timeout: Duration) -> PrefetchStatus {
        let context = self.inner.scene.context();
        let todo = |_: &Counts| (context.threads() == 0).then_some(());
        let ending = self.inner.handle.wait_working(timeout, todo, |(), left| {
            if !context.step() {
                std::thread::sleep(left.min(Duration::from_millis(1)));
            }
        });
        self.inner.status(ending)
    }

    /// Ends the prefetch. Blocks that were read stay until the room is needed.
    pub fn cancel(&self) {
        self.inner.stop.store(true, SeqCst);
        self.inner.end(PrefetchState::Cancelled, None);
    }

    /// Sets a function that is called once when the prefetch ends, from any thread, without a lock held. If it has
    /// ended already, this thread calls the function at once. Replaces the previous function; `None` only removes it.
    pub fn set_wake(&self, wake: Option<Arc<dyn Fn() + Send + Sync>>) {
        self.inner.handle.set_wake(wake);
    }
}

impl Drop for Prefetch {
    fn drop(&mut self) {
        self.set_wake(None);
        self.cancel();
    }
}

impl Inner {
    fn walk(&self) -> MutexGuard<'_, Walk> {
        self.walk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn status(&self, ending: Option<(PrefetchState, Option<Arc<Error>>)>) -> PrefetchStatus {
        let bytes_wanted = self.view.status().bytes_wanted;
        let core = self.handle.lock();
        let (state, error) = ending.unwrap_or((PrefetchState::Running, None));
        let fraction = if state == PrefetchState::Done { 1.0 } else { core.fraction };
        PrefetchStatus { state, fraction, blocks: core.blocks, bytes: core.bytes, bytes_wanted, error }
    }

    /// Submits the job if it does not run: there may be work to do.
    fn news(self: &Arc<Self>) {
        self.again.store(true, SeqCst);
        if !self.stop.load(SeqCst) && !self.runs.swap(true, SeqCst) {
            self.scene.context().pool().submit(1, Arc::new(Going(Arc::downgrade(self))));
        }
    }

    /// Ends the prefetch and releases its snapshot and its wants. Only the first call has an effect.
    fn end(&self, state: PrefetchState, error: Option<Arc<Error>>) {
        if self.handle.ending().is_some() {
            return;
        }
        self.stop.store(true, SeqCst);
        if let Ok(mut walk) = self.walk.try_lock() {
            // A piece that is being worked on releases the snapshot when it ends.
            walk.snapshots = None;
        }
        self.view.want(&[]);
        self.handle.end((state, error));
    }

    /// Works on a piece of a pass. Returns the outcome if the prefetch ends.
    fn go_on(&self) -> Option<End> {
        let mut walk = self.walk();
        if walk.snapshots.is_none() {
            // A pass finds nothing new before all wanted blocks have arrived or failed.
            match self.view.status().state {
                ViewState::Busy => return None,
                ViewState::Full => return Some((PrefetchState::Full, None)),
                ViewState::Failed => self.find_out(&mut walk),
                ViewState::Satisfied => {}
            }
            self.count_arrived(&mut walk);
            walk.begin_pass(&self.scene);
        }
        if walk.step(&self.scene, self.stamp) {
            self.more.store(true, SeqCst);
            return None;
        }
        walk.snapshots = None;
        self.want_more(&mut walk)
    }

    /// Records which wanted blocks failed, and the first error.
    fn find_out(&self, walk: &mut Walk) {
        let there = Snapshots::take(&self.scene);
        for need in walk.taken.iter().filter(|need| !there.has(**need)) {
            let blocks = self.scene.models[need.model as usize].blocks();
            match blocks.bring(&[need.block], &Default::default()) {
                Ok(_) => {}
                Err(error) => walk.error = walk.error.take().or(Some(error)),
            }
            walk.failed.push(*need);
        }
    }

    fn count_arrived(&self, walk: &mut Walk) {
        let there = Snapshots::take(&self.scene);
        let came: Vec<Need> = walk.taken.drain(..).filter(|need| there.has(*need)).collect();
        let bytes: u64 = came.iter().map(|&need| bytes_of(&self.scene, need)).sum();
        let mut counts = self.handle.lock();
        counts.blocks += came.len() as u64;
        counts.bytes += bytes;
    }

    /// Wants the most important of the blocks that a pass lacked. Returns the outcome if none is missing or none fits.
    fn want_more(&self, walk: &mut Walk) -> Option<End> {
        let mut lacking = walk.lacking.sorted();
        lacking.retain(|(need, _)| !walk.failed.contains(need));
        if lacking.is_empty() {
            let error = walk.error.take().map(Arc::new);
            return Some((if error.is_some() { PrefetchState::Failed } else { PrefetchState::Done }, error));
        }
        let room = self.scene.context().residency().room_beside(self.stamp);
        let (mut sum, mut is_next) = (0, one_at_least(AT_ONCE));
        let fits = |&&(need, _): &&(Need, f32)| {
            let bytes = bytes_of(&self.scene, need);
            sum += bytes;
            sum <= room && is_next(bytes)
        };
        let taken: Vec<(Need, f32)> = lacking.iter().take_while(fits).copied().collect();
        let missing: u64 = lacking.iter().map(|&(need, _)| bytes_of(&self.scene, need)).sum();
        {
            let mut counts = self.handle.lock();
            let now = counts.bytes as f64 / (counts.bytes + missing) as f64;
            counts.fraction = counts.fraction.max(now).min(0.999);
        }
        if taken.is_empty() {
            return Some((PrefetchState::Full, None));
        }
        let most = lacking[0].1.max(f32::MIN_POSITIVE);
        let wanted = |&(need, weight): &(Need, f32)| Wanted {
            model: self.scene.models[need.model as usize].blocks().key(),
            block: need.block,
            weight: weight / most * SMALL,
        };
        walk.taken = taken.iter().map(|(need, _)| *need).collect();
        self.view.want(&taken.iter().map(wanted).collect::<Vec<_>>());
        // The blocks may have arrived already.
        self.again.store(true, SeqCst);
        None
    }
}

impl Walk {
    fn begin_pass(&mut self, scene: &Arc<SceneState>) {
        self.snapshots = Some(Snapshots::take(scene));
        self.lacking = Lacking::default();
        match &mut self.aim {
            Aim::Box(walk) => walk.begin(scene),
            Aim::View(walk) => walk.begin(),
        }
    }

    /// Works on a small piece. Returns true if there is more.
    fn step(&mut self, scene: &SceneState, stamp: u32) -> bool {
        let Some(snapshots) = &self.snapshots else { return false };
        let view = SceneView { accept_missing: true, ties_by_place: true, ..SceneView::new(scene, snapshots, stamp) };
        match &mut self.aim {
            Aim::Box(walk) => walk.step(&view, &mut self.lacking),
            Aim::View(walk) => walk.step(&view, &mut self.lacking),
        }
    }
}

/// The job. Its reference is weak: a job in the pool's queue must not keep the pool alive.
struct Going(Weak<Inner>);

impl Work for Going {
    fn run(&self, _: usize) -> Result<()> {
        self.0.upgrade().map_or(Ok(()), |inner| inner.run())
    }

    fn round_done(&self) -> Result<usize> {
        Ok(self.0.upgrade().map_or(0, |inner| inner.items_left()))
    }

    fn ended(&self, ending: &Ending) {
        if let Some(inner) = self.0.upgrade() {
            inner.job_ended(ending);
        }
    }
}

impl Inner {
    fn run(&self) -> Result<()> {
        self.again.store(false, SeqCst);
        if !self.stop.load(SeqCst)
            && let Some((state, error)) = self.go_on()
        {
            self.end(state, error);
        }
        if self.stop.load(SeqCst) {
            self.walk().snapshots = None;
        }
        Ok(())
    }

    fn items_left(&self) -> usize {
        let goes_on = |flag: &AtomicBool| flag.swap(false, SeqCst) && !self.stop.load(SeqCst);
        if goes_on(&self.more) || goes_on(&self.again) {
            return 1;
        }
        self.runs.store(false, SeqCst);
        // A thread that found the job running meanwhile has left the work to this one.
        usize::from(self.again.load(SeqCst) && !self.stop.load(SeqCst) && !self.runs.swap(true, SeqCst))
    }

    fn job_ended(&self, ending: &Ending) {
        match ending {
            Ending::Finished => {}
            Ending::Cancelled => self.end(PrefetchState::Cancelled, None),
            Ending::Failed(error) => self.end(PrefetchState::Failed, Some(Arc::clone(error))),
        }
    }
}
