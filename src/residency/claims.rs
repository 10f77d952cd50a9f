//! Claims: which thread reads which block. Several threads may need the same block, and none is to be read twice.

use super::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use crate::base::ids::BlockId;
use std::collections::HashSet;

/// Blocks that are being read, each by one thread. Reads hold no lock: a source may be the caller's own function.
#[derive(Default)]
pub(super) struct Claims {
    loading: Mutex<HashSet<BlockId>>,
    /// Signalled when blocks leave `loading`.
    loaded: Condvar,
}

impl Claims {
    /// Claims up to `most` of the blocks that `missing` returns, ascending, each once; `None` once `missing` returns an
    /// empty list. A holder publishes its blocks before it drops the claim, and `missing` runs under the lock, so it
    /// sees the blocks that were read. If another thread reads all of the blocks, waits for it. If that read fails,
    /// this thread tries it again, so that every caller gets an error of its own.
    pub fn claim(&self, missing: impl Fn() -> Vec<BlockId>, most: usize) -> Option<Claim<'_>> {
        let mut loading = self.lock();
        loop {
            let missing = missing();
            if missing.is_empty() {
                return None;
            }
            let mut mine: Vec<_> = missing.into_iter().filter(|id| !loading.contains(id)).take(most).collect();
            if !mine.is_empty() {
                mine.sort_unstable();
                mine.dedup();
                loading.extend(&mine);
                return Some(Claim { claims: self, ids: mine });
            }
            loading = self.loaded.wait(loading).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Claims those of `ids` that no thread reads now and that `missing` accepts. Never waits.
    pub fn try_claim(&self, ids: &[BlockId], missing: impl Fn(BlockId) -> bool) -> Option<Claim<'_>> {
        let mut loading = self.lock();
        let mut mine: Vec<_> = ids.iter().copied().filter(|&id| !loading.contains(&id) && missing(id)).collect();
        if mine.is_empty() {
            return None;
        }
        mine.sort_unstable();
        mine.dedup();
        loading.extend(&mine);
        Some(Claim { claims: self, ids: mine })
    }

    /// True if a thread reads the block now.
    pub fn is_claimed(&self, id: BlockId) -> bool {
        self.lock().contains(&id)
    }

    fn lock(&self) -> MutexGuard<'_, HashSet<BlockId>> {
        // A poisoned lock is usable: every step under it leaves a valid state.
        self.loading.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Blocks that one thread has claimed. Dropping it releases them, also after a failure.
pub(super) struct Claim<'a> {
    claims: &'a Claims,
    /// Ascending.
    pub ids: Vec<BlockId>,
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        let mut loading = self.claims.lock();
        loading.retain(|id| self.ids.binary_search(id).is_err());
        self.claims.loaded.notify_all();
    }
}
