//! One for each context: the budget, the blocks of all models that are in memory, and the wants of all views.
//!
//! All changes of the blocks in memory go through one mutex. Threads that pump or fetch take it for a few microseconds;
//! reading and decoding happen outside of it, and threads that trace never take it.

use super::account::{Account, Charge};
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
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

/// Options of [`Residency::new`].
#[derive(Debug, Clone, Copy)]
pub struct ResidencyOptions {
    /// Bytes for all models together.
    pub budget: u64,
    /// Whether what fits is read in the background before it is wanted.
    pub promote: bool,
}

/// The memory of all models of a context. Cloning is cheap and gives the same. Thread-safe.
///
/// **Snapshots** are immutable; evicting a block publishes a snapshot without it, and an older one that is held
/// keeps its blocks: that is the epoch scheme, each snapshot held being an epoch. No single thread owns all writes:
/// each thread that pumps takes one mutex, which threads that trace never take.
///
/// **The budget** holds tables, slots until their last holder drops them, and the working memory of threads that read.
/// A part of it, the reserve, is for the lease of exact jobs, so that they end whatever views keep in memory.
#[derive(Clone)]
pub struct Residency(Arc<Shared>);

pub(super) struct Shared {
    options: ResidencyOptions,
    pub main: Account,
    pub reserve: Reserve,
    /// Of `main`, kept free of slots: for tables in the making, and for threads that read.
    pub headroom: u64,
    pub state: Mutex<State>,
    /// The last pass begun.
    pub pass: AtomicU32,
    /// The factor on thresholds, as bits.
    pub pressure: AtomicU32,
    /// Bytes of blocks that have come so far.
    pub come: AtomicU64,
    pub wakeup: Wakeup,
}

/// What the mutex guards.
pub(super) struct State {
    pub models: BTreeMap<ModelKey, Weak<Inner>>,
    next_key: u32,
    pub views: Vec<Weak<ViewCore>>,
    pub ranking: Ranking,
    pub ahead: Ahead,
    pub together: Together,
    pub victims: Victims,
    pub pressure: Pressure,
    /// Bytes of slots in the published snapshots.
    pub resident: u64,
    /// Bytes of slots being read.
    pub in_flight: u64,
    /// Bytes of tables, when all is in memory; and of blocks that stay.
    tables: u64,
    pinned: u64,
}

/// How long opening a model waits at most for others to let go of memory.
pub(super) const FOR_ROOM: Duration = Duration::from_secs(2);

/// What is to be done once the mutex is given back.
#[derive(Default)]
pub(super) struct After {
    /// Snapshots that are no longer published: letting go of them may free much.
    pub garbage: Vec<Arc<Snapshot>>,
    pub calls: Vec<Call>,
    /// A block has gone that a view wants: fetchers must look again.
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

/// Bytes kept free of slots under a budget, and those for the lease.
fn shares(budget: u64) -> [u64; 2] {
    [(budget / 16).clamp(1 << 20, 4 << 20), (budget / 8).clamp(1 << 20, 8 << 20)]
}

/// The least budget that leaves `bytes` beside what [`shares`] takes.
fn least_budget(bytes: u64) -> u64 {
    let mut budget = bytes;
    // Both sides grow with the budget, the right one slower.
    loop {
        let more = bytes.saturating_add(shares(budget).iter().sum());
        if more <= budget {
            return budget;
        }
        budget = more;
    }
}

impl Residency {
    /// With nothing in memory and no threads: see [`Residency::start`].
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
            resident: 0,
            in_flight: 0,
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
        }))
    }

    /// With a budget in bytes, reading only what is asked for.
    pub fn with_budget(budget: u64) -> Self {
        Self::new(ResidencyOptions { budget, promote: false })
    }

    /// The budget in bytes.
    pub fn budget(&self) -> u64 {
        self.0.options.budget
    }

    /// Bytes in use of it.
    pub fn used(&self) -> u64 {
        self.0.main.used() + self.0.reserve.used()
    }

    /// A stamp for a pass that no view makes. Later passes have greater ones.
    pub fn stamp(&self) -> u32 {
        self.0.next_pass(NO_VIEW)
    }

    /// The stamp of the last pass begun, or of the last blocks that came, in the channel for users other than views.
    /// Calls that begin no pass of their own use it: a block is written to once after each, and all that they use
    /// between two counts as used at one time.
    pub fn now(&self) -> u32 {
        self.0.now()
    }

    /// Bytes that blocks may take beside those that stay, those being read, and those that live views, or passes from
    /// `stamp` on, have used.
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
        // Every step under the lock leaves a valid state.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn budget(&self) -> u64 {
        self.options.budget
    }

    pub fn promotes(&self) -> bool {
        self.options.promote
    }

    /// The stamp of a pass that begins now.
    pub fn next_pass(&self, channel: u32) -> u32 {
        (self.pass.fetch_add(1, Relaxed) + 1) * CHANNELS as u32 + channel
    }

    /// The stamp of blocks that a user other than a view uses now. Passes that begin later have greater ones, and so
    /// has what is used after other blocks have come.
    pub fn now(&self) -> u32 {
        self.pass.load(Relaxed) * CHANNELS as u32 + NO_VIEW
    }

    /// Bytes that slots may take, given the tables.
    pub fn capacity(&self, state: &State) -> u64 {
        self.main.limit().saturating_sub(self.headroom + state.tables)
    }

    /// A key and what pays for `stays` bytes of tables, for the model `name` whose tables take `tables` bytes at most
    /// and of which `roots` bytes of blocks stay. What others use goes if it must: then it waits until passes that hold
    /// it have ended, [`FOR_ROOM`] at most.
    pub fn admit(&self, name: &Path, [stays, tables, roots]: [u64; 3], cancel: &Cancel) -> Result<(ModelKey, Charge)> {
        let have = self.options.budget;
        let key = {
            let mut state = self.lock();
            let need = least_budget(state.tables + tables + state.pinned + roots);
            if need > have {
                return Err(Error::OverBudget { what: format!("opening {}", name.display()), need, have });
            }
            state.tables += tables;
            state.pinned += roots;
            state.next_key += 1;
            ModelKey(state.next_key - 1)
        };
        let begun = Instant::now();
        loop {
            let charge = if self.takes_room(0) { self.main.charge(stays, 0) } else { None };
            if let Some(charge) = charge {
                return Ok((key, charge));
            }
            let cancelled = cancel.check();
            if cancelled.is_err() || begun.elapsed() >= FOR_ROOM {
                {
                    let mut state = self.lock();
                    state.tables -= tables;
                    state.pinned -= roots;
                    let _ = state.ranking.invalidate();
                }
                // There is more room again.
                self.wake();
                cancelled?;
                let what = format!("opening {} beside what is in use", name.display());
                return Err(Error::OverBudget { what, need: have + stays + roots, have });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Makes room for slots of `bytes` that must be in memory, also at the cost of blocks in use; false if snapshots
    /// hold the evicted blocks for now.
    pub fn takes_room(&self, bytes: u64) -> bool {
        let mut after = After::default();
        let is_free = {
            let mut state = self.lock();
            state.fits(self, bytes) || state.free_up_whoever_uses_it(self, bytes, &mut after).is_ok()
        };
        after.run(self);
        is_free
    }

    /// Makes a model known.
    pub fn register(&self, model: &Arc<Inner>, roots: u64) {
        let mut state = self.lock();
        state.models.insert(model.key, Arc::downgrade(model));
        debug_assert!(state.pinned >= roots);
    }

    /// Takes a model out.
    pub fn forget(&self, model: &Inner) {
        {
            let mut state = self.lock();
            if state.models.remove(&model.key).is_some() {
                let snapshot = model.published.load();
                state.resident -= snapshot.resident().map(|(id, _)| model.slot_bytes(id)).sum::<u64>();
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

    /// Shows `slots` in all snapshots taken from now on; false if there is no memory for the table.
    pub fn publish(&self, model: &Inner, slots: &[(BlockId, Slot)], stamp: u32) -> bool {
        let mut after = After::default();
        let done = {
            let mut state = self.lock();
            state.publish(self, model, slots, stamp, &mut after)
        };
        after.run(self);
        done
    }

    /// There may be something to do.
    pub fn wake(&self) {
        self.wakeup.wake();
    }
}

impl State {
    pub fn model(&self, key: ModelKey) -> Option<Arc<Inner>> {
        self.models.get(&key)?.upgrade()
    }

    pub fn live_views(&mut self) -> Vec<Arc<ViewCore>> {
        self.views.retain(|view| view.strong_count() > 0);
        self.views.iter().filter_map(Weak::upgrade).collect()
    }

    /// In each channel the oldest pass that a view stands on; blocks used there since are in use.
    pub fn oldest_live_pass(&mut self) -> [u32; CHANNELS] {
        let mut oldest = [u32::MAX; CHANNELS];
        for view in self.live_views() {
            let of_channel = &mut oldest[channel(view.channel)];
            *of_channel = view.oldest_live_pass().min(*of_channel);
        }
        oldest
    }

    /// The channel that fewest views are in.
    pub fn free_channel(&mut self) -> u32 {
        let views = self.live_views();
        (0..NO_VIEW).min_by_key(|channel| views.iter().filter(|view| view.channel == *channel).count()).unwrap_or(0)
    }

    /// Whether slots of `need` bytes fit beside what is, and is to be, published.
    pub fn fits(&self, shared: &Shared, need: u64) -> bool {
        self.resident + self.in_flight + need <= shared.capacity(self)
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
        // What calls use from here on, which begin no passes, counts as used later than what was used before.
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
