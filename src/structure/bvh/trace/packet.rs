//! Sixteen rays at a time (first version: one after the other).

use super::walk::{Outcome, Walk};
use super::{LocalRay, PartFilter, TriHit, TreeView};

/// Rays of a packet.
pub const PACKET: usize = 16;

/// The state of sixteen rays in one tree. Reusable.
#[derive(Debug, Default)]
pub struct PacketWalk {
    walks: [Walk; PACKET],
    waiting: u32,
}

impl PacketWalk {
    /// For any number of packets.
    pub fn new() -> Self {
        Self::default()
    }

    /// Puts the rays of `active` (bit `i`: ray `i`) at the root of `view`.
    pub fn begin(&mut self, view: &TreeView, rays: &[LocalRay; PACKET], active: u32) {
        self.waiting = active;
        for (i, (walk, ray)) in self.walks.iter_mut().zip(rays).enumerate() {
            if active >> i & 1 == 1 {
                walk.begin(view, ray);
            }
        }
    }

    /// The best hit so far of ray `i`.
    pub fn best(&self, i: usize) -> TriHit {
        self.walks[i].best()
    }

    /// Rays that have not ended.
    pub fn waiting(&self) -> u32 {
        self.waiting
    }

    /// What the walks did.
    pub fn counters(&self) -> super::Counters {
        let mut all = super::Counters::default();
        self.walks.iter().for_each(|w| all += w.counters);
        all
    }
}

impl TreeView<'_> {
    /// Finds the closest hits of the rays that `walk` has begun (or goes on after `Pending`): the same, to
    /// the bit, as [`TreeView::closest`] finds for each alone.
    pub fn closest16(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        for i in 0..PACKET {
            if walk.waiting >> i & 1 == 1 {
                if let pending @ Outcome::Pending(_) = self.closest(filter, &mut walk.walks[i]) {
                    return pending;
                }
                walk.waiting &= !(1 << i);
            }
        }
        Outcome::Done
    }

    /// Finds any hit of each ray that `walk` has begun (or goes on after `Pending`).
    pub fn any16(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        for i in 0..PACKET {
            if walk.waiting >> i & 1 == 1 {
                if let pending @ Outcome::Pending(_) = self.any(filter, &mut walk.walks[i]) {
                    return pending;
                }
                walk.waiting &= !(1 << i);
            }
        }
        Outcome::Done
    }
}
