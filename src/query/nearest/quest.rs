//! The search for the nearest points of a batch, in [rounds](super::super::rounds). Points near each other follow one
//! another, so that they find what they read in the caches of the processor.

use super::super::among::Among;
use super::super::rounds::{Quest, Rounds};
use super::super::waiting::{Lacking, Waiting};
use super::walk::{At, Best, Candidate, Entry, Scratch, Walker};
use super::{NearestOptions, NearestPoint, answer};
use crate::base::error::Result;
use crate::query::batch::Policy;
use crate::scene::SceneState;
use crate::scene::walk::{Need, SceneView, Snapshots};
use crate::simd::{Op, Simd, dispatch};
use glam::DVec3;
use std::cmp::Reverse;
use std::sync::{Mutex, PoisonError};

/// Points that a worker takes at a time.
const CHUNK: usize = 64;

/// A batch of points.
#[derive(Clone, Copy)]
pub(super) struct Points<'a> {
    pub scene: &'a SceneState,
    pub among: &'a Among<'a>,
    pub points: &'a [DVec3],
    pub options: &'a NearestOptions,
}

impl Points<'_> {
    /// The squared distance beyond which nothing is sought.
    fn limit(&self) -> f64 {
        self.options.max_distance * self.options.max_distance
    }
}

/// Answers a batch.
pub(super) fn run(batch: &Points, out: &mut [NearestPoint]) -> Result<()> {
    let order = along_curve(batch.points);
    let count = order.len().div_ceil(CHUNK);
    let stamp = batch.scene.context().residency().stamp();
    let rounds = Rounds::new(Search { batch: *batch, order, stamp, out: Mutex::new(out) });
    batch.scene.context().pool().run_scoped(count, &rounds).into_result()
}

/// The indices of points in the order of a Morton curve over their bounds.
fn along_curve(points: &[DVec3]) -> Vec<u32> {
    if points.len() <= CHUNK {
        return (0..points.len() as u32).collect();
    }
    let all = points.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], &p| [a.min(p), b.max(p)]);
    let extent = (all[1] - all[0]).max(DVec3::splat(f64::MIN_POSITIVE));
    let spread = |x: f64| (0..16).fold(0u64, |code, bit| code | u64::from(x as u32 >> bit & 1) << (3 * bit));
    let key = |p: &DVec3| {
        let at = ((*p - all[0]) / extent * 65535.0).min(DVec3::splat(65535.0));
        spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
    };
    let mut order: Vec<(u64, u32)> = points.iter().map(key).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, index)| index).collect()
}

struct Search<'a, 'b> {
    batch: Points<'a>,
    order: Vec<u32>,
    stamp: u32,
    out: Mutex<&'b mut [NearestPoint]>,
}

/// A point whose walk lacks blocks.
pub(super) struct Piece {
    index: u32,
    best: Best,
    /// The nearest first.
    left: Vec<Entry>,
    /// The block that it needs next.
    need: Need,
}

impl Lacking for Piece {
    type Step = [Need; 1];

    fn bytes(&self) -> u64 {
        let ties = self.best.ties.capacity() * size_of::<Candidate>();
        (ties + self.left.capacity() * size_of::<Entry>()) as u64
    }

    fn steps(&self) -> impl Iterator<Item = [Need; 1]> {
        std::iter::once([self.need])
    }

    /// The blocks that most walks need come first.
    fn sort(steps: &mut Vec<[Need; 1]>) {
        steps.sort_unstable();
        let mut counts: Vec<_> = steps.chunk_by(|a, b| a == b).map(|alike| (Reverse(alike.len()), alike[0])).collect();
        counts.sort_unstable();
        *steps = counts.into_iter().map(|(_, step)| step).collect();
    }
}

/// Walks from points, compiled for a set of instructions.
struct Walk<'a, 'b, I> {
    batch: Points<'a>,
    view: &'a SceneView<'a>,
    scratch: &'b mut Scratch,
    /// The points, and how each begins.
    points: I,
    answers: &'b mut Vec<(u32, NearestPoint)>,
    parked: &'b mut Vec<Piece>,
}

impl<I: Iterator<Item = (u32, Option<Piece>)>> Op for Walk<'_, '_, I> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { batch, view, scratch, points, answers, parked } = self;
        let walker = Walker::new(view, batch.among);
        let is_exact = batch.options.policy == Policy::Exact;
        for (index, begun) in points {
            let p = batch.points[index as usize];
            scratch.stack.clear();
            scratch.left.clear();
            match begun {
                Some(piece) => {
                    scratch.best = piece.best;
                    scratch.stack.extend(piece.left.iter().rev());
                }
                None => {
                    scratch.best.begin(batch.limit());
                    let root = batch.among.root();
                    scratch.stack.extend(root.map(|root| Entry { squared: 0.0, at: At::Top(root) }));
                }
            }
            if is_exact {
                walker.go_on::<false>(p, scratch);
            } else {
                walker.go_on::<true>(p, scratch);
            }
            let Scratch { best, left, .. } = &mut *scratch;
            let around = best.around.map_or(f64::INFINITY, |(squared, _)| squared);
            walker.prune(p, best.squared.min(around), left);
            let is_named = left.is_empty() && walker.name(best);
            if is_exact && !is_named {
                left.sort_by(|a, b| a.squared.total_cmp(&b.squared));
                let left = left.clone();
                if let Some(need) = need(view, best, &left) {
                    parked.push(Piece { index, best: std::mem::take(best), left, need });
                    continue;
                }
            }
            if !is_exact {
                walker.name(best);
            }
            answers.push((index, answer(&walker, batch.scene, p, batch.options.max_distance, best, left)));
        }
    }
}

/// The block that a walk needs next: that of the nearest place, then those of primitive ids.
fn need(view: &SceneView, best: &Best, left: &[Entry]) -> Option<Need> {
    let of_left = left.iter().find_map(|entry| match entry.at {
        At::In(placed, place) => Some((placed, place)),
        At::Top(_) => None,
    });
    let of_ties = || best.ties.iter().find(|tie| tie.prim.is_none()).map(|tie| (tie.placed, tie.prim_at));
    let (placed, place) = of_left.or_else(of_ties)?;
    Some(view.need(placed, crate::base::ids::BlockId(place.block)))
}

impl Search<'_, '_> {
    fn walk(&self, points: impl Iterator<Item = (u32, Option<Piece>)>, snapshots: &Snapshots) -> Vec<Piece> {
        let context = self.batch.scene.context();
        let view = SceneView::new(self.batch.scene, snapshots, self.stamp);
        let mut scratch = context.take_scratch::<Scratch>();
        let (mut answers, mut parked) = (Vec::with_capacity(CHUNK), Vec::new());
        let walk = Walk {
            batch: self.batch,
            view: &view,
            scratch: &mut scratch,
            points,
            answers: &mut answers,
            parked: &mut parked,
        };
        dispatch(context.isa(), walk);
        context.give_scratch(scratch);
        let mut out = self.out.lock().unwrap_or_else(PoisonError::into_inner);
        answers.into_iter().for_each(|(index, answer)| out[index as usize] = answer);
        parked
    }
}

impl Quest for Search<'_, '_> {
    type Waiting = Waiting<Piece>;
    const ITEM_BYTES: u64 = 1 << 15;
    const RENEWAL: usize = 16;
    const FETCH: usize = 16;

    fn scene(&self) -> &SceneState {
        self.batch.scene
    }

    fn begin(&self, item: usize, snapshots: &Snapshots) -> Vec<Piece> {
        let points = self.order.chunks(CHUNK).nth(item).unwrap_or(&[]);
        self.walk(points.iter().map(|&index| (index, None)), snapshots)
    }

    fn resume(&self, piece: Piece, snapshots: &Snapshots) -> Option<Piece> {
        self.walk(std::iter::once((piece.index, Some(piece))), snapshots).pop()
    }
}
