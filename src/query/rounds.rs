//! The engine of rounds under batches of rays and overlaps.
//!
//! A round takes each piece of work as far as the blocks in a snapshot allow. A piece that lacks blocks waits. The next
//! round brings blocks for the pieces that wait, up to a share of the budget, and holds them; the round after that
//! resumes the pieces whose blocks have come. The answer does not depend on what was in memory.
//!
//! Each of these rounds makes progress. The blocks that at least one piece waits for are brought beside the blocks that
//! views use. Where views leave less room than the reserve has, pieces go on in a round under a lease of the reserve.
//! Where all is in memory there is one round, and no lease.
//!
//! A prefetch does not use this engine: see `render/prefetch`. Frames render in passes: see `render/passes.rs`.

use super::needs::{by_model, bytes_of};
use crate::base::error::Result;
use crate::base::progress::Cancel;
use crate::base::tasks::Work;
use crate::residency::Lease;
use crate::scene::SceneState;
use crate::scene::walk::{Hold, Need, Snapshots};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A question that is answered in pieces, each as far as the blocks in memory allow.
pub(super) trait Quest: Send + Sync {
    /// Its pieces that lack blocks.
    type Waiting: WaitList;
    /// Pieces that wait at most; items of the first round are put off while there are more.
    const MOST_WAITING: usize;
    /// Pieces that an item of the first round leaves waiting at most.
    const PIECES: usize;
    /// Items of the first round from one renewal of its snapshot to the next. A snapshot holds blocks that others have
    /// evicted, so a long round renews it; to compare it with what is in memory takes some nanoseconds a model.
    const RENEWAL: usize;
    /// Blocks that a worker brings at a time.
    const FETCH: usize;

    /// The scene that is asked.
    fn scene(&self) -> &SceneState;
    /// Begins an item of the first round; returns the pieces of it that lack blocks.
    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Parked<Self>>;
    /// Takes up a piece that has blocks it waited for; returns it if it lacks others.
    fn resume(&self, piece: Piece<Self>, snapshots: &Snapshots) -> Option<Parked<Self>>;
}

/// Pieces that wait, by the blocks that they wait for.
pub(super) trait WaitList: Default + Send {
    /// A piece that goes on.
    type Piece: Send;
    /// A piece that waits, with the blocks that it waits for; made under no lock.
    type Parked: Send;

    /// How many pieces wait.
    fn len(&self) -> usize;
    /// Whether no piece waits.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Adds a piece.
    fn push(&mut self, parked: Self::Parked);
    /// Takes out the pieces that can go on with the blocks of which `is_there` holds.
    fn take(&mut self, is_there: impl Fn(Need) -> bool) -> Vec<Self::Piece>;
    /// The blocks to bring, the most urgent first, each once: as many as there is `room` for, but enough for one piece
    /// to go on; and whether these are all that pieces wait for. `room` is in bytes, and `bytes` counts those of a
    /// block.
    fn plan(&self, room: u64, bytes: impl Fn(Need) -> u64) -> (Vec<Need>, bool);
}

/// A piece of a quest that goes on.
type Piece<Q> = <<Q as Quest>::Waiting as WaitList>::Piece;
/// A piece of a quest that waits.
pub(super) type Parked<Q> = <<Q as Quest>::Waiting as WaitList>::Parked;

/// A quest at work: a job's work.
pub(super) struct Rounds<Q: Quest> {
    pub quest: Q,
    state: Mutex<State<Q>>,
}

struct State<Q: Quest> {
    /// Of the present round.
    snapshots: Arc<Snapshots>,
    /// Of the present round, but for the first, whose items are numbers.
    items: Vec<Option<Item<Piece<Q>>>>,
    is_first: bool,
    /// Items of the first round that were begun.
    begun: usize,
    /// Blocks are being brought: the next round resumes the pieces that wait for them.
    is_fetching: bool,
    /// The blocks that were brought for the next round.
    hold: Hold,
    room: Room,
    waiting: Q::Waiting,
    /// Items of the first round that were put off because too many pieces wait.
    deferred: Vec<usize>,
}

/// A piece of work of a round after the first.
enum Item<P> {
    /// An item of the first round.
    Begin(usize),
    /// To bring blocks as far as there is room beside those that views use.
    Fetch(Vec<Need>),
    Resume(P),
    /// A round under a lease.
    Lease,
}

/// The largest part of the budget that a round brings: one part in so many. Others hold blocks too.
const ROUND_SHARE: u64 = 4;

impl<Q: Quest> Rounds<Q> {
    /// A quest of which nothing is begun.
    pub fn new(quest: Q) -> Self {
        let snapshots = Snapshots::take(quest.scene());
        Self { quest, state: Mutex::new(State::new(snapshots)) }
    }

    /// A quest of which all but `parked` is done; [`Work::round_done`] begins its first round.
    pub fn rest(quest: Q, parked: Vec<Parked<Q>>) -> Self {
        let rounds = Self::new(quest);
        rounds.park(parked);
        rounds
    }

    fn state(&self) -> MutexGuard<'_, State<Q>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins an item of the first round, or puts it off.
    fn begin(&self, item: usize) {
        let scene = self.quest.scene();
        let snapshots = {
            let mut state = self.state();
            if state.waiting.len() >= Q::MOST_WAITING {
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
        self.park(self.quest.resume(piece, snapshots));
    }

    /// Keeps pieces for later rounds.
    fn park(&self, parked: impl IntoIterator<Item = Parked<Q>>) {
        let mut parked = parked.into_iter().peekable();
        if parked.peek().is_some() {
            let mut state = self.state();
            parked.for_each(|piece| state.waiting.push(piece));
        }
    }

    /// Brings blocks, the first of them first, as far as there is room.
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
                    // The rest would look for room in vain, each under a lock that frames take.
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// A round with blocks of the reserve. The thread that holds the lease waits for no thread that may wait for the
    /// lease: other workers finish the pieces of this round that they take on.
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

    /// After pieces went as far as they came: a round that brings blocks, or that goes on without.
    fn next_fetch(&self) -> usize {
        let scene = self.quest.scene();
        let mut state = self.state();
        // The blocks that this round held may go.
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
        // A worker is left for frames, which are not to wait for the disk.
        let readers = context.concurrency().saturating_sub(1).max(1);
        let shares = if is_all { neighbours(needs, readers) } else { by_turns(&needs, readers, Q::FETCH) };
        state.items = shares.into_iter().map(|needs| Some(Item::Fetch(needs))).collect();
        state.is_fetching = true;
        state.items.len()
    }
}

/// Shares of some readers where there is room for all: neighbours are read together.
fn neighbours(mut needs: Vec<Need>, readers: usize) -> Vec<Vec<Need>> {
    needs.sort_unstable();
    needs.chunks(needs.len().div_ceil(readers)).map(<[_]>::to_vec).collect()
}

/// Shares of some readers that take `few` blocks by turns: all of them begin with the most urgent, for there may be no
/// room for the last.
fn by_turns(needs: &[Need], readers: usize, few: usize) -> Vec<Vec<Need>> {
    let of = |reader| needs.chunks(few).skip(reader).step_by(readers).flatten().copied().collect();
    (0..readers.min(needs.len().div_ceil(few))).map(of).collect()
}

impl<Q: Quest> State<Q> {
    /// Before the first round.
    fn new(snapshots: Snapshots) -> Self {
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
        }
    }

    /// Begins a round of the pieces that can go on with `snapshots`, or else one under a lease.
    fn begin_resuming(&mut self, snapshots: Snapshots) -> usize {
        let ready = self.waiting.take(|need| snapshots.has(need));
        let mut items: Vec<_> = ready.into_iter().map(Item::Resume).collect();
        if items.is_empty() && !self.waiting.is_empty() {
            items.push(Item::Lease);
        }
        self.snapshots = Arc::new(snapshots);
        self.begin(items)
    }

    /// Begins a round of `items`, and of items of the first round that were put off, as far as few pieces wait; returns
    /// how many there are.
    fn begin(&mut self, items: Vec<Item<Piece<Q>>>) -> usize {
        let more = Q::MOST_WAITING.saturating_sub(self.waiting.len() + items.len()).div_ceil(Q::PIECES);
        let from = self.deferred.len() - more.min(self.deferred.len());
        let deferred = self.deferred.drain(from..).map(Item::Begin);
        self.items = items.into_iter().chain(deferred).map(Some).collect();
        self.is_fetching = false;
        self.items.len()
    }
}

/// How many bytes a round asks for: as many as had room lately.
struct Room {
    /// Bytes that were to be brought for the next round, and those of them that came.
    asked: u64,
    came: u64,
    /// Bytes that the next round asks for at most: those that came last, where not all had room, and a quarter more
    /// after each round since.
    limit: u64,
}

/// Bytes that count as having come where fewer did, so that some rounds later the room is tried anew.
const FEW: u64 = 64 << 10;

impl Default for Room {
    fn default() -> Self {
        Self { asked: 0, came: 0, limit: u64::MAX }
    }
}

impl Room {
    /// Before blocks of so many bytes are brought.
    fn asks(&mut self, bytes: u64) {
        (self.asked, self.came) = (bytes, 0);
    }

    /// After blocks were brought.
    fn has_fetched(&mut self) {
        if self.came < self.asked {
            self.limit = self.came;
        } else {
            self.grow();
        }
    }

    /// Whether to take a round under a lease: if the reserve holds more than there is room for beside it. That room
    /// then counts as a quarter more, so that it is tried anew after some rounds.
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
        // Without memory for the tables a lease is taken.
        let snapshots = Snapshots::holding(self.quest.scene(), &hold).unwrap_or(Snapshots::none());
        Ok(self.state().begin_resuming(snapshots))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    /// Three readers bring neighbours where all comes, and else begin with the most urgent.
    #[test]
    fn readers_share_what_is_to_be_brought() {
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

    /// Views may let go of blocks, so rounds under leases, which take turns with those of all other jobs, are for a
    /// while only.
    #[test]
    fn rounds_that_had_no_room_look_for_it_again() {
        let lease_room = 700 << 10;
        let mut room = Room::default();
        assert!(!room.takes_lease(lease_room), "nothing was asked for yet");
        room.asks(4 << 20);
        room.has_fetched();
        let leased = (0..100).take_while(|_| room.takes_lease(lease_room)).count();
        assert!((5..20).contains(&leased), "{leased} rounds");
        // There is as much room as is asked for: a quarter more each time, and no lease.
        for _ in 0..20 {
            let asked = room.limit;
            (room.asked, room.came) = (asked, asked);
            room.has_fetched();
            assert_eq!(room.limit, asked + asked / 4);
            assert!(!room.takes_lease(lease_room));
        }
        // Less than the reserve holds had room: leases again, but not from the beginning.
        (room.asked, room.came) = (room.limit, lease_room - 1);
        room.has_fetched();
        assert!(room.takes_lease(lease_room) && !room.takes_lease(lease_room));
    }
}
