//! Reading, checking and decoding blocks that are neighbours in the file. No lock is held.

use super::account::{Account, Charge};
use super::blocks::Inner;
use super::slots::Slot;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::store::ModelFile;
use crate::store::directory::Row;
use std::sync::atomic::Ordering::Relaxed;

/// Greatest number of stored bytes in a run.
pub(super) const RUN_BYTES: u64 = 256 << 10;

/// Greatest number of bytes between two blocks of a run.
const GAP_BYTES: u64 = 16 << 10;

/// Bytes of the block in memory.
pub(super) fn slot_bytes(file: &ModelFile, id: BlockId) -> u64 {
    Slot::bytes_for(file.decoded_len(id).div_ceil(4) as usize)
}

/// Bytes of a block in memory, by its row of the directory.
pub(super) fn slot_bytes_of(row: &Row) -> u64 {
    Slot::bytes_for(row.decoded_len.div_ceil(4) as usize)
}

/// Bytes of working memory to read a run of blocks, given their rows: the stored bytes, one payload and one decoded
/// block at a time, and as much again as a decoded block. (The arrays that decoding allocates meanwhile, some two
/// blocks more, are not charged.)
pub(super) fn reading_bytes(run: &[Row]) -> u64 {
    let (Some(first), Some(last)) = (run.first(), run.last()) else { return 0 };
    let most = |len: fn(&Row) -> u32| u64::from(run.iter().map(len).max().unwrap_or(0));
    last.end().saturating_sub(first.offset) + most(|row| row.payload_len) + 2 * most(|row| row.decoded_len)
}

/// True if block `next` can be added to the run from `first` to `last`, with `most` bytes at most.
pub(super) fn goes_with(file: &ModelFile, [first, last, next]: [BlockId; 3], most: u64) -> bool {
    let row = |id: BlockId| file.directory().get(id.0 as usize);
    let (Some(first), Some(last), Some(next)) = (row(first), row(last), row(next)) else { return false };
    next.end().saturating_sub(first.offset) <= most && next.offset.saturating_sub(last.end()) <= GAP_BYTES
}

/// Splits ascending ids into runs, each to be read in one piece.
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

/// Outcome of reading a run.
#[derive(Default)]
pub(super) struct Loaded {
    /// Blocks that were read, ascending.
    pub slots: Vec<(BlockId, Slot)>,
    /// Blocks that failed twice.
    pub failed: Vec<(BlockId, Error)>,
}

/// Working memory of a thread that reads.
#[derive(Default)]
pub(super) struct Buffers {
    stored: Vec<u8>,
    payload: Vec<u8>,
    _charge: Charge,
}

impl Buffers {
    /// Creates buffers that `account` pays for; `None` if that has too little for `run`, ascending neighbours in
    /// `file`. All that the directory states of the blocks is paid for before they are read.
    pub fn new(account: &Account, file: &ModelFile, run: &[BlockId]) -> Option<Self> {
        let (first, last) = (run.first()?.0 as usize, run.last()?.0 as usize);
        let charge = account.charge(reading_bytes(file.directory().get(first..=last)?), 0)?;
        Some(Self { _charge: charge, ..Self::default() })
    }
}

impl Inner {
    /// Reads, checks and decodes `run`, ascending neighbours, paid for by `charge`. If a read or a check fails, the
    /// failure is counted, reported (once, until the block is read), and the block is read once more, as a single
    /// block: a disk or a network may have failed briefly. Ends early once cancelled.
    pub fn load(&self, run: &[BlockId], charge: &mut Charge, buffers: &mut Buffers, cancel: &Cancel) -> Loaded {
        let mut loaded = Loaded::default();
        let (Some(&first), Some(&last)) = (run.first(), run.last()) else { return loaded };
        let mut alone = false;
        let mut together = self.file.read_stored(first, last, &mut buffers.stored);
        for &id in run {
            if cancel.is_cancelled() {
                return loaded;
            }
            // After a single read the buffer no longer holds the run.
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

    /// Decodes the block from the stored bytes that begin with block `first`.
    fn decode(&self, id: BlockId, first: BlockId, charge: &mut Charge, buffers: &mut Buffers) -> Result<Slot> {
        self.file.open_stored(id, first, &buffers.stored, &mut buffers.payload)?;
        let stated = self.file.decoded_len(id) as usize;
        let words = self.decoder.decode(id, &buffers.payload, stated / 4).map_err(|why| self.corrupt(id, why))?;
        if words.len() * 4 != stated {
            return Err(self.corrupt(id, "the decoded size differs from the size in the directory"));
        }
        let statements = self.decoder.statements(id, &words);
        self.links.check(id, &statements).map_err(|why| self.corrupt(id, why))?;
        Ok(Slot::charged(&words, charge.split(self.slot_bytes(id))))
    }
}
