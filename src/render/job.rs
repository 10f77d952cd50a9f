//! One request of a frame: a sequence of passes over its tiles. Each pass is a job of the pool.
//!
//! The first pass renders all tiles from the blocks in memory, with stand-ins for missing blocks, so the picture is
//! complete at once. The request then wants the missing blocks. When some of them have arrived, a pass renders the
//! tiles that lacked blocks again, and so on until no block is missing. Passes with more samples follow. If the blocks
//! do not fit at once, the picture is completed pane by pane (`panes.rs`). `passes.rs` decides the order. No thread
//! waits between passes: the request is then only a state that news of the residency wakes.
//!
//! Before the first picture of a frame, probes of every 32nd pixel find the blocks that it will lack. The worker that
//! ends a probe waits for these blocks, [`GLIMPSES`] at most. So the first picture of a newly opened model already has
//! its most important blocks. The wait freezes no picture, because none is on screen yet.

use super::film::{Buffer, Film};
use super::frame::FrameSettings;
use super::integrators::Integrator;
use super::integrators::direct::{Asks, Direct, Scratch};
use super::merged::Merged;
use super::passes::{Next, Now, Passes, Seen};
use super::status::Progress;
use super::tile::{TilePixels, tiles_from_the_middle};
use super::wants::Wants;
use crate::base::error::{Error, Result};
use crate::base::tasks::{Ending, Job, Work};
use crate::math::DBounds;
use crate::math::srgb::Srgb;
use crate::residency::{ForRequest, View, ViewState, Wanted};
use crate::scene::LightKind;
use crate::scene::SceneState;
use crate::scene::camera::PixelRays;
use crate::scene::frame::Scenes;
use crate::scene::placed::Placed;
use crate::scene::walk::{Need, SceneView, Snapshots};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Longest wait of a frame's first picture for blocks.
const GLIMPSES: Duration = Duration::from_millis(80);

/// Shortest and longest time of reading before the next picture, if the thread that waits for the picture reads.
const READS: (Duration, Duration) = (Duration::from_millis(80), Duration::from_secs(1));

/// Shortest time between two pictures while panes are completed: each is a copy.
const PANES_SHOWN: Duration = Duration::from_millis(100);

/// Longest wait for reads in progress by a request that would end coarser than requested. No view wants these blocks
/// any more, but their end may show that finer detail fits.
const LAST_READS: Duration = Duration::from_millis(500);

/// Outcome of a request.
#[derive(Debug, Clone)]
pub(super) enum End {
    /// The picture is as exact as requested.
    Converged,
    /// The picture shows all data that fits the budget and can be read. The error is that of an unreadable block.
    Budget(Option<Arc<Error>>),
    Cancelled,
    Failed(Arc<Error>),
}

/// Receiver of a request's news. No lock is held during its calls.
pub(super) trait Owner: Send + Sync {
    /// The film of `request` holds a complete picture, better than the last one. Returns false if there is no memory to
    /// show it.
    fn improved(&self, request: &Request, film: &Film) -> bool;
    /// `request` has ended with `film`. Called once.
    fn ended(&self, request: &Request, film: Film, end: &End);
}

/// A request being rendered.
pub(super) struct Request {
    pub number: u64,
    pub scene: Arc<SceneState>,
    pub rays: PixelRays,
    /// See [`Direct::is_fine`].
    is_fine: bool,
    pub settings: FrameSettings,
    pub begun: Instant,
    pub pixels: u64,
    pub size: (u32, u32),
    me: Weak<Request>,
    owner: Weak<dyn Owner>,
    view: Arc<View>,
    /// True if the request shows the same as the previous one.
    unchanged: bool,
    /// True if the frame shows no picture yet, and threads other than its caller read blocks.
    may_glimpse: bool,
    srgb: Arc<Srgb>,
    corners: Vec<(u32, u32)>,
    /// `None` once the request has ended.
    film: Mutex<Option<Arc<Film>>>,
    stop: AtomicBool,
    /// Bytes of blocks that all models had read when the request began.
    come_before: u64,
    /// Pixels done in the current pass.
    pixels_done: AtomicU64,
    running: Mutex<Running>,
}

/// Phase of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Running,
    /// The request waits for blocks.
    Waiting,
    Ended,
}

struct Running {
    phase: Phase,
    passes: Passes,
    /// Snapshots of the current pass.
    snapshots: Option<Arc<Snapshots>>,
    stamp: u32,
    accept_missing: bool,
    /// Begin of the current pass; `pass_took` is the duration of the last one.
    pass_begun: Instant,
    pass_took: Duration,
    /// Time of the last picture.
    shown_at: Instant,
    /// True if the blocks that the last pass lacked are wanted.
    has_wanted: bool,
    /// Error of the first block that could not be read for a pane.
    unreadable: Option<Arc<Error>>,
    /// True while the thread that waits for the request reads blocks. That thread then checks for news itself.
    is_read_for: bool,
    job: Option<Job>,
    free: Vec<TileScratch>,
}

/// A worker's memory for a tile.
struct TileScratch {
    pixels: TilePixels,
    scratch: Scratch,
}

/// Arguments of [`Request::new`].
pub(super) struct Asked {
    pub number: u64,
    pub scene: Arc<SceneState>,
    pub rays: PixelRays,
    pub settings: FrameSettings,
    pub film: Film,
    pub srgb: Arc<Srgb>,
    pub view: Arc<View>,
    pub unchanged: bool,
    pub is_first: bool,
    pub owner: Weak<dyn Owner>,
}

impl Request {
    pub fn new(asked: Asked) -> Arc<Self> {
        let Asked { number, scene, rays, settings, film, srgb, view, unchanged, is_first, owner } = asked;
        let may_glimpse = is_first && scene.context().threads() > 0;
        let corners = tiles_from_the_middle(film.width, film.height);
        let running = Running {
            phase: Phase::Running,
            passes: Passes::new(corners.len(), settings.samples, settings.at_once),
            snapshots: None,
            stamp: 0,
            accept_missing: true,
            pass_begun: Instant::now(),
            pass_took: Duration::ZERO,
            shown_at: Instant::now(),
            has_wanted: false,
            unreadable: None,
            is_read_for: false,
            job: None,
            free: Vec::new(),
        };
        Arc::new_cyclic(|me| Self {
            number,
            is_fine: is_fine(&scene, &rays),
            scene,
            rays,
            settings,
            begun: Instant::now(),
            size: (film.width, film.height),
            pixels: u64::from(film.width) * u64::from(film.height),
            me: me.clone(),
            owner,
            come_before: view.bytes_come(),
            view,
            unchanged,
            may_glimpse,
            srgb,
            corners,
            film: Mutex::new(Some(Arc::new(film))),
            stop: AtomicBool::new(false),
            pixels_done: AtomicU64::new(0),
            running: Mutex::new(running),
        })
    }

    /// Begins the first pass; called once. Blocks that could not be read for earlier requests may be read again.
    pub fn start(&self) {
        self.scene.models.iter().for_each(|model| model.blocks().forget_failures());
        self.view().begin();
        let mut running = self.running();
        if running.phase == Phase::Running {
            if self.may_glimpse && !Snapshots::take(&self.scene).is_whole(&self.scene) {
                running.passes.begin_probe();
            } else {
                running.passes.begin_all();
            }
            self.begin_pass(running, true);
        }
    }

    /// Tells the request that wanted blocks may have arrived, or that some will not arrive.
    pub fn news(&self) {
        let mut running = self.running();
        running.passes.has_news = true;
        if !running.is_read_for {
            drop(running);
            self.look();
        }
    }

    /// Reads blocks for a request that waits, in a context without threads. Calls `step`, which does one piece of work
    /// if there is any, for as long as the last pass took, at least and at most [`READS`], and `most` at most. Then
    /// checks for news. (A check after each step would make hundreds of pictures for some hundred reads.) Returns true
    /// if the last `step` did any work.
    pub fn read(&self, most: Duration, step: impl Fn() -> bool) -> bool {
        let (begun, stamp, time) = {
            let mut running = self.running();
            running.is_read_for = true;
            (Instant::now(), running.stamp, running.pass_took.clamp(READS.0, READS.1).min(most))
        };
        // Reading ends when only another pass can tell which blocks are needed next.
        let lacks_more =
            || self.is_waiting() && self.view.status().state == ViewState::Busy && !self.view.is_stale(stamp);
        let mut did = step();
        while did && begun.elapsed() < time && lacks_more() {
            did = step();
        }
        self.running().is_read_for = false;
        self.look();
        did
    }

    /// Continues the request if it waits and there is news.
    fn look(&self) {
        let mut running = self.running();
        if running.phase == Phase::Waiting && running.passes.has_news {
            running.phase = Phase::Running;
            drop(running);
            self.go_on();
        }
    }

    /// Stops the request. Tiles in flight end within a packet; a request that waits for blocks ends at once.
    pub fn stop(&self) {
        self.stop.store(true, Relaxed);
        let job = {
            let mut running = self.running();
            if running.phase == Phase::Waiting {
                running.phase = Phase::Ended;
                drop(running);
                return self.finish(&End::Cancelled);
            }
            running.job.clone()
        };
        if let Some(job) = job {
            job.cancel();
        }
    }

    /// The job of the current pass; `None` between two passes.
    pub fn job(&self) -> Option<Job> {
        self.running().job.clone()
    }

    /// True if the request is between two passes and waits for blocks.
    pub fn is_waiting(&self) -> bool {
        self.running().phase == Phase::Waiting
    }

    /// Notes that the picture of the last pass can be mapped.
    pub fn is_shown(&self) {
        self.running().passes.is_shown();
    }

    /// Returns the progress of the request.
    pub fn progress(&self) -> Progress {
        let wanted = self.view.status().bytes_wanted;
        let share = self.pixels_done.load(Relaxed) as f64 / self.pixels as f64;
        let mut running = self.running();
        let come = self.view.bytes_come() - self.come_before;
        let now = Now { share, wanted, come, seconds: self.begun.elapsed().as_secs_f64() };
        running.passes.progress(now, self.settings.poe)
    }

    fn view(&self) -> ForRequest<'_> {
        self.view.of(self.number)
    }

    fn running(&self) -> MutexGuard<'_, Running> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn film(&self) -> Option<Arc<Film>> {
        self.film.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The state, or `None` if the request was stopped: it has ended then.
    fn unless_stopped(&self) -> Option<MutexGuard<'_, Running>> {
        let mut running = self.running();
        if !self.stop.load(Relaxed) {
            return Some(running);
        }
        running.phase = Phase::Ended;
        drop(running);
        self.finish(&End::Cancelled);
        None
    }

    /// Begins the planned pass. `afresh`: with a new stamp and the current pressure.
    fn begin_pass(&self, mut running: MutexGuard<Running>, afresh: bool) {
        if afresh {
            let first = running.stamp == 0;
            running.stamp = self.view().begin_pass(first && !self.unchanged);
            if !running.passes.has_panes() {
                running.passes.pressure = self.view.pressure();
            }
        }
        let snapshots = Snapshots::take(&self.scene);
        // If all blocks are in memory, traversals need no checks for missing blocks.
        running.accept_missing = !snapshots.is_whole(&self.scene);
        running.snapshots = Some(Arc::new(snapshots));
        let items = running.passes.items();
        running.has_wanted = false;
        running.pass_begun = Instant::now();
        drop(running);
        self.pixels_done.store(0, Relaxed);
        let Some(me) = self.me.upgrade() else { return };
        let job = self.scene.context().pool().submit(items, me);
        let mut running = self.running();
        // The pass may have ended already, and later passes may have begun.
        if running.phase == Phase::Running && job.ending().is_none() && running.snapshots.is_some() {
            running.job = Some(job.clone());
        }
        drop(running);
        if self.stop.load(Relaxed) {
            job.cancel();
        }
    }

    /// Takes the next step after a pass or after news.
    fn go_on(&self) {
        let lacking = self.running().passes.wants();
        let key = |model: u32| self.scene.models[model as usize].blocks().key();
        let wants: Vec<Wanted> =
            lacking.iter().map(|(n, weight)| Wanted { model: key(n.model), block: n.block, weight }).collect();
        // No lock of the request is held: the call takes the residency's lock. Wants that stand are not repeated:
        // fetchers would try again at once, and report again that there is no room.
        if !std::mem::replace(&mut self.running().has_wanted, true) {
            self.view().want(&wants);
        }
        if self.running().passes.is_probe {
            return self.after_glimpse(wants.is_empty());
        }
        if wants.is_empty() && !self.running().passes.has_panes() {
            self.ease();
        }
        // The errors are collected before the state is read, because a request of another frame may clear them.
        let unreadable = self.unreadable(&lacking);
        let stamp = {
            let mut running = self.running();
            // News of panes that come from here on may not be in the status.
            running.passes.has_news &= !running.passes.has_panes();
            running.stamp
        };
        let (status, pressure) = (self.view.status(), self.view.pressure());
        let seen =
            Seen { wants: status.state, is_alone: status.is_alone, pressure, is_stale: self.view.is_stale(stamp) };
        let Some(mut running) = self.unless_stopped() else { return };
        if running.passes.has_panes() && seen.wants == ViewState::Failed && running.unreadable.is_none() {
            running.unreadable = unreadable.clone();
        }
        let unreadable = unreadable.or_else(|| running.unreadable.clone());
        match running.passes.next(seen, self.settings.poe) {
            Next::Pane => {
                drop(running);
                self.begin_pane();
            }
            Next::Pass { afresh } => self.begin_pass(running, afresh),
            Next::Wait => running.phase = Phase::Waiting,
            Next::End { is_converged } => {
                running.phase = Phase::Ended;
                let has_panes = running.passes.has_panes();
                drop(running);
                if has_panes {
                    self.view().rest();
                }
                self.finish(&if is_converged { End::Converged } else { End::Budget(unreadable) });
            }
        }
    }

    /// Begins the next pane, or waits for the turn of this view: the views of a context take turns, because two panes
    /// at once may not fit.
    fn begin_pane(&self) {
        self.view().rest();
        self.view().end_turn();
        if self.view().takes_turn() {
            self.running().passes.begin_pane();
            return self.begin_pass(self.running(), true);
        }
        let Some(mut running) = self.unless_stopped() else { return };
        running.phase = Phase::Waiting;
        drop(running);
        // The other view may have ended its turn meanwhile. A request that was stopped since then has ended already, so
        // it must not keep the turn.
        if self.view().takes_turn() {
            if self.running().phase == Phase::Ended {
                return self.view().end_turn();
            }
            self.news();
        }
    }

    /// Lowers the pressure by a step if there is room: after a camera has moved there may be more room than is known
    /// yet, and a request that ended now would end coarser than necessary. Waits for reads in progress, [`LAST_READS`]
    /// at most.
    fn ease(&self) {
        let begun = Instant::now();
        while self.view.ease() && !self.stop.load(Relaxed) && begun.elapsed() < LAST_READS {
            std::thread::sleep(Duration::from_micros(500));
        }
    }

    /// Waits for the blocks that a probe found missing. Then begins another probe or the first picture.
    fn after_glimpse(&self, is_all_there: bool) {
        let is_up = || self.stop.load(Relaxed) || self.begun.elapsed() >= GLIMPSES;
        while !is_up() && self.view.status().state == ViewState::Busy {
            std::thread::sleep(Duration::from_micros(500));
        }
        let again = !is_all_there && !is_up() && self.view.status().state == ViewState::Satisfied;
        if !again {
            // Further reads would take processor time from rendering threads.
            self.view().want(&[]);
        }
        let Some(mut running) = self.unless_stopped() else { return };
        if !again {
            running.passes.begin_all();
        }
        self.begin_pass(running, true);
    }

    /// Returns the error of the first missing block that could not be read.
    fn unreadable(&self, lacking: &Wants) -> Option<Arc<Error>> {
        let why = |need: Need| self.scene.models[need.model as usize].blocks().why_failed(need.block);
        lacking.iter().find_map(|(need, _)| why(need)).map(Arc::new)
    }

    fn finish(&self, end: &End) {
        let film = self.film.lock().unwrap_or_else(PoisonError::into_inner).take();
        self.view().end_turn();
        {
            let mut running = self.running();
            running.free.clear();
            (running.snapshots, running.job) = (None, None);
        }
        // No tile is in flight any more, so the film has no other owner.
        let film = film.and_then(|f| Arc::try_unwrap(f).ok());
        if let (Some(owner), Some(film)) = (self.owner.upgrade(), film) {
            owner.ended(self, film, end);
        }
    }
}

/// True if the camera sees a tree from so far away that directions in single precision are too coarse for its pixels.
fn is_fine(scene: &SceneState, rays: &PixelRays) -> bool {
    let eye = rays.eye();
    let bounds = scene.bounds();
    if bounds.is_empty() || !rays.needs_rest((bounds.max - eye).abs().max((bounds.min - eye).abs()).length()) {
        return false;
    }
    let is_too_far = |p: &Placed| p.is_far(eye) && rays.needs_rest((p.bounds.center() - eye).length());
    let may_be = |b: &DBounds| rays.needs_rest((b.max - eye).abs().max((b.min - eye).abs()).length());
    scene.placed_in(Scenes::VISIBLE, may_be).any(|number| is_too_far(&scene.placed(number)))
}

impl Work for Request {
    fn run(&self, item: usize) -> Result<()> {
        let Some(film) = self.film() else { return Ok(()) };
        let (index, is_probe, only, effort, pressure, stamp, accept_missing, snapshots, tile_scratch) = {
            let mut running = self.running();
            let Some(snapshots) = running.snapshots.clone() else { return Ok(()) };
            let passes = &running.passes;
            let (index, pressure) = (passes.tile(item), passes.pressure);
            let (only, effort) = (passes.pixels(index), passes.effort(self.settings.poe));
            let (stamp, accept_missing) = (running.stamp, running.accept_missing);
            (index, passes.is_probe, only, effort, pressure, stamp, accept_missing, snapshots, running.free.pop())
        };
        let tile = self.corners[index];
        let mut tile_scratch =
            tile_scratch.unwrap_or_else(|| TileScratch { pixels: TilePixels::new(), scratch: Scratch::new() });
        let wanted = film.wanted();
        let any = |buffers: &[Buffer]| buffers.iter().any(|b| wanted.has(*b));
        let view = SceneView { accept_missing, stop: &self.stop, ..SceneView::new(&self.scene, &snapshots, stamp) };
        let asks = Asks {
            ids: any(&[Buffer::Part, Buffer::Instance, Buffer::Occurrence]),
            prims: any(&[Buffer::Primitive]),
            precise: any(&[Buffer::Depth, Buffer::Error]),
            normals: any(&[Buffer::Normal, Buffer::ShadingNormal]),
            uvs: any(&[Buffer::Uv]),
        };
        let integrator = Integrator::Direct(Direct {
            view,
            rays: &self.rays,
            size: (film.width, film.height),
            samples: effort.samples,
            ambient: self.settings.ambient.max(0.0),
            poe: effort.poe,
            is_pressed: pressure > 1.0,
            srgb: &self.srgb,
            tone: self.settings.tone(),
            asks,
            casts: self.scene.lights.iter().any(|light| light.kind != LightKind::Headlight),
            is_fine: self.is_fine,
            within: self.rays.rectangle_of(&self.scene.bounds_of_hits()),
        });
        let stop = || self.stop.load(Relaxed);
        let TileScratch { pixels, scratch } = &mut tile_scratch;
        scratch.wants.clear();
        let merged = if is_probe {
            TilePixels::probe(&integrator, tile, scratch);
            Some(Merged::default())
        } else {
            pixels.render(&integrator, tile, only, wanted, scratch, stop).map(|tally| {
                // No other worker has this tile meanwhile.
                let mut merged = self.running().passes.take(index);
                // A picture that is to fit at once has one threshold, whatever it is.
                let is_asked = effort.poe == self.settings.poe || self.settings.at_once;
                let as_requested = is_asked && scratch.wants.is_empty();
                let better = merged.add(pixels, tally, effort, as_requested);
                film.take(tile.0, tile.1, pixels, &better);
                self.pixels_done.fetch_add(u64::from(pixels.width) * u64::from(pixels.height), Relaxed);
                merged
            })
        };
        scratch.wants.add_up();
        let mut running = self.running();
        if let Some(merged) = merged {
            running.passes.done(index, merged, effort, &tile_scratch.scratch.wants);
        }
        running.free.push(tile_scratch);
        Ok(())
    }

    fn ended(&self, ending: &Ending) {
        {
            let mut running = self.running();
            (running.snapshots, running.job) = (None, None);
            running.pass_took = running.pass_begun.elapsed();
        }
        let end = match ending {
            Ending::Failed(error) => Some(End::Failed(Arc::clone(error))),
            Ending::Cancelled => Some(End::Cancelled),
            Ending::Finished => self.stop.load(Relaxed).then_some(End::Cancelled),
        };
        if let Some(end) = end {
            self.running().phase = Phase::Ended;
            return self.finish(&end);
        }
        let is_picture = {
            let running = self.running();
            let passes = &running.passes;
            // The end of the request shows the last picture.
            let is_due = !passes.has_panes() || running.shown_at.elapsed() >= PANES_SHOWN;
            !passes.is_probe && !passes.is_last() && is_due
        };
        if let (Some(film), Some(owner), true) = (self.film(), self.owner.upgrade(), is_picture)
            && owner.improved(self, &film)
        {
            let mut running = self.running();
            running.passes.is_shown();
            running.shown_at = Instant::now();
        }
        self.go_on();
    }
}
