//! Depths of pairs of parts, some pairs at a time: as many as the memory for their triangles allows.

use super::depth::{Reach, Two};
use super::facts::PairKey;
use super::solid::Solid;
use super::task::{PartKey, Task};
use crate::base::error::{Error, Result};
use crate::base::tasks::Work;
use crate::residency::Kept;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

/// Share of the budget that triangles of parts may take, if several pairs are tried at a time.
const SHARE: u64 = 8;
/// Most pairs that are tried at a time, for each worker: results are handed out in between.
const PAIRS_EACH: usize = 64;

/// Parts that are in memory.
pub(super) struct Depths<'a> {
    task: &'a Task<'a>,
    solids: BTreeMap<PartKey, Solid>,
    kept: Kept,
}

impl<'a> Depths<'a> {
    pub fn new(task: &'a Task<'a>) -> Self {
        Self { task, solids: BTreeMap::new(), kept: Kept::default() }
    }

    /// Number of pairs, from the first on, that are tried together.
    pub fn count(&self, pairs: &[PairKey]) -> usize {
        let residency = self.task.scene.context().residency();
        let (room, most) = (residency.budget() / SHARE, PAIRS_EACH * self.task.scene.context().pool().concurrency());
        let (mut parts, mut bytes) = (BTreeSet::new(), 0);
        let fits = |pair: &&PairKey| {
            let more = pair.iter().filter(|key| parts.insert(**key));
            bytes += more.map(|key| self.bytes(*key)).sum::<u64>();
            bytes <= room
        };
        pairs.iter().take(most).take_while(fits).count().max(1).min(pairs.len())
    }

    fn bytes(&self, [instance, part]: PartKey) -> u64 {
        let info = self.task.scene.model_of_instance(instance.into()).parts().get(part as usize);
        Solid::bytes(info.map_or(0, |info| info.triangles))
    }

    /// Returns the depths of pairs of closed parts; `None` for a pair whose triangles do not fit the budget.
    pub fn of(&mut self, pairs: &[PairKey]) -> Result<Vec<Option<Reach>>> {
        let Self { task, .. } = *self;
        let needed: BTreeSet<PartKey> = pairs.iter().flatten().copied().collect();
        self.solids.retain(|key, _| needed.contains(key));
        let bytes = needed.iter().map(|key| self.bytes(*key)).sum();
        // The memory of parts that are not needed is given back first.
        self.kept.shrink_to(bytes);
        match self.kept.grow_to(task.scene.context().residency(), "triangles of two parts, for their depth", bytes) {
            Err(Error::OverBudget { .. }) if pairs.len() == 1 => return Ok(vec![None]),
            Err(Error::OverBudget { .. }) => {
                let each = pairs.iter().map(|&pair| Ok(self.of(&[pair])?.pop().flatten()));
                return each.collect();
            }
            other => other?,
        }
        for key in needed {
            if let Entry::Vacant(entry) = self.solids.entry(key) {
                entry.insert(Solid::read(task.scene, key, task.cancel())?);
            }
        }
        let found = pairs.iter().map(|_| Mutex::new(None)).collect();
        let all = All { task, solids: &self.solids, pairs, found };
        task.scene.context().pool().run_scoped(pairs.len(), &all).into_result()?;
        Ok(all.found.into_iter().map(|it| it.into_inner().unwrap_or_else(PoisonError::into_inner)).collect())
    }
}

/// The pairs that are tried together.
struct All<'a> {
    task: &'a Task<'a>,
    solids: &'a BTreeMap<PartKey, Solid>,
    pairs: &'a [PairKey],
    found: Vec<Mutex<Option<Reach>>>,
}

impl Work for All<'_> {
    fn run(&self, item: usize) -> Result<()> {
        self.task.cancel().check()?;
        let [Some(a), Some(b)] = self.pairs[item].map(|key| self.solids.get(&key)) else { return Ok(()) };
        let two = Two { solids: [a, b], tolerance: self.task.options.tolerance };
        *self.found[item].lock().unwrap_or_else(PoisonError::into_inner) = Some(two.reach());
        Ok(())
    }
}
