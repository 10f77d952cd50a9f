//! A packet of rays in a scene of several trees. The packet goes down the top tree, and those of its rays that enter
//! the box of a placed tree, or of a scene in this one, go into it as a packet. Like the walk of a single ray, a packet
//! can stop at a missing block and continue later.

use super::frame::{Fork, Frame, FrameKey, Scenes};
use super::placed::{At, Placed};
use super::ray_rows::RayRows;
use super::state::Stand;
use super::walk::{FirstCell, Found, HitTree, NOTHING, SceneView, Step};
use crate::math::{PACKET, Ray, bits};
use crate::simd::Isa;
use crate::structure::{LocalRay, LocalRays, MemberChild, Outcome, PacketWalk};
use glam::Vec3;

/// The state of a packet's rays in a scene. Reusable.
pub(crate) struct ScenePacket {
    /// The packet in top trees, at one for each level. The scene that it is in is the last of the first `depth`.
    levels: Vec<Box<Level>>,
    depth: usize,
    /// The placed tree that rays are to enter next, and these rays.
    next: Option<(u64, u32)>,
    /// The placed tree that the packet is in.
    at: Option<u64>,
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

/// A packet in a top tree.
struct Level {
    walk: PacketWalk,
    /// The placement of each ray there.
    at: [At; PACKET],
    /// The scene that the tree is of.
    frame: FrameKey,
    /// The rays that entered the tree.
    inside: u32,
}

impl Level {
    /// Takes over how far rays may still go, and which are done.
    fn follow(&mut self, rays: u32, far: &[f64; PACKET], active: u32) {
        for i in bits(rays) {
            self.walk.shorten(i, self.at[i].in_tree(far[i]));
            if active >> i & 1 == 0 {
                self.walk.stop(i);
            }
        }
    }
}

impl Default for ScenePacket {
    fn default() -> Self {
        Self {
            levels: Vec::new(),
            depth: 0,
            next: None,
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
        (self.at, self.next, self.depth, self.active) = (None, None, 0, 0);
        for (i, it) in rays.iter().enumerate() {
            self.rows.set(i, it);
            (self.best[i].t, self.best[i].tree, self.best[i].first_cell) = (it.t_max, HitTree::NONE, FirstCell::NONE);
            self.far[i] = it.t_max;
            self.active |= (active >> i & u32::from(it.can_hit())) << i;
        }
        let root = Frame::outermost(view.scene).root(seen_by_any(rays, self.active));
        self.enter(view, rays, root, self.active);
    }

    /// Takes the rays of `among` into the tree of a scene, as far as they may meet something there.
    fn enter(&mut self, view: &SceneView, rays: &[Ray; PACKET], fork: Option<Fork>, among: u32) {
        let frame = match fork {
            None => return,
            Some(Fork::Placed(placed)) => return self.next = Some((placed, among)),
            Some(Fork::Node(frame, _)) => frame,
        };
        let among = bits(among).filter(|&i| rays[i].mask & frame.seen_by() != 0).fold(0, |all, i| all | 1 << i);
        let Some((members, boxes)) = frame.walked() else { return };
        let isa = view.scene.context().isa();
        let inside = self.take_into(isa, rays, &boxes, NOTHING, among, true);
        if inside == 0 {
            return;
        }
        if !frame.has_cells() {
            self.local.cone = [[0.0; PACKET]; 2];
        }
        if self.levels.len() == self.depth {
            let (walk, at) = (PacketWalk::new(), [At::NONE; PACKET]);
            self.levels.push(Box::new(Level { walk, at, frame: FrameKey::OUTERMOST, inside: 0 }));
        }
        let level = &mut self.levels[self.depth];
        (level.at, level.frame, level.inside) = (self.moved, frame.key(), inside);
        level.walk.set_rows(&self.local);
        level.walk.start(&members.tree(isa), inside);
        self.depth += 1;
    }

    /// Takes the rays of `among` into the frame of a placed tree, up to where they may still go. Returns those that may
    /// hit something there.
    fn take_into(
        &mut self,
        isa: Isa,
        rays: &[Ray; PACKET],
        frame: &Placed,
        placed: u64,
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

    /// Takes over the cells of the last level's tree that rays met.
    fn take_cells<const ANY: bool>(&mut self, beyond: bool, tree: HitTree, rays: &[Ray; PACKET]) {
        let Some(level) = self.levels[..self.depth].last() else { return };
        for i in bits(level.inside) {
            let (hit, first_cell) = (level.walk.best(i), level.walk.first_cell()[i]);
            self.best[i].offer_in::<ANY>(beyond, tree, &level.at[i], hit, first_cell);
            self.far[i] = self.best[i].reach(&rays[i]);
            if ANY && self.best[i].is_hit() {
                self.active &= !(1 << i);
            }
        }
    }

    /// The best hit so far of ray `i`.
    #[inline]
    pub fn best(&self, i: usize) -> &Found {
        &self.best[i]
    }
}

/// The scenes that some of the rays see.
fn seen_by_any(rays: &[Ray; PACKET], among: u32) -> Scenes {
    Scenes::SeenBy(bits(among).fold(0, |all, i| all | rays[i].mask))
}

impl SceneView<'_> {
    /// Traces the rays as a packet; finds the hits that [`SceneView::trace`] finds for each single ray.
    pub fn trace_packet<const ANY: bool>(&self, rays: &[Ray; PACKET], walk: &mut ScenePacket) -> Step {
        debug_assert!(self.within.is_none(), "a double-precision interval belongs to a single ray");
        // Where the packet has just entered, that is known.
        let mut here = None;
        loop {
            if let Some(placed) = walk.at {
                let stand = here.take().unwrap_or_else(|| self.scene.stand(placed));
                let (tree, filter) = (self.tree_at(&stand), self.filter_at(&stand));
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
                    if ANY && walk.best[i].is_hit() {
                        walk.active &= !(1 << i);
                    }
                }
                if let Some(level) = walk.levels[..walk.depth].last_mut() {
                    level.follow(walk.inside, &walk.far, walk.active);
                }
            }
            match self.next_of_packet::<ANY>(rays, walk) {
                Some((placed, among)) => here = Some(self.enter_packet(rays, placed, among, walk)),
                None => return Step::Done,
            }
        }
    }

    /// The next placed tree that rays of a packet may enter, and these rays. Takes over the stand-ins for several
    /// members that rays meet on the way.
    fn next_of_packet<const ANY: bool>(&self, rays: &[Ray; PACKET], walk: &mut ScenePacket) -> Option<(u64, u32)> {
        loop {
            if let Some(next) = walk.next.take() {
                return Some(next);
            }
            let level = walk.levels[..walk.depth].last_mut()?;
            let frame = Frame::of(self.scene, &level.frame);
            let tree = frame.tree()?;
            let outcome = if ANY {
                tree.any_together(None, &mut level.walk)
            } else {
                tree.closest_together(None, &mut level.walk)
            };
            match outcome {
                Outcome::Member(member) => {
                    let among = level.walk.at_member() & walk.active;
                    let fork = frame.fork(MemberChild::Member(member), seen_by_any(rays, among));
                    walk.enter(self, rays, fork, among);
                }
                // All blocks of this tree are in memory.
                Outcome::Done | Outcome::Pending(_) => {
                    if frame.has_cells() {
                        walk.take_cells::<ANY>(self.widen_interval, frame.hit_tree(), rays);
                    }
                    walk.depth -= 1;
                    if let Some(level) = walk.levels[..walk.depth].last_mut() {
                        level.follow(level.walk.at_member(), &walk.far, walk.active);
                    }
                }
            }
        }
    }

    fn enter_packet(&self, rays: &[Ray; PACKET], placed: u64, mask: u32, walk: &mut ScenePacket) -> Stand<'_> {
        let (stand, p) = self.scene.stand_placed(placed);
        let seen_by = self.scene.seen_at(&stand);
        let sees = bits(mask).filter(|&i| rays[i].mask & seen_by != 0).fold(0, |all, i| all | 1 << i);
        let isa = self.scene.context().isa();
        walk.inside = walk.take_into(isa, rays, &p, placed, sees, self.widen_interval);
        if walk.inside != 0 {
            walk.tree.set_rows(&walk.local);
            walk.tree.start(&self.tree_at(&stand), walk.inside);
            walk.at = Some(placed);
        }
        stand
    }
}
