//! A view: a user of models' blocks that shows pictures or reads ahead (a live frame or a prefetch).

use super::blocks::ModelKey;
use super::core::{Residency, Shared, State};
use super::rank::{Key, RankedWant};
use crate::base::ids::BlockId;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Function of a view's owner that receives news.
pub(super) type Call = Arc<dyn Fn() + Send + Sync>;

/// A block that a view lacked in a pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Key of the model ([`super::ModelBlocks::key`]).
    pub model: ModelKey,
    /// The block.
    pub block: BlockId,
    /// Weight: pixels × error removed. Not negative; NaN counts as 0.
    pub weight: f32,
}

/// State of a view's wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViewState {
    /// No block is left to be read, and some have arrived since they were wanted: another pass will want less.
    Satisfied,
    /// Wanted blocks are being read or will be read.
    Busy,
    /// Wanted blocks do not fit beside the blocks in use, even at the greatest pressure.
    Full,
    /// Wanted blocks cannot be read.
    Failed,
}

/// Status of a view's wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ViewStatus {
    /// Decoded bytes of wanted blocks that are not in memory.
    pub bytes_wanted: u64,
    /// State of the wants.
    pub state: ViewState,
    /// True if no other view makes a pass, or has wants that get room before those of the view with the turn. Otherwise
    /// there may be more room later.
    pub is_alone: bool,
}

/// A live view: the blocks that it uses are not evicted, and those that it wants are read. Thread-safe; meant to be
/// driven by one thread.
///
/// A view makes passes. A pass calls [`View::begin_pass`], then takes snapshots, traces with the stamp, drops the
/// snapshots, and reports the missing blocks with [`View::want`]. (A view that only reads ahead makes no passes: its
/// wants get room last, and are refused when room is short.) Dropping the view withdraws its wants.
pub struct View {
    core: Arc<ViewCore>,
    shared: Arc<Shared>,
}

pub(super) struct ViewCore {
    /// Channel of the view's stamps.
    pub channel: u32,
    /// The older of the view's live passes, the current one and the one before; `u32::MAX` before the first.
    oldest_live_pass: AtomicU32,
    /// Stamp of the last pass begun.
    running: AtomicU32,
    wants: Mutex<Wants>,
    /// Number of the latest request that uses the view.
    user: AtomicU64,
    /// Number of the request that has the turn; 0 if none has it.
    turn: AtomicU64,
    on_change: Mutex<Option<Call>>,
}

#[derive(Default)]
struct Wants {
    /// Sorted by key, ascending.
    list: Vec<(Key, f32)>,
    /// Stamp of the pass that lacked the blocks.
    stamp: u32,
}

impl Residency {
    /// Creates a view without wants.
    pub fn view(&self) -> View {
        let shared = Arc::clone(self.shared());
        let mut state = shared.lock();
        let core = Arc::new(ViewCore {
            channel: state.free_channel(),
            oldest_live_pass: AtomicU32::new(u32::MAX),
            running: AtomicU32::new(0),
            wants: Mutex::default(),
            user: AtomicU64::new(0),
            turn: AtomicU64::new(0),
            on_change: Mutex::default(),
        });
        state.views.push(Arc::downgrade(&core));
        drop(state);
        View { core, shared }
    }
}

/// A view as one of the requests for its pictures uses it. From the moment a later request begins, calls for it do
/// nothing: otherwise a request that was replaced could still withdraw the wants of the one that replaced it.
#[derive(Clone, Copy)]
pub struct ForRequest<'a> {
    view: &'a View,
    request: u64,
}

impl ForRequest<'_> {
    /// Makes the request the user of the view.
    pub fn begin(self) {
        let _state = self.view.shared.lock();
        self.view.core.user.fetch_max(self.request, Relaxed);
    }

    /// True if a later request uses the view. The lock of `state` keeps it so.
    fn is_over(self, _state: &State) -> bool {
        self.request < self.view.core.user.load(Relaxed)
    }

    /// See [`View::begin_pass`]. Returns 0 if a later request has begun.
    pub fn begin_pass(self, changed: bool) -> u32 {
        let View { core, shared, .. } = self.view;
        let mut state = shared.lock();
        if self.is_over(&state) {
            return 0;
        }
        let stamp = shared.next_pass(core.channel);
        let before = core.running.swap(stamp, Relaxed);
        core.oldest_live_pass.store(if before == 0 { stamp } else { before }, Relaxed);
        if changed {
            state.pressure.may_fall = true;
        }
        stamp
    }

    /// See [`View::want`].
    pub fn want(self, wanted: &[Wanted]) {
        let View { core, shared, .. } = self.view;
        let weight = |w: f32| if w > 0.0 { w } else { 0.0 };
        let mut list: Vec<(Key, f32)> = wanted.iter().map(|w| ((w.model, w.block), weight(w.weight))).collect();
        list.sort_unstable_by_key(|w| w.0);
        let mut state = shared.lock();
        if self.is_over(&state) {
            return;
        }
        let running = core.running.load(Relaxed);
        for same in list.chunk_by(|a, b| a.0.0 == b.0.0) {
            let Some(model) = state.model(same[0].0.0) else { continue };
            let snapshot = model.published.load();
            same.iter().for_each(|((_, id), _)| snapshot.stamp_at_least(*id, running));
        }
        // An empty list after an empty list is no news for fetchers, unless room was short.
        let is_news = !list.is_empty() || !core.lock().list.is_empty() || self.view.pressure() > 1.0;
        // Reading ahead waits while a pass runs.
        let is_news = is_news || shared.promotes() && !state.models.is_empty();
        *core.lock() = Wants { list, stamp: running };
        if running != 0 {
            core.oldest_live_pass.store(running, Relaxed);
        }
        let must_look = state.ranking.invalidate();
        drop(state);
        if is_news || must_look {
            shared.wake();
        }
    }

    /// Withdraws the view's wants, and lets its blocks be evicted although they were used last by it: its picture does
    /// not need them any more.
    pub fn rest(self) {
        self.want(&[]);
        let state = self.view.shared.lock();
        if !self.is_over(&state) {
            self.view.core.oldest_live_pass.store(u32::MAX, Relaxed);
        }
    }

    /// Takes the turn, unless another view has it or a later request has begun. Wants of the view that has the turn
    /// never raise the pressure: they come last, and if they do not fit, the state is `Full`.
    pub fn takes_turn(self) -> bool {
        let core = &self.view.core;
        let mut state = self.view.shared.lock();
        let is_free = state.turn.upgrade().is_none_or(|of| Arc::ptr_eq(&of, core) || !of.has_turn());
        if !is_free || self.is_over(&state) {
            return false;
        }
        state.turn = Arc::downgrade(core);
        core.turn.store(self.request, Relaxed);
        // The view's wants are patient from here on.
        if state.ranking.invalidate() {
            drop(state);
            self.view.shared.wake();
        }
        true
    }

    /// Ends the turn, if the request has it, and calls the functions of all other views.
    pub fn end_turn(self) {
        let View { core, shared, .. } = self.view;
        let mut others = {
            let mut state = shared.lock();
            if core.turn.compare_exchange(self.request, 0, Relaxed, Relaxed).is_err() {
                return;
            }
            // The wants of a later request were ranked as patient.
            let _ = state.ranking.invalidate();
            state.live_views()
        };
        shared.wake();
        others.retain(|view| !Arc::ptr_eq(view, core));
        others.iter().filter_map(|view| view.call()).for_each(|call| call());
    }
}

impl View {
    /// The view as request `number` uses it: a number above 0, greater than those of the requests before.
    pub fn of(&self, number: u64) -> ForRequest<'_> {
        ForRequest { view: self, request: number }
    }

    /// Begins a pass; returns the stamp with which it visits blocks. The blocks that the pass before used stay in use
    /// until this one has ended. `changed`: the camera or the scene differs from the pass before.
    ///
    /// Query the [pressure](View::pressure) after this call.
    pub fn begin_pass(&self, changed: bool) -> u32 {
        self.of(u64::MAX).begin_pass(changed)
    }

    /// Replaces the view's wants by the blocks that the last begun pass lacked, and ends the pass: blocks that only
    /// earlier passes used become evictable. Wanted blocks that arrived meanwhile are kept for the next pass.
    pub fn want(&self, wanted: &[Wanted]) {
        self.of(u64::MAX).want(wanted);
    }

    /// Returns the factor for the view's threshold: at least 1, and more if the wants of all views do not fit the
    /// budget. If it is above 1, a view with threshold 0 must use a small threshold instead; otherwise its wants would
    /// never shrink.
    pub fn pressure(&self) -> f32 {
        f32::from_bits(self.shared.pressure.load(Relaxed))
    }

    /// True if the pressure has changed since the pass with `stamp` began.
    pub fn is_stale(&self, stamp: u32) -> bool {
        stamp <= self.shared.lock().pressure.changed_at
    }

    /// Lowers the pressure if there is room and that was not done yet. For a view that lacks no block and is about to
    /// end. All views are notified. Returns true if blocks are being read: call it again after that.
    pub fn ease(&self) -> bool {
        self.pressure() > 1.0 && self.shared.ease()
    }

    /// Bytes of blocks that were read for all models since the residency was created.
    pub fn bytes_come(&self) -> u64 {
        self.shared.come.load(Relaxed)
    }

    /// Status of the view's wants.
    pub fn status(&self) -> ViewStatus {
        let mut state = self.shared.lock();
        let is_alone = state.live_views().iter().all(|view| Arc::ptr_eq(view, &self.core) || !view.is_busy());
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
            // Otherwise the blocks that arrived last would not be shown.
            (_, 0) if came > 0 => ViewState::Satisfied,
            (_, 0) => ViewState::Failed,
            _ if is_full(&state) || self.core.is_patient(wants.stamp) && state.ranking.is_refused() => ViewState::Full,
            _ => ViewState::Busy,
        };
        ViewStatus { bytes_wanted, state, is_alone }
    }

    /// Sets a function that is called when wanted blocks were published, when some turned out to be unavailable, and
    /// when the pressure changed. The view should then begin a pass. The call comes from any thread, without a lock
    /// held; calls may be late, and more frequent than news. Replaces an earlier function.
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

    /// Returns the older of the view's live passes.
    pub fn oldest_live_pass(&self) -> u32 {
        self.oldest_live_pass.load(Relaxed)
    }

    pub fn has_turn(&self) -> bool {
        self.turn.load(Relaxed) != 0
    }

    /// True if the view is between passes and wants nothing.
    pub fn is_at_rest(&self) -> bool {
        let wants = self.lock();
        wants.list.is_empty() && self.running.load(Relaxed) == wants.stamp
    }

    /// True if wants of a pass with `stamp` wait for room instead of raising the pressure.
    pub fn is_patient(&self, stamp: u32) -> bool {
        stamp == 0 || self.has_turn()
    }

    /// True if a pass has begun and not ended.
    pub fn is_passing(&self) -> bool {
        self.running.load(Relaxed) != self.wanted_at()
    }

    /// Stamp of the pass that lacked the wanted blocks.
    pub fn wanted_at(&self) -> u32 {
        self.lock().stamp
    }

    /// True if the view makes a pass, or has wants that are not patient.
    fn is_busy(&self) -> bool {
        let wants = self.lock();
        self.running.load(Relaxed) != wants.stamp || !wants.list.is_empty() && !self.is_patient(wants.stamp)
    }

    /// Appends the view's wants to `out`.
    pub fn add_wants(&self, out: &mut Vec<RankedWant>) {
        let wants = self.lock();
        let (stamp, is_patient) = (wants.stamp, self.is_patient(wants.stamp));
        out.extend(wants.list.iter().map(|&(key, weight)| RankedWant { key, weight, stamp, is_patient }));
    }

    /// True if the view wants one of the blocks.
    pub fn wants_any(&self, model: ModelKey, ids: &[BlockId]) -> bool {
        let wants = self.lock();
        ids.iter().any(|&id| wants.list.binary_search_by_key(&(model, id), |w| w.0).is_ok())
    }

    /// Returns the owner's function.
    pub fn call(&self) -> Option<Call> {
        self.on_change.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
