//! A frame: one view being rendered, with its buffers.
//!
//! A frame has more than two buffers of each kind. The last complete picture is shared and immutable, the picture being
//! rendered belongs to its job, and buffers that are no longer held are reused.

use super::film::{Buffer, Film, Mapped, Outputs, Picture, Spare, Target};
use super::job::{Asked, End, Owner, Request};
use super::pick::{MOST_RADIUS, pick, pick_near};
use super::status::{FrameState, FrameStatus, Progress};
use super::tone::Tone;
use crate::base::error::{Error, Result};
use crate::base::handle::{WakeFn, Waker};
use crate::math::srgb::Srgb;
use crate::query::Hit;
use crate::residency::View;
use crate::scene::camera::PixelRays;
use crate::scene::{Camera, Context, SceneState};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Options of a new frame.
#[derive(Clone)]
pub struct FrameOptions {
    /// Number of pixels in a row, 1 to 65536.
    pub width: u32,
    /// Number of rows, 1 to 65536.
    pub height: u32,
    /// Buffers to keep. They can be mapped when a picture is complete.
    pub outputs: Outputs,
    /// The caller's memory for some buffers, which need not be in `outputs`. A resize drops the targets.
    pub targets: Vec<(Buffer, Arc<dyn Target>)>,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self { width: 1024, height: 768, outputs: Outputs::COLOUR, targets: Vec::new() }
    }
}

/// Settings of a request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameSettings {
    /// Threshold in pixels of error: the area, in pixels, that a stand-in may cover; 0: exact.
    pub poe: f32,
    /// Rays per pixel for the colour, 1 to 1024. The other buffers use the ray through the pixel's centre.
    pub samples: u32,
    /// Ambient light, so that no surface is black; below 0: none.
    pub ambient: f32,
    /// If the data of the picture does not fit the budget at once, the request ends with the picture that does, at a
    /// higher threshold. Otherwise it goes on until the picture is as requested.
    pub at_once: bool,
    /// Factor to the light of surfaces in [`Buffer::ColourSrgb8`], finite and 0 or more. Backgrounds and
    /// [`Buffer::ColourLinear`] keep their colours.
    pub exposure: f32,
    /// If true, [`Buffer::ColourSrgb8`] has the nearest level to each linear colour times `exposure`. If false, values
    /// of surfaces above 0.8 are compressed so that they stay below white, and levels are dithered.
    pub exact_colours: bool,
}

impl Default for FrameSettings {
    fn default() -> Self {
        Self { poe: 0.0, samples: 1, ambient: 0.15, at_once: false, exposure: 1.0, exact_colours: false }
    }
}

/// One view being rendered. Thread-safe. [`Frame::wait`] and [`Frame::pick`] block. So do [`Frame::resize`], and
/// [`Frame::request`] of a frame with targets: they wait for tiles in flight. All other calls are cheap.
///
/// Dropping it cancels the request in progress and waits for the tiles in flight.
pub struct Frame {
    context: Context,
    shared: Arc<Shared>,
}

/// Data that a frame shares with its jobs.
///
/// It has the [`Waker`] of a [`crate::base::handle::Handle`], not a whole handle. A handle ends once. A frame ends once
/// per request, also calls the wake function for better pictures, and counts the replaced requests that still write to
/// its targets.
struct Shared {
    inner: Mutex<Inner>,
    /// Signalled when a request has ended, and when a better picture is available.
    changed: Condvar,
    /// Held while a request waits for earlier ones. Without it two requests could wait for each other.
    beginning: Mutex<()>,
    srgb: Arc<Srgb>,
    /// View of the residency: the blocks that the frame uses and wants.
    view: Arc<View>,
}

struct Inner {
    size: (u32, u32),
    outputs: Outputs,
    targets: Vec<(Buffer, Arc<dyn Target>)>,
    /// The last request.
    request: Option<Arc<Request>>,
    requests: u64,
    /// Number of requests that have not ended: the last one, and replaced ones with tiles in flight.
    unfinished: u32,
    /// Outcome of the last request, and the time of its end.
    ending: Option<(End, Instant)>,
    waker: Waker,
    /// The last complete picture.
    front: Option<Arc<Picture>>,
    /// Buffers to be reused.
    spare: Option<Spare>,
}

const MOST_PIXELS_ALONG: u32 = 1 << 16;
const MOST_PIXELS: u64 = 1 << 30;

pub(super) fn check_size(width: u32, height: u32) -> Result<()> {
    let fine = |n: u32| (1..=MOST_PIXELS_ALONG).contains(&n);
    if !fine(width) || !fine(height) {
        return Err(Error::bad_argument("the width and height of a frame must be from 1 to 65536 pixels"));
    }
    if u64::from(width) * u64::from(height) > MOST_PIXELS {
        let text =
            format!("a frame of {width} x {height} pixels is too large: at most {MOST_PIXELS} pixels are possible");
        return Err(Error::bad_argument(text));
    }
    Ok(())
}

impl FrameSettings {
    /// Fails with [`Error::BadArgument`] if a number is out of its range.
    pub fn check(&self) -> Result<()> {
        if !self.poe.is_finite() || self.poe < 0.0 {
            return Err(Error::bad_argument(format!("frame: poe is {}; it must be finite and 0 or more", self.poe)));
        }
        if !self.ambient.is_finite() {
            return Err(Error::bad_argument(format!("frame: ambient is {}; it must be finite", self.ambient)));
        }
        if !(1..=1024).contains(&self.samples) {
            return Err(Error::bad_argument("frame: samples must be from 1 to 1024"));
        }
        if !self.exposure.is_finite() || self.exposure < 0.0 {
            let text = format!("frame: exposure is {}; it must be finite and 0 or more", self.exposure);
            return Err(Error::bad_argument(text));
        }
        Ok(())
    }

    /// The conversion of colours to bytes.
    pub(super) fn tone(&self) -> Tone {
        Tone { exposure: self.exposure, exact: self.exact_colours }
    }
}

impl Frame {
    /// Creates a frame with its buffers. Fails with `BadArgument` if the size is out of range, `NoMemory` if there is
    /// no memory for the buffers.
    pub fn new(context: &Context, options: FrameOptions) -> Result<Self> {
        check_size(options.width, options.height)?;
        let inner = Inner {
            size: (options.width, options.height),
            outputs: options.outputs,
            targets: options.targets,
            request: None,
            requests: 0,
            unfinished: 0,
            ending: None,
            waker: Waker::default(),
            front: None,
            spare: Some(Spare::of((options.width, options.height), options.outputs, None)?),
        };
        let view = Arc::new(context.residency().view());
        let (changed, beginning, srgb) = (Condvar::new(), Mutex::new(()), Arc::new(Srgb::new()));
        let shared = Arc::new(Shared { inner: Mutex::new(inner), changed, beginning, srgb, view });
        let weak = Arc::downgrade(&shared);
        shared.view.on_change(Some(Arc::new(move || {
            let request = weak.upgrade().and_then(|shared| shared.inner().request.clone());
            if let Some(request) = request {
                request.news();
            }
        })));
        Ok(Self { context: context.clone(), shared })
    }

    /// The frame's context.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Begins a picture of `scene` from `camera` and cancels the request in progress. Returns at once, except that a
    /// frame with targets first waits for the tiles in flight, so that only one request writes to the targets.
    ///
    /// Fails with `BadArgument` for a bad camera, bad settings or a scene of another context, and with `NoMemory` if
    /// there is no memory for buffers beside those that are shown. The request in progress then continues.
    pub fn request(&self, scene: &Arc<SceneState>, camera: &Camera, settings: &FrameSettings) -> Result<()> {
        if !scene.context().same(&self.context) {
            return Err(Error::bad_argument("the scene belongs to another context"));
        }
        settings.check()?;
        let one_at_a_time = self.shared.beginning.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may resize the frame in between. The loop then reads the size again.
        let (request, before) = loop {
            let size = self.shared.inner().size;
            let rays = camera.prepare(size.0, size.1)?;
            let mut inner = self.shared.inner();
            if inner.size == size {
                break inner.begin(&self.shared, scene, rays, settings)?;
            }
        };
        if let Some(before) = before {
            before.stop();
        }
        self.settle(1);
        drop(one_at_a_time);
        request.start();
        Ok(())
    }

    /// Returns the status of the last request. Never blocks.
    pub fn poll(&self) -> FrameStatus {
        let inner = self.shared.inner();
        let ending = inner.ending.clone();
        Self::status(inner, ending)
    }

    fn status(inner: MutexGuard<'_, Inner>, ending: Option<(End, Instant)>) -> FrameStatus {
        let (request, shown) = (inner.request.clone(), inner.front.as_ref().map(|picture| picture.request));
        drop(inner);
        request.map_or_else(FrameStatus::default, |r| status_of(&r, ending, shown == Some(r.number)))
    }

    /// Waits until the last request has ended and a wake function that another thread calls has returned, `timeout` at
    /// most. After that time the state is still running. In a context without threads the caller does the work.
    pub fn wait(&self, timeout: Duration) -> FrameStatus {
        let deadline = Instant::now().checked_add(timeout);
        loop {
            let inner = self.shared.inner();
            let left = deadline.map_or(Duration::MAX, |d| d.saturating_duration_since(Instant::now()));
            let ending = inner.ending.clone().filter(|_| !inner.waker.is_called_elsewhere());
            let runs = ending.is_none() && !left.is_zero();
            let Some(request) = inner.request.clone().filter(|_| runs) else { return Self::status(inner, ending) };
            match request.job() {
                Some(job) => {
                    drop(inner);
                    job.wait(left.min(Duration::from_millis(100)));
                }
                None if request.is_waiting() && self.context.threads() == 0 => {
                    // The request waits for blocks, and no other thread may read them.
                    drop(inner);
                    if !request.read(left, || self.context.step()) {
                        std::thread::sleep(left.min(Duration::from_millis(1)));
                    }
                }
                // Each pass and each end signals. Another pass may have begun meanwhile.
                None => drop(self.shared.changed.wait_timeout(inner, left.min(Duration::from_millis(20)))),
            }
        }
    }

    /// Cancels the request in progress, within the time of a tile. The last complete picture stays mapped and complete.
    pub fn cancel(&self) {
        let request = self.shared.inner().request.clone();
        if let Some(request) = request {
            request.stop();
        }
    }

    /// Changes the size of later requests and cancels the request in progress. The last complete picture keeps its size
    /// until the next one is complete. Targets are dropped, and not written to after this call returns. Fails with
    /// `BadArgument` if the size is out of range, `NoMemory` if there is no memory for the buffers; then nothing has
    /// changed.
    pub fn resize(&self, width: u32, height: u32) -> Result<()> {
        check_size(width, height)?;
        let outputs = self.shared.inner().outputs;
        let spare = Spare::of((width, height), outputs, None)?;
        self.cancel();
        self.settle(0);
        let mut inner = self.shared.inner();
        inner.size = (width, height);
        inner.targets.clear();
        inner.spare = Some(spare);
        Ok(())
    }

    /// Waits until at most `left` requests write to targets. The others must have been stopped before.
    fn settle(&self, left: u32) {
        let mut inner = self.shared.inner();
        while !inner.targets.is_empty() && inner.unfinished > left {
            inner = self.shared.changed.wait(inner).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Returns the exact hit at pixel (`x`, `y`) of the last complete picture or, before there is one, of the last
    /// request, with every field filled. As in the picture, a surface that the eye is on is not hit. Blocks; may read
    /// the disk. Fails with `BadArgument` outside of the picture, `BadState` before the first request.
    pub fn pick(&self, x: u32, y: u32) -> Result<Hit> {
        let (scene, rays, _) = self.seen_at(x, y)?;
        let (ray, ahead) = rays.ray_from(f64::from(x) + 0.5, f64::from(y) + 0.5, &scene.bounds_of_hits());
        pick(&scene, &ray, ahead)
    }

    /// Returns a hit near a pixel, with a preference for thin parts: wires, and what covers few pixels.
    ///
    /// Rays go through the centre and six other points of each pixel within `radius` pixels of the pixel's centre. A
    /// part is thin if it covers less than a fifth of the picture within `radius` of its nearest point. The result is
    /// the nearest hit of a thin part, at equal distances that of the smaller depth; without a thin part, the hit at
    /// the pixel itself; and if that is a miss, the nearest hit. All hits are as for [`Frame::pick`].
    ///
    /// Fails as [`Frame::pick`], and with `BadArgument` if `radius` is not from 0 to 32.
    pub fn pick_near(&self, x: u32, y: u32, radius: f64) -> Result<Hit> {
        let (scene, rays, size) = self.seen_at(x, y)?;
        if !(0.0..=MOST_RADIUS).contains(&radius) {
            return Err(Error::BadArgument(format!("pick: the radius is {radius}; it must be from 0 to 32 pixels")));
        }
        pick_near(&scene, &rays, size, (x, y), radius)
    }

    /// Returns the scene, the camera and the size of the last complete picture, or of the last request, if it has the
    /// pixel.
    fn seen_at(&self, x: u32, y: u32) -> Result<(Arc<SceneState>, PixelRays, (u32, u32))> {
        let seen = {
            let inner = self.shared.inner();
            let last = || inner.request.as_ref().map(|r| (Arc::clone(&r.scene), r.rays, r.size));
            let front = inner.front.as_ref().map(|p| (Arc::clone(&p.scene), p.rays, (p.width, p.height)));
            front.or_else(last)
        };
        let Some((scene, rays, size)) = seen else {
            return Err(Error::BadState("pick: no picture was requested yet".into()));
        };
        if x >= size.0 || y >= size.1 {
            let text = format!("pick: pixel ({x}, {y}) is outside of the picture of {} x {} pixels", size.0, size.1);
            return Err(Error::BadArgument(text));
        }
        Ok((scene, rays, size))
    }

    /// Maps a buffer of the last complete picture. Cheap, without a copy. Fails with `BadState` if there is no complete
    /// picture yet or the frame does not keep this buffer.
    pub fn map(&self, buffer: Buffer) -> Result<Mapped> {
        let (front, has_target) = {
            let inner = self.shared.inner();
            (inner.front.clone(), inner.targets.iter().any(|(target, _)| *target == buffer))
        };
        let Some(picture) = front else {
            return Err(Error::BadState("map: no picture has been completed yet".into()));
        };
        let why = match has_target {
            true => "map: the frame writes this buffer to the caller's target; `buffers` must also name it to map it",
            false => "map: the frame does not keep this buffer; `buffers` must name it",
        };
        Mapped::of(picture, buffer).ok_or_else(|| Error::BadState(why.into()))
    }

    /// Sets a function that is called when a better picture can be mapped and when a request ends, also if it was
    /// cancelled or failed. The call comes from any thread, without a lock held. The function must not block; it may
    /// call the frame's cheap methods. `None` removes it.
    pub fn set_wake(&self, wake: Option<Arc<dyn Fn() + Send + Sync>>) {
        let before = self.shared.inner().waker.set(wake);
        drop(before);
    }
}

impl Drop for Frame {
    fn drop(&mut self) {
        // The frame's owner drops it and needs no wake call.
        self.set_wake(None);
        self.cancel();
        let mut inner = self.shared.inner();
        // Another thread may still run the wake function. (If this thread runs it, the function itself drops the
        // frame.)
        while inner.unfinished > 0 || inner.waker.is_called_elsewhere() {
            inner = self.shared.changed.wait(inner).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Inner {
    /// Takes the spare buffers if they have this size.
    fn take_spare(&mut self, size: (u32, u32)) -> Option<Spare> {
        self.spare.take_if(|spare| spare.size == size)
    }

    /// Keeps buffers for reuse if they have the current size.
    fn keep_spare(&mut self, buffers: Spare) {
        if buffers.size == self.size {
            self.spare = Some(buffers);
        }
    }

    /// Makes a new request the last one. Returns it, and the previous one if that still runs.
    fn begin(
        &mut self,
        shared: &Arc<Shared>,
        scene: &Arc<SceneState>,
        rays: PixelRays,
        settings: &FrameSettings,
    ) -> Result<(Arc<Request>, Option<Arc<Request>>)> {
        let film = Film::new(self.size, self.outputs, &self.targets, self.spare.take())?;
        self.requests += 1;
        self.unfinished += 1;
        let owner: Weak<Shared> = Arc::downgrade(shared);
        let is_same = |r: &Arc<Request>| Arc::ptr_eq(&r.scene, scene) && r.rays == rays && r.settings == *settings;
        let request = Request::new(Asked {
            number: self.requests,
            scene: Arc::clone(scene),
            rays,
            settings: *settings,
            film,
            srgb: Arc::clone(&shared.srgb),
            view: Arc::clone(&shared.view),
            unchanged: self.request.as_ref().is_some_and(is_same),
            is_first: self.front.is_none(),
            owner,
        });
        let running = self.ending.is_none();
        let before = self.request.replace(Arc::clone(&request));
        self.ending = None;
        Ok((request, before.filter(|_| running)))
    }
}

impl Shared {
    /// Calls the wake function. A panic in it does not affect the request.
    fn call(&self, wake: Option<WakeFn>) {
        let Some(wake) = wake else { return };
        let _ = catch_unwind(AssertUnwindSafe(|| wake()));
        // Dropped before the call counts as returned, as in `Handle::end`.
        drop(wake);
        self.inner().waker.returned();
        self.changed.notify_all();
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        // A poisoned lock is usable: every step under it leaves a valid state.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Owner for Shared {
    fn improved(&self, request: &Request, film: &Film) -> bool {
        let spare = {
            let mut inner = self.inner();
            if inner.requests != request.number {
                return true;
            }
            inner.take_spare((film.width, film.height))
        };
        // The copy of some megabytes is made without a lock. If there is no memory for it, the picture is shown when it
        // is finished.
        let Ok(copy) = film.copy(spare) else { return false };
        let picture = copy.into_picture(request.number, Arc::clone(&request.scene), request.rays);
        let wake = {
            let mut inner = self.inner();
            let newer = inner.front.as_ref().is_none_or(|p| p.request <= request.number);
            let old = if newer { inner.front.replace(Arc::new(picture)) } else { Some(Arc::new(picture)) };
            // A picture that is still mapped keeps its buffers.
            if let Some(old) = old.and_then(Arc::into_inner) {
                inner.keep_spare(old.into_spare());
            }
            if newer { inner.waker.call() } else { None }
        };
        self.changed.notify_all();
        self.call(wake);
        true
    }

    fn ended(&self, request: &Request, film: Film, ending: &End) {
        let mut cut_short = false;
        let wake = {
            let mut inner = self.inner();
            inner.unfinished -= 1;
            let newer = inner.front.as_ref().is_none_or(|p| p.request <= request.number);
            let buffers = film.into_spare();
            if matches!(ending, End::Converged | End::Budget(_)) && newer {
                let picture = buffers.into_picture(request.number, Arc::clone(&request.scene), request.rays);
                let old = inner.front.replace(Arc::new(picture));
                request.is_shown();
                // A picture that is still mapped keeps its buffers.
                if let Some(old) = old.and_then(Arc::into_inner) {
                    inner.keep_spare(old.into_spare());
                }
            } else {
                inner.keep_spare(buffers);
            }
            if inner.requests == request.number {
                cut_short = matches!(ending, End::Cancelled | End::Failed(_));
                inner.ending = Some((ending.clone(), Instant::now()));
                inner.waker.call()
            } else {
                None
            }
        };
        if cut_short {
            // The request's pass has not ended by itself. This call ends it: the blocks that it used become evictable,
            // and threads that wait for passes to end can continue.
            self.view.of(request.number).want(&[]);
        }
        self.changed.notify_all();
        self.call(wake);
    }
}

/// Returns the status of a request. `is_shown`: the last complete picture is the request's.
fn status_of(request: &Request, ending: Option<(End, Instant)>, is_shown: bool) -> FrameStatus {
    let Progress { fraction, tally, wanted, effective_poe, pictures, seconds_to_go } = request.progress();
    let (state, error) = match &ending {
        None => (FrameState::Running, None),
        Some((End::Converged, _)) => (FrameState::Converged, None),
        Some((End::Budget(unreadable), _)) => (FrameState::CompleteWithinBudget, unreadable.clone()),
        Some((End::Cancelled, _)) => (FrameState::Cancelled, None),
        Some((End::Failed(error), _)) => (FrameState::Failed, Some(Arc::clone(error))),
    };
    let is_complete = matches!(state, FrameState::Converged | FrameState::CompleteWithinBudget);
    let until = ending.map_or_else(Instant::now, |(_, at)| at);
    FrameStatus {
        state,
        request: request.number,
        fraction: if is_complete { 1.0 } else { fraction },
        // A pass that has ended counts as a picture once that can be mapped.
        pictures: if is_shown { pictures.max(1) } else { 0 },
        pixels_exact: tally.exact,
        pixels_lod: tally.lod,
        pixels_missing: tally.missing,
        pixels_total: request.pixels,
        worst_error_px: tally.error_max,
        mean_error_px: (tally.error_sum / tally.hits.max(1) as f64) as f32,
        effective_poe,
        bytes_resident: request.scene.resident_bytes(),
        bytes_wanted: if state == FrameState::Running || is_complete { wanted } else { 0 },
        seconds_to_go: if state == FrameState::Running { seconds_to_go } else { 0.0 },
        seconds: until.saturating_duration_since(request.begun).as_secs_f64(),
        error,
    }
}
