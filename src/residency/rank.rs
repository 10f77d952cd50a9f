//! Ranking of the wants of all views, the most wanted block first.

use super::blocks::{Inner, ModelKey};
use super::core::State;
use super::load::{RUN_BYTES, goes_with};
use crate::base::ids::BlockId;
use std::sync::Arc;

/// A block of a model.
pub(super) type Key = (ModelKey, BlockId);

/// A block that a view wants.
pub(super) struct RankedWant {
    pub key: Key,
    pub weight: f32,
    /// Stamp of the pass that lacked it; 0 for none.
    pub stamp: u32,
    /// See [`super::view::ViewCore::is_patient`]. Among patient wants those outside of passes come last.
    pub is_patient: bool,
}

/// The wants of all views at the time of ranking.
#[derive(Default)]
pub(super) struct Ranking {
    /// Wanted blocks, ascending, each with the last pass that wanted it.
    wanted: Vec<(Key, u32)>,
    /// Blocks that only patient views want: the last ones in the order.
    patient: usize,
    /// Wanted blocks by descending weight.
    order: Vec<Key>,
    next: usize,
    valid: bool,
    /// True if the next block does not fit, and nothing has changed since that was found.
    pub is_stuck: bool,
}

impl Ranking {
    /// Marks the ranking as outdated: views want other blocks, or wanted blocks may be read again. Returns true if a
    /// block was refused: a fetcher must then search again, or the refused view would get no more news.
    #[must_use]
    pub fn invalidate(&mut self) -> bool {
        std::mem::replace(&mut self.valid, false) && self.is_stuck
    }

    /// True if the next block does not fit.
    pub fn is_refused(&self) -> bool {
        self.valid && self.is_stuck
    }

    /// True if only patient views want the next block, and all blocks behind it.
    pub fn is_patient(&self) -> bool {
        self.next + self.patient >= self.order.len()
    }

    /// Returns the stamp of the last pass that wanted the block; 0 for none.
    pub fn stamp(&self, key: Key) -> u32 {
        self.wanted.binary_search_by_key(&key, |w| w.0).map_or(0, |at| self.wanted[at].1)
    }

    /// Returns the most wanted block that was not [skipped](Ranking::pass_over).
    pub fn first(&self) -> Option<Key> {
        self.order.get(self.next).copied()
    }

    /// Skips the first block.
    pub fn pass_over(&mut self) {
        self.next += 1;
    }

    /// Returns the wanted neighbours of a block that are read with it, including the block, ascending.
    pub fn run_around(&self, model: &Inner, (key, id): Key) -> Vec<BlockId> {
        let Ok(at) = self.wanted.binary_search_by_key(&(key, id), |w| w.0) else { return vec![id] };
        let absent = |&&((of, id), _): &&(Key, u32)| of == key && can_be_had(model, id);
        let mut run = vec![id];
        for ((_, before), _) in self.wanted[..at].iter().rev().take_while(absent) {
            let last = run[run.len() - 1];
            let joins = goes_with(&model.file, [*before, *before, run[0]], RUN_BYTES);
            if !(joins && goes_with(&model.file, [*before, last, last], RUN_BYTES)) {
                break;
            }
            run.insert(0, *before);
        }
        for ((_, after), _) in self.wanted[at + 1..].iter().take_while(absent) {
            if !goes_with(&model.file, [run[0], run[run.len() - 1], *after], RUN_BYTES) {
                break;
            }
            run.push(*after);
        }
        run
    }
}

/// True if the block is not in memory and may be read.
pub(super) fn can_be_had(model: &Inner, id: BlockId) -> bool {
    !model.is_there(id) && !model.failures.has(id) && !model.claims.is_claimed(id)
}

impl State {
    /// Returns the most wanted block that may be read, and its model.
    pub fn first_to_be_had(&mut self) -> Option<(Arc<Inner>, Key)> {
        while let Some((key, id)) = self.ranking.first() {
            if let Some(model) = self.model(key).filter(|model| can_be_had(model, id)) {
                return Some((model, (key, id)));
            }
            self.ranking.pass_over();
        }
        None
    }

    /// Ranks the wants again if something has changed.
    pub fn rank(&mut self) {
        if self.ranking.valid {
            return;
        }
        let mut all: Vec<RankedWant> = Vec::new();
        for view in self.live_views() {
            view.add_wants(&mut all);
        }
        all.sort_unstable_by_key(|want| want.key);
        let ranking = &mut self.ranking;
        ranking.wanted.clear();
        let mut weights: Vec<(u8, f32, Key)> = Vec::with_capacity(all.len());
        for same in all.chunk_by(|a, b| a.key == b.key) {
            let last = same.iter().map(|want| want.stamp).max().unwrap_or(0);
            ranking.wanted.push((same[0].key, last));
            let patience = |want: &RankedWant| u8::from(want.is_patient) + u8::from(want.stamp == 0);
            let least = same.iter().map(patience).min().unwrap_or(0);
            weights.push((least, same.iter().map(|want| want.weight).sum(), same[0].key));
        }
        // Among equals lower ids come first: parents before children.
        weights.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)).then(a.2.cmp(&b.2)));
        ranking.patient = weights.iter().filter(|weight| weight.0 > 0).count();
        ranking.order = weights.into_iter().map(|(.., key)| key).collect();
        (ranking.next, ranking.valid, ranking.is_stuck) = (0, true, false);
        self.pressure.is_full = false;
    }
}
