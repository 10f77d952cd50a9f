//! Memory beside blocks and tables of models that counts against the budget: what scenes hold.

use super::account::Charge;
use super::admit::Needs;
use super::core::{Residency, Shared};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use std::sync::Arc;

/// Most bytes of an object that do not count against the budget: a scene of some instances must fit the least budget of
/// its models.
pub const UNCOUNTED: u64 = 16 << 10;

/// Greatest number of bytes that are charged in advance.
const STEP: u64 = 64 << 10;

/// Bytes that are charged to the budget until this is dropped.
#[derive(Default)]
pub struct Kept {
    charge: Charge,
    of: Option<(Arc<Shared>, u64)>,
}

/// Returns the bytes that [`Residency::keep`] charges for `bytes`.
pub fn counted(bytes: u64) -> u64 {
    if bytes <= UNCOUNTED { 0 } else { bytes }
}

impl Residency {
    /// Fails with `OverBudget`, which names a budget that suffices, if `tables` bytes can never be charged together.
    pub fn check_room(&self, what: &str, tables: u64) -> Result<()> {
        let (need, have) = (self.shared().lock().least_with(&Needs { tables, ..Needs::default() }), self.budget());
        if tables > 0 && need > have { Err(Error::OverBudget { what: what.into(), need, have }) } else { Ok(()) }
    }

    /// Charges `bytes` of memory, evicting blocks if it must; up to [`UNCOUNTED`] bytes are not charged. If passes hold
    /// the evicted blocks, waits until they have ended, [`super::core::FOR_ROOM`] at most. Fails with `OverBudget`,
    /// which says `what` the memory is for.
    pub fn keep(&self, what: &str, bytes: u64) -> Result<Kept> {
        if bytes <= UNCOUNTED { Ok(Kept::default()) } else { self.keep_all(what, bytes) }
    }

    /// [`Residency::keep`] that charges few bytes too.
    pub fn keep_all(&self, what: &str, bytes: u64) -> Result<Kept> {
        let (shared, have) = (Arc::clone(self.shared()), self.budget());
        let reserved = shared.reserve(&Needs { tables: bytes, ..Needs::default() });
        reserved.map_err(|need| Error::OverBudget { what: what.into(), need, have })?;
        // From here on the drop of `kept` gives the memory back.
        let mut kept = Kept { charge: Charge::default(), of: Some((Arc::clone(&shared), bytes)) };
        kept.charge = shared.charge_when_free(bytes, bytes, &|| what.into(), &Cancel::new())?;
        Ok(kept)
    }
}

impl Kept {
    /// Charges `bytes` in all, rounded up to steps, unless more are charged already. Fails like [`Residency::keep`],
    /// and then changes nothing.
    pub fn grow_to(&mut self, residency: &Residency, what: &str, bytes: u64) -> Result<()> {
        let charged = self.of.as_ref().map_or(0, |(_, charged)| *charged);
        if bytes <= charged.max(UNCOUNTED) {
            return Ok(());
        }
        let mut more = residency.keep_all(what, bytes.next_multiple_of(STEP) - charged)?;
        self.charge.join(std::mem::take(&mut more.charge));
        if let Some((shared, bytes)) = more.of.take() {
            self.of = Some((shared, charged + bytes));
        }
        Ok(())
    }

    /// Gives back the bytes above `bytes`.
    pub fn shrink_to(&mut self, bytes: u64) {
        let Some((shared, charged)) = &mut self.of else { return };
        let less = charged.saturating_sub(bytes);
        if less > 0 {
            *charged -= less;
            drop(self.charge.split(less));
            shared.give_tables_back(less);
        }
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        if let Some((shared, bytes)) = self.of.take() {
            self.charge = Charge::default();
            shared.give_tables_back(bytes);
        }
    }
}

impl Shared {
    /// Notes that tables of `bytes` are gone, whose charge was given back.
    fn give_tables_back(&self, bytes: u64) {
        {
            let mut state = self.lock();
            state.tables -= bytes;
            let _ = state.ranking.invalidate();
        }
        // Fetchers can use the room that is free again.
        self.wake();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_back_can_be_used_again() {
        let residency = Residency::with_budget(16 << 20);
        let tables = || residency.shared().lock().tables;
        let mut kept = residency.keep("a test", 8 << 20).unwrap();
        assert!(residency.keep("a test", 8 << 20).is_err());
        kept.shrink_to(1 << 20);
        assert_eq!((residency.used(), tables()), (1 << 20, 1 << 20));
        // More than was charged changes nothing.
        kept.shrink_to(2 << 20);
        let other = residency.keep("a test", 8 << 20).unwrap();
        assert_eq!((residency.used(), tables()), (9 << 20, 9 << 20));
        drop((kept, other));
        assert_eq!((residency.used(), tables()), (0, 0));
        // Memory that grows is charged in steps.
        let mut grown = Kept::default();
        for (bytes, charged) in
            [(UNCOUNTED, 0), (UNCOUNTED + 1, STEP), (STEP, STEP), (STEP + 1, 2 * STEP), (1, 2 * STEP)]
        {
            grown.grow_to(&residency, "a test", bytes).unwrap();
            assert_eq!((residency.used(), tables()), (charged, charged));
        }
        assert!(grown.grow_to(&residency, "a test", 16 << 20).is_err());
        grown.shrink_to(5);
        assert_eq!((residency.used(), tables()), (5, 5));
        drop(grown);
        assert_eq!((residency.used(), tables()), (0, 0));
        // Little memory is not counted.
        residency.keep("a test", UNCOUNTED).unwrap().shrink_to(0);
        assert_eq!((residency.used(), tables()), (0, 0));
    }
}
