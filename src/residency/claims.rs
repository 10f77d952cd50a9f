//! Which thread reads which block: several may need the same one, and none is to be read twice.

use super::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use crate::base::ids::BlockId;
use std::collections::HashSet;

/// Blocks being read now, each by one thread. Not locked while reading: a source may be the caller's own function.
#[derive(Default)]
pub(super) struct Claims {
    loading: Mutex<HashSet<BlockId>>,
    /// Signalled when blocks leave `loading`.
    loaded: Condvar,
}

impl Claims {
    /// Takes on up to `most` of the blocks that `missing` names, ascending, each once; `None` once it names none. A
    /// claim's holder publishes its blocks before it drops the claim, and `missing` is asked under the lock: so blocks
    /// that were read are seen. Waits for blocks that another thread reads: if it fails they are tried again here, so
    /// that everybody has an error of their own.
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

    /// Takes on those of `ids` that no thread reads now and that `missing` accepts; never waits.
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

    /// Whether a thread reads the block now.
    pub fn is_claimed(&self, id: BlockId) -> bool {
        self.lock().contains(&id)
    }

    fn lock(&self) -> MutexGuard<'_, HashSet<BlockId>> {
        // Every step under the lock leaves a valid state.
        self.loading.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Blocks that one thread has taken on; whatever happens, they are given back.
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
