//! Reading, checking and decoding blocks that are neighbours in the file. Under no lock.

use super::account::{Account, Charge};
use super::blocks::Inner;
use super::slots::Slot;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::ModelFile;
use std::sync::atomic::Ordering::Relaxed;

/// Stored bytes that are read together, at most.
pub(super) const RUN_BYTES: u64 = 256 << 10;

/// What is between two blocks that are read together, at most.
const GAP_BYTES: u64 = 16 << 10;

/// Bytes that the block takes in memory.
pub(super) fn slot_bytes(file: &ModelFile, id: BlockId) -> u64 {
    Slot::bytes_for(file.decoded_len(id).div_ceil(4) as usize)
}

/// Whether blocks up to `next` can be read together with those from `first` on, of which `last` is the last.
pub(super) fn goes_with(file: &ModelFile, [first, last, next]: [BlockId; 3], most: u64) -> bool {
    let row = |id: BlockId| file.directory().get(id.0 as usize);
    let (Some(first), Some(last), Some(next)) = (row(first), row(last), row(next)) else { return false };
    next.end().saturating_sub(first.offset) <= most && next.offset.saturating_sub(last.end()) <= GAP_BYTES
}

/// Cuts ascending ids into runs that are read together.
pub(super) fn runs<'a>(file: &'a ModelFile, ids: &'a [BlockId], most: u64) -> impl Iterator<Item = &'a [BlockId]> {
    let mut rest = ids;
    std::iter::from_fn(move || {
        let (&first, _) = rest.split_first()?;
        let together = rest.windows(2).take_while(|w| goes_with(file, [first, w[0], w[1]], most)).count();
        let (run, after) = rest.split_at(together + 1);
        rest = after;
        Some(run)
    })
}

/// What became of a run.
#[derive(Default)]
pub(super) struct Loaded {
    /// Those that came, ascending.
    pub slots: Vec<(BlockId, Slot)>,
    /// Those that failed, twice.
    pub failed: Vec<(BlockId, Error)>,
}

/// Working memory of whoever reads.
#[derive(Default)]
pub(super) struct Buffers {
    stored: Vec<u8>,
    payload: Vec<u8>,
    _charge: Charge,
}

impl Buffers {
    /// Paid for by `account`; `None` if that has too little for a run of `run` bytes of `file`.
    pub fn new(account: &Account, file: &ModelFile, run: u64) -> Option<Self> {
        let largest = u64::from(file.header().block_size);
        // Stored bytes, a payload (four times a block at most, mostly one or less), and what is decoded. (Arrays that
        // decoding makes meanwhile and gives back, some three blocks, are not paid for.)
        let charge = account.charge(run + 3 * largest, 0)?;
        Some(Self { _charge: charge, ..Self::default() })
    }
}

impl Inner {
    /// Reads, checks and decodes `run`, ascending neighbours, paid for by `charge`. A block whose reading or check
    /// fails is counted, reported (once, until it comes) and read once more, alone: a disk or a network may have
    /// hiccuped. Ends early once cancelled.
    pub fn load(&self, run: &[BlockId], charge: &mut Charge, buffers: &mut Buffers, cancel: &Cancel) -> Loaded {
        let mut loaded = Loaded::default();
        let (Some(&first), Some(&last)) = (run.first(), run.last()) else { return loaded };
        let mut alone = false;
        let mut together = self.file.read_stored(first, last, &mut buffers.stored);
        for &id in run {
            if cancel.is_cancelled() {
                return loaded;
            }
            // Once one had to be read alone, what was read together is overwritten.
            let first_try = match std::mem::replace(&mut together, Ok(())) {
                Ok(()) if !alone => self.decode(id, first, charge, buffers),
                Ok(()) => self.load_alone(id, charge, buffers),
                Err(error) => Err(error),
            };
            let slot = match first_try {
                Err(error @ (Error::Corrupt { .. } | Error::Io { .. })) => {
                    alone = true;
                    self.read_again.fetch_add(1, Relaxed);
                    if self.failures.say_once(id) {
                        (self.report)(&error);
                    }
                    self.load_alone(id, charge, buffers)
                }
                slot => slot,
            };
            match slot {
                Ok(slot) => {
                    self.failures.came(id);
                    loaded.slots.push((id, slot));
                }
                Err(error) => loaded.failed.push((id, error)),
            }
        }
        loaded
    }

    fn load_alone(&self, id: BlockId, charge: &mut Charge, buffers: &mut Buffers) -> Result<Slot> {
        self.file.read_stored(id, id, &mut buffers.stored)?;
        self.decode(id, id, charge, buffers)
    }

    /// The block from what was read from `first` on.
    fn decode(&self, id: BlockId, first: BlockId, charge: &mut Charge, buffers: &mut Buffers) -> Result<Slot> {
        self.file.open_stored(id, first, &buffers.stored, &mut buffers.payload)?;
        let words = self.decoder.decode(id, &buffers.payload).map_err(|why| self.corrupt(id, why))?;
        if words.len() * 4 != self.file.decoded_len(id) as usize {
            return Err(self.corrupt(id, "its decoded size is not what the directory says"));
        }
        let mut references = Vec::new();
        let has = self.decoder.links(id, &words, &mut |reference| references.push(reference));
        self.links.check(id, has, &references).map_err(|why| self.corrupt(id, why))?;
        Ok(Slot::charged(&words, charge.split(self.slot_bytes(id))))
    }
}
