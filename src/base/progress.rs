//! Progress and cancellation of long work, shared between the worker and its observers.

use super::error::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};

/// A cloneable switch. Once cancelled, it stays cancelled.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// A switch that is not cancelled.
    pub fn new() -> Self {
        Self::default()
    }
    /// Cancels. Any thread may call this any number of times.
    pub fn cancel(&self) {
        self.0.store(true, Relaxed);
    }
    /// True if [`Cancel::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Relaxed)
    }
    /// Fails with [`Error::Cancelled`] once cancelled. Long loops call this at least every 50 ms.
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// The phase of a build, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Phase {
    /// The build has not begun.
    Waiting = 0,
    /// Reading and parsing input.
    Read = 1,
    /// Building trees.
    Build = 2,
    /// Arranging, encoding and writing blocks.
    Write = 3,
    /// Syncing and renaming.
    Seal = 4,
    /// The build has ended, with or without an error.
    Done = 5,
}

/// Counters that one side writes and any thread reads.
#[derive(Debug, Default)]
pub struct Progress {
    phase: AtomicU32,
    /// Fraction of the whole, in units of 1/2^32: an integer, so that taking the maximum is one atomic instruction.
    fraction: AtomicU64,
    /// Number of triangles read so far.
    pub triangles: AtomicU64,
    /// Number of bytes read from inputs so far.
    pub bytes_read: AtomicU64,
    /// Number of bytes written to the output so far.
    pub bytes_written: AtomicU64,
}

impl Progress {
    /// Enters `phase`; an earlier phase has no effect.
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
    /// Raises the completed fraction to `fraction`, in [0, 1]; a lower value has no effect, and neither has NaN.
    pub fn advance(&self, fraction: f64) {
        let scaled = (fraction.clamp(0.0, 1.0) * 4294967296.0) as u64;
        self.fraction.fetch_max(scaled, Relaxed);
    }
    /// The completed fraction, in [0, 1]; it starts at 0 and never decreases.
    pub fn fraction(&self) -> f64 {
        self.fraction.load(Relaxed) as f64 / 4294967296.0
    }
}
