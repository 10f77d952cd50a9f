//! Pressure: one factor on the thresholds of all views. It rises when their wants do not fit, and all become coarser
//! evenly.
//!
//! The factor rises a step at a time, and only for wants of passes that began after the last step, so views respond
//! before the next one. It falls only after a camera has moved, and no more once it has risen since. So while all
//! cameras rest it changes finitely often: some steps down, then some up. At a constant factor a resting view needs a
//! fixed set of blocks. Each of them is read once, because blocks that the view's passes use are not evicted. So reads
//! stop.

use super::core::{After, Shared, State};
use super::sync::Ordering::Relaxed;

/// Factor of one step.
pub(super) const STEP: f32 = 1.25;

/// Greatest pressure: 60 steps. Wants that do not fit even then are refused.
pub(super) const MOST: f32 = 650_000.0;

/// The pressure falls if the blocks in use, times [`STEP`], take at most this fraction of the bytes for slots.
const AMPLE: f64 = 0.8;

/// The pressure and the conditions of its changes.
pub(super) struct Pressure {
    pub factor: f32,
    /// Stamp at the last change: passes with greater stamps began after it.
    pub changed_at: u32,
    /// True if a camera has moved since the factor last rose.
    pub may_fall: bool,
    /// True if the wants do not fit and the factor cannot rise.
    pub is_full: bool,
}

impl Default for Pressure {
    fn default() -> Self {
        Self { factor: 1.0, changed_at: 0, may_fall: false, is_full: false }
    }
}

impl State {
    /// Handles a block that does not fit: the most wanted one, wanted by a pass with `stamp`, while all blocks are in
    /// use. If only patient views want it, they are refused: no picture becomes coarser for it.
    pub fn overfull(&mut self, shared: &Shared, stamp: u32, after: &mut After) {
        // The outcome stays the same until views change.
        self.ranking.is_stuck = true;
        if self.ranking.is_patient() {
            let views = self.live_views();
            let refused = views.iter().filter(|view| view.is_patient(view.wanted_at()));
            after.calls.extend(refused.filter_map(|view| view.call()));
            return;
        }
        if stamp <= self.pressure.changed_at {
            return;
        }
        if self.pressure.factor * STEP > MOST {
            self.pressure.is_full = true;
        } else {
            self.set_factor(shared, self.pressure.factor * STEP);
            self.pressure.may_fall = false;
        }
        self.tell_all(after);
    }

    /// Lowers the factor if no block is left to be read, there is room, and a camera has moved since it rose.
    pub fn settle(&mut self, shared: &Shared, after: &mut After) {
        if !self.pressure.may_fall || self.pressure.factor <= 1.0 || self.in_flight > 0 {
            return;
        }
        let changed_at = self.pressure.changed_at;
        let answered = self.live_views().iter().any(|view| view.wanted_at() > changed_at);
        let room = AMPLE * shared.capacity(self) as f64;
        if answered && self.in_use() as f64 * f64::from(STEP) <= room {
            self.set_factor(shared, (self.pressure.factor / STEP).max(1.0));
            self.tell_all(after);
        }
    }

    fn set_factor(&mut self, shared: &Shared, factor: f32) {
        // Powers of the step, so that steps up and down again give exactly 1.
        let steps = (factor.ln() / STEP.ln()).round();
        self.pressure.factor = STEP.powi(steps as i32).max(1.0);
        self.pressure.changed_at = shared.now();
        shared.pressure.store(self.pressure.factor.to_bits(), Relaxed);
    }

    fn tell_all(&mut self, after: &mut After) {
        after.calls.extend(self.live_views().iter().filter_map(|view| view.call()));
    }
}
