//! A packet of rays in a scene of several trees. The packet goes down the top tree, and those of its rays that enter
//! the box of a placed tree go into it as a packet. Like the walk of a single ray, a packet can stop at a missing block
//! and continue later.

use super::beam::Beam;
use super::box_ray::PacketBoxRays;
use super::placed::At;
use super::ray_rows::RayRows;
use super::top::{NodeRef, Target};
use super::walk::{FirstCell, Found, NOTHING, SceneView, Step};
use crate::math::{PACKET, Ray, bits};
use crate::structure::{LocalRay, LocalRays, Outcome, PacketWalk};
use glam::Vec3;

/// The state of a packet's rays in a scene. Reusable.
pub(crate) struct ScenePacket {
    /// A stack of top-tree nodes, the next one last. Each has the rays that may enter it, and the distance at which the
    /// first of them does.
    todo: Vec<(NodeRef, u32, f64)>,
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
    box_rays: PacketBoxRays,
    /// The beam of the rays if they share an origin. It is nearly as narrow as the rays: only for small boxes do
    /// notably fewer rays enter the box than the beam.
    beam: Option<Beam>,
    /// Rays that still search for a hit.
    active: u32,
    /// Parts of the directions that single precision has lost.
    rest: Option<[Vec3; PACKET]>,
}

impl Default for ScenePacket {
    fn default() -> Self {
        Self {
            todo: Vec::new(),
            at: None,
            moved: [At::NONE; PACKET],
            inside: 0,
            tree: PacketWalk::new(),
            rows: Box::new(RayRows::NONE),
            local: Box::new(LocalRays::NONE),
            best: [Found::nothing(0.0); PACKET],
            far: [0.0; PACKET],
            box_rays: PacketBoxRays::NONE,
            beam: None,
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
        self.todo.clear();
        self.at = None;
        self.active = 0;
        for (i, it) in rays.iter().enumerate() {
            self.rows.set(i, it);
            (self.best[i].t, self.best[i].placed, self.best[i].first_cell) = (it.t_max, NOTHING, FirstCell::NONE);
            self.far[i] = it.t_max;
            self.active |= (active >> i & u32::from(it.can_hit())) << i;
        }
        let Some(root) = view.scene.placement.top.root() else { return };
        if let Target::Inner(_) = root.target() {
            self.box_rays.set(rays, rest);
            self.beam = if rest.is_none() { Beam::from_one_point(rays, self.active) } else { None };
        }
        self.todo.push((root, self.active, 0.0));
    }

    /// The best hit so far of ray `i`.
    #[inline]
    pub fn best(&self, i: usize) -> &Found {
        &self.best[i]
    }

    /// The greatest distance up to which any ray of `rays` may still go.
    fn farthest(&self, rays: u32) -> f64 {
        bits(rays).fold(f64::NEG_INFINITY, |far, i| far.max(self.far[i]))
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
                    walk.far[i] = walk.best[i].t;
                    if ANY && walk.best[i].is_hit() {
                        walk.active &= !(1 << i);
                    }
                }
            }
            let Some((node, mask, enter)) = walk.todo.pop() else { return Step::Done };
            let mask = mask & walk.active;
            if mask == 0 || enter > walk.farthest(mask) {
                continue;
            }
            match node.target() {
                Target::Placed(placed) => self.enter_packet(rays, placed, mask, walk),
                Target::Inner(index) => self.push_children_packet(index, mask, walk),
            }
        }
    }

    fn enter_packet(&self, rays: &[Ray; PACKET], placed: u32, mask: u32, walk: &mut ScenePacket) {
        let p = self.scene.placed(placed);
        let seen_by = self.seen_by(placed);
        let ScenePacket { tree, rows, local, far, moved, .. } = walk;
        let isa = self.scene.context().isa();
        let mut sees = mask;
        for i in bits(mask) {
            sees &= !(u32::from(rays[i].mask & seen_by == 0) << i);
        }
        walk.inside = match &walk.rest {
            None => {
                *moved = [At { placed, shift: 0.0, scale: 1.0 }; PACKET];
                rows.take_all_into_tree(isa, &p, sees, (far, self.widen_interval), local, |i, (shift, scale)| {
                    moved[i] = At { placed, shift, scale };
                })
            }
            Some(rest) => {
                let (mut inside, mut one) = (0, LocalRay::NONE);
                for i in bits(sees) {
                    if let Some((shift, scale)) = p.local_of(&rays[i], rest[i], far[i], self.widen_interval, &mut one) {
                        local.set(i, &one);
                        moved[i] = At { placed, shift, scale };
                        inside |= 1 << i;
                    }
                }
                inside
            }
        };
        if walk.inside != 0 {
            tree.set_rows(local);
            tree.start(&self.tree(placed), walk.inside);
            walk.at = Some(placed);
        }
    }

    fn push_children_packet(&self, index: u32, mask: u32, walk: &mut ScenePacket) {
        let node = self.scene.placement.top.node(index);
        let (mut met, mut nearest) = ([0; 2], [f64::INFINITY; 2]);
        let mut enter = [0.0; PACKET];
        for side in 0..2 {
            if let (Some(beam), Target::Inner(_)) = (&walk.beam, node.child[side].target()) {
                if let Some(enter) = beam.enter(&node.bounds[side], walk.farthest(mask)) {
                    (met[side], nearest[side]) = (mask, enter);
                }
                continue;
            }
            met[side] =
                mask & walk.box_rays.enter(self.scene.context().isa(), &node.bounds[side], &walk.far, &mut enter);
            nearest[side] = bits(met[side]).fold(f64::INFINITY, |nearest, i| nearest.min(enter[i]));
        }
        let far = usize::from(nearest[0] <= nearest[1]);
        for side in [far, 1 - far] {
            if met[side] != 0 {
                walk.todo.push((node.child[side], met[side], nearest[side]));
            }
        }
    }
}
