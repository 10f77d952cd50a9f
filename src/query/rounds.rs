//! The engine that answers ray batches and overlaps in rounds.
//!
//! A round takes each piece of work as far as the blocks in a snapshot allow. A piece that lacks blocks waits. The next
//! round reads blocks for the waiting pieces, up to a share of the budget, and holds them. The round after that resumes
//! the pieces whose blocks have come. The answer does not depend on the blocks in memory.
//!
//! Each of these rounds makes progress: it reads the blocks of at least one piece in addition to the blocks that views
//! use. If views leave less room than the reserve has, pieces go on in a round under a lease of the reserve. If all
//! blocks are in memory, there is one round and no lease.
//!
//! Waiting pieces take working memory outside of the budget, so their bytes are limited for all jobs of a context
//! together. While they take more, items of the first round are deferred.
//!
//! Prefetches do not use this engine: see `render/prefetch`. Frames render in passes: see `render/passes.rs`.

use super::needs::{by_model, bytes_of};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::base::tasks::Work;
use crate::residency::Lease;
use crate::scene::SceneState;
use crate::scene::walk::{Hold, Need, Snapshots};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A job that is answered in pieces, each as far as the blocks in memory allow.
pub(super) trait Quest: Send + Sync {
    /// The list of its pieces that lack blocks.
    type Waiting: WaitList;
    /// Bytes of the waiting pieces that an item of the first round usually leaves if it lacks blocks.
    const ITEM_BYTES: u64;
    /// Number of items of the first round between two renewals of its snapshot. A snapshot keeps blocks alive that
    /// other jobs have evicted, so a long round renews it. A comparison with the current table takes some nanoseconds
    /// per model.
    const RENEWAL: usize;
    /// Number of blocks that a worker reads at a time.
    const FETCH: usize;

    /// The scene of the job.
    fn scene(&self) -> &SceneState;
    /// Begins an item of the first round; returns its pieces that lack blocks.
    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Parked<Self>>;
    /// Resumes a piece that has blocks it waited for; returns it if it lacks others.
    fn resume(&self, piece: Piece<Self>, snapshots: &Snapshots) -> Option<Parked<Self>>;
}

/// Waiting pieces, indexed by the blocks that they wait for.
pub(super) trait WaitList: Default + Send {
    /// A piece that goes on.
    type Piece: Send;
    /// A piece that waits, with the blocks that it waits for. It is made under no lock.
    type Parked: Send;

    /// Bytes of memory of a piece and of its entries in the list.
    fn bytes(piece: &Self::Piece) -> u64;
    /// The piece in `parked`.
    fn piece(parked: &Self::Parked) -> &Self::Piece;
    /// True if no piece waits.
    fn is_empty(&self) -> bool;
    /// Adds a piece.
    fn push(&mut self, parked: Self::Parked);
    /// Removes the pieces that can go on with the blocks for which `is_there` holds.
    fn take(&mut self, is_there: impl Fn(Need) -> bool) -> Vec<Self::Piece>;
    /// Returns the blocks to read, each once and the most urgent first: as many as `room` bytes hold, but enough for
    /// one piece to go on. Also returns true if these are all blocks that pieces wait for. `bytes` returns the size of
    /// a block.
    fn plan(&self, room: u64, bytes: impl Fn(Need) -> u64) -> (Vec<Need>, bool);
}

/// A piece of a quest that goes on.
type Piece<Q> = <<Q as Quest>::Waiting as WaitList>::Piece;

/// Greatest number of bytes of the pieces of all quests of a context that wait. A quest may exceed it by the pieces of
/// the items that its workers begin at the same time, and a quest without pieces may begin an item in any case.
pub(super) const MOST_WAITING: u64 = 24 << 20;

/// A piece of a quest that waits.
pub(super) type Parked<Q> = <<Q as Quest>::Waiting as WaitList>::Parked;

/// A quest in progress: the work of a job.
pub(super) struct Rounds<Q: Quest> {
    pub quest: Q,
    state: Mutex<State<Q>>,
}

struct State<Q: Quest> {
    /// The snapshots of the present round.
    snapshots: Arc<Snapshots>,
    /// The items of the present round. The items of the first round are plain numbers and not listed here.
    items: Vec<Option<Item<Piece<Q>>>>,
    is_first: bool,
    /// Number of items of the first round that were begun.
    begun: usize,
    /// True while a round reads blocks: the next round resumes the pieces that wait for them.
    is_fetching: bool,
    /// The blocks that were read for the next round.
    hold: Hold,
    room: Room,
    waiting: Q::Waiting,
    /// Items of the first round that are deferred because waiting pieces take too much memory.
    deferred: Vec<usize>,
    /// Memory of the pieces that wait, and of those in `items`.
    held: Held,
}

/// Bytes of pieces, counted for the quest and for its context.
struct Held {
    own: u64,
    all: Arc<AtomicU64>,
}

impl Held {
    fn add(&mut self, bytes: u64) {
        self.own += bytes;
        self.all.fetch_add(bytes, Relaxed);
    }

    fn remove(&mut self, bytes: u64) {
        self.own -= bytes;
        self.all.fetch_sub(bytes, Relaxed);
    }

    /// Bytes of further pieces that may wait.
    fn left(&self) -> u64 {
        let left = MOST_WAITING.saturating_sub(self.all.load(Relaxed));
        if self.own == 0 { left.max(1) } else { left }
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.remove(self.own);
    }
}

/// An item of a round after the first.
enum Item<P> {
    /// An item of the first round.
    Begin(usize),
    /// Reads blocks as far as there is room in addition to the blocks that views use.
    Fetch(Vec<Need>),
    Resume(P),
    /// Runs a round under a lease.
    Lease,
}

/// A round reads at most the budget divided by this: other jobs hold blocks too.
const ROUND_SHARE: u64 = 4;

impl<Q: Quest> Rounds<Q> {
    /// A quest that is not begun.
    pub fn new(quest: Q) -> Self {
        let snapshots = Snapshots::take(quest.scene());
        let held = Held { own: 0, all: quest.scene().context().waiting() };
        Self { quest, state: Mutex::new(State::new(snapshots, held)) }
    }

    /// A quest of which only `parked` remains; [`Work::round_done`] begins its first round.
    pub fn rest(quest: Q, parked: Vec<Parked<Q>>) -> Self {
        let rounds = Self::new(quest);
        rounds.park(parked);
        rounds
    }

    fn state(&self) -> MutexGuard<'_, State<Q>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins an item of the first round, or defers it.
    fn begin(&self, item: usize) {
        let scene = self.quest.scene();
        let snapshots = {
            let mut state = self.state();
            if state.held.left() == 0 {
                return state.deferred.push(item);
            }
            let is_renewed =
                !state.is_first || state.begun.is_multiple_of(Q::RENEWAL) && !state.snapshots.is_current(scene);
            state.begun += 1;
            if is_renewed {
                let now = Arc::new(Snapshots::take(scene));
                if state.is_first {
                    state.snapshots = Arc::clone(&now);
                }
                now
            } else {
                Arc::clone(&state.snapshots)
            }
        };
        self.park(self.quest.begin(item, &snapshots));
    }

    fn resume(&self, piece: Piece<Q>, snapshots: &Snapshots) {
        self.state().held.remove(Q::Waiting::bytes(&piece));
        self.park(self.quest.resume(piece, snapshots));
    }

    /// Keeps pieces for later rounds.
    fn park(&self, parked: impl IntoIterator<Item = Parked<Q>>) {
        let mut parked = parked.into_iter().peekable();
        if parked.peek().is_some() {
            let mut state = self.state();
            parked.for_each(|parked| {
                state.held.add(Q::Waiting::bytes(Q::Waiting::piece(&parked)));
                state.waiting.push(parked);
            });
        }
    }

    /// Reads blocks in their order, as far as there is room.
    fn fetch(&self, needs: &[Need]) -> Result<()> {
        let scene = self.quest.scene();
        for few in needs.chunks(Q::FETCH) {
            for (model, blocks) in by_model(few) {
                let held = scene.models[model as usize].blocks().bring(&blocks, &Cancel::new())?;
                let is_full = held.len() < blocks.len();
                let came: u64 = held.iter().map(|&(block, _)| bytes_of(scene, Need { model, block })).sum();
                let mut state = self.state();
                state.room.came += came;
                state.hold.add(model, held);
                if is_full {
                    // Further blocks would search for room in vain, each under a lock that frames take.
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Runs a round with blocks of the reserve. The thread that holds the lease must not wait for a thread that may
    /// itself wait for the lease: other workers finish the pieces of this round that they take.
    fn run_leased(&self) -> Result<()> {
        let scene = self.quest.scene();
        let mut lease = scene.context().residency().lease();
        let (needs, _) = self.state().waiting.plan(lease.room(), |need| Lease::counts(bytes_of(scene, need)));
        for (model, blocks) in by_model(&needs) {
            lease.fetch(scene.models[model as usize].blocks(), &blocks, &Cancel::new())?;
        }
        let snapshots = Snapshots::leased(scene, &lease)?;
        let pieces = self.state().waiting.take(|need| snapshots.has(need));
        let pieces = pieces.into_iter().map(|piece| Mutex::new(Some(piece))).collect();
        let leased = Leased { rounds: self, pieces, snapshots };
        scene.context().pool().run_scoped(leased.pieces.len(), &leased).into_result()
    }

    /// Plans the next round after pieces went as far as possible: one that reads blocks, or one that goes on without.
    fn next_fetch(&self) -> usize {
        let scene = self.quest.scene();
        let mut state = self.state();
        // The blocks that this round held may be evicted.
        (state.snapshots, state.hold) = (Arc::new(Snapshots::none()), Hold::default());
        if state.waiting.is_empty() {
            return state.begin_resuming(Snapshots::take(scene));
        }
        let context = scene.context();
        let residency = context.residency();
        if residency.lease_is_free() && state.room.takes_lease(residency.lease_room()) {
            return state.begin(vec![Item::Lease]);
        }
        let room = state.room.limit.min(context.memory_budget() / ROUND_SHARE);
        let (needs, is_all) = state.waiting.plan(room, |need| bytes_of(scene, need));
        state.room.asks(needs.iter().map(|&need| bytes_of(scene, need)).sum());
        // One worker stays free for frames, which must not wait for the disk.
        let readers = context.concurrency().saturating_sub(1).max(1);
        let shares = if is_all { neighbours(needs, readers) } else { by_turns(&needs, readers, Q::FETCH) };
        state.items = shares.into_iter().map(|needs| Some(Item::Fetch(needs))).collect();
        state.is_fetching = true;
        state.items.len()
    }
}

/// Shares for readers if there is room for all blocks: each reader gets neighbours, which one read can bring.
fn neighbours(mut needs: Vec<Need>, readers: usize) -> Vec<Vec<Need>> {
    needs.sort_unstable();
    needs.chunks(needs.len().div_ceil(readers)).map(<[_]>::to_vec).collect()
}

/// Shares for readers that take `few` blocks alternately: all readers begin with the most urgent blocks, as there may
/// be no room for the last ones.
fn by_turns(needs: &[Need], readers: usize, few: usize) -> Vec<Vec<Need>> {
    let of = |reader| needs.chunks(few).skip(reader).step_by(readers).flatten().copied().collect();
    (0..readers.min(needs.len().div_ceil(few))).map(of).collect()
}

impl<Q: Quest> State<Q> {
    /// The state before the first round.
    fn new(snapshots: Snapshots, held: Held) -> Self {
        Self {
            snapshots: Arc::new(snapshots),
            items: Vec::new(),
            is_first: true,
            begun: 0,
            is_fetching: false,
            hold: Hold::default(),
            room: Room::default(),
            waiting: Q::Waiting::default(),
            deferred: Vec::new(),
            held,
        }
    }

    /// Begins a round of the pieces that can go on with `snapshots`, or a round under a lease if only pieces without
    /// their blocks wait.
    fn begin_resuming(&mut self, snapshots: Snapshots) -> usize {
        let ready = self.waiting.take(|need| snapshots.has(need));
        let mut items: Vec<_> = ready.into_iter().map(Item::Resume).collect();
        if items.is_empty() && !self.waiting.is_empty() {
            items.push(Item::Lease);
        }
        self.snapshots = Arc::new(snapshots);
        self.begin(items)
    }

    /// Begins a round of `items`, and of deferred items of the first round as long as waiting pieces leave memory.
    /// Returns the number of items.
    fn begin(&mut self, items: Vec<Item<Piece<Q>>>) -> usize {
        let more = usize::try_from(self.held.left().div_ceil(Q::ITEM_BYTES)).unwrap_or(usize::MAX);
        let from = self.deferred.len() - more.min(self.deferred.len());
        let deferred = self.deferred.drain(from..).map(Item::Begin);
        self.items = items.into_iter().chain(deferred).map(Some).collect();
        self.is_fetching = false;
        self.items.len()
    }
}

/// The number of bytes that a round requests: as many as recently had room.
struct Room {
    /// Bytes requested for the next round, and the bytes of these that came.
    asked: u64,
    came: u64,
    /// Greatest number of bytes that the next round requests. After a round with too little room it is the number of
    /// bytes that came; it then grows by a quarter with each round.
    limit: u64,
}

/// Least number of bytes that the limit grows to, so that a few rounds after a failure the room is probed again.
const FEW: u64 = 64 << 10;

impl Default for Room {
    fn default() -> Self {
        Self { asked: 0, came: 0, limit: u64::MAX }
    }
}

impl Room {
    /// Notes the bytes of a round that is about to read.
    fn asks(&mut self, bytes: u64) {
        (self.asked, self.came) = (bytes, 0);
    }

    /// Adapts the limit after blocks were read.
    fn has_fetched(&mut self) {
        if self.came < self.asked {
            self.limit = self.came;
        } else {
            self.grow();
        }
    }

    /// True if the next round should run under a lease, because the reserve holds more than the room outside of it. The
    /// limit then grows by a quarter, so that the room outside is probed again after some rounds.
    fn takes_lease(&mut self, lease_room: u64) -> bool {
        let is_leased = self.limit < lease_room;
        if is_leased {
            self.grow();
        }
        is_leased
    }

    fn grow(&mut self) {
        self.limit = self.limit.max(FEW).saturating_add(self.limit / 4);
    }
}

/// Pieces that go on under a lease.
struct Leased<'a, Q: Quest> {
    rounds: &'a Rounds<Q>,
    pieces: Vec<Mutex<Option<Piece<Q>>>>,
    snapshots: Snapshots,
}

impl<Q: Quest> Work for Leased<'_, Q> {
    fn run(&self, item: usize) -> Result<()> {
        let piece = self.pieces[item].lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(piece) = piece {
            self.rounds.resume(piece, &self.snapshots);
        }
        Ok(())
    }
}

impl<Q: Quest> Work for Rounds<Q> {
    fn run(&self, item: usize) -> Result<()> {
        let (todo, snapshots) = {
            let mut state = self.state();
            if state.is_first {
                drop(state);
                self.begin(item);
                return Ok(());
            }
            (state.items.get_mut(item).and_then(Option::take), Arc::clone(&state.snapshots))
        };
        match todo {
            Some(Item::Begin(item)) => {
                drop(snapshots);
                self.begin(item);
            }
            Some(Item::Resume(piece)) => self.resume(piece, &snapshots),
            Some(Item::Fetch(needs)) => self.fetch(&needs)?,
            Some(Item::Lease) => {
                self.state().snapshots = Arc::new(Snapshots::none());
                drop(snapshots);
                self.run_leased()?;
            }
            None => {}
        }
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        let hold = {
            let mut state = self.state();
            state.is_first = false;
            if state.waiting.is_empty() && state.deferred.is_empty() {
                return Ok(0);
            }
            state.is_fetching.then(|| {
                state.room.has_fetched();
                std::mem::take(&mut state.hold)
            })
        };
        let Some(hold) = hold else { return Ok(self.next_fetch()) };
        // If there is no memory for the tables, the next round takes a lease.
        let snapshots = Snapshots::holding(self.quest.scene(), &hold).unwrap_or(Snapshots::none());
        Ok(self.state().begin_resuming(snapshots))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    /// Three readers share neighbours if all blocks have room, and else all begin with the most urgent blocks.
    #[test]
    fn readers_share_all_planned_blocks() {
        let needs: Vec<Need> = (0..100).rev().map(|block| Need { model: 0, block: BlockId(block) }).collect();
        let firsts = |shares: &[Vec<Need>]| shares.iter().map(|share| share[0].block.0).collect::<Vec<_>>();
        let (all, most_urgent) = (neighbours(needs.clone(), 3), by_turns(&needs, 3, 16));
        assert_eq!((firsts(&all), firsts(&most_urgent)), (vec![0, 34, 68], vec![99, 83, 67]));
        for shares in [all, most_urgent] {
            let mut brought = shares.concat();
            brought.sort_unstable();
            assert!(brought.iter().eq(needs.iter().rev()));
        }
        assert_eq!(by_turns(&needs[..5], 3, 16).len(), 1);
    }

    /// Rounds under leases alternate with those of all other jobs, so they are temporary: views may release blocks
    /// meanwhile.
    #[test]
    fn rounds_without_room_probe_for_it_again() {
        let lease_room = 700 << 10;
        let mut room = Room::default();
        assert!(!room.takes_lease(lease_room), "nothing was asked for yet");
        room.asks(4 << 20);
        room.has_fetched();
        let leased = (0..100).take_while(|_| room.takes_lease(lease_room)).count();
        assert!((5..20).contains(&leased), "{leased} rounds");
        // All requested bytes have room: the limit grows by a quarter each time, without a lease.
        for _ in 0..20 {
            let asked = room.limit;
            (room.asked, room.came) = (asked, asked);
            room.has_fetched();
            assert_eq!(room.limit, asked + asked / 4);
            assert!(!room.takes_lease(lease_room));
        }
        // Less than the reserve's size had room: the next round takes a lease, and one round later the room is probed
        // again.
        (room.asked, room.came) = (room.limit, lease_room - 1);
        room.has_fetched();
        assert!(room.takes_lease(lease_room) && !room.takes_lease(lease_room));
    }
}
