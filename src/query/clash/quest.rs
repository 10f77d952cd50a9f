//! The search for pairs of triangles, in [rounds](super::super::rounds): a walk through a pair of placed trees goes on
//! when blocks that it lacked have come.

use super::super::frames::Frames;
use super::super::rounds::{Quest, Rounds};
use super::super::waiting::{Lacking, Waiting};
use super::facts::{Found, Meeting};
use super::task::Task;
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::scene::SceneState;
use crate::scene::walk::{Need, SceneView, Snapshots};
use crate::structure::pairs::{PairCounters, PairDescent, PairSide, PairWalk};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Number of walks that work is divided into, if blocks are in memory: enough for all threads.
const WALKS: usize = 512;
/// Share of the walks in the progress of a query.
pub(super) const WALKS_SHARE: f64 = 0.9;

/// Walks through pairs of placed trees. Each is two indices of placed trees, the first not above the second.
pub(super) fn search(task: &Task, pairs: &[[u32; 2]]) -> Result<Found> {
    let scene = task.scene;
    let stamp = scene.context().residency().stamp();
    let (mut items, mut steps) = (Vec::new(), PairCounters::default());
    {
        let snapshots = Snapshots::take(scene);
        let view = SceneView::new(scene, &snapshots, stamp);
        let each = WALKS.div_ceil(pairs.len().max(1));
        let mut walk = PairWalk::default();
        for &pair in pairs {
            let [a, b] = pair.map(|placed| view.tree(placed.into()));
            let members = pair.map(|at| task.bits_of(&scene.placed(at.into())));
            let mut descent = PairDescent::new(&a, &b, pair[0] == pair[1]);
            if each > 1 {
                let frames = frames(task, pair);
                let sides = [PairSide { tree: a, frame: &frames.of[0] }, PairSide { tree: b, frame: &frames.of[1] }];
                walk.clear();
                // Pairs of leaves stay: nothing is found.
                let mut found = Found::default();
                let mut meeting = Meeting::new(task, pair, &sides, &frames, &mut found, members);
                descent.widen([&sides[0], &sides[1]], each, &mut walk, &mut meeting);
            }
            steps += std::mem::take(&mut walk.counters);
            items.extend(descent.split(each).into_iter().map(|descent| Piece::new(pair, members, descent)));
        }
    }
    let count = items.len();
    let items = items.into_iter().map(|piece| Mutex::new(Some(piece))).collect();
    let rounds = Rounds::new(Walks { task, items, stamp, found: Mutex::default(), done: AtomicU64::new(0) });
    scene.context().pool().run_scoped(count, &rounds).into_result()?;
    let mut found = rounds.quest.found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.steps += steps;
    Ok(found)
}

fn frames(task: &Task, pair: [u32; 2]) -> Frames {
    let placed = pair.map(|at| task.scene.placed(at.into()));
    Frames::new(placed.each_ref().map(|p| &**p), task.options.clearance)
}

/// The quest: its items and pieces are walks.
struct Walks<'a> {
    task: &'a Task<'a>,
    items: Vec<Mutex<Option<Piece>>>,
    stamp: u32,
    found: Mutex<Found>,
    /// Number of items that are finished.
    done: AtomicU64,
}

/// The rest of a walk through a pair of placed trees.
pub(super) struct Piece {
    pair: [u32; 2],
    /// See [`Task::bits_of`].
    members: [[u32; 2]; 2],
    models: [u32; 2],
    descent: PairDescent,
    found: Found,
}

impl Piece {
    fn new(pair: [u32; 2], members: [[u32; 2]; 2], descent: PairDescent) -> Self {
        Self { pair, members, models: [0; 2], descent, found: Found::default() }
    }
}

impl Lacking for Piece {
    type Step = [Need; 2];

    fn bytes(&self) -> u64 {
        self.descent.bytes() + self.found.bytes()
    }

    fn steps(&self) -> impl Iterator<Item = [Need; 2]> {
        let [a, b] = self.models;
        self.descent.needs().map(move |[x, y]: [BlockId; 2]| [Need { model: a, block: x }, Need { model: b, block: y }])
    }

    /// The first pairs of places come first: their blocks are neighbours in both trees.
    fn sort(steps: &mut Vec<[Need; 2]>) {
        steps.sort_unstable();
        steps.dedup();
    }
}

impl Walks<'_> {
    /// Takes a walk as far as the blocks in memory allow; returns it if anything is left.
    fn go_on(&self, mut piece: Piece, snapshots: &Snapshots) -> Option<Piece> {
        let Self { task, stamp, .. } = *self;
        if task.is_over() {
            return None;
        }
        let view = SceneView::new(task.scene, snapshots, stamp);
        piece.models = piece.pair.map(|at| task.scene.ids_of(at.into()).model);
        let frames = frames(task, piece.pair);
        let [a, b] = piece.pair.map(|at| view.tree(at.into()));
        let sides = [PairSide { tree: a, frame: &frames.of[0] }, PairSide { tree: b, frame: &frames.of[1] }];
        let context = task.scene.context();
        let mut walk = context.take_scratch::<PairWalk>();
        walk.clear();
        walk.counters = PairCounters::default();
        let mut meeting = Meeting::new(task, piece.pair, &sides, &frames, &mut piece.found, piece.members);
        piece.descent.go_on([&sides[0], &sides[1]], &mut walk, &mut meeting);
        piece.found.steps += walk.counters;
        context.give_scratch(walk);
        if piece.descent.is_done() {
            let found = std::mem::take(&mut piece.found);
            self.found.lock().unwrap_or_else(PoisonError::into_inner).merge(found, task.options.limit);
            let done = self.done.fetch_add(1, Relaxed) + 1;
            task.progress.advance(done as f64 / self.items.len() as f64 * WALKS_SHARE);
            return None;
        }
        Some(piece)
    }
}

impl Quest for Walks<'_> {
    type Waiting = Waiting<Piece>;
    const ITEM_BYTES: u64 = 4096;
    const RENEWAL: usize = 8;
    const FETCH: usize = 32;

    fn scene(&self) -> &SceneState {
        self.task.scene
    }

    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Piece> {
        let piece = self.items[item].lock().unwrap_or_else(PoisonError::into_inner).take();
        piece.and_then(|piece| self.go_on(piece, snapshots)).into_iter().collect()
    }

    fn resume(&self, piece: Piece, snapshots: &Snapshots) -> Option<Piece> {
        self.go_on(piece, snapshots)
    }
}
