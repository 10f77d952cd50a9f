//! Blocks that could not be read, and the reasons, so that no view waits for them.

use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::memory::room;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering::AcqRel, Ordering::Relaxed, Ordering::Release};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Reason why a block is unavailable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failure {
    /// The source failed.
    Unreadable,
    /// The bytes that were read are not those that were written.
    Damaged,
}

const UNREADABLE: u8 = 1;
const DAMAGED: u8 = 2;
const FAILED: u8 = UNREADABLE | DAMAGED;

/// Flag: the failure was reported, and the block was not read since.
const SAID: u8 = 4;

/// Failures of a model's blocks.
pub(super) struct Failures {
    blocks: Box<[AtomicU8]>,
    /// True if blocks have failed since the last call of `forget` that cleared them.
    any: AtomicBool,
    /// Time of that call.
    forgotten: Mutex<Option<Instant>>,
}

/// Least time between two such calls. A moving camera makes one for each picture, and without a limit a block that
/// fails slowly would never count as failed.
const OFTEN: Duration = Duration::from_millis(250);

impl Failures {
    /// Creates the table for `count` blocks, none failed. Fails with `NoMemory`.
    pub fn new(count: u32) -> Result<Self> {
        let mut blocks: Vec<AtomicU8> = room(count as usize, "the table of failed blocks")?;
        blocks.extend((0..count).map(|_| AtomicU8::new(0)));
        Ok(Self { blocks: blocks.into(), any: AtomicBool::new(false), forgotten: Mutex::default() })
    }

    /// Marks a block as unavailable.
    pub fn set(&self, id: BlockId, why: &Error) {
        if let Some(block) = self.blocks.get(id.0 as usize) {
            block.fetch_or(if matches!(why, Error::Io { .. }) { UNREADABLE } else { DAMAGED }, Relaxed);
            // A thread that sees this flag sees the block's flag too.
            self.any.store(true, Release);
        }
    }

    /// Returns the reason why the block is unavailable, if it is.
    pub fn of(&self, id: BlockId) -> Option<Failure> {
        let flags = self.blocks.get(id.0 as usize).map_or(DAMAGED, |block| block.load(Relaxed)) & FAILED;
        match flags {
            0 => None,
            UNREADABLE => Some(Failure::Unreadable),
            _ => Some(Failure::Damaged),
        }
    }

    /// True if the block is unavailable or does not exist.
    pub fn has(&self, id: BlockId) -> bool {
        self.of(id).is_some()
    }

    /// Clears all failures, so that the blocks may be read again, unless that was done just now. Returns true if it
    /// did.
    pub fn forget(&self) -> bool {
        if !self.any.load(Relaxed) {
            return false;
        }
        let now = Instant::now();
        let mut forgotten = self.forgotten.lock().unwrap_or_else(PoisonError::into_inner);
        if forgotten.is_some_and(|last| now.duration_since(last) < OFTEN) {
            return false;
        }
        *forgotten = Some(now);
        self.any.swap(false, AcqRel);
        for block in self.blocks.iter().filter(|block| block.load(Relaxed) & FAILED != 0) {
            block.fetch_and(!FAILED, Relaxed);
        }
        true
    }

    /// True if the failure of the block is to be reported now: once until the block is read.
    pub fn say_once(&self, id: BlockId) -> bool {
        self.blocks.get(id.0 as usize).is_none_or(|block| block.fetch_or(SAID, Relaxed) & SAID == 0)
    }

    /// Notes that the block was read.
    pub fn came(&self, id: BlockId) {
        if let Some(block) = self.blocks.get(id.0 as usize).filter(|block| block.load(Relaxed) != 0) {
            block.store(0, Relaxed);
        }
    }
}
