//! Admission of models: memory for their tables, before these are read, and the least budget that a model needs.

use super::account::Charge;
use super::blocks::ModelKey;
use super::core::{FOR_ROOM, Residency, Shared};
use super::lease::WORKING_SHARE;
use super::links::Links;
use super::load::{reading_bytes, slot_bytes_of};
use super::snapshot::{PAGE_BYTES, Snapshot};
use super::sync::Ordering::Relaxed;
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use crate::store::directory::Row;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Bytes that a model needs in memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Needs {
    /// Tables that stay as long as the model.
    pub tables: u64,
    /// Greatest addition for a changed table of the blocks in memory.
    pub changes: u64,
    /// Blocks that stay.
    pub pinned: u64,
    /// The block with the greatest size in memory.
    pub largest: u64,
    /// Reading the block that takes most.
    pub reading: u64,
}

impl Needs {
    /// Bytes for `blocks` blocks, `geometry` of which are geometry, and `entered` of which others may refer to; not
    /// those for the blocks themselves.
    pub fn of_blocks(blocks: u32, geometry: u32, entered: u32) -> Self {
        let [stays, changes] = Snapshot::bytes_for(blocks);
        // A flag for each of pinned and failed blocks.
        let tables = stays + u64::from(blocks) * 2 + Links::bytes_for(geometry, entered);
        Self { tables, changes, ..Self::default() }
    }

    /// Adds a block that stays.
    pub fn pin(&mut self, row: &Row) {
        self.pinned += slot_bytes_of(row);
        self.hold(row);
    }

    /// Adds a block that is read and evicted.
    pub fn hold(&mut self, row: &Row) {
        self.largest = self.largest.max(slot_bytes_of(row));
        self.reading = self.reading.max(reading_bytes(std::slice::from_ref(row)));
    }

    /// The sum of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            tables: self.tables.saturating_add(other.tables),
            changes: self.changes + other.changes,
            pinned: self.pinned + other.pinned,
            largest: self.largest.max(other.largest),
            reading: self.reading.max(other.reading),
        }
    }
}

/// Memory for the tables of a model that is being opened. Dropping it gives the memory back.
pub struct Admission {
    shared: Arc<Shared>,
    name: PathBuf,
    key: ModelKey,
    pub(super) needs: Needs,
    charges: Vec<Charge>,
    /// True if a model has taken over: its end gives the memory back.
    is_taken: bool,
}

/// Returns the bytes kept free of slots under a budget, and the bytes for the lease.
pub(super) fn shares(budget: u64) -> [u64; 2] {
    [(budget / 16).clamp(1 << 20, 4 << 20), (budget / 8).clamp(1 << 20, 8 << 20)]
}

/// Returns the least budget for models that need `needs`.
fn least_budget(needs: &Needs) -> u64 {
    let bytes = needs.tables.saturating_add(needs.changes + needs.pinned);
    let working = needs.reading.max(PAGE_BYTES + needs.changes / 16);
    let mut budget = bytes;
    // The shares grow slower than the budget, so the loop ends.
    loop {
        let [headroom, reserve] = shares(budget);
        let least = bytes.saturating_add(headroom + reserve);
        let is_enough = headroom >= working && reserve / WORKING_SHARE >= working && reserve / 2 >= needs.largest;
        if least <= budget && (is_enough || budget > MOST_SHARES) {
            return budget;
        }
        budget = least.max(budget.saturating_add(if is_enough { 0 } else { 64 << 10 }));
    }
}

/// Budgets from this size on have the largest shares.
const MOST_SHARES: u64 = 64 << 20;

/// Returns a budget that has room for `bytes` more than `have` has.
pub(super) fn grown(have: u64, bytes: u64) -> u64 {
    let wanted = have.saturating_sub(shares(have).iter().sum()).saturating_add(bytes);
    let mut budget = have;
    // The shares grow slower than the budget, so the loop ends.
    loop {
        let least = wanted.saturating_add(shares(budget).iter().sum());
        if least <= budget {
            return budget;
        }
        budget = least;
    }
}

impl Residency {
    /// Admits a model with the needs that are known before its tables are read. `rest` returns the others; it is called
    /// only if the budget is too small, so that the error can name the least sufficient budget.
    ///
    /// Fails with `OverBudget`, with `Cancelled`, or with the error of `rest`.
    pub fn admit(
        &self,
        name: &Path,
        needs: Needs,
        rest: impl FnOnce() -> Result<Needs>,
        cancel: &Cancel,
    ) -> Result<Admission> {
        let shared = Arc::clone(self.shared());
        let key = shared.lock().new_key();
        let (name, none) = (name.to_path_buf(), Needs::default());
        let mut admission = Admission { shared, name, key, needs: none, charges: Vec::new(), is_taken: false };
        admission.add(needs, rest, cancel)?;
        Ok(admission)
    }
}

impl Shared {
    /// Makes the least budget grow by `more`, if it is still at most the budget then. Otherwise nothing changes, and
    /// the error is the budget that would be needed.
    pub fn reserve(&self, more: &Needs) -> std::result::Result<(), u64> {
        let mut state = self.lock();
        let need = state.least_with(more);
        if need > self.budget() {
            return Err(need);
        }
        state.tables += more.tables + more.changes;
        state.pinned += more.pinned;
        Ok(())
    }

    /// Charges `bytes`. Evicts blocks in use if it must, and then waits until passes that hold them have ended,
    /// [`FOR_ROOM`] at most, or not at all where the host's threads do all work. Fails with `Cancelled`, or with
    /// `OverBudget` for `what`, which lacks `lacking` bytes.
    pub fn charge_when_free(
        &self,
        bytes: u64,
        lacking: u64,
        what: &dyn Fn() -> String,
        cancel: &Cancel,
    ) -> Result<Charge> {
        let begun = Instant::now();
        loop {
            let charge = if self.takes_room(0) { self.main.charge(bytes, 0) } else { None };
            if let Some(charge) = charge {
                return Ok(charge);
            }
            cancel.check()?;
            if begun.elapsed() >= FOR_ROOM || self.is_stepped.load(Relaxed) {
                let have = self.budget();
                let what = format!("{} in addition to the data in use", what());
                return Err(Error::OverBudget { what, need: grown(have, lacking), have });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Admission {
    /// Admits further needs. See [`Residency::admit`].
    pub(super) fn add(&mut self, more: Needs, rest: impl FnOnce() -> Result<Needs>, cancel: &Cancel) -> Result<()> {
        if let Err(need) = self.shared.reserve(&more) {
            let (what, have) = (format!("opening {}", self.name.display()), self.shared.budget());
            let all = more.and(rest()?);
            let need = self.shared.lock().least_with(&all).max(need);
            return Err(Error::OverBudget { what, need, have });
        }
        self.needs = self.needs.and(more);
        self.charge(more, cancel)
    }

    /// Charges the tables. Evicts blocks in use if it must, and then waits until passes that hold them have ended,
    /// [`FOR_ROOM`] at most.
    fn charge(&mut self, more: Needs, cancel: &Cancel) -> Result<()> {
        let what = || format!("opening {}", self.name.display());
        let lacking = more.tables + more.changes + more.pinned;
        self.charges.push(self.shared.charge_when_free(more.tables, lacking, &what, cancel)?);
        Ok(())
    }

    pub(super) fn key(&self) -> ModelKey {
        self.key
    }

    pub(super) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }

    /// Hands the memory over to the model, which gives it back at its end.
    pub(super) fn take(&mut self) -> Vec<Charge> {
        self.is_taken = true;
        std::mem::take(&mut self.charges)
    }
}

impl Drop for Admission {
    fn drop(&mut self) {
        if self.is_taken {
            return;
        }
        {
            let mut state = self.shared.lock();
            state.tables -= self.needs.tables + self.needs.changes;
            state.pinned -= self.needs.pinned;
            let _ = state.ranking.invalidate();
        }
        self.charges.clear();
        // Fetchers can use the room that is free again.
        self.shared.wake();
    }
}

impl super::core::State {
    /// The least budget for the models that are open and one that needs `more`.
    pub fn least_with(&self, more: &Needs) -> u64 {
        least_budget(&Needs { tables: self.tables, pinned: self.pinned, ..Needs::default() }.and(*more))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_budget_holds_its_shares() {
        for tables in [0, 1 << 20, 100 << 20, u64::MAX / 2] {
            for reading in [0, 300 << 10, 500 << 10] {
                let needs = Needs { tables, reading, largest: 60 << 10, ..Needs::default() };
                let budget = least_budget(&needs);
                let [headroom, reserve] = shares(budget);
                assert!(budget - headroom - reserve >= tables && reserve / WORKING_SHARE >= reading);
                assert!(budget < tables + (32 << 20), "{budget} for {tables}");
            }
        }
        assert_eq!(least_budget(&Needs { tables: u64::MAX, ..Needs::default() }), u64::MAX);
    }

    #[test]
    fn a_grown_budget_has_more_room() {
        for have in [0, 1 << 20, 20 << 20, 1 << 40] {
            for bytes in [1, 576, 1 << 20, 1 << 30] {
                let room = |budget: u64| budget.saturating_sub(shares(budget).iter().sum());
                let budget = grown(have, bytes);
                assert!(room(budget) >= room(have) + bytes && room(budget - 1) < room(have) + bytes, "{have} {bytes}");
            }
        }
        assert_eq!(grown(u64::MAX, 5), u64::MAX);
    }
}
