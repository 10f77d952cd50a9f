//! The search for the nearest two triangles, in [rounds](super::super::rounds): its pieces are walks through pairs of
//! places, which share the least distance found so far.

use super::super::among::Among;
use super::super::rounds::{Quest, Rounds};
use super::super::waiting::{Lacking, Waiting};
use super::walk::{Entry, Nearest, Rest, Scratch, Walker, needed};
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::scene::SceneState;
use crate::scene::walk::{Need, SceneView, Snapshots};
use crate::simd::{Op, Simd, dispatch};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Number of walks that work is divided into: enough for all threads.
const WALKS: usize = 64;

/// Finds the nearest two triangles of two sets; `None` if there are none within the squared distance `most`.
pub(super) fn search(scene: &SceneState, sets: [&Among; 2], is_self: bool, most: f64) -> Result<Option<Nearest>> {
    let stamp = scene.context().residency().stamp();
    let bound = AtomicU64::new(most.to_bits());
    let pieces = {
        let snapshots = Snapshots::take(scene);
        let view = SceneView::new(scene, &snapshots, stamp);
        let walker = Walker { view: &view, sets, is_self, bound: &bound };
        let all = walker.widened(Rest::new(sets), WALKS);
        let each = all.len().div_ceil(WALKS).max(1);
        let pieces = all
            .chunks(each)
            .enumerate()
            .map(|(index, left)| Mutex::new(Some(Piece { index, rest: Rest::of(left.to_vec()), needs: Vec::new() })));
        pieces.collect::<Vec<_>>()
    };
    let count = pieces.len();
    let found = pieces.iter().map(|_| Mutex::new(None)).collect();
    let zero_at = AtomicUsize::new(usize::MAX);
    let rounds = Rounds::new(Search { scene, sets, is_self, stamp, bound, zero_at, pieces, found });
    scene.context().pool().run_scoped(count, &rounds).into_result()?;
    let found = rounds.quest.found.into_iter().filter_map(|it| it.into_inner().unwrap_or_else(PoisonError::into_inner));
    // The first of those with a common point, otherwise the least.
    Ok(found.reduce(|best, next| if best.squared > 0.0 && next.precedes(&best) { next } else { best }))
}

struct Search<'a> {
    scene: &'a SceneState,
    sets: [&'a Among<'a>; 2],
    is_self: bool,
    stamp: u32,
    bound: AtomicU64,
    /// The first walk that found a common point: those behind it do not count.
    zero_at: AtomicUsize,
    pieces: Vec<Mutex<Option<Piece>>>,
    /// What each walk found.
    found: Vec<Mutex<Option<Nearest>>>,
}

/// The rest of a walk.
pub(super) struct Piece {
    index: usize,
    rest: Rest,
    /// The blocks that the nearest pair of places needs.
    needs: Vec<Need>,
}

impl Lacking for Piece {
    type Step = Vec<Need>;

    fn bytes(&self) -> u64 {
        (self.rest.left.capacity() * size_of::<Entry>() + self.needs.capacity() * size_of::<Need>()) as u64
    }

    fn steps(&self) -> impl Iterator<Item = Vec<Need>> {
        std::iter::once(self.needs.clone())
    }

    /// The first walks come first.
    fn sort(_: &mut Vec<Vec<Need>>) {}
}

/// A walk, compiled for a set of instructions.
struct Walk<'a, 'b> {
    walker: Walker<'a>,
    rest: &'b mut Rest,
    scratch: &'b mut Scratch,
    is_over: &'b dyn Fn() -> bool,
}

impl Op for Walk<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        self.walker.go_on(self.rest, self.scratch, self.is_over);
    }
}

impl Search<'_> {
    fn go_on(&self, mut piece: Piece, snapshots: &Snapshots) -> Option<Piece> {
        let Self { scene, sets, is_self, stamp, ref bound, ref zero_at, .. } = *self;
        let view = SceneView::new(scene, snapshots, stamp);
        let index = piece.index;
        let is_over = || zero_at.load(Relaxed) < index;
        let mut scratch = scene.context().take_scratch::<Scratch>();
        let walker = Walker { view: &view, sets, is_self, bound };
        let walk = Walk { walker, rest: &mut piece.rest, scratch: &mut scratch, is_over: &is_over };
        dispatch(scene.context().isa(), walk);
        scene.context().give_scratch(scratch);
        if piece.rest.best.is_some_and(|best| best.squared == 0.0) {
            zero_at.fetch_min(index, Relaxed);
        }
        let nearest = piece.rest.left.iter().min_by(|a, b| a.squared.total_cmp(&b.squared));
        match nearest {
            Some(nearest) if !is_over() => {
                let need = |(placed, block)| view.need(placed, BlockId(block));
                piece.needs = needed(is_self, nearest).map(need).collect();
                Some(piece)
            }
            _ => {
                *self.found[index].lock().unwrap_or_else(PoisonError::into_inner) = piece.rest.best;
                None
            }
        }
    }
}

impl Walker<'_> {
    /// Replaces pairs of places by those below them, in order, until there are at least `count`, as far as blocks are
    /// in memory. Pairs of leaves stay.
    fn widened(&self, rest: Rest, count: usize) -> Vec<Entry> {
        let (mut all, mut is_wider) = (rest.left, true);
        let mut scratch = self.view.scene.context().take_scratch::<Scratch>();
        while is_wider && all.len() < count {
            is_wider = false;
            for entry in std::mem::take(&mut all) {
                if self.below(&entry, &mut scratch) {
                    is_wider = true;
                    all.append(&mut scratch.stack);
                } else {
                    all.push(entry);
                }
            }
        }
        self.view.scene.context().give_scratch(scratch);
        all
    }
}

impl Quest for Search<'_> {
    type Waiting = Waiting<Piece>;
    const ITEM_BYTES: u64 = 1 << 14;
    const RENEWAL: usize = 8;
    const FETCH: usize = 16;

    fn scene(&self) -> &SceneState {
        self.scene
    }

    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Piece> {
        let piece = self.pieces[item].lock().unwrap_or_else(PoisonError::into_inner).take();
        piece.and_then(|piece| self.go_on(piece, snapshots)).into_iter().collect()
    }

    fn resume(&self, piece: Piece, snapshots: &Snapshots) -> Option<Piece> {
        self.go_on(piece, snapshots)
    }
}
