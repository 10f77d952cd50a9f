//! Progress and cancel of long work, shared between the worker and whoever watches.

use super::error::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};

/// A cloneable switch: once cancelled, it stays cancelled.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// A switch that is not cancelled.
    pub fn new() -> Self {
        Self::default()
    }
    /// Cancels; any thread, any number of times.
    pub fn cancel(&self) {
        self.0.store(true, Relaxed);
    }
    /// Whether [`Cancel::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed)
    }
    /// [`Error::Cancelled`] once cancelled. Long loops call this at least every 50 ms.
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// The phase of a build, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Phase {
    /// Nothing begun.
    Waiting = 0,
    /// Reading and parsing input.
    Read = 1,
    /// Building trees.
    Build = 2,
    /// Laying out, coding and writing blocks.
    Write = 3,
    /// Syncing and renaming.
    Seal = 4,
    /// Ended, well or not.
    Done = 5,
}

/// Counters that one side writes and any thread reads.
#[derive(Debug, Default)]
pub struct Progress {
    phase: AtomicU32,
    /// Fraction of the whole, in 1/2^32 (kept integral so that a maximum is one instruction).
    fraction: AtomicU64,
    /// Triangles read so far.
    pub triangles: AtomicU64,
    /// Bytes read from inputs so far.
    pub bytes_read: AtomicU64,
    /// Bytes written to the output so far.
    pub bytes_written: AtomicU64,
}

impl Progress {
    /// Enters `phase`.
    pub fn enter(&self, phase: Phase) {
        self.phase.fetch_max(phase as u32, Relaxed);
    }
    /// The present phase.
    pub fn phase(&self) -> Phase {
        match self.phase.load(Relaxed) {
            0 => Phase::Waiting,
            1 => Phase::Read,
            2 => Phase::Build,
            3 => Phase::Write,
            4 => Phase::Seal,
            _ => Phase::Done,
        }
    }
    /// Raises the fraction done to `fraction` in [0, 1]; it never goes back. NaN does nothing.
    pub fn advance(&self, fraction: f64) {
        let scaled = (fraction.clamp(0.0, 1.0) * 4294967296.0) as u64;
        self.fraction.fetch_max(scaled, Relaxed);
    }
    /// Fraction done in [0, 1]; starts at 0 and never goes back.
    pub fn fraction(&self) -> f64 {
        self.fraction.load(Relaxed) as f64 / 4294967296.0
    }
}
