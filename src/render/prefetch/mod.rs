//! Reading ahead of being asked: what a box, or a camera, would need.
//!
//! A prefetch goes in passes, each a job of the pool in small pieces: it follows the blocks in memory to where they
//! end, wants the most important of the blocks that it lacks there, as many as there is room for beside those that
//! frames use, and goes on once these have come. The wants of frames come first, no picture gets coarser for it, and no
//! block that a frame uses is evicted for it: it has no pass of its own that others would make room for (see [`View`]).
//!
//! Like batches of rays and overlaps it looks again once blocks have come, and it shares with them how many blocks
//! there is room for (`query/needs.rs`) and the handle. It does not use their engine, `query/rounds.rs`. That answers a
//! question, so it reads the blocks of a round itself, holds them until they are used, and takes a lease where there is
//! no room. A prefetch must not take room from anything: it only wants blocks, through a [`View`]; between two passes
//! it holds no snapshot and has no job until the view has news; and it ends where blocks do not fit.

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
    /// Reading, or waiting for what is more urgent.
    Running = 1,
    /// All is in memory.
    Done = 2,
    /// It was cancelled.
    Cancelled = 3,
    /// Some of it cannot be read; `error` says why. The rest is in memory, as far as it fits.
    Failed = 4,
    /// The most important of it is in memory: more does not fit beside what frames use.
    Full = 5,
}

/// How far a [`Prefetch`] is.
#[derive(Debug, Clone)]
pub struct PrefetchStatus {
    /// Its state.
    pub state: PrefetchState,
    /// Fraction done, from 0 to 1, never going back: of what is known so far to be needed.
    pub fraction: f64,
    /// Blocks that it has had read.
    pub blocks: u64,
    /// Their bytes in memory.
    pub bytes: u64,
    /// Bytes that it wants now and that are not in memory.
    pub bytes_wanted: u64,
    /// Why it failed.
    pub error: Option<Arc<Error>>,
}

/// Reading ahead in the background. Dropping it ends it; what was read stays until room is needed for something else.
/// Thread-safe; all calls are cheap but [`Prefetch::wait`].
pub struct Prefetch {
    inner: Arc<Inner>,
}

type End = (PrefetchState, Option<Arc<Error>>);

struct Inner {
    scene: Arc<SceneState>,
    view: View,
    /// Of all that it visits, so that it can be told from what was used before.
    stamp: u32,
    walk: Mutex<Walk>,
    handle: Handle<End, Counts>,
    stop: AtomicBool,
    /// The job is there.
    runs: AtomicBool,
    /// There may be more to do than when it last looked.
    again: AtomicBool,
    /// The pass has not ended.
    more: AtomicBool,
}

/// What is to be looked for.
#[allow(clippy::large_enum_variant)] // one for each prefetch
enum Aim {
    Box(InBox),
    View(InView),
}

/// Owned by the job while it runs.
struct Walk {
    aim: Aim,
    /// Of the present pass.
    snapshots: Option<Snapshots>,
    lacking: Lacking,
    /// What was wanted last.
    taken: Vec<Need>,
    /// Blocks that cannot be read are not asked for again.
    failed: Vec<Need>,
    error: Option<Error>,
}

/// Blocks that are missing, and how much each matters.
#[derive(Default)]
struct Lacking(BTreeMap<Need, f32>);

impl Lacking {
    fn add(&mut self, need: Need, weight: f32) {
        let before = self.0.entry(need).or_insert(0.0);
        *before = before.max(weight);
    }

    /// The most important first; among equals the lower, which are the coarser.
    fn sorted(&self) -> Vec<(Need, f32)> {
        let mut list: Vec<_> = self.0.iter().map(|(&need, &weight)| (need, weight)).collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1));
        list
    }
}

/// Its progress so far.
#[derive(Default)]
struct Counts {
    fraction: f64,
    blocks: u64,
    bytes: u64,
}

/// Bytes wanted at a time: what matters most comes first, also of what is found on the way.
const AT_ONCE: u64 = 8 << 20;

/// Weights are made so small that whatever a frame wants comes before.
const SMALL: f32 = 1e-6;

impl Prefetch {
    /// Of what lies in the closed box `bounds`, in world space: blocks below cells that meet it and are longer than
    /// `cell` (world units; 0: all of them), those below the longest cells first. Hidden parts too.
    ///
    /// Fails with `BadArgument` for NaN, or a `cell` below 0. An empty box has nothing.
    pub fn of_box(scene: &Arc<SceneState>, bounds: &DBounds, cell: f64) -> Result<Self> {
        if bounds.min.is_nan() || bounds.max.is_nan() {
            return Err(Error::bad_argument("prefetch: the box holds NaN"));
        }
        if cell.is_nan() || cell < 0.0 {
            return Err(Error::bad_argument("prefetch: the length of cells must be 0 or more"));
        }
        Ok(Self::begin(scene, Aim::Box(InBox::new(*bounds, cell))))
    }

    /// Of what a picture of `size` pixels by `camera` would need at `poe` pixels of error, as far as a ray in every
    /// fourth pixel of every fourth row finds it; without shadows, and what is behind transparent surfaces.
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

    /// How far it is. Never blocks.
    pub fn poll(&self) -> PrefetchStatus {
        self.inner.status(self.inner.handle.ending())
    }

    /// Waits until it has ended and a wake function that another thread calls has returned, `timeout` at most; after
    /// that time it still counts as running. Works itself where the context has no threads.
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

    /// Ends it. What was read stays until room is needed.
    pub fn cancel(&self) {
        self.inner.stop.store(true, SeqCst);
        self.inner.end(PrefetchState::Cancelled, None);
    }

    /// Calls `wake` once when it ends, from any thread, never under a lock of ours; at once, here, if it has ended.
    /// Replaces an earlier one. `None`: nothing is called.
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

    /// There may be something to do.
    fn news(self: &Arc<Self>) {
        self.again.store(true, SeqCst);
        if !self.stop.load(SeqCst) && !self.runs.swap(true, SeqCst) {
            self.scene.context().pool().submit(1, Arc::new(Going(Arc::downgrade(self))));
        }
    }

    /// Ends it, without snapshot and wants. The first end counts.
    fn end(&self, state: PrefetchState, error: Option<Arc<Error>>) {
        if self.handle.ending().is_some() {
            return;
        }
        self.stop.store(true, SeqCst);
        if let Ok(mut walk) = self.walk.try_lock() {
            // If a piece is being worked on, that ends with it.
            walk.snapshots = None;
        }
        self.view.want(&[]);
        self.handle.end((state, error));
    }

    /// A piece of a pass; whether there is more of it.
    fn go_on(&self) -> Option<End> {
        let mut walk = self.walk();
        if walk.snapshots.is_none() {
            // Until all that was wanted has come, or will not, there is no use in looking.
            match self.view.status().state {
                ViewState::Busy => return None,
                ViewState::Full => return Some((PrefetchState::Full, None)),
                ViewState::Failed => self.find_out(&mut walk),
                ViewState::Satisfied => {}
            }
            self.count_what_came(&mut walk);
            walk.begin_pass(&self.scene);
        }
        if walk.step(&self.scene, self.stamp) {
            self.more.store(true, SeqCst);
            return None;
        }
        walk.snapshots = None;
        self.want_more(&mut walk)
    }

    /// Why what was wanted is not there.
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

    fn count_what_came(&self, walk: &mut Walk) {
        let there = Snapshots::take(&self.scene);
        let came: Vec<Need> = walk.taken.drain(..).filter(|need| there.has(*need)).collect();
        let bytes: u64 = came.iter().map(|&need| bytes_of(&self.scene, need)).sum();
        let mut counts = self.handle.lock();
        counts.blocks += came.len() as u64;
        counts.bytes += bytes;
    }

    /// After a pass: wants the most important of what it lacked; or how it has ended.
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
        // It may have come already.
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

    /// A small piece; whether there is more.
    fn step(&mut self, scene: &SceneState, stamp: u32) -> bool {
        let Some(snapshots) = &self.snapshots else { return false };
        let view = SceneView { accept_missing: true, ..SceneView::new(scene, snapshots, stamp) };
        match &mut self.aim {
            Aim::Box(walk) => walk.step(&view, &mut self.lacking),
            Aim::View(walk) => walk.step(&view, &mut self.lacking),
        }
    }
}

/// The job: what waits in the pool's queue must not keep the pool.
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
        // Whoever found it running meanwhile has left it to us.
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
