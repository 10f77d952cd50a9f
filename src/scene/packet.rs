//! A packet of rays in a scene of several trees. The packet goes down the top tree, and those of its rays that enter
//! the box of a placed tree go into it as a packet. Like the walk of a single ray, a packet can stop at a missing block
//! and continue later.

use super::placed::{At, Placed};
use super::ray_rows::RayRows;
use super::top::{NodeRef, Target};
use super::walk::{FirstCell, Found, NOTHING, SceneView, Step};
use crate::math::{PACKET, Ray, bits};
use crate::simd::Isa;
use crate::structure::{LocalRay, LocalRays, Outcome, PacketWalk};
use glam::Vec3;

/// The state of a packet's rays in a scene. Reusable.
pub(crate) struct ScenePacket {
    /// The packet in the top tree, and the placement of each ray there.
    top: PacketWalk,
    at_top: [At; PACKET],
    /// The only placed tree, and the rays that are to enter it.
    only: Option<(u32, u32)>,
    /// True if rays are in the top tree.
    is_in_top: bool,
    /// The placed tree that the packet is in.
    at: Option<u32>,
    /// The placement of each ray in that tree.
    moved: [At; PACKET],
    inside: u32,
    tree: PacketWalk,
    rows: Box<RayRows>,
    local: Box<LocalRays<PACKET>>,
    best: [Found; PACKET],
    /// The distance up to which each ray may still go.
    far: [f64; PACKET],
    /// Rays that still search for a hit.
    active: u32,
    /// Parts of the directions that single precision has lost.
    rest: Option<[Vec3; PACKET]>,
}

impl Default for ScenePacket {
    fn default() -> Self {
        Self {
            top: PacketWalk::new(),
            at_top: [At::NONE; PACKET],
            only: None,
            is_in_top: false,
            at: None,
            moved: [At::NONE; PACKET],
            inside: 0,
            tree: PacketWalk::new(),
            rows: Box::new(RayRows::NONE),
            local: Box::new(LocalRays::NONE),
            best: [Found::nothing(0.0); PACKET],
            far: [0.0; PACKET],
            active: 0,
            rest: None,
        }
    }
}

impl ScenePacket {
    /// See [`PacketWalk::begin_batch`].
    pub fn begin_batch(&mut self) {
        self.tree.begin_batch();
    }

    /// Puts the rays of `active` (bit `i`: ray `i`) at the root.
    pub fn begin(&mut self, view: &SceneView, rays: &[Ray; PACKET], active: u32) {
        self.begin_fine(view, rays, None, active);
    }

    /// [`ScenePacket::begin`] of rays with directions in more than single precision: `rest` is the part that these have
    /// lost. It matters in trees that are far away.
    pub fn begin_fine(&mut self, view: &SceneView, rays: &[Ray; PACKET], rest: Option<&[Vec3; PACKET]>, active: u32) {
        self.rest = rest.copied();
        (self.at, self.only, self.is_in_top, self.active) = (None, None, false, 0);
        for (i, it) in rays.iter().enumerate() {
            self.rows.set(i, it);
            (self.best[i].t, self.best[i].placed, self.best[i].first_cell) = (it.t_max, NOTHING, FirstCell::NONE);
            self.far[i] = it.t_max;
            self.active |= (active >> i & u32::from(it.can_hit())) << i;
        }
        match view.scene.placement.top.root().map(NodeRef::target) {
            None => {}
            Some(Target::Placed(placed)) => self.only = Some((placed, self.active)),
            Some(Target::Inner(_)) => {
                let Some((members, frame)) = view.scene.placement.top.walked() else { return };
                let isa = view.scene.context().isa();
                let inside = self.take_into(isa, rays, frame, NOTHING, self.active, true);
                self.at_top = self.moved;
                // No cell of this tree stands in.
                self.local.cone = [[0.0; PACKET]; 2];
                self.top.set_rows(&self.local);
                self.top.start(&members.tree(isa), inside);
                self.is_in_top = inside != 0;
            }
        }
    }

    /// Takes the rays of `among` into the frame of a placed tree, up to where they may still go. Returns those that may
    /// hit something there.
    fn take_into(
        &mut self,
        isa: Isa,
        rays: &[Ray; PACKET],
        frame: &Placed,
        placed: u32,
        among: u32,
        beyond: bool,
    ) -> u32 {
        let Self { rows, local, far, moved, .. } = self;
        let Some(rest) = &self.rest else {
            *moved = [At { placed, shift: 0.0, scale: 1.0 }; PACKET];
            return rows.take_all_into_tree(isa, frame, among, (far, beyond), local, |i, (shift, scale)| {
                moved[i] = At { placed, shift, scale };
            });
        };
        let (mut inside, mut one) = (0, LocalRay::NONE);
        for i in bits(among) {
            if let Some((shift, scale)) = frame.local_of(&rays[i], rest[i], far[i], beyond, &mut one) {
                local.set(i, &one);
                moved[i] = At { placed, shift, scale };
                inside |= 1 << i;
            }
        }
        inside
    }

    /// The best hit so far of ray `i`.
    #[inline]
    pub fn best(&self, i: usize) -> &Found {
        &self.best[i]
    }
}

impl SceneView<'_> {
    /// Traces the rays as a packet; finds the hits that [`SceneView::trace`] finds for each single ray.
    pub fn trace_packet<const ANY: bool>(&self, rays: &[Ray; PACKET], walk: &mut ScenePacket) -> Step {
        debug_assert!(self.within.is_none(), "a double-precision interval belongs to a single ray");
        loop {
            if let Some(placed) = walk.at {
                let (tree, filter) = (self.tree(placed), self.filter(placed));
                let outcome = if ANY {
                    tree.any_together(filter.as_ref(), &mut walk.tree)
                } else {
                    tree.closest_together(filter.as_ref(), &mut walk.tree)
                };
                if let Outcome::Pending(block) = outcome {
                    return Step::Pending(self.need(placed, block));
                }
                walk.at = None;
                for i in bits(walk.inside) {
                    walk.best[i].offer::<ANY>(
                        self.widen_interval,
                        &walk.moved[i],
                        walk.tree.best(i),
                        walk.tree.first_cell()[i],
                    );
                    walk.far[i] = walk.best[i].reach(&rays[i]);
                    walk.top.shorten(i, walk.at_top[i].in_tree(walk.far[i]));
                    if ANY && walk.best[i].is_hit() {
                        walk.active &= !(1 << i);
                        walk.top.stop(i);
                    }
                }
            }
            if let Some((placed, among)) = walk.only.take() {
                self.enter_packet(rays, placed, among, walk);
                continue;
            }
            let Some((members, _)) = self.scene.placement.top.walked().filter(|_| walk.is_in_top) else {
                return Step::Done;
            };
            match members.tree(self.scene.context().isa()).closest_together(None, &mut walk.top) {
                Outcome::Member(placed) => {
                    let among = walk.top.at_member() & walk.active;
                    self.enter_packet(rays, placed, among, walk);
                }
                // All blocks of this tree are in memory.
                Outcome::Done | Outcome::Pending(_) => return Step::Done,
            }
        }
    }

    fn enter_packet(&self, rays: &[Ray; PACKET], placed: u32, mask: u32, walk: &mut ScenePacket) {
        let p = self.scene.placed(placed);
        let seen_by = self.seen_by(placed);
        let sees = bits(mask).filter(|&i| rays[i].mask & seen_by != 0).fold(0, |all, i| all | 1 << i);
        let isa = self.scene.context().isa();
        walk.inside = walk.take_into(isa, rays, &p, placed, sees, self.widen_interval);
        if walk.inside != 0 {
            walk.tree.set_rows(&walk.local);
            walk.tree.start(&self.tree(placed), walk.inside);
            walk.at = Some(placed);
        }
    }
}
