//! Batches as jobs in rounds: rays that meet a missing block are parked with their walks, the blocks
//! fetched, the rays resumed. The answer does not depend on what was in memory.

use super::batch::{Hits, Policy, QueryOptions, RayWithMask, Rays};
use super::finish::finish;
use super::hit::{Hit, HitKind, Want};
use crate::base::error::Result;
use crate::base::tasks::{Ending, Work};
use crate::scene::SceneState;
use crate::scene::walk::{Found, Need, ScenePacket, SceneView, SceneWalk, Snapshots, Step, fetch};
use crate::structure::bvh::trace::PACKET;
use std::borrow::Borrow;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Groups of 16 rays in an item: some tens to hundreds of microseconds of work.
const GROUPS: usize = 16;
/// Rays of an item of the first round.
const CHUNK: usize = GROUPS * PACKET;

/// Called when a batch has ended.
pub(super) type Wake = Arc<dyn Fn() + Send + Sync>;

/// What is known of a batch from outside.
#[derive(Default)]
pub(super) struct Shared {
    answered: AtomicU64,
    end: Mutex<(Option<Ending>, Option<Wake>)>,
}

impl Shared {
    /// Rays answered so far.
    pub fn answered(&self) -> u64 {
        self.answered.load(Relaxed)
    }

    /// How it ended; `None` while it runs.
    pub fn ending(&self) -> Option<Ending> {
        self.end().0.clone()
    }

    /// Whom to call at the end; at once if that was before.
    pub fn set_wake(&self, wake: Option<Wake>) {
        let mut end = self.end();
        if end.0.is_none() {
            end.1 = wake;
        } else if let Some(wake) = wake {
            drop(end);
            wake();
        }
    }

    fn ended(&self, ending: &Ending) {
        let wake = {
            let mut end = self.end();
            end.0 = Some(ending.clone());
            end.1.take()
        };
        if let Some(wake) = wake {
            wake();
        }
    }

    fn end(&self) -> MutexGuard<'_, (Option<Ending>, Option<Wake>)> {
        self.end.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A batch of closest hits, or of any hits if `ANY`.
pub(super) struct Batch<S, R, H, const ANY: bool> {
    pub scene: S,
    rays: R,
    hits: H,
    options: QueryOptions,
    count: usize,
    shared: Arc<Shared>,
    rounds: Mutex<Rounds>,
}

struct Rounds {
    snapshots: Arc<Snapshots>,
    /// Of the present round: groups to resume; empty in the first, where items are chunks of rays.
    resuming: Vec<Option<Box<Group>>>,
    first: bool,
    /// For the next round.
    parked: Vec<Box<Group>>,
    needs: Vec<Need>,
    /// Groups that nobody uses.
    free: Vec<Box<Group>>,
}

/// Sixteen rays (fewer at the end) on their way; what it takes to put them down and take them up again.
struct Group {
    first: usize,
    count: usize,
    rays: [RayWithMask; PACKET],
    stage: Stage,
    packet: ScenePacket,
    walk: SceneWalk,
    /// Single rays that were put down, each with its walk.
    put_down: Vec<(usize, SceneWalk)>,
    found: [Found; PACKET],
    /// Bit `i`: ray `i` was answered without a block that it needed.
    lacking: u32,
    hits: [Hit; PACKET],
}

#[derive(Clone, Copy, PartialEq)]
enum Stage {
    Begin,
    Tracing,
    Finishing,
}

impl Group {
    fn new() -> Box<Self> {
        Box::new(Self {
            first: 0,
            count: 0,
            rays: [RayWithMask::NONE; PACKET],
            stage: Stage::Begin,
            packet: ScenePacket::default(),
            walk: SceneWalk::default(),
            put_down: Vec::new(),
            found: [Found::nothing(0.0); PACKET],
            lacking: 0,
            hits: [Hit::MISS; PACKET],
        })
    }
}

impl<S, R, H, const ANY: bool> Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    /// Of `rays`, answers to `hits`.
    pub fn new(scene: S, rays: R, hits: H, options: QueryOptions) -> Self {
        let rounds = Rounds {
            snapshots: Arc::new(Snapshots::take(scene.borrow())),
            resuming: Vec::new(),
            first: true,
            parked: Vec::new(),
            needs: Vec::new(),
            free: Vec::new(),
        };
        let count = rays.count();
        Self { scene, rays, hits, options, count, shared: Arc::default(), rounds: Mutex::new(rounds) }
    }

    /// Items of the first round.
    pub fn items(&self) -> usize {
        self.count.div_ceil(CHUNK)
    }

    /// Rays.
    pub fn total(&self) -> u64 {
        self.count as u64
    }

    /// What is counted.
    pub fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    fn rounds(&self) -> MutexGuard<'_, Rounds> {
        self.rounds.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A chunk of rays not yet begun.
    fn run_chunk(&self, item: usize, view: &SceneView, mut group: Box<Group>) {
        let end = ((item + 1) * CHUNK).min(self.count);
        for first in (item * CHUNK..end).step_by(PACKET) {
            group.first = first;
            group.count = (end - first).min(PACKET);
            group.stage = Stage::Begin;
            let count = group.count;
            self.rays.read(first, &mut group.rays[..count]);
            group = self.advance(view, group);
        }
        self.rounds().free.push(group);
    }

    /// Takes a group as far as it comes; returns it, or another if it had to be parked.
    fn advance(&self, view: &SceneView, mut group: Box<Group>) -> Box<Group> {
        let mut needs = Vec::new();
        if group.stage != Stage::Finishing {
            if self.options.coherent {
                self.trace_packet(view, &mut group, &mut needs);
            } else {
                self.trace_singles(view, &mut group, &mut needs);
            }
        }
        if needs.is_empty() {
            group.stage = Stage::Finishing;
            self.finish(view, &mut group, &mut needs);
        }
        if needs.is_empty() {
            self.hits.write(group.first, &group.hits[..group.count]);
            self.shared.answered.fetch_add(group.count as u64, Relaxed);
            return group;
        }
        let mut rounds = self.rounds();
        rounds.needs.append(&mut needs);
        rounds.parked.push(group);
        rounds.free.pop().unwrap_or_else(Group::new)
    }

    fn trace_packet(&self, view: &SceneView, group: &mut Group, needs: &mut Vec<Need>) {
        if group.stage == Stage::Begin {
            group.packet.begin(view, &group.rays, (1 << group.count) - 1);
            group.stage = Stage::Tracing;
        }
        group.lacking = 0;
        match view.trace16::<ANY>(&group.rays, &mut group.packet) {
            Step::Done => {}
            Step::Pending(need) if self.options.policy == Policy::Exact => needs.push(need),
            Step::Pending(_) => group.lacking = u32::MAX,
        }
    }

    fn trace_singles(&self, view: &SceneView, group: &mut Group, needs: &mut Vec<Need>) {
        let Group { put_down, rays, found, walk, count, lacking, stage, .. } = group;
        if *stage != Stage::Begin {
            put_down.retain_mut(|(i, walk)| match view.trace::<ANY>(&rays[*i].ray, rays[*i].mask, walk) {
                Step::Pending(need) => {
                    needs.push(need);
                    true
                }
                Step::Done => {
                    found[*i] = walk.best();
                    false
                }
            });
            return;
        }
        *stage = Stage::Tracing;
        *lacking = 0;
        let mut done = 0;
        while done < *count {
            let (n, step) = view.trace_each::<ANY>(&rays[done..*count], walk, &mut found[done..*count]);
            done += n;
            if step == Step::Done {
                continue;
            }
            // The ray that stopped goes on alone.
            let it = &rays[done];
            let mut alone = SceneWalk::default();
            alone.begin(view, &it.ray);
            match view.trace::<ANY>(&it.ray, it.mask, &mut alone) {
                Step::Pending(need) if self.options.policy == Policy::Exact => {
                    needs.push(need);
                    put_down.push((done, alone));
                }
                step => {
                    found[done] = alone.best();
                    *lacking |= u32::from(step != Step::Done) << done;
                }
            }
            done += 1;
        }
    }

    fn finish(&self, view: &SceneView, group: &mut Group, needs: &mut Vec<Need>) {
        let want = if ANY { Want::NOTHING } else { self.options.want };
        for i in 0..group.count {
            let found = if self.options.coherent { group.packet.best(i) } else { &group.found[i] };
            let hit = &mut group.hits[i];
            let lacking = finish(view, &group.rays[i].ray, found, want, hit).err();
            match (lacking, self.options.policy) {
                (None, _) if group.lacking >> i & 1 == 0 => {}
                (Some(need), Policy::Exact) => needs.push(need),
                _ => hit.kind = HitKind::Missing,
            }
        }
    }
}

impl<S, R, H, const ANY: bool> Work for Batch<S, R, H, ANY>
where
    S: Borrow<SceneState> + Send + Sync,
    R: Rays + Send + Sync,
    H: Hits + Send + Sync,
{
    fn run(&self, item: usize) -> Result<()> {
        let (first, resumed, free, snapshots) = {
            let mut rounds = self.rounds();
            let resumed = rounds.resuming.get_mut(item).and_then(Option::take);
            (rounds.first, resumed, rounds.free.pop(), Arc::clone(&rounds.snapshots))
        };
        let view = SceneView { scene: self.scene.borrow(), snapshots: &snapshots };
        if first {
            self.run_chunk(item, &view, free.unwrap_or_else(Group::new));
        } else if let Some(group) = resumed {
            let group = self.advance(&view, group);
            let mut rounds = self.rounds();
            rounds.free.push(group);
            rounds.free.extend(free);
        }
        Ok(())
    }

    fn round_done(&self) -> Result<usize> {
        let needs = std::mem::take(&mut self.rounds().needs);
        if needs.is_empty() {
            return Ok(0);
        }
        fetch(self.scene.borrow(), needs)?;
        let mut rounds = self.rounds();
        rounds.snapshots = Arc::new(Snapshots::take(self.scene.borrow()));
        rounds.first = false;
        rounds.resuming = std::mem::take(&mut rounds.parked).into_iter().map(Some).collect();
        Ok(rounds.resuming.len())
    }

    fn ended(&self, ending: &Ending) {
        self.shared.ended(ending);
    }
}
