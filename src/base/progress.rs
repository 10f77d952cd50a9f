//! Progress and cancellation of long work, shared between the worker and its observers.

use super::error::{Error, Result};
use super::reserve;
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
    /// Fails with [`Error::Cancelled`] once cancelled, and with [`Error::NoMemory`] if the system refuses memory (see
    /// [`reserve::check`]). Long loops call this at least every 50 ms.
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() { Err(Error::Cancelled) } else { reserve::check() }
    }
}

/// A stretch of long work: its cancel flag, and the interval of the whole progress that it takes. Threads report what
/// they have done of it.
#[derive(Debug)]
pub struct Stretch<'a> {
    cancel: &'a Cancel,
    progress: &'a Progress,
    /// Fractions of the whole at its begin and end.
    ends: (f64, f64),
    /// Units of work.
    total: u64,
    done: AtomicU64,
}

impl<'a> Stretch<'a> {
    /// A stretch from one fraction of the whole progress to another.
    pub fn new(progress: &'a Progress, cancel: &'a Cancel, ends: (f64, f64)) -> Self {
        Self { cancel, progress, ends, total: 1, done: AtomicU64::new(0) }
    }
    /// The part between two fractions of this stretch, of `total` units of work.
    pub fn part(&self, from: f64, to: f64, total: u64) -> Stretch<'a> {
        let at = |f: f64| self.ends.0 + (self.ends.1 - self.ends.0) * f;
        Self { ends: (at(from), at(to)), total: total.max(1), ..Self::new(self.progress, self.cancel, self.ends) }
    }
    /// As [`Cancel::check`].
    pub fn check(&self) -> Result<()> {
        self.cancel.check()
    }
    /// Begins a unit of the work: fails once cancelled, else counts the unit.
    pub fn begin(&self) -> Result<()> {
        self.check()?;
        self.did(1);
        Ok(())
    }
    /// Reports that `units` of the work are done.
    pub fn did(&self, units: u64) {
        let done = self.done.fetch_add(units, Relaxed) + units;
        let fraction = (done as f64 / self.total as f64).min(1.0);
        self.progress.advance(self.ends.0 + (self.ends.1 - self.ends.0) * fraction);
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
    /// Number of times that the fraction rose in each phase.
    steps: [AtomicU64; Phase::Done as usize + 1],
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
        if self.fraction.fetch_max(scaled, Relaxed) < scaled {
            self.steps[self.phase() as usize].fetch_add(1, Relaxed);
        }
    }
    /// Number of times that the fraction rose in a phase.
    pub fn steps(&self, phase: Phase) -> u64 {
        self.steps[phase as usize].load(Relaxed)
    }
    /// The completed fraction, in [0, 1]; it starts at 0 and never decreases.
    pub fn fraction(&self) -> f64 {
        self.fraction.load(Relaxed) as f64 / 4294967296.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_stretch_add_up() {
        let (progress, cancel) = (Progress::default(), Cancel::new());
        let whole = Stretch::new(&progress, &cancel, (0.4, 0.8));
        let (first, second) = (whole.part(0.0, 0.5, 10), whole.part(0.5, 1.0, 0));
        let near = |wanted: f64| assert!((progress.fraction() - wanted).abs() < 1e-6, "{}", progress.fraction());
        (0..5).for_each(|_| first.begin().unwrap());
        near(0.5);
        first.did(50);
        near(0.6);
        second.did(1);
        near(0.8);
        first.did(1);
        near(0.8);
        cancel.cancel();
        assert!(second.begin().is_err());
    }
}
