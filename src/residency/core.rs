//! The data of a residency: the budget, the blocks of all models in memory, and the wants of all views. One per
//! context.
//!
//! One mutex guards all changes of the blocks in memory. Threads that pump or fetch take it for a few microseconds.
//! Reading and decoding happen outside of it, and threads that trace never take it.

use super::account::Account;
use super::admit::shares;
use super::blocks::{Inner, ModelKey};
use super::evict::Victims;
use super::lease::Reserve;
use super::pressure::Pressure;
use super::pump::{Ahead, Together};
use super::rank::Ranking;
use super::slots::Slot;
use super::snapshot::{CHANNELS, NO_VIEW, Snapshot, channel};
use super::sync::{AtomicU32, AtomicU64, Mutex, MutexGuard, Ordering::Relaxed, PoisonError};
use super::view::{Call, ViewCore};
use super::wakeup::Wakeup;
use crate::base::ids::BlockId;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Weak};
use std::time::Duration;

/// Options of [`Residency::new`].
#[derive(Debug, Clone, Copy)]
pub struct ResidencyOptions {
    /// Bytes for all models together.
    pub budget: u64,
    /// True if blocks that fit are read in the background before they are wanted.
    pub promote: bool,
}

/// The memory of all models of a context. Cloning is cheap and shares the data. Thread-safe.
///
/// **Snapshots** are immutable. Evicting a block publishes a snapshot without it, and an older snapshot that is held
/// keeps its blocks. This is the epoch scheme, with each held snapshot as an epoch. No single thread owns all writes:
/// each thread that pumps takes one mutex, which threads that trace never take.
///
/// **The budget** holds tables, slots until their last holder drops them, and the working memory of threads that read,
/// except the arrays that blocks are decoded in, at most some 300 KB for each such thread.
/// A part of it, the reserve, is for the lease of exact jobs, so that they end even if views use the rest.
#[derive(Clone)]
pub struct Residency(Arc<Shared>);

pub(super) struct Shared {
    options: ResidencyOptions,
    pub main: Account,
    pub reserve: Reserve,
    /// Bytes of `main` that are kept free of slots: for tables under construction, and for threads that read.
    pub headroom: u64,
    pub state: Mutex<State>,
    /// Counter of passes begun and of publications. Stamps are made from it.
    pub pass: AtomicU32,
    /// The pressure, as the bits of an f32.
    pub pressure: AtomicU32,
    /// Bytes of blocks that were read so far.
    pub come: AtomicU64,
    pub wakeup: Wakeup,
    /// See [`Residency::set_stepped`].
    pub is_stepped: AtomicBool,
}

/// The data behind the mutex.
pub(super) struct State {
    pub models: BTreeMap<ModelKey, Weak<Inner>>,
    next_key: u32,
    pub views: Vec<Weak<ViewCore>>,
    pub ranking: Ranking,
    pub ahead: Ahead,
    pub together: Together,
    pub victims: Victims,
    pub pressure: Pressure,
    /// The view that completes its picture pane by pane.
    pub turn: Weak<ViewCore>,
    /// Bytes of slots in the published snapshots.
    pub resident: u64,
    /// Bytes of slots being read.
    pub in_flight: u64,
    /// Bytes of companions in the published snapshots.
    pub companions: u64,
    /// Bytes of tables when all blocks are in memory. `pinned`: bytes of blocks that stay.
    pub tables: u64,
    pub pinned: u64,
}

/// Longest time that opening a model waits for other users to release memory.
pub(super) const FOR_ROOM: Duration = Duration::from_secs(2);

/// Work to do after the mutex is released.
#[derive(Default)]
pub(super) struct After {
    /// Snapshots that are no longer published. Dropping them may free much memory.
    pub garbage: Vec<Arc<Snapshot>>,
    pub calls: Vec<Call>,
    /// True if a block that a view wants was evicted: fetchers must search again.
    pub must_look: bool,
}

impl After {
    pub fn run(self, shared: &Shared) {
        drop(self.garbage);
        if self.must_look {
            shared.wake();
        }
        self.calls.into_iter().for_each(|call| call());
    }
}

impl Residency {
    /// Creates a residency with nothing in memory and no threads: see [`Residency::start`].
    pub fn new(options: ResidencyOptions) -> Self {
        let [headroom, reserve] = shares(options.budget);
        let state = State {
            models: BTreeMap::new(),
            next_key: 0,
            views: Vec::new(),
            ranking: Ranking::default(),
            ahead: Ahead::default(),
            together: Together::default(),
            victims: Victims::default(),
            pressure: Pressure::default(),
            turn: Weak::new(),
            resident: 0,
            in_flight: 0,
            companions: 0,
            tables: 0,
            pinned: 0,
        };
        Self(Arc::new(Shared {
            options,
            main: Account::new(options.budget.saturating_sub(reserve)),
            reserve: Reserve::new(reserve.min(options.budget)),
            headroom,
            state: Mutex::new(state),
            pass: AtomicU32::new(0),
            pressure: AtomicU32::new(1f32.to_bits()),
            come: AtomicU64::new(0),
            wakeup: Wakeup::default(),
            is_stepped: AtomicBool::new(false),
        }))
    }

    /// Tells that threads of the host do all work: while one of them waits, no pass ends. Calls then do not wait for
    /// memory that passes hold.
    pub fn set_stepped(&self) {
        self.0.is_stepped.store(true, Relaxed);
    }

    /// Creates a residency with a budget in bytes that reads only requested blocks.
    pub fn with_budget(budget: u64) -> Self {
        Self::new(ResidencyOptions { budget, promote: false })
    }

    /// The budget in bytes.
    pub fn budget(&self) -> u64 {
        self.0.options.budget
    }

    /// Bytes of the budget that are in use.
    pub fn used(&self) -> u64 {
        self.0.main.used() + self.0.reserve.used()
    }

    /// Returns a stamp for a pass that no view makes. Later passes have greater stamps.
    pub fn stamp(&self) -> u32 {
        self.0.next_pass(NO_VIEW)
    }

    /// Returns the stamp of the last pass begun, or of the last blocks published, in the channel for users other than
    /// views. Calls that begin no pass use it. A block's stamp is then written once per such event, and all blocks used
    /// between two events count as used at the same time.
    pub fn now(&self) -> u32 {
        self.0.now()
    }

    /// Returns the bytes that blocks may take beside pinned blocks, blocks being read, and blocks that live views, or
    /// passes from `stamp` on, have used.
    pub fn room_beside(&self, stamp: u32) -> u64 {
        let mut state = self.0.lock();
        let mut oldest_live_pass = state.oldest_live_pass();
        oldest_live_pass[channel(stamp)] = oldest_live_pass[channel(stamp)].min(stamp);
        let used = state.used_since(&oldest_live_pass) + state.in_flight;
        self.0.capacity(&state).saturating_sub(used)
    }

    pub(super) fn shared(&self) -> &Arc<Shared> {
        &self.0
    }
}

impl Shared {
    pub fn lock(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every step under it leaves a valid state.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn budget(&self) -> u64 {
        self.options.budget
    }

    pub fn promotes(&self) -> bool {
        self.options.promote
    }

    /// Returns the stamp of a pass that begins now.
    pub fn next_pass(&self, channel: u32) -> u32 {
        (self.pass.fetch_add(1, Relaxed) + 1) * CHANNELS as u32 + channel
    }

    /// Returns the stamp of blocks that a user other than a view uses now. Passes that begin later have greater stamps,
    /// and so do uses after other blocks were published.
    pub fn now(&self) -> u32 {
        self.pass.load(Relaxed) * CHANNELS as u32 + NO_VIEW
    }

    /// Bytes that slots may take beside the tables.
    pub fn capacity(&self, state: &State) -> u64 {
        self.main.limit().saturating_sub(self.headroom + state.tables)
    }

    /// Makes room for slots of `bytes` that must be in memory, also by evicting blocks in use. Returns false if
    /// snapshots still hold the evicted blocks.
    pub fn takes_room(&self, bytes: u64) -> bool {
        let mut after = After::default();
        let is_free = {
            let mut state = self.lock();
            state.fits(self, bytes) || state.free_up_in_use(self, bytes, &mut after).is_ok()
        };
        after.run(self);
        is_free
    }

    /// Adds a model.
    pub fn register(&self, model: &Arc<Inner>, roots: u64) {
        let mut state = self.lock();
        state.models.insert(model.key, Arc::downgrade(model));
        debug_assert!(state.pinned >= roots);
    }

    /// Removes a model.
    pub fn forget(&self, model: &Inner) {
        {
            let mut state = self.lock();
            if state.models.remove(&model.key).is_some() {
                let snapshot = model.published.load();
                state.resident -= snapshot.resident().map(|(id, _)| model.slot_bytes(id)).sum::<u64>();
                state.companions -= snapshot.companion_bytes();
                state.tables -= model.table_bytes;
                state.pinned -= model.root_bytes;
                let State { models, together, .. } = &mut *state;
                together.forget(models.values().filter_map(Weak::upgrade));
                let _ = state.ranking.invalidate();
            }
        }
        self.reserve.forget(model.key);
        self.wake();
    }

    /// Publishes `slots` to all later snapshots. Returns false if there is no memory for the table.
    pub fn publish(&self, model: &Inner, slots: &[(BlockId, Slot)], stamp: u32) -> bool {
        let mut after = After::default();
        let done = {
            let mut state = self.lock();
            state.publish(self, model, slots, stamp, &mut after)
        };
        after.run(self);
        done
    }

    /// Wakes fetchers, because there may be work.
    pub fn wake(&self) {
        self.wakeup.wake();
    }
}

impl State {
    /// Returns a key for a further model.
    pub fn new_key(&mut self) -> ModelKey {
        self.next_key += 1;
        ModelKey(self.next_key - 1)
    }

    pub fn model(&self, key: ModelKey) -> Option<Arc<Inner>> {
        self.models.get(&key)?.upgrade()
    }

    pub fn live_views(&mut self) -> Vec<Arc<ViewCore>> {
        self.views.retain(|view| view.strong_count() > 0);
        self.views.iter().filter_map(Weak::upgrade).collect()
    }

    /// Returns the oldest live pass of each channel. Blocks used in the channel since then are in use. While a view has
    /// the turn, the blocks of views at rest are not in use: their pictures are complete.
    pub fn oldest_live_pass(&mut self) -> [u32; CHANNELS] {
        let mut oldest = [u32::MAX; CHANNELS];
        let turn = self.turn.upgrade().filter(|view| view.has_turn());
        for view in self.live_views() {
            if turn.as_ref().is_some_and(|turn| !Arc::ptr_eq(turn, &view)) && view.is_at_rest() {
                continue;
            }
            let of_channel = &mut oldest[channel(view.channel)];
            *of_channel = view.oldest_live_pass().min(*of_channel);
        }
        oldest
    }

    /// Returns the channel with the fewest views.
    pub fn free_channel(&mut self) -> u32 {
        let views = self.live_views();
        (0..NO_VIEW).min_by_key(|channel| views.iter().filter(|view| view.channel == *channel).count()).unwrap_or(0)
    }

    /// True if slots of `need` bytes fit beside the published slots, those being read, and companions.
    pub fn fits(&self, shared: &Shared, need: u64) -> bool {
        self.resident + self.in_flight + self.companions + need <= shared.capacity(self)
    }

    pub fn publish(
        &mut self,
        shared: &Shared,
        model: &Inner,
        slots: &[(BlockId, Slot)],
        stamp: u32,
        after: &mut After,
    ) -> bool {
        if !self.models.contains_key(&model.key) {
            return false;
        }
        let before = model.published.load_full();
        let new: Vec<_> = slots.iter().filter(|(id, _)| before.block(*id).is_none()).cloned().collect();
        for (id, _) in &new {
            before.stamp_at_least(*id, stamp);
        }
        let bytes: u64 = new.iter().map(|(id, _)| model.slot_bytes(*id)).sum();
        let ids: Vec<BlockId> = new.iter().map(|(id, _)| *id).collect();
        let changes = new.into_iter().map(|(id, slot)| (id, Some(slot))).collect();
        let Some(next) = before.changed(changes, Some(&shared.main)) else { return false };
        after.garbage.push(before);
        after.garbage.push(model.published.swap(Arc::new(next)));
        // Blocks that calls without a pass use from here on get a later stamp than blocks used before.
        shared.pass.fetch_add(1, Relaxed);
        self.resident += bytes;
        model.count_promoted(ids.iter().copied(), true);
        shared.come.fetch_add(bytes, Relaxed);
        for view in self.live_views() {
            if view.wants_any(model.key, &ids) {
                after.calls.extend(view.call());
            }
        }
        true
    }
}
