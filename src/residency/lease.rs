//! Lease: a part of the budget that lets exact jobs end even if views use the rest. One job holds it at a time.

use super::account::Account;
use super::admit::grown;
use super::blocks::{Inner, ModelBlocks, ModelKey};
use super::bring::Held;
use super::claims::Claim;
use super::core::{Residency, Shared};
use super::load::{Buffers, RUN_BYTES, runs};
use super::rank::Key;
use super::slots::Slot;
use super::snapshot::{PAGE_BYTES, Snapshot};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// The reserve, and the blocks that the last leases left in it.
pub(super) struct Reserve {
    account: Account,
    inside: Mutex<Inside>,
    /// Signalled when the turn goes to the next job.
    passed: Condvar,
}

#[derive(Default)]
struct Inside {
    /// Number for the next job that asks for the lease. `turn` is the number of the job that may hold it.
    given: u64,
    turn: u64,
    /// Blocks that leases left, each with the number of the lease that used it last.
    left: HashMap<Key, (Slot, u64)>,
}

/// One part in this many of the reserve is kept free for tables and for reading.
pub(super) const WORKING_SHARE: u64 = 3;

impl Reserve {
    pub fn new(bytes: u64) -> Self {
        Self { account: Account::new(bytes), inside: Mutex::default(), passed: Condvar::new() }
    }

    pub fn used(&self) -> u64 {
        self.account.used()
    }

    /// Drops the blocks of a model.
    pub fn forget(&self, model: ModelKey) {
        self.lock().left.retain(|(of, _), _| *of != model);
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        // A poisoned lock is usable: every step under it leaves a valid state.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn working(&self) -> u64 {
        self.account.limit() / WORKING_SHARE
    }

    fn room(&self) -> u64 {
        self.account.limit() - self.working()
    }
}

/// The reserve, held by one job. No other job sees the blocks that it reads. Their memory can be reused once the lease
/// and its snapshots are dropped.
pub struct Lease {
    shared: Arc<Shared>,
    number: u64,
    held: BTreeMap<ModelKey, Held>,
}

impl Residency {
    /// Bytes of blocks, in memory, that a lease can hold at a time: the limit for [`Lease::fetch`].
    pub fn lease_room(&self) -> u64 {
        self.shared().reserve.room()
    }

    /// True if no job holds the reserve, or waits for it, now.
    pub fn lease_is_free(&self) -> bool {
        let inside = self.shared().reserve.lock();
        inside.turn == inside.given
    }

    /// Returns the reserve when it is this caller's turn. Waits while other jobs hold it; first come, first served.
    ///
    /// The holder must not wait for a job that may wait for the lease, and should hold it for one round of work.
    pub fn lease(&self) -> Lease {
        let shared = Arc::clone(self.shared());
        let mut inside = shared.reserve.lock();
        let number = inside.given;
        inside.given += 1;
        while inside.turn != number {
            inside = shared.reserve.passed.wait(inside).unwrap_or_else(PoisonError::into_inner);
        }
        drop(inside);
        Lease { shared, number, held: BTreeMap::new() }
    }
}

impl Lease {
    /// Same as [`Residency::lease_room`].
    pub fn room(&self) -> u64 {
        self.shared.reserve.room()
    }

    /// Bytes of [`Lease::room`] that a block of `bytes` bytes in memory uses. It may be the only block in its page of
    /// the table. The rest of the reserve holds that page, and the working memory of reads.
    pub fn counts(bytes: u64) -> u64 {
        bytes.max(4 * PAGE_BYTES)
    }

    /// Brings `ids` into the lease. Blocks that are in memory cost nothing. Reads the disk and blocks the thread.
    ///
    /// Fails with `Corrupt` naming the block, `Io`, `Cancelled`, or with `OverBudget` if the lease has no room for the
    /// blocks.
    pub fn fetch(&mut self, model: &ModelBlocks, ids: &[BlockId], cancel: &Cancel) -> Result<()> {
        let mut left = ids.to_vec();
        left.sort_unstable();
        left.dedup();
        loop {
            cancel.check()?;
            self.hold_present(&model.inner, &mut left);
            let there = || {
                let there = model.snapshot();
                left.iter().copied().filter(|&id| there.block(id).is_none()).collect::<Vec<_>>()
            };
            if left.is_empty() {
                return Ok(());
            }
            let Some(claim) = model.inner.claims.claim(there, usize::MAX) else { continue };
            let loaded = self.load_claimed(&model.inner, &claim, cancel);
            // No other job sees the blocks of a lease, so views that want them still need them read.
            self.shared.give_back(&model.inner, claim);
            loaded?;
        }
    }

    fn load_claimed(&mut self, model: &Inner, claim: &Claim, cancel: &Cancel) -> Result<()> {
        if let Some(id) = claim.ids.iter().find(|id| id.0 >= model.file.block_count()) {
            return Err(model.corrupt(*id, "the block does not exist"));
        }
        for run in runs(&model.file, &claim.ids, (self.shared.reserve.working() / 4).min(RUN_BYTES)) {
            self.load(model, run, cancel)?;
        }
        Ok(())
    }

    /// Returns the blocks in memory now, with those of the lease.
    pub fn snapshot(&self, model: &ModelBlocks) -> Result<Arc<Snapshot>> {
        let shared = model.snapshot();
        let Some(held) = self.held.get(&model.inner.key) else { return Ok(shared) };
        let changes: Vec<_> = held.iter().map(|(id, slot)| (*id, Some(slot.clone()))).collect();
        let with = shared.changed(changes, Some(&self.shared.reserve.account));
        // The pages take a share of the reserve only.
        let bytes = || held.len() as u64 * PAGE_BYTES * WORKING_SHARE;
        with.map(Arc::new).ok_or_else(|| self.no_room(&model.inner, bytes()))
    }

    /// Moves those of `left` that are in memory, or that leases have left, to the held blocks.
    fn hold_present(&mut self, model: &Inner, left: &mut Vec<BlockId>) {
        let there = model.published.load_full();
        let held = self.held.entry(model.key).or_default();
        let mut inside = self.shared.reserve.lock();
        left.retain(|&id| {
            if held.iter().any(|(of, _)| *of == id) {
                return false;
            }
            let of_lease = inside.left.get_mut(&(model.key, id)).map(|(slot, last)| {
                *last = self.number;
                slot.clone()
            });
            let slot = of_lease.or_else(|| there.slot(id).cloned());
            held.extend(slot.iter().map(|slot| (id, slot.clone())));
            slot.is_none()
        });
    }

    fn load(&mut self, model: &Inner, run: &[BlockId], cancel: &Cancel) -> Result<()> {
        let reserve = &self.shared.reserve;
        let bytes: u64 = run.iter().map(|&id| model.slot_bytes(id)).sum();
        let mut charge = reserve.account.charge(bytes, reserve.working());
        if charge.is_none() {
            self.drop_released();
            charge = reserve.account.charge(bytes, reserve.working());
        }
        let mut charge = charge.ok_or_else(|| self.no_room(model, bytes))?;
        let buffers = Buffers::new(&reserve.account, &model.file, run);
        let mut buffers = buffers.ok_or_else(|| self.no_room(model, bytes))?;
        let loaded = model.load(run, &mut charge, &mut buffers, cancel);
        let mut inside = reserve.lock();
        for (id, slot) in &loaded.slots {
            inside.left.insert((model.key, *id), (slot.clone(), self.number));
        }
        drop(inside);
        self.held.entry(model.key).or_default().extend(loaded.slots);
        loaded.failed.into_iter().next().map_or(Ok(()), |(_, error)| Err(error))
    }

    /// Drops the blocks that other leases left and this lease has not used.
    fn drop_released(&self) {
        self.shared.reserve.lock().left.retain(|_, (_, last)| *last == self.number);
    }

    fn no_room(&self, model: &Inner, bytes: u64) -> Error {
        let have = self.shared.budget();
        let what = format!("an exact query of {}", model.file.name().display());
        Error::OverBudget { what, need: grown(have, 8 * bytes), have }
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.held.clear();
        self.shared.reserve.lock().turn += 1;
        self.shared.reserve.passed.notify_all();
        self.shared.wake();
    }
}
