//! Companions: values that are made from all blocks of a model and kept beside them while there is room.
//!
//! A snapshot holds the companion as it holds blocks: users see it as long as they hold the snapshot. When room is
//! needed, companions are given back before any block is evicted.

use super::account::Charge;
use super::blocks::{Inner, ModelBlocks};
use super::core::{After, Shared, State};
use std::any::Any;
use std::sync::{Arc, Weak};

/// The value of a companion.
pub type Value = Box<dyn Any + Send + Sync>;

/// A companion, and the charge for its memory.
pub(super) struct Companion {
    value: Value,
    bytes: u64,
    _charge: Charge,
}

/// Memory that is charged for a companion.
pub struct CompanionRoom {
    bytes: u64,
    charge: Charge,
}

impl std::fmt::Debug for Companion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Companion").field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl Companion {
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    pub fn value(&self) -> &(dyn Any + Send + Sync) {
        &*self.value
    }
}

impl CompanionRoom {
    /// Bytes that are charged.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Part of the budget that companions leave free.
const FREE_SHARE: u64 = 16;

impl ModelBlocks {
    /// Charges `bytes` for a companion, if they fit beside all blocks in memory and those that are read ahead. Nothing
    /// is evicted for it.
    pub fn companion_room(&self, bytes: u64) -> Option<CompanionRoom> {
        let shared = &self.inner.residency;
        let state = shared.lock();
        let models: Vec<Arc<Inner>> = state.models.values().filter_map(Weak::upgrade).collect();
        drop(state);
        let lacking: u64 =
            if shared.promotes() { models.iter().map(|model| model.promoted_lacking()).sum() } else { 0 };
        let leaving = shared.headroom.saturating_add(lacking).saturating_add(shared.budget() / FREE_SHARE);
        Some(CompanionRoom { bytes, charge: shared.main.charge(bytes, leaving)? })
    }

    /// Publishes a companion, which replaces an older one. Returns false if there is no memory for the table.
    pub fn put_companion(&self, value: Value, room: CompanionRoom) -> bool {
        let CompanionRoom { bytes, charge } = room;
        let companion = Arc::new(Companion { value, bytes, _charge: charge });
        let (shared, mut after) = (&self.inner.residency, After::default());
        let done = shared.lock().publish_companion(shared, &self.inner, Some(companion), &mut after);
        after.run(shared);
        done
    }

    /// Bytes of the companion.
    pub fn companion_bytes(&self) -> u64 {
        self.snapshot().companion_bytes()
    }
}

impl State {
    /// Publishes a snapshot with another companion, or without any.
    fn publish_companion(
        &mut self,
        shared: &Shared,
        model: &Inner,
        companion: Option<Arc<Companion>>,
        after: &mut After,
    ) -> bool {
        if !self.models.contains_key(&model.key) {
            return false;
        }
        let before = model.published.load_full();
        let Some(next) = before.with_companion(companion, &shared.main) else { return false };
        self.companions = self.companions + next.companion_bytes() - before.companion_bytes();
        after.garbage.push(before);
        after.garbage.push(model.published.swap(Arc::new(next)));
        true
    }

    /// Gives back companions until slots of `need` bytes fit, or none is left. Their memory is free once `after` has
    /// run and no snapshot holds them.
    pub fn give_back_companions(&mut self, shared: &Shared, need: u64, after: &mut After) {
        let models: Vec<Arc<Inner>> = self.models.values().filter_map(Weak::upgrade).collect();
        for model in models {
            if self.companions == 0 || self.fits(shared, need) {
                break;
            }
            if model.published.load().companion_bytes() > 0 {
                self.publish_companion(shared, &model, None, after);
            }
        }
    }
}
