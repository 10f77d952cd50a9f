//! Memory beside blocks and tables of models that counts against the budget: what scenes hold.

use super::account::Charge;
use super::admit::Needs;
use super::core::{Residency, Shared, State};
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use std::sync::Arc;

/// Most bytes of an object that do not count against the budget: a scene of some instances must fit the least budget of
/// its models.
const UNCOUNTED: u64 = 16 << 10;

/// Bytes that are charged to the budget until this is dropped.
#[derive(Default)]
pub struct Kept {
    charge: Charge,
    of: Option<(Arc<Shared>, u64)>,
}

impl Residency {
    /// Charges `bytes` of memory, evicting blocks if it must; up to [`UNCOUNTED`] bytes are not charged. If passes hold
    /// the evicted blocks, waits until they have ended, [`super::core::FOR_ROOM`] at most. Fails with `OverBudget`,
    /// which says `what` the memory is for.
    pub fn keep(&self, what: &str, bytes: u64) -> Result<Kept> {
        if bytes <= UNCOUNTED {
            return Ok(Kept::default());
        }
        let shared = Arc::clone(self.shared());
        {
            let mut state = shared.lock();
            self.fits(&state, what, bytes)?;
            state.tables += bytes;
        }
        // From here on the drop of `kept` gives the memory back.
        let mut kept = Kept { charge: Charge::default(), of: Some((Arc::clone(&shared), bytes)) };
        kept.charge = shared.charge_when_free(bytes, bytes, &|| what.into(), &Cancel::new())?;
        Ok(kept)
    }

    /// Fails with `OverBudget` if the budget is too small for several calls of [`Residency::keep`] with these numbers
    /// of bytes. The error then names a budget that suffices for all of them, not only for the first.
    pub fn can_keep(&self, what: &str, bytes: &[u64]) -> Result<()> {
        let counted = bytes.iter().filter(|&&bytes| bytes > UNCOUNTED).sum();
        if counted == 0 { Ok(()) } else { self.fits(&self.shared().lock(), what, counted) }
    }

    fn fits(&self, state: &State, what: &str, bytes: u64) -> Result<()> {
        let (need, have) = (state.least_with(&Needs { tables: bytes, ..Needs::default() }), self.budget());
        if need > have { Err(Error::OverBudget { what: what.into(), need, have }) } else { Ok(()) }
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        if let Some((shared, bytes)) = self.of.take() {
            self.charge = Charge::default();
            {
                let mut state = shared.lock();
                state.tables -= bytes;
                let _ = state.ranking.invalidate();
            }
            // Fetchers can use the room that is free again.
            shared.wake();
        }
    }
}
