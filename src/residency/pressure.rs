//! One factor on the thresholds of all views: when what they want does not fit it rises, and all get coarser evenly.
//!
//! It rises a step at a time, and only for wants of passes that began after the last step: views answer before the
//! next. It falls only after a camera has moved, and no more once it has risen since. So while all cameras rest it
//! changes finitely often: some steps down, then some up. At a constant factor a resting view needs a fixed set of
//! blocks, of which each is read once, since what its passes use is not evicted. So reads stop.

use super::core::{After, Shared, State};
use super::sync::Ordering::Relaxed;

/// A step of the factor.
pub(super) const STEP: f32 = 1.25;

/// The factor at most: 60 steps. Wants that do not fit even so are refused.
pub(super) const MOST: f32 = 650_000.0;

/// The factor falls if what is in use, grown by [`STEP`], takes at most this share of what slots may take.
const AMPLE: f64 = 0.8;

/// The factor and what moved it.
pub(super) struct Pressure {
    pub factor: f32,
    /// The last pass begun before the factor changed.
    pub changed_at: u32,
    /// A camera has moved since the factor last rose.
    pub may_fall: bool,
    /// What is wanted does not fit, and the factor cannot rise.
    pub is_full: bool,
}

impl Default for Pressure {
    fn default() -> Self {
        Self { factor: 1.0, changed_at: 0, may_fall: false, is_full: false }
    }
}

impl State {
    /// The most wanted block, wanted by a pass with `stamp`, does not fit, and all in memory is in use.
    pub fn overfull(&mut self, shared: &Shared, stamp: u32, after: &mut After) {
        // Nothing changes until views do.
        self.ranking.is_stuck = true;
        if stamp == 0 {
            // No picture needs it, so no picture gets coarser for it.
            let views = self.live_views();
            after.calls.extend(views.iter().filter(|view| view.wanted_at() == 0).filter_map(|view| view.call()));
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

    /// Nothing is left to be read: lowers the factor if there is room, and a camera has moved since it rose.
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
        // Powers of the step, so that going up and down again gives 1.
        let steps = (factor.ln() / STEP.ln()).round();
        self.pressure.factor = STEP.powi(steps as i32).max(1.0);
        self.pressure.changed_at = shared.now();
        shared.pressure.store(self.pressure.factor.to_bits(), Relaxed);
    }

    fn tell_all(&mut self, after: &mut After) {
        after.calls.extend(self.live_views().iter().filter_map(|view| view.call()));
    }
}
