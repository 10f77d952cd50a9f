//! Reading of wanted blocks, a run of neighbours at a time.

use super::account::Charge;
use super::blocks::Inner;
use super::claims::Claim;
use super::core::{After, Residency, Shared, State};
use super::evict::Short;
use super::huge_pages::{Page, filled, put_together};
use super::load::{Buffers, RUN_BYTES, goes_with};
use super::rank::can_be_had;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::base::threads;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

/// Sleep of a fetcher before it checks again if a snapshot was dropped.
const STARVED: Duration = Duration::from_millis(2);
/// The same for a thread that may hold that snapshot itself: it drops the snapshot as soon as it does other work.
const STARVED_AMONG_OTHERS: Duration = Duration::from_micros(100);

/// Outcome of a search for work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unit {
    /// A run was read, or huge pages were collapsed.
    Did,
    /// There is no work.
    Idle,
    /// There is work, but no memory until a snapshot is dropped.
    Starved,
    /// There is work, but not while views render.
    Later,
}

enum Next {
    Load(Task),
    /// A model with all blocks in memory, to be searched for huge pages.
    Find(Arc<Inner>),
    /// Huge pages to be collapsed.
    Together(Vec<Page>),
    /// Room was made: search once more.
    Again,
    Idle,
    Starved,
    Later,
}

/// A run to be read, and the memory for it.
struct Task {
    model: Arc<Inner>,
    ids: Vec<BlockId>,
    stamp: u32,
    room: Room,
}

/// Memory for blocks that are to be read.
pub(super) struct Room {
    pub charge: Charge,
    pub buffers: Buffers,
    _in_flight: InFlight,
}

/// Counts bytes as being read, until it is dropped.
struct InFlight {
    shared: Arc<Shared>,
    bytes: u64,
}

impl Drop for InFlight {
    fn drop(&mut self) {
        self.shared.lock().in_flight -= self.bytes;
    }
}

impl Residency {
    /// Does a unit of work in this thread instead of a fetcher, if there is any that no thread does: takes the most
    /// wanted block, makes room, reads and decodes it with its neighbours, and publishes them. Returns true if there
    /// may be more. Thread-safe. Waits for the disk without a lock held. If there is no memory until a snapshot is
    /// dropped, it sleeps for a moment and returns true, because dropping a snapshot wakes no thread.
    pub fn pump_on(&self) -> bool {
        match self.shared().unit() {
            Unit::Did => true,
            Unit::Idle | Unit::Later => false,
            Unit::Starved => {
                std::thread::sleep(STARVED_AMONG_OTHERS);
                true
            }
        }
    }

    /// Like [`Residency::pump_on`], but returns false if there is no memory until a snapshot is dropped.
    #[cfg(test)]
    pub fn pump(&self) -> bool {
        self.shared().unit() == Unit::Did
    }

    /// Sets a function that is called when there is work for [`Residency::pump_on`], from any thread, without a lock
    /// held. Replaces an earlier one.
    pub fn set_waker(&self, waker: Option<Arc<dyn Fn() + Send + Sync>>) {
        self.shared().wakeup.set_waker(waker);
    }

    /// Starts threads that pump whenever there is work. They end when the returned value is dropped. Fails if a thread
    /// cannot be started.
    pub fn start(&self, threads: usize) -> Result<Fetchers> {
        let mut fetchers = Fetchers { shared: Arc::downgrade(self.shared()), threads: Vec::new() };
        for i in 0..threads {
            let shared = Arc::clone(self.shared());
            let thread = threads::named(format!("outcrop fetch {i}"))
                .spawn(move || shared.fetch_until_stopped())
                .map_err(|e| Error::io("fetcher thread", "start", e))?;
            fetchers.threads.push(thread);
        }
        Ok(fetchers)
    }
}

/// Threads that fetch blocks. Dropping it waits until they have ended.
pub struct Fetchers {
    shared: Weak<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl Drop for Fetchers {
    fn drop(&mut self) {
        if let Some(shared) = self.shared.upgrade() {
            shared.wakeup.stop();
        }
        let me = std::thread::current().id();
        for thread in self.threads.drain(..) {
            // The last owner may be a fetcher itself, which drops the data that a model held.
            if thread.thread().id() != me {
                let _ = thread.join();
            }
        }
    }
}

/// The blocks of a model that remain to be read ahead.
#[derive(Default)]
pub(super) struct Ahead {
    model: Weak<Inner>,
    /// Descending: the next block is the last element. Some may have been read meanwhile.
    left: Vec<BlockId>,
    /// Bytes of the blocks in `left`.
    bytes: u64,
}

/// Huge pages of models with all blocks in memory.
#[derive(Default)]
pub(super) struct Together {
    /// Pages that remain to be collapsed.
    left: Vec<Page>,
    /// True once the system has collapsed one page.
    works: bool,
}

/// Number of huge pages collapsed at a time. That takes some milliseconds, or tens of them if the system must first be
/// given memory.
const PAGES: usize = 4;

impl Together {
    /// Clears the list after memory was freed: its pages may hold other blocks by now. Fetchers search for them again.
    pub fn forget(&mut self, models: impl Iterator<Item = Arc<Inner>>) {
        if !self.left.is_empty() {
            self.left.clear();
            models.for_each(|model| model.is_together.store(false, Relaxed));
        }
    }
}

impl State {
    /// Returns the next huge pages to collapse, unless a view renders: it could have to wait for the system. (Queries
    /// may wait for as long as it takes to copy a page.)
    fn next_together(&mut self) -> Next {
        let is_new = |model: Arc<Inner>| model.is_complete.load(Relaxed) && !model.is_together.load(Relaxed);
        if self.together.left.is_empty() && !self.models.values().filter_map(Weak::upgrade).any(is_new) {
            return Next::Idle;
        }
        if self.live_views().iter().any(|view| view.is_passing()) {
            return Next::Later;
        }
        if !self.together.left.is_empty() {
            let from = self.together.left.len().saturating_sub(PAGES);
            return Next::Together(self.together.left.split_off(from));
        }
        let models: Vec<_> = self.models.values().filter_map(Weak::upgrade).collect();
        let mut complete = models.into_iter().filter(|model| model.is_complete.load(Relaxed));
        complete.find(|model| !model.is_together.swap(true, Relaxed)).map_or(Next::Idle, Next::Find)
    }

    /// Returns the next run to be read ahead, in the order of the file, from a model that fits as a whole. (Models are
    /// searched only when the results of the last search are used up: a search per block would take minutes for a
    /// million blocks. A model is searched only if its missing blocks fit: otherwise each search would visit all blocks
    /// with the lock held.)
    fn next_ahead(&mut self, shared: &Shared) -> Option<(Arc<Inner>, Vec<BlockId>)> {
        let begun = self.ahead.model.upgrade();
        if let Some(run) = begun.and_then(|model| Some((Arc::clone(&model), self.run_ahead(shared, &model)?))) {
            return Some(run);
        }
        let models: Vec<_> = self.models.values().filter_map(Weak::upgrade).collect();
        models.into_iter().filter(|model| model.may_promote.load(Relaxed)).find_map(|model| {
            let lacking = model.promoted_lacking();
            if lacking == 0 {
                model.is_complete.store(true, Relaxed);
            }
            // `in_flight` is not added, because blocks being read may be among the missing ones.
            let is_in_vain = lacking == 0 || lacking == model.lacked_in_vain.load(Relaxed);
            if is_in_vain || self.resident + lacking > shared.capacity(self) {
                return None;
            }
            let is_lacking = |id: &BlockId| model.decoder.class(*id).is_read_ahead && can_be_had(&model, *id);
            let left: Vec<BlockId> = (0..model.file.block_count()).rev().map(BlockId).filter(is_lacking).collect();
            if left.is_empty() {
                model.is_complete.store(true, Relaxed);
                model.lacked_in_vain.store(lacking, Relaxed);
            }
            let bytes = left.iter().map(|&id| model.slot_bytes(id)).sum();
            self.ahead = Ahead { model: Arc::downgrade(&model), left, bytes };
            Some((Arc::clone(&model), self.run_ahead(shared, &model)?))
        })
    }

    fn run_ahead(&mut self, shared: &Shared, model: &Inner) -> Option<Vec<BlockId>> {
        let ahead = &mut self.ahead;
        while let Some(id) = ahead.left.pop_if(|id| !can_be_had(model, *id)) {
            ahead.bytes -= model.slot_bytes(id);
        }
        let (&first, bytes) = (ahead.left.last()?, ahead.bytes);
        let mut run = vec![first];
        for &next in ahead.left.iter().rev().skip(1) {
            if !can_be_had(model, next) || !goes_with(&model.file, [first, run[run.len() - 1], next], RUN_BYTES) {
                break;
            }
            run.push(next);
        }
        self.fits(shared, bytes).then_some(run)
    }
}

impl Shared {
    fn fetch_until_stopped(self: Arc<Self>) {
        while let Some(seen) = self.wakeup.reasons() {
            match self.unit() {
                Unit::Did => {}
                Unit::Idle => self.wakeup.sleep(seen, None),
                Unit::Starved | Unit::Later => self.wakeup.sleep(seen, Some(STARVED)),
            }
        }
    }

    pub fn unit(self: &Arc<Self>) -> Unit {
        // Another thread may take the room that was made, so the loop tries several times.
        for _ in 0..8 {
            let mut after = After::default();
            let next = {
                let mut state = self.lock();
                self.next(&mut state, &mut after)
            };
            after.run(self);
            match next {
                Next::Again => {}
                Next::Load(task) => return self.work(task),
                Next::Find(model) => {
                    self.find_pages(&model);
                    return Unit::Did;
                }
                Next::Together(pages) => {
                    let done = pages.into_iter().filter(|page| put_together(*page)).count();
                    let together = &mut self.lock().together;
                    together.works |= done > 0;
                    if !together.works {
                        together.left.clear();
                    }
                    return Unit::Did;
                }
                Next::Idle => return Unit::Idle,
                Next::Starved => return Unit::Starved,
                Next::Later => return Unit::Later,
            }
        }
        Unit::Starved
    }

    fn next(self: &Arc<Self>, state: &mut State, after: &mut After) -> Next {
        state.rank();
        if state.ranking.is_stuck {
            return Next::Idle;
        }
        let Some((model, (key, id))) = state.first_to_be_had() else {
            state.settle(self, after);
            return match self.promotion(state, after) {
                Next::Idle => state.next_together(),
                next => next,
            };
        };
        let run = state.ranking.run_around(&model, (key, id));
        let stamp = state.ranking.stamp((key, id));
        match self.room_for(state, &model, &run, after) {
            Ok(Some(room)) => Next::Load(Task { model, ids: run, stamp: self.used_at(stamp), room }),
            Ok(None) => Next::Again,
            Err(Short::ForNow) => Next::Starved,
            Err(Short::InUse) => match self.room_for(state, &model, &[id], after) {
                Ok(Some(room)) => Next::Load(Task { model, ids: vec![id], stamp: self.used_at(stamp), room }),
                Ok(None) => Next::Again,
                Err(Short::ForNow) => Next::Starved,
                Err(Short::InUse) => {
                    state.overfull(self, stamp, after);
                    Next::Idle
                }
            },
        }
    }

    /// Lowers the pressure if no block that views want is left to be read and there is room. Returns true if a read in
    /// progress may leave room: call it again.
    pub fn ease(&self) -> bool {
        let mut after = After::default();
        {
            let mut state = self.lock();
            state.rank();
            if state.ranking.is_stuck || state.first_to_be_had().is_some() {
                return false;
            }
            if state.in_flight > 0 {
                return state.pressure.may_fall;
            }
            state.settle(self, &mut after);
        }
        after.run(self);
        false
    }

    /// Returns the last-used stamp for blocks that a pass with `stamp` wanted. Wants outside of any pass have stamp 0,
    /// and their blocks get the current stamp. With stamp 0 the first blocks read would be the first to be evicted.
    fn used_at(&self, stamp: u32) -> u32 {
        if stamp == 0 { self.now() } else { stamp }
    }

    /// Reserves memory for a run. Returns `None` if it evicted blocks: `after` must run before the next attempt.
    fn room_for(
        self: &Arc<Self>,
        state: &mut State,
        model: &Inner,
        run: &[BlockId],
        after: &mut After,
    ) -> std::result::Result<Option<Room>, Short> {
        let bytes = run.iter().map(|&id| model.slot_bytes(id)).sum();
        if !state.fits(self, bytes) {
            state.free_up(self, bytes, after)?;
            return Ok(None);
        }
        let charge = self.main.charge(bytes, self.headroom).ok_or(Short::ForNow)?;
        let buffers = Buffers::new(&self.main, &model.file, run).ok_or(Short::ForNow)?;
        state.in_flight += bytes;
        Ok(Some(Room { charge, buffers, _in_flight: InFlight { shared: Arc::clone(self), bytes } }))
    }

    /// Calls [`Shared::room_for`] and runs the work that it leaves.
    pub fn make_room(self: &Arc<Self>, model: &Inner, run: &[BlockId]) -> std::result::Result<Room, Short> {
        for _ in 0..8 {
            let mut after = After::default();
            let room = {
                let mut state = self.lock();
                self.room_for(&mut state, model, run, &mut after)
            };
            after.run(self);
            if let Some(room) = room? {
                return Ok(room);
            }
        }
        Err(Short::ForNow)
    }

    /// Returns the next run to be read ahead.
    fn promotion(self: &Arc<Self>, state: &mut State, after: &mut After) -> Next {
        // Frames come first: the blocks that they lack are known only after their passes have ended.
        if !self.promotes() || state.live_views().iter().any(|view| view.is_passing()) {
            return Next::Idle;
        }
        let Some((model, ids)) = state.next_ahead(self) else { return Next::Idle };
        match self.room_for(state, &model, &ids, after) {
            Ok(Some(room)) => Next::Load(Task { model, ids, stamp: 0, room }),
            Ok(None) => Next::Again,
            Err(Short::ForNow) => Next::Starved,
            Err(Short::InUse) => Next::Idle,
        }
    }

    fn work(self: &Arc<Self>, task: Task) -> Unit {
        let Task { model, ids, stamp, mut room } = task;
        let Some(claim) = model.claims.try_claim(&ids, |id| !model.is_there(id)) else { return Unit::Did };
        let loaded = model.load(&claim.ids, &mut room.charge, &mut room.buffers, &Cancel::new());
        let published = self.publish(&model, &loaded.slots, stamp);
        // Set before the claim ends: after that another thread may read the blocks, and its success must clear the
        // failures.
        loaded.failed.iter().for_each(|(id, why)| model.failures.set(*id, why));
        self.give_back(&model, claim);
        drop(room);
        if !loaded.failed.is_empty() {
            let failed: Vec<BlockId> = loaded.failed.iter().map(|(id, _)| *id).collect();
            self.notify_views(&model, &failed);
        }
        if published { Unit::Did } else { Unit::Starved }
    }

    /// Adds the huge pages that a model's blocks fill to those to be collapsed.
    fn find_pages(&self, model: &Inner) {
        let there = model.published.load_full();
        let pages = filled(there.resident().map(|(_, slot)| slot.addresses()));
        self.lock().together.left.extend(pages);
    }

    /// Ends a claim. Fetchers that searched for work meanwhile have skipped its blocks, so the missing ones are ranked
    /// again.
    pub fn give_back(&self, model: &Inner, claim: Claim) {
        let left: Vec<BlockId> =
            claim.ids.iter().copied().filter(|id| !model.is_there(*id) && !model.failures.has(*id)).collect();
        drop(claim);
        if !left.is_empty() {
            model.lacked_in_vain.store(u64::MAX, Relaxed);
        }
        let is_wanted = !left.is_empty() && {
            let mut state = self.lock();
            let is_wanted = state.live_views().iter().any(|view| view.wants_any(model.key, &left));
            is_wanted && {
                let _ = state.ranking.invalidate();
                true
            }
        };
        if is_wanted {
            self.wake();
        }
    }

    fn notify_views(&self, model: &Inner, ids: &[BlockId]) {
        let mut after = After::default();
        let mut state = self.lock();
        let views = state.live_views();
        after.calls.extend(views.iter().filter(|view| view.wants_any(model.key, ids)).filter_map(|view| view.call()));
        drop(state);
        after.run(self);
    }
}

/// Bytes of a block in the file.
pub(super) fn stored_len(model: &Inner, id: BlockId) -> u64 {
    model.file.directory().get(id.0 as usize).map_or(0, |row| u64::from(row.stored_len))
}
