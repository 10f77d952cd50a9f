//! A user of models' blocks that shows pictures or reads ahead: a live frame, or a prefetch.

use super::blocks::ModelKey;
use super::core::{Residency, Shared, State};
use super::rank::Key;
use crate::base::ids::BlockId;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Calls of a view's owner.
pub(super) type Call = Arc<dyn Fn() + Send + Sync>;

/// A block that a view lacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// The model: [`super::ModelBlocks::key`].
    pub model: ModelKey,
    /// The block.
    pub block: BlockId,
    /// How much it is worth: pixels × error removed. Not negative; NaN counts as 0.
    pub weight: f32,
}

/// Whether what a view wants comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViewState {
    /// All that can be read is in memory, some of it since it was wanted: another pass has less to want.
    Satisfied,
    /// It is being read, or will be.
    Busy,
    /// It does not fit beside what is in use, however coarse.
    Full,
    /// It cannot be read.
    Failed,
}

/// How a view's wants stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ViewStatus {
    /// Bytes, decoded, of what is wanted and not in memory.
    pub bytes_wanted: u64,
    /// Whether it comes.
    pub state: ViewState,
}

/// A live view: what it uses is not evicted, and what it wants is read. Thread-safe; meant to be driven by one thread.
///
/// It makes passes. (A view that only reads ahead makes none: its wants come last to room, and are refused when room is
/// short.) A pass: [`View::begin_pass`], then take snapshots, trace with the stamp, let go of the snapshots, and say
/// with [`View::want`] what was missing. Dropping it withdraws its wants.
pub struct View {
    core: Arc<ViewCore>,
    shared: Arc<Shared>,
}

pub(super) struct ViewCore {
    /// Of its stamps.
    pub channel: u32,
    /// The older of the passes that it stands on; `u32::MAX` before the first.
    oldest_live_pass: AtomicU32,
    /// The last pass begun.
    running: AtomicU32,
    wants: Mutex<Wants>,
    on_change: Mutex<Option<Call>>,
}

#[derive(Default)]
struct Wants {
    /// Ascending by key.
    list: Vec<(Key, f32)>,
    /// The pass that lacked them.
    stamp: u32,
}

impl Residency {
    /// A view that wants nothing yet.
    pub fn view(&self) -> View {
        let shared = Arc::clone(self.shared());
        let mut state = shared.lock();
        let core = Arc::new(ViewCore {
            channel: state.free_channel(),
            oldest_live_pass: AtomicU32::new(u32::MAX),
            running: AtomicU32::new(0),
            wants: Mutex::default(),
            on_change: Mutex::default(),
        });
        state.views.push(Arc::downgrade(&core));
        drop(state);
        View { core, shared }
    }
}

impl View {
    /// Begins a pass; returns the stamp with which it visits blocks. What the pass before used is in use until this one
    /// has ended. `changed`: the camera, or what is seen, is another than in the pass before.
    ///
    /// Ask for the [pressure](View::pressure) after this.
    pub fn begin_pass(&self, changed: bool) -> u32 {
        let mut state = self.shared.lock();
        let stamp = self.shared.next_pass(self.core.channel);
        let before = self.core.running.swap(stamp, Relaxed);
        self.core.oldest_live_pass.store(if before == 0 { stamp } else { before }, Relaxed);
        if changed {
            state.pressure.may_fall = true;
        }
        stamp
    }

    /// Replaces what it wants by what the pass that was begun last lacked, and ends the pass: what only passes before
    /// used may go. Blocks that came meanwhile are kept for the next pass.
    pub fn want(&self, wanted: &[Wanted]) {
        let running = self.core.running.load(Relaxed);
        let weight = |w: f32| if w > 0.0 { w } else { 0.0 };
        let mut list: Vec<(Key, f32)> = wanted.iter().map(|w| ((w.model, w.block), weight(w.weight))).collect();
        list.sort_unstable_by_key(|w| w.0);
        let mut state = self.shared.lock();
        for same in list.chunk_by(|a, b| a.0.0 == b.0.0) {
            let Some(model) = state.model(same[0].0.0) else { continue };
            let snapshot = model.published.load();
            same.iter().for_each(|((_, id), _)| snapshot.stamp_at_least(*id, running));
        }
        // An empty list after an empty list is no news for fetchers, unless room was short.
        let is_news = !list.is_empty() || !self.core.lock().list.is_empty() || self.pressure() > 1.0;
        // What is read ahead waits while a pass runs.
        let is_news = is_news || self.shared.promotes() && !state.models.is_empty();
        *self.core.lock() = Wants { list, stamp: running };
        if running != 0 {
            self.core.oldest_live_pass.store(running, Relaxed);
        }
        let must_look = state.ranking.invalidate();
        drop(state);
        if is_news || must_look {
            self.shared.wake();
        }
    }

    /// What the view's threshold is to be multiplied by, at least 1: more than that when what all views want does not
    /// fit the budget. A view whose threshold is 0 is to take a small one instead when this is above 1: what it wants
    /// would never get less.
    pub fn pressure(&self) -> f32 {
        f32::from_bits(self.shared.pressure.load(Relaxed))
    }

    /// Whether the pressure has changed since the pass with `stamp` began.
    pub fn is_stale(&self, stamp: u32) -> bool {
        stamp <= self.shared.lock().pressure.changed_at
    }

    /// For a view that has all it wants and would end: lowers the pressure, if there is room and it has not been done
    /// yet; views are told as ever. True if something is being read: ask again after that.
    pub fn ease(&self) -> bool {
        self.pressure() > 1.0 && self.shared.ease()
    }

    /// Bytes of blocks that have come to all models since the beginning.
    pub fn bytes_come(&self) -> u64 {
        self.shared.come.load(Relaxed)
    }

    /// How its wants stand.
    pub fn status(&self) -> ViewStatus {
        let state = self.shared.lock();
        let wants = self.core.lock();
        let (mut bytes_wanted, mut failed, mut waiting) = (0, 0, 0);
        let mut came = wants.list.len();
        for same in wants.list.chunk_by(|a, b| a.0.0 == b.0.0) {
            let Some(model) = state.model(same[0].0.0) else { continue };
            let snapshot = model.published.load();
            for id in same.iter().map(|((_, id), _)| *id).filter(|id| snapshot.block(*id).is_none()) {
                bytes_wanted += u64::from(model.file.decoded_len(id));
                *(if model.failures.has(id) { &mut failed } else { &mut waiting }) += 1;
                came -= 1;
            }
        }
        let state = match (failed, waiting) {
            (0, 0) => ViewState::Satisfied,
            // Else what came last would not be shown.
            (_, 0) if came > 0 => ViewState::Satisfied,
            (_, 0) => ViewState::Failed,
            _ if is_full(&state) || wants.stamp == 0 && state.ranking.is_refused() => ViewState::Full,
            _ => ViewState::Busy,
        };
        ViewStatus { bytes_wanted, state }
    }

    /// Has `call` called when blocks that it wants were published, when it became clear that some will not come, and
    /// when the pressure changed: begin a pass then. Called from any thread, under no lock of ours; calls may come
    /// late, and more often than there is news. Replaces an earlier one.
    pub fn on_change(&self, call: Option<Arc<dyn Fn() + Send + Sync>>) {
        *self.core.on_change.lock().unwrap_or_else(PoisonError::into_inner) = call;
    }
}

fn is_full(state: &State) -> bool {
    state.pressure.is_full
}

impl Drop for View {
    fn drop(&mut self) {
        let must_look = {
            let mut state = self.shared.lock();
            state.views.retain(|view| !std::ptr::eq(view.as_ptr(), Arc::as_ptr(&self.core)));
            state.ranking.invalidate()
        };
        if must_look || !self.core.lock().list.is_empty() || self.pressure() > 1.0 || self.core.is_passing() {
            self.shared.wake();
        }
    }
}

impl ViewCore {
    fn lock(&self) -> MutexGuard<'_, Wants> {
        self.wants.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The oldest pass that it stands on.
    pub fn oldest_live_pass(&self) -> u32 {
        self.oldest_live_pass.load(Relaxed)
    }

    /// Whether a pass has begun and not ended.
    pub fn is_passing(&self) -> bool {
        self.running.load(Relaxed) != self.wanted_at()
    }

    /// The pass that its wants are of.
    pub fn wanted_at(&self) -> u32 {
        self.lock().stamp
    }

    /// Adds its wants, each with its weight and pass.
    pub fn add_wants(&self, out: &mut Vec<(Key, f32, u32)>) {
        let wants = self.lock();
        out.extend(wants.list.iter().map(|&(key, weight)| (key, weight, wants.stamp)));
    }

    /// Whether it wants one of the blocks.
    pub fn wants_any(&self, model: ModelKey, ids: &[BlockId]) -> bool {
        let wants = self.lock();
        ids.iter().any(|&id| wants.list.binary_search_by_key(&(model, id), |w| w.0).is_ok())
    }

    /// Whom to call.
    pub fn call(&self) -> Option<Call> {
        self.on_change.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
