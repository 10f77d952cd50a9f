//! Batches as jobs in rounds: rays that meet a missing block are parked with their walks, blocks are fetched, the most
//! wanted first, up to what there is room for, and the rays that have theirs resumed. The answer does not depend on
//! what was in memory.
//!
//! A call that blocks answers a batch of one chunk at once, without what rounds take, and one or two rays without what a chunk takes; only what must wait for
//! blocks goes on in rounds.
//!
//! Each round makes progress: what at least one ray waits for is fetched beside what views use, or where they leave less
//! room than the reserve has, into that, under a lease. Where all is in memory there is one round, and no lease.

use super::alone::{self, ALONE};
use super::batch::{Hits, QueryOptions, Rays};
use super::chunk::{CHUNK, Chunk, Group, Task};
use super::hit::Want;
use super::parked::{Parked, Parking};
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::base::tasks::Work;
use crate::residency::Lease;
use crate::scene::SceneState;
use crate::scene::walk::{Hold, Need, Snapshots};
use crate::structure::bvh::trace::PACKET;
use std::borrow::Borrow;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Answers a batch of closest hits, or of any hits if `ANY`. Blocks.
pub(super) fn answer<const ANY: bool>(scene: &SceneState, rays: &dyn Rays, hits: &dyn Hits, options: QueryOptions) -> Result<()> {
    let pool = scene.context().pool();
    if rays.count() == 0 {
        return Ok(());
    }
    if rays.count() > CHUNK {
        let batch = Batch::<_, _, _, ANY>::new(scene, rays, hits, options);
        return pool.run_scoped(batch.items(), &batch).into_result();
    }
    let task = task_of::<ANY>(options);
    if rays.count() <= ALONE && alone::answer(scene, task, rays, hits)? {
        return Ok(());
    }
    let at_once = AtOnce { scene, rays, hits, task, parked: Mutex::default() };
    pool.run_scoped(1, &at_once).into_result()?;
    let parked = at_once.parked.into_inner().unwrap_or_else(PoisonError::into_inner);
    if parked.is_empty() {
        return Ok(());
    }
    let batch = Batch::<_, _, _, ANY>::rest(scene, rays, hits, options, parked);
    pool.run_scoped(pool.here(|| batch.round_done())?, &batch).into_result()
}

fn task_of<const ANY: bool>(options: QueryOptions) -> Task {
    let want = if ANY { Want::NOTHING } else { options.want };
    Task { coherent: options.coherent, policy: options.policy, want, any: ANY }
}

/// Answers `count` rays from `first` on; returns those that must wait.
fn trace_chunk(
    scene: &SceneState,
    snapshots: &Snapshots,
    stamp: u32,
    task: Task,
    (first, count): (usize, usize),
    rays: &impl Rays,
    hits: &impl Hits,
) -> Vec<Box<Group>> {
    let view = task.view(scene, snapshots, stamp);
    let mut chunk = scene.context().take_scratch::<Chunk>();
    chunk.run(&view, task, first, count, rays, hits);
    let parked = std::mem::take(&mut chunk.parked);
    scene.context().give_scratch(chunk);
    parked
}

/// A batch of one chunk.
struct AtOnce<'a> {
    scene: &'a SceneState,
    rays: &'a dyn Rays,
    hits: &'a dyn Hits,
    task: Task,
    /// What must wait for blocks.
    parked: Mutex<Vec<Box<Group>>>,
}

impl Work for AtOnce<'_> {
    fn run(&self, _: usize) -> Result<()> {
        // Neither a count nor a stamp of its own: threads share both, and a new stamp is written to each block that is visited.
        let mut snapshots = Snapshots::none();
        snapshots.lend(self.scene);
        let stamp = self.scene.context().residency().now();
        let parked = trace_chunk(self.scene, &snapshots, stamp, self.task, (0, self.rays.count()), &self.rays, &self.hits);
        if !parked.is_empty() {
            *self.parked.lock().unwrap_or_else(PoisonError::into_inner) = parked;
        }
        Ok(())
    }
}

/// A batch of closest hits, or of any hits if `ANY`.
pub(super) struct Batch<S, R, H, const ANY: bool> {
    pub scene: S,
    rays: R,
    hits: H,
    options: QueryOptions,
    count: usize,
    /// Of the blocks that it uses.
    stamp: u32,
    /// Rays answered so far.
    answered: Arc<AtomicU64>,
    rounds: Mutex<Rounds>,
}

struct Rounds {
    snapshots: Arc<Snapshots>,
    /// Of the present round; in the first, items are chunks of rays.
    items: Vec<Option<Item>>,
    first: bool,
    /// Blocks are being read: then what has them is to be resumed.
    fetching: bool,
    /// What was read for the round to come.
    hold: Hold,
    /// Bytes that were to be read for it, and those of them that came.
    asked: u64,
    came: u64,
    /// Bytes that the next round asks for at most: what came, where not all had room, and a quarter more after each round since.
    room: u64,
    /// For later rounds.
    parked: Parked<Box<Group>>,
    /// Chunks that were not begun because too many groups were parked.
    deferred: Vec<usize>,
}

/// A piece of work of a round after the first.
enum Item {
    /// Rays to be begun.
    Chunk(usize),
    /// Blocks to be read, where there is room beside what views use.
    Fetch(Vec<Need>),
    /// Rays to be gone on with.
    Resume(Box<Group>),
    /// A round under a lease.
    Lease,
}

/// Groups parked at most before chunks that have not begun must wait: some tens of kilobytes each, at worst.
const MOST_PARKED: usize = 1024;

/// Of the budget, how much a round brings at most: one part in so many. Others hold blocks too.
const ROUND_SHARE: u64 = 4;

/// Bytes that count as having come where less did: some rounds later it is looked anew what has room.
const FEW: u64 = 64 << 10;

/// Blocks of a model that a worker brings at a time.
const FETCH: usize = 16;

impl<S, R, H, const ANY: bool> Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    /// Of `rays`, answers to `hits`.
    pub fn new(scene: S, rays: R, hits: H, options: QueryOptions) -> Self {
        let rounds = Rounds::new(Snapshots::take(scene.borrow()));
        let count = rays.count();
        let stamp = scene.borrow().context().residency().stamp();
        Self { scene, rays, hits, options, count, stamp, answered: Arc::default(), rounds: Mutex::new(rounds) }
    }

    /// What is left of a batch of which all but `parked` is answered.
    fn rest(scene: S, rays: R, hits: H, options: QueryOptions, parked: Vec<Box<Group>>) -> Self {
        let batch = Self::new(scene, rays, hits, options);
        batch.park(parked);
        batch
    }

    /// Items of the first round.
    pub fn items(&self) -> usize {
        self.count.div_ceil(CHUNK)
    }

    /// Rays.
    pub fn total(&self) -> u64 {
        self.count as u64
    }

    /// The count of rays answered.
    pub fn answered(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.answered)
    }

    fn rounds(&self) -> MutexGuard<'_, Rounds> {
        self.rounds.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn task(&self) -> Task {
        task_of::<ANY>(self.options)
    }

    /// A chunk of rays not yet begun.
    fn run_chunk(&self, item: usize) {
        let scene = self.scene.borrow();
        let snapshots = {
            let mut rounds = self.rounds();
            if rounds.parked.len() >= MOST_PARKED {
                return rounds.deferred.push(item);
            }
            if rounds.first && rounds.snapshots.is_current(scene) {
                Arc::clone(&rounds.snapshots)
            } else {
                // What has gone meanwhile is not to be held by the rest of a long batch.
                let now = Arc::new(Snapshots::take(scene));
                if rounds.first {
                    rounds.snapshots = Arc::clone(&now);
                }
                now
            }
        };
        let first = item * CHUNK;
        let count = (self.count - first).min(CHUNK);
        let parked = trace_chunk(scene, &snapshots, self.stamp, self.task(), (first, count), &self.rays, &self.hits);
        let waiting: usize = parked.iter().map(|group| group.count()).sum();
        self.answered.fetch_add((count - waiting) as u64, Relaxed);
        if waiting > 0 {
            self.park(parked);
        }
    }

    /// Takes a parked group as far as it comes.
    fn resume(&self, snapshots: &Snapshots, mut group: Box<Group>) {
        let view = self.task().view(self.scene.borrow(), snapshots, self.stamp);
        let (first, count) = (group.first(), group.count());
        match group.resume(&view, self.task()) {
            Some(hits) => {
                self.hits.write(first, hits);
                self.answered.fetch_add(count as u64, Relaxed);
            }
            None => self.park(vec![group]),
        }
    }

    /// Bytes of a block in memory.
    fn bytes(&self, need: Need) -> u64 {
        self.scene.borrow().models[need.model as usize].blocks().slot_bytes(need.block)
    }

    /// Keeps groups for later rounds.
    fn park(&self, groups: Vec<Box<Group>>) {
        let parking: Vec<_> = groups.into_iter().map(Parking::new).collect();
        let mut rounds = self.rounds();
        parking.into_iter().for_each(|it| rounds.parked.push(it));
    }

    /// Brings blocks, the first of them first, as far as there is room.
    fn fetch(&self, needs: &[Need]) -> Result<()> {
        for few in needs.chunks(FETCH) {
            for (model, blocks) in by_model(few) {
                let held = self.scene.borrow().models[model as usize].blocks().bring(&blocks, &Cancel::new())?;
                let is_full = held.len() < blocks.len();
                let came: u64 = held.iter().map(|&(block, _)| self.bytes(Need { model, block })).sum();
                let mut rounds = self.rounds();
                rounds.came += came;
                rounds.hold.add(model, held);
                if is_full {
                    // To look for room for each of the rest would be in vain, under a lock that frames take.
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// A round with blocks of the reserve. Whoever holds the lease waits for nobody who may wait for it: what others of
    /// the pool take on of this round, they finish.
    fn run_leased(&self) -> Result<()> {
        let scene = self.scene.borrow();
        let mut lease = scene.context().residency().lease();
        let (needs, _) = self.rounds().parked.plan(lease.room(), |need| Lease::counts(self.bytes(need)));
        for (model, blocks) in by_model(&needs) {
            lease.fetch(scene.models[model as usize].blocks(), &blocks, &Cancel::new())?;
        }
        let snapshots = Snapshots::leased(scene, &lease)?;
        let groups = self.rounds().parked.take(|need| snapshots.has(need));
        let groups = groups.into_iter().map(|group| Mutex::new(Some(group))).collect();
        let resuming = Resuming { batch: self, groups, snapshots };
        scene.context().pool().run_scoped(resuming.groups.len(), &resuming).into_result()
    }

    /// After rays went as far as they came: what they wait for is to be read, or rays are to be begun.
    fn next_fetch(&self) -> usize {
        let mut rounds = self.rounds();
        // What this round held may go.
        (rounds.snapshots, rounds.hold) = (Arc::new(Snapshots::none()), Hold::default());
        if rounds.parked.is_empty() {
            return self.next_resume(&mut rounds, Snapshots::take(self.scene.borrow()));
        }
        let context = self.scene.borrow().context();
        let residency = context.residency();
        if residency.lease_is_free() && rounds.takes_lease(residency.lease_room()) {
            return rounds.begin(vec![Item::Lease]);
        }
        let room = rounds.room.min(context.memory_budget() / ROUND_SHARE);
        let (mut needs, is_all) = rounds.parked.plan(room, |need| self.bytes(need));
        (rounds.asked, rounds.came) = (needs.iter().map(|&need| self.bytes(need)).sum(), 0);
        // A worker is left for frames, which are not to wait for the disk.
        let readers = context.concurrency().saturating_sub(1).max(1);
        let shares: Vec<Vec<Need>> = if is_all {
            // Neighbours are read together.
            needs.sort_unstable();
            needs.chunks(needs.len().div_ceil(readers)).map(<[_]>::to_vec).collect()
        } else {
            // All begin with what most rays wait for.
            let of = |reader| needs.chunks(FETCH).skip(reader).step_by(readers).flatten().copied().collect();
            (0..readers.min(needs.len().div_ceil(FETCH))).map(of).collect()
        };
        rounds.items = shares.into_iter().map(|needs| Some(Item::Fetch(needs))).collect();
        rounds.fetching = true;
        rounds.items.len()
    }

    /// A round of what can go on, and of chunks not begun while few groups are parked.
    fn next_resume(&self, rounds: &mut Rounds, snapshots: Snapshots) -> usize {
        let ready = rounds.parked.take(|need| snapshots.has(need));
        let mut items: Vec<_> = ready.into_iter().map(Item::Resume).collect();
        if items.is_empty() && !rounds.parked.is_empty() {
            items.push(Item::Lease);
        }
        rounds.snapshots = Arc::new(snapshots);
        rounds.begin(items)
    }
}

impl Rounds {
    /// The first of which all items are chunks of rays.
    fn new(snapshots: Snapshots) -> Self {
        Self {
            snapshots: Arc::new(snapshots),
            items: Vec::new(),
            first: true,
            fetching: false,
            hold: Hold::default(),
            asked: 0,
            came: 0,
            room: u64::MAX,
            parked: Parked::default(),
            deferred: Vec::new(),
        }
    }

    /// Begins a round of `items`, and of chunks that were not begun while few groups are parked; returns how many there are.
    fn begin(&mut self, items: Vec<Item>) -> usize {
        let more = (MOST_PARKED.saturating_sub(self.parked.len() + items.len())).div_ceil(CHUNK / PACKET);
        let from = self.deferred.len() - more.min(self.deferred.len());
        let chunks = self.deferred.drain(from..).map(Item::Chunk);
        self.items = items.into_iter().chain(chunks).map(Some).collect();
        self.fetching = false;
        self.items.len()
    }

    /// After blocks were read: as much is asked for next as had room.
    fn has_fetched(&mut self) {
        if self.came < self.asked {
            self.room = self.came;
        } else {
            self.grow();
        }
    }

    /// Takes a round under a lease, if the reserve holds more than there is room for beside it: that then counts as a quarter more, so after some rounds it is
    /// looked anew what has room.
    fn takes_lease(&mut self, lease_room: u64) -> bool {
        let is_leased = self.room < lease_room;
        if is_leased {
            self.grow();
        }
        is_leased
    }

    fn grow(&mut self) {
        self.room = self.room.max(FEW).saturating_add(self.room / 4);
    }
}

/// Blocks of each model, in their order.
fn by_model(needs: &[Need]) -> BTreeMap<u32, Vec<BlockId>> {
    let mut models = BTreeMap::<u32, Vec<BlockId>>::new();
    needs.iter().for_each(|need| models.entry(need.model).or_default().push(need.block));
    models
}

/// Groups gone on with under a lease.
struct Resuming<'a, S, R, H, const ANY: bool> {
    batch: &'a Batch<S, R, H, ANY>,
    groups: Vec<Mutex<Option<Box<Group>>>>,
    snapshots: Snapshots,
}

impl<S, R, H, const ANY: bool> Work for Resuming<'_, S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    fn run(&self, item: usize) -> Result<()> {
        let group = self.groups[item].lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(group) = group {
            self.batch.resume(&self.snapshots, group);
        }
        Ok(())
    }
}

impl<S, R, H, const ANY: bool> Work for Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    fn run(&self, item: usize) -> Result<()> {
        let (todo, snapshots) = {
            let mut rounds = self.rounds();
            if rounds.first {
                drop(rounds);
                self.run_chunk(item);
                return Ok(());
            }
            (rounds.items.get_mut(item).and_then(Option::take), Arc::clone(&rounds.snapshots))
        };
        match todo {
            Some(Item::Chunk(chunk)) => {
                drop(snapshots);
                self.run_chunk(chunk);
            }
            Some(Item::Resume(group)) => self.resume(&snapshots, group),
            Some(Item::Fetch(needs)) => self.fetch(&needs)?,
            Some(Item::Lease) => {
                self.rounds().snapshots = Arc::new(Snapshots::none());
                drop(snapshots);
                self.run_leased()?;
            }
            None => {}
        }
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        let hold = {
            let mut rounds = self.rounds();
            rounds.first = false;
            if rounds.parked.is_empty() && rounds.deferred.is_empty() {
                return Ok(0);
            }
            rounds.fetching.then(|| {
                rounds.has_fetched();
                std::mem::take(&mut rounds.hold)
            })
        };
        let Some(hold) = hold else { return Ok(self.next_fetch()) };
        // Without memory for the tables it takes a lease.
        let snapshots = Snapshots::holding(self.scene.borrow(), &hold).unwrap_or(Snapshots::none());
        Ok(self.next_resume(&mut self.rounds(), snapshots))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What others hold they may let go of: rounds under leases, which take turns with all others', are for a while only.
    #[test]
    fn rounds_that_had_no_room_look_for_it_again() {
        let lease_room = 700 << 10;
        let mut rounds = Rounds::new(Snapshots::none());
        assert!(!rounds.takes_lease(lease_room), "nothing was asked for yet");
        (rounds.asked, rounds.came) = (4 << 20, 0);
        rounds.has_fetched();
        let leased = (0..100).take_while(|_| rounds.takes_lease(lease_room)).count();
        assert!((5..20).contains(&leased), "{leased} rounds");
        // There is as much room as is asked for: a quarter more each time, and no lease.
        for _ in 0..20 {
            let asked = rounds.room;
            (rounds.asked, rounds.came) = (asked, asked);
            rounds.has_fetched();
            assert_eq!(rounds.room, asked + asked / 4);
            assert!(!rounds.takes_lease(lease_room));
        }
        // Less than the reserve holds had room: leases again, but not from the beginning.
        (rounds.asked, rounds.came) = (rounds.room, lease_room - 1);
        rounds.has_fetched();
        assert!(rounds.takes_lease(lease_room) && !rounds.takes_lease(lease_room));
    }
}
