//! Sixteen coherent rays at a time: their state, and how they enter and leave the kernel.
#![allow(clippy::needless_range_loop)] // lanes and axes index several arrays at once

use super::packet_visit::{self, Shared};
use super::walk::{Counters, Outcome, Walk};
use super::{LocalRay, PartFilter, TreeView, TriHit};
use crate::math::Cone;
use crate::simd::{Op, Simd, dispatch};
use glam::Vec3;

/// Rays of a packet.
pub const PACKET: usize = 16;

/// Distance of origins that are near each other, as a part of the tree's reach.
const NEAR: f32 = 1.0 / 64.0;

/// Something that some rays still have to visit.
#[derive(Debug, Clone, Copy)]
pub(super) struct PacketEntry {
    /// No ray enters it before.
    pub t: f32,
    /// The rays that may.
    pub rays: u32,
    /// The block that holds the reference.
    pub block: u32,
    /// The child reference.
    pub child: u32,
}

/// What the rays are, lane by lane. Lanes without a ray repeat one that has.
#[derive(Debug)]
pub(super) struct PacketRays {
    /// Origins and directions by axis.
    pub org: [[f32; PACKET]; 3],
    pub dir: [[f32; PACKET]; 3],
    pub t_min: [f32; PACKET],
    /// See [`super::PreparedRay`].
    pub inv: [[f32; PACKET]; 3],
    pub minus_off_near: [[f32; PACKET]; 3],
    pub minus_off_far: [[f32; PACKET]; 3],
    pub shear: [[f32; PACKET]; 3],
}

impl PacketRays {
    /// Ray `i` by itself, up to any distance.
    #[inline(always)]
    pub fn one(&self, i: usize) -> LocalRay {
        let (org, dir) = (&self.org, &self.dir);
        let org = Vec3::new(org[0][i], org[1][i], org[2][i]);
        let dir = Vec3::new(dir[0][i], dir[1][i], dir[2][i]);
        LocalRay { org, dir, t_min: self.t_min[i], t_max: f32::INFINITY, cone: Cone::ZERO }
    }
}

/// The best hits, lane by lane.
#[derive(Debug)]
pub(super) struct PacketHits {
    pub t: [f32; PACKET],
    pub u: [f32; PACKET],
    pub v: [f32; PACKET],
    pub block: [u32; PACKET],
    pub tri: [u32; PACKET],
}

/// The state of sixteen rays in one tree. Reusable.
#[derive(Debug)]
pub struct PacketWalk {
    pub(super) stack: Vec<PacketEntry>,
    pub(super) rays: PacketRays,
    pub(super) hits: PacketHits,
    /// Set where the rays can go together.
    pub(super) shared: Option<Shared>,
    /// Rays that have not ended.
    pub(super) waiting: u32,
    /// For rays that leave the packet.
    pub(super) alone: Walk,
    /// What the walks did.
    pub(super) counters: Counters,
}

impl Default for PacketWalk {
    fn default() -> Self {
        Self::new()
    }
}

impl PacketWalk {
    /// For any number of packets.
    pub fn new() -> Self {
        let zero = [[0.0; PACKET]; 3];
        let rays = PacketRays {
            org: zero,
            dir: zero,
            inv: zero,
            minus_off_near: zero,
            minus_off_far: zero,
            shear: zero,
            t_min: [0.0; PACKET],
        };
        let none = [0.0; PACKET];
        let hits = PacketHits { t: none, u: none, v: none, block: [u32::MAX; PACKET], tri: [0; PACKET] };
        Self {
            stack: Vec::new(),
            rays,
            hits,
            shared: None,
            waiting: 0,
            alone: Walk::new(),
            counters: Counters::default(),
        }
    }

    /// Puts the rays of `active` (bit `i`: ray `i`) at the root of `view`; the others miss.
    pub fn begin(&mut self, view: &TreeView, rays: &[LocalRay; PACKET], active: u32) {
        for (i, ray) in rays.iter().enumerate() {
            self.set(i, ray);
        }
        self.start(view, active);
    }

    /// Takes ray `i` over, below [`PACKET`]; [`PacketWalk::start`] comes next. (Apart, because a loop that is compiled
    /// for a wider set gathers the fields, which takes longer than all else here.)
    #[inline(always)]
    pub fn set(&mut self, i: usize, ray: &LocalRay) {
        let (i, r) = (i & (PACKET - 1), &mut self.rays);
        (r.org[0][i], r.org[1][i], r.org[2][i]) = (ray.org.x, ray.org.y, ray.org.z);
        (r.dir[0][i], r.dir[1][i], r.dir[2][i]) = (ray.dir.x, ray.dir.y, ray.dir.z);
        r.t_min[i] = ray.t_min;
        self.hits.t[i] = ray.t_max;
    }

    /// Puts those of the rays taken over that are in `active` at the root of `view`; the others miss.
    pub fn start(&mut self, view: &TreeView, active: u32) {
        dispatch(view.isa, Start { walk: self, view, active });
    }

    /// Whether the rays gain by going together: all directions have the same signs and are greatest on the same axis,
    /// and all origins are near each other, as those of neighbouring pixels are, unless it `says` so.
    #[inline]
    pub fn is_coherent(&self, view: &TreeView, says: bool) -> bool {
        self.shared.as_ref().is_some_and(|shared| says || shared.spread() <= view.reach * NEAR)
    }

    /// The best hit so far of ray `i`.
    #[inline]
    pub fn best(&self, i: usize) -> TriHit {
        let h = &self.hits;
        if h.block[i] == u32::MAX {
            return TriHit::none(h.t[i]);
        }
        TriHit { t: h.t[i], u: h.u[i], v: h.v[i], block: h.block[i], tri: h.tri[i] }
    }

    /// Rays that have not ended.
    pub fn waiting(&self) -> u32 {
        self.waiting
    }

    /// What the walks did, packets and rays alone together: a node visited by a packet counts once.
    pub fn counters(&self) -> Counters {
        let mut all = self.counters;
        all += self.alone.counters;
        all
    }
}

struct Start<'a, 'v> {
    walk: &'a mut PacketWalk,
    view: &'a TreeView<'v>,
    active: u32,
}

impl Op for Start<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let Self { walk, view, active } = self;
        walk.stack.clear();
        walk.hits.block = [u32::MAX; PACKET];
        walk.waiting = packet_visit::valid(s, &walk.rays, &walk.hits.t) & active & 0xffff;
        if walk.waiting == 0 || view.is_empty() {
            walk.waiting = 0;
            return;
        }
        if walk.waiting != 0xffff {
            repeat_first(walk);
        }
        walk.shared = packet_visit::prepare(s, &mut walk.rays, view.reach);
        walk.stack.push(PacketEntry { t: 0.0, rays: walk.waiting, block: view.root_block, child: view.root });
    }
}

/// Fills the lanes without a ray: a ray that ends before it begins meets no box.
#[cold]
fn repeat_first(walk: &mut PacketWalk) {
    let first = walk.waiting.trailing_zeros() as usize & (PACKET - 1);
    let r = &mut walk.rays;
    for i in (0..PACKET).filter(|i| walk.waiting >> i & 1 == 0) {
        walk.hits.t[i] = f32::NEG_INFINITY;
        r.t_min[i] = r.t_min[first];
        for axis in 0..3 {
            r.org[axis][i] = r.org[axis][first];
            r.dir[axis][i] = r.dir[axis][first];
        }
    }
}

impl TreeView<'_> {
    /// Finds the closest hits of the rays that `walk` has begun (or goes on after `Pending`): the same, to
    /// the bit, as [`TreeView::closest`] finds for each alone.
    pub fn closest16(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        packet_visit::run::<false>(self, filter, walk)
    }

    /// Finds any hit of each ray that `walk` has begun (or goes on after `Pending`). Which one may differ from
    /// what [`TreeView::any`] finds; whether there is one does not.
    pub fn any16(&self, filter: Option<&PartFilter>, walk: &mut PacketWalk) -> Outcome {
        packet_visit::run::<true>(self, filter, walk)
    }
}
