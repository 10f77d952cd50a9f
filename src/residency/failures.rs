//! Blocks that could not be had, and why: so that no view waits for them.

use crate::base::error::Error;
use crate::base::ids::BlockId;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering::AcqRel, Ordering::Relaxed, Ordering::Release};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Why a block cannot be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failure {
    /// The source failed.
    Unreadable,
    /// What was read is not what was written.
    Damaged,
}

const UNREADABLE: u8 = 1;
const DAMAGED: u8 = 2;
const FAILED: u8 = UNREADABLE | DAMAGED;

/// It was said that the block failed, and it has not come since.
const SAID: u8 = 4;

/// Of the blocks of a model.
pub(super) struct Failures {
    blocks: Box<[AtomicU8]>,
    /// Some have failed since they were forgotten.
    any: AtomicBool,
    /// When they were forgotten last.
    forgotten: Mutex<Option<Instant>>,
}

/// They are not forgotten more often than that: a camera that moves asks each time, and what fails slowly would never
/// have failed.
const OFTEN: Duration = Duration::from_millis(250);

impl Failures {
    /// Of so many blocks, of which none has failed.
    pub fn new(count: u32) -> Self {
        Self {
            blocks: (0..count).map(|_| AtomicU8::new(0)).collect(),
            any: AtomicBool::new(false),
            forgotten: Mutex::default(),
        }
    }

    /// Marks a block as one that cannot be had.
    pub fn set(&self, id: BlockId, why: &Error) {
        if let Some(block) = self.blocks.get(id.0 as usize) {
            block.fetch_or(if matches!(why, Error::Io { .. }) { UNREADABLE } else { DAMAGED }, Relaxed);
            // A thread that sees this flag sees the block's.
            self.any.store(true, Release);
        }
    }

    /// Why the block cannot be had.
    pub fn of(&self, id: BlockId) -> Option<Failure> {
        let flags = self.blocks.get(id.0 as usize).map_or(DAMAGED, |block| block.load(Relaxed)) & FAILED;
        match flags {
            0 => None,
            UNREADABLE => Some(Failure::Unreadable),
            _ => Some(Failure::Damaged),
        }
    }

    /// Whether the block cannot be had; true for one that does not exist.
    pub fn has(&self, id: BlockId) -> bool {
        self.of(id).is_some()
    }

    /// All may be asked for again, unless they were forgotten just now. Whether any had failed.
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

    /// Whether this is to be said of the block now: once, until it has come.
    pub fn say_once(&self, id: BlockId) -> bool {
        self.blocks.get(id.0 as usize).is_none_or(|block| block.fetch_or(SAID, Relaxed) & SAID == 0)
    }

    /// The block has come.
    pub fn came(&self, id: BlockId) {
        if let Some(block) = self.blocks.get(id.0 as usize).filter(|block| block.load(Relaxed) != 0) {
            block.store(0, Relaxed);
        }
    }
}
