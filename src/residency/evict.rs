//! Eviction: which blocks are evicted first when room is needed.
//!
//! A block is evictable if no live pass of a view used it and it is not pinned. Blocks that are not coarse are evicted
//! first, the least recently used of them before others. Coarse blocks follow, the highest ids first. References lead
//! to higher ids, and a block with one other block below it counts as used whenever that one is. So a block is never
//! evicted before the blocks below it.

use super::blocks::{Inner, ModelKey};
use super::core::{After, Shared, State};
use super::snapshot::{CHANNELS, Snapshot};
use crate::base::ids::BlockId;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Reason for a lack of room.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Short {
    /// All blocks in memory are in use.
    InUse,
    /// Memory will become free: snapshots still hold evicted blocks, or blocks are being read.
    ForNow,
}

/// Evictable blocks in the order of eviction, at the time of listing.
#[derive(Default)]
pub(super) struct Victims {
    order: Vec<Victim>,
    next: usize,
}

/// A candidate. The order of candidates is that of their eviction.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Victim {
    is_coarse: bool,
    stamp: u32,
    /// `u32::MAX` minus the id: the highest id comes first.
    below_top: u32,
    model: ModelKey,
}

impl Victim {
    fn of(model: &Inner, id: BlockId, stamp: u32) -> Self {
        let is_coarse = model.decoder.class(id).is_coarse;
        // Coarse blocks are ordered by their ids only.
        Self { is_coarse, stamp: if is_coarse { 0 } else { stamp }, below_top: u32::MAX - id.0, model: model.key }
    }

    fn id(&self) -> BlockId {
        BlockId(u32::MAX - self.below_top)
    }
}

/// More is freed at once than needed: one part in `AHEAD_SHARE` of the bytes for slots, [`AHEAD`] bytes at most.
const AHEAD_SHARE: u64 = 64;
const AHEAD: u64 = 1 << 20;

impl State {
    /// Unpublishes blocks that no live view uses until slots of `need` bytes fit. Their memory is free once `after` has
    /// run and no snapshot holds them.
    pub fn free_up(&mut self, shared: &Shared, need: u64, after: &mut After) -> Result<(), Short> {
        let oldest_live_pass = self.oldest_live_pass();
        self.free_up_beside(shared, need, &oldest_live_pass, after)
    }

    /// Like [`State::free_up`], but also evicts blocks that views use. Complete pictures stay, and running passes end
    /// with the blocks that they hold.
    pub fn free_up_in_use(&mut self, shared: &Shared, need: u64, after: &mut After) -> Result<(), Short> {
        self.free_up_beside(shared, need, &[u32::MAX; CHANNELS], after)
    }

    /// Unpublishes blocks that no pass from `oldest_live_pass` on has used, channel by channel.
    fn free_up_beside(
        &mut self,
        shared: &Shared,
        need: u64,
        oldest_live_pass: &[u32; CHANNELS],
        after: &mut After,
    ) -> Result<(), Short> {
        if self.companions > 0 {
            self.give_back_companions(shared, need, after);
            if self.fits(shared, need) {
                return Ok(());
            }
        }
        let capacity = shared.capacity(self);
        let enough = (self.resident + self.in_flight + need).saturating_sub(capacity);
        let wished = enough + (capacity / AHEAD_SHARE).min(AHEAD);
        let (mut freed, mut going) = (0, BTreeMap::<ModelKey, (Arc<Inner>, BTreeSet<BlockId>)>::new());
        let mut listed = false;
        while freed < wished {
            let Some(victim) = self.victims.pop() else {
                if listed || freed >= enough {
                    break;
                }
                self.list_victims(oldest_live_pass);
                listed = true;
                continue;
            };
            let Some(model) = self.model(victim.model) else { continue };
            // The block may have been used or evicted since it was listed.
            let stamp = last_use_of_evictable(&model, &model.published.load(), victim.id(), oldest_live_pass);
            if stamp.is_some_and(|stamp| victim.is_coarse || stamp == victim.stamp) {
                let bytes = model.slot_bytes(victim.id());
                let (_, ids) = going.entry(victim.model).or_insert_with(|| (model, BTreeSet::new()));
                freed += if ids.insert(victim.id()) { bytes } else { 0 };
            }
        }
        if freed < enough {
            // Too little can be freed, so no block is evicted. The next call lists the blocks again.
            self.victims.clear();
            // Blocks that are being read are in use only until their read ends.
            return Err(if freed + self.in_flight >= enough { Short::ForNow } else { Short::InUse });
        }
        let all = going.into_values().all(|(model, ids)| self.unpublish(shared, &model, &ids, after));
        if all { Ok(()) } else { Err(Short::ForNow) }
    }

    /// Publishes a snapshot without `ids`. Returns false if there is no memory for the table.
    fn unpublish(&mut self, shared: &Shared, model: &Inner, ids: &BTreeSet<BlockId>, after: &mut After) -> bool {
        let before = model.published.load_full();
        let Some(next) = before.changed(ids.iter().map(|&id| (id, None)).collect(), Some(&shared.main)) else {
            return false;
        };
        after.garbage.push(before);
        after.garbage.push(model.published.swap(Arc::new(next)));
        self.resident -= ids.iter().map(|&id| model.slot_bytes(id)).sum::<u64>();
        model.count_promoted(ids.iter().copied(), false);
        // Blocks that were read for a view without passes do not count as in use. Fetchers have skipped them, because
        // they were in memory.
        let ids: Vec<BlockId> = ids.iter().copied().collect();
        if self.live_views().iter().any(|view| view.wants_any(model.key, &ids)) {
            let _ = self.ranking.invalidate();
            after.must_look = true;
        }
        true
    }

    fn list_victims(&mut self, oldest_live_pass: &[u32; CHANNELS]) {
        let models: Vec<_> = self.models.values().filter_map(std::sync::Weak::upgrade).collect();
        self.victims.clear();
        for model in &models {
            let snapshot = model.published.load();
            let evictable = snapshot.resident().filter_map(|(id, _)| {
                let stamp = last_use_of_evictable(model, &snapshot, id, oldest_live_pass)?;
                Some(Victim::of(model, id, stamp))
            });
            self.victims.order.extend(evictable);
        }
        self.victims.order.sort_unstable();
    }

    /// Bytes of blocks that cannot be evicted now.
    pub fn in_use(&mut self) -> u64 {
        let oldest_live_pass = self.oldest_live_pass();
        self.used_since(&oldest_live_pass)
    }

    /// Bytes of pinned blocks, and of blocks that passes from `oldest_live_pass` on have used, channel by channel.
    pub fn used_since(&self, oldest_live_pass: &[u32; CHANNELS]) -> u64 {
        let models: Vec<_> = self.models.values().filter_map(std::sync::Weak::upgrade).collect();
        let of_model = |model: &Arc<Inner>| {
            let snapshot = model.published.load();
            let used = snapshot
                .resident()
                .filter(|(id, _)| last_use_of_evictable(model, &snapshot, *id, oldest_live_pass).is_none());
            used.map(|(id, _)| model.slot_bytes(id)).sum::<u64>()
        };
        models.iter().map(of_model).sum()
    }
}

/// Returns the last-used stamp of the block if it is in memory and evictable.
fn last_use_of_evictable(
    model: &Inner,
    snapshot: &Snapshot,
    id: BlockId,
    oldest_live_pass: &[u32; CHANNELS],
) -> Option<u32> {
    let mut stamps = snapshot.stamps(id);
    if let Some(below) = model.decoder.class(id).below.filter(|below| snapshot.block(*below).is_some()) {
        let of_leaves = snapshot.stamps(below);
        stamps = std::array::from_fn(|channel| stamps[channel].max(of_leaves[channel]));
    }
    let is_used = stamps.iter().zip(oldest_live_pass).any(|(stamp, oldest_live_pass)| stamp >= oldest_live_pass);
    let may_go = !is_used && !model.is_pinned(id) && snapshot.block(id).is_some();
    may_go.then(|| stamps.into_iter().fold(0, u32::max))
}

impl Victims {
    fn pop(&mut self) -> Option<Victim> {
        let victim = self.order.get(self.next).copied();
        self.next += 1;
        victim
    }

    fn clear(&mut self) {
        self.order.clear();
        self.next = 0;
    }
}
