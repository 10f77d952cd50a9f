//! Walks through a scene: the top-level tree, and inside each instance the walk of its tree. Like
//! those, they can be put down at a missing block and taken up again.
//!
//! A hit is the least (t, placed tree) over what the trees' own walks answer; order of visits,
//! packets and interruptions do not change it.

use super::model::Model;
use super::state::SceneState;
use super::top::{NodeRef, Slabs, Target};
use crate::base::error::Result;
use crate::base::ids::BlockId;
pub(crate) use crate::math::bits;
use crate::math::Ray;
use crate::residency::{Held, Lease, Shown};
use crate::structure::bvh::trace::{LocalRay, Outcome, PACKET, PacketWalk, PartFilter, STREAM, Stream, TreeView, TriHit, Triangle, Walk, Within};

/// A block that a job needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Need {
    /// Index of the scene's model.
    pub model: u32,
    pub block: BlockId,
}

/// Whether a walk has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    Done,
    /// Call again with the same walk and a snapshot that has the block.
    Pending(Need),
}

/// What is in memory of a scene's models, at one moment.
pub(crate) struct Snapshots(Vec<Shown>);

impl Snapshots {
    /// As it is now.
    pub fn take(scene: &SceneState) -> Self {
        Self(scene.models.iter().map(|m| Shown::from_inner(m.blocks().snapshot())).collect())
    }

    /// As it is now, in the room of what was there; for a moment in one thread.
    pub fn lend(&mut self, scene: &SceneState) {
        self.0.clear();
        self.0.extend(scene.models.iter().map(|m| m.blocks().shown()));
    }

    /// Of nothing, in the same room.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Of nothing: what is not held may go.
    pub fn none() -> Self {
        Self(Vec::new())
    }

    /// As it is now, and what is held; `None` if there is no memory for the tables.
    pub fn holding(scene: &SceneState, hold: &Hold) -> Option<Self> {
        let nothing = Held::new();
        let held = |i: usize| hold.0.get(i).unwrap_or(&nothing);
        let models = scene.models.iter().enumerate();
        models.map(|(i, model)| model.blocks().snapshot_with(held(i)).map(Shown::from_inner)).collect::<Option<_>>().map(Self)
    }

    /// With what a lease holds. Fails with `OverBudget` if it holds too much.
    pub fn leased(scene: &SceneState, lease: &Lease) -> Result<Self> {
        scene.models.iter().map(|model| lease.snapshot(model.blocks()).map(Shown::from_inner)).collect::<Result<_>>().map(Self)
    }

    /// Whether this is what is in memory now.
    pub fn is_current(&self, scene: &SceneState) -> bool {
        self.0.len() == scene.models.len() && scene.models.iter().zip(&self.0).all(|(m, s)| m.blocks().is_current(s))
    }

    /// Whether all geometry is there.
    pub fn is_whole(&self, scene: &SceneState) -> bool {
        let is_whole = |(model, snapshot): (&Model, &Shown)| {
            (0..model.info().geometry_blocks).all(|id| snapshot.block(BlockId(id)).is_some())
        };
        scene.models.iter().zip(&self.0).all(is_whole)
    }

    /// Whether the block is there.
    pub fn has(&self, need: Need) -> bool {
        self.0.get(need.model as usize).is_some_and(|snapshot| snapshot.block(need.block).is_some())
    }
}

/// Blocks that a job keeps in memory until it has used them, for each model of a scene.
#[derive(Default)]
pub(crate) struct Hold(Vec<Held>);

impl Hold {
    /// Keeps blocks of a model.
    pub fn add(&mut self, model: u32, held: Held) {
        let least = model as usize + 1;
        if self.0.len() < least {
            self.0.resize_with(least, Held::new);
        }
        self.0[model as usize].extend(held);
    }
}

/// Where a ray meets a placed tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// In units of the world ray's direction.
    pub t: f64,
    /// Index of the placed tree; `NOTHING` for none.
    pub placed: u32,
    pub tri: TriHit,
    /// Where the ray passed a stand-in first, in the same unit: infinity if it passed none. It may be behind the hit, and then may or may
    /// not be told.
    pub passed: f64,
}

pub(super) const NOTHING: u32 = u32::MAX;

impl Found {
    /// Nothing up to `t`.
    pub const fn nothing(t: f64) -> Self {
        Self { t, placed: NOTHING, tri: TriHit::none(0.0), passed: f64::INFINITY }
    }

    pub fn is_hit(&self) -> bool {
        self.placed != NOTHING
    }

    /// Whether the ray passed a stand-in on its way to the hit, or as far as it goes: what is before the hit may not be free, and a miss may
    /// be none.
    #[inline]
    pub fn has_passed(&self) -> bool {
        // Not where both are infinite.
        self.passed <= self.t.min(f64::MAX)
    }

    /// Takes over a tree's hit if it is nearer, or as near and of an earlier placed tree; and where the ray `passed` a stand-in in it, if
    /// that is nearer.
    #[inline]
    pub(super) fn offer<const ANY: bool>(&mut self, beyond: bool, placed: u32, tri: TriHit, passed: f32, shift: f64, scale: f64) {
        self.passed = self.passed.min(shift + scale * f64::from(passed));
        if tri.is_hit() {
            let t = shift + scale * f64::from(tri.t);
            // The tree's walk had the best t rounded up: what it found may still be beyond. Where any
            // will do there is no other to fall back on, and t_max is met to rounding; the first of who looks `beyond` is for that one to judge.
            let takes_any = ANY || beyond && !self.is_hit();
            if takes_any || t < self.t || t == self.t && placed < self.placed {
                *self = Self { t, placed, tri, passed: self.passed };
            }
        }
    }
}

/// A scene and what of it is in memory: what rays are traced in.
#[derive(Clone, Copy)]
pub(crate) struct SceneView<'a> {
    pub scene: &'a SceneState,
    pub snapshots: &'a Snapshots,
    /// Whether cells stand in for blocks that are not in memory. Else walks ask for these.
    pub never_waits: bool,
    /// Whether no ray passes a cell that stands in.
    pub is_solid: bool,
    /// The pass that visits, see `residency::View`.
    pub stamp: u32,
    /// Whether walks look so far beyond the ends of rays' intervals that nothing is lost that double precision puts within: whoever takes a
    /// hit then sees whether it is. Else intervals hold in single precision.
    pub looks_beyond: bool,
    /// What is asked of each hit of a ray that is traced alone, if anything: see [`PartFilter::within`].
    pub within: Option<&'a dyn Ends>,
}

/// [`Within`] for all placed trees, and in the world's distances.
pub(crate) trait Ends: std::fmt::Debug + Sync {
    fn triangle(&self, placed: u32, triangle: &Triangle, t: f64) -> bool;
    fn cell(&self, t: f64) -> bool;
    fn is_beyond(&self, t: f64) -> bool;
}

/// In one of the trees.
#[derive(Debug)]
struct EndsIn<'a> {
    ends: &'a dyn Ends,
    at: At,
}

impl Within for EndsIn<'_> {
    fn triangle(&self, triangle: &Triangle, t: f32) -> bool {
        self.ends.triangle(self.at.placed, triangle, self.at.in_world(t))
    }
    fn cell(&self, t: f32) -> bool {
        self.ends.cell(self.at.in_world(t))
    }
    fn is_beyond(&self, t: f32) -> bool {
        self.ends.is_beyond(self.at.in_world(t))
    }
}

/// The state of one ray in a scene. Reusable.
#[derive(Debug, Default)]
pub(crate) struct SceneWalk {
    todo: Vec<(NodeRef, f64)>,
    /// The tree that the ray is in.
    at: Option<At>,
    tree: Walk,
    best: Option<Found>,
}

#[derive(Debug, Clone, Copy)]
struct At {
    placed: u32,
    shift: f64,
    scale: f64,
}

impl At {
    fn in_world(&self, t: f32) -> f64 {
        self.shift + self.scale * f64::from(t)
    }
}

impl SceneWalk {
    /// Puts the ray at the root.
    pub fn begin(&mut self, view: &SceneView, ray: &Ray) {
        self.todo.clear();
        self.at = None;
        self.best = Some(Found::nothing(ray.t_max));
        if ray.can_hit() {
            self.todo.extend(view.scene.placement.top.root().map(|root| (root, 0.0)));
        }
    }

    /// The best hit so far.
    pub fn best(&self) -> Found {
        self.best.unwrap_or(Found::nothing(0.0))
    }
}

impl<'a> SceneView<'a> {
    /// For exact walks that wait for blocks.
    pub fn new(scene: &'a SceneState, snapshots: &'a Snapshots, stamp: u32) -> Self {
        Self { scene, snapshots, never_waits: false, is_solid: false, stamp, looks_beyond: false, within: None }
    }

    /// The block that a hit stands in for, if that is missing.
    pub fn wanted(&self, found: &Found) -> Option<Need> {
        let block = self.tree(found.placed).wanted(&found.tri)?;
        Some(self.need(found.placed, BlockId(block)))
    }

    /// A placed tree's view.
    #[inline]
    pub fn tree(&self, placed: u32) -> TreeView<'a> {
        let p = &self.scene.placement.placed[placed as usize];
        let view = self.model_of(placed).tree_view(p.tree, &self.snapshots.0[p.model as usize]);
        TreeView { never_waits: self.never_waits, is_solid: self.is_solid, stamp: self.stamp, ..view }
    }

    /// A placed tree's model.
    #[inline]
    pub fn model_of(&self, placed: u32) -> &'a Model {
        &self.scene.models[self.scene.placement.placed[placed as usize].model as usize]
    }

    #[inline]
    pub(crate) fn filter(&self, placed: u32) -> Option<PartFilter<'a>> {
        let p = &self.scene.placement.placed[placed as usize];
        let parts = &self.scene.instances[p.instance as usize].parts;
        let filter = || PartFilter { hidden: &parts.hidden, first_part: p.first_part, touched: parts.touched(p.first_part), within: None };
        (!parts.shown.is_empty()).then(filter)
    }

    /// The mask of the rays that see the placed tree.
    #[inline]
    pub(super) fn seen_by(&self, placed: u32) -> u32 {
        let p = &self.scene.placement.placed[placed as usize];
        let instance = &self.scene.instances[p.instance as usize];
        if instance.state.visible { instance.mask } else { 0 }
    }

    pub(crate) fn need(&self, placed: u32, block: BlockId) -> Need {
        Need { model: self.scene.placement.placed[placed as usize].model, block }
    }

    /// Finds the closest hit of the ray that `walk` was begun with (or any hit, if `ANY`).
    pub fn trace<const ANY: bool>(&self, ray: &Ray, walk: &mut SceneWalk) -> Step {
        let slabs = Slabs::new(ray);
        let mut best = walk.best();
        loop {
            if let Some(at @ At { placed, shift, scale }) = walk.at {
                let (tree, mut filter) = (self.tree(placed), self.filter(placed));
                let within = self.within.map(|ends| EndsIn { ends, at });
                if let Some(within) = &within {
                    filter = Some(PartFilter { within: Some(within), ..filter.unwrap_or_default() });
                }
                let outcome = if ANY {
                    tree.any(filter.as_ref(), &mut walk.tree)
                } else {
                    tree.closest(filter.as_ref(), &mut walk.tree)
                };
                if let Outcome::Pending(block) = outcome {
                    return Step::Pending(self.need(placed, block));
                }
                walk.at = None;
                best.offer::<ANY>(self.looks_beyond, placed, walk.tree.best(), walk.tree.passed(), shift, scale);
                walk.best = Some(best);
                if ANY && best.is_hit() {
                    return Step::Done;
                }
            }
            let Some((node, enter)) = walk.todo.pop() else { return Step::Done };
            if enter > best.t {
                continue;
            }
            match node.target() {
                Target::Placed(placed) => self.enter(ray, placed, best.t, walk),
                Target::Inner(index) => self.push_children(&slabs, ray, index, best.t, &mut walk.todo),
            }
        }
    }

    fn enter(&self, ray: &Ray, placed: u32, best: f64, walk: &mut SceneWalk) {
        if self.seen_by(placed) & ray.mask == 0 {
            return;
        }
        let p = &self.scene.placement.placed[placed as usize];
        let mut local = LocalRay::NONE;
        if let Some((shift, scale)) = p.local(ray, best, self.looks_beyond, &mut local) {
            walk.tree.begin(&self.tree(placed), &local);
            walk.at = Some(At { placed, shift, scale });
        }
    }

    fn push_children(&self, slabs: &Slabs, ray: &Ray, index: u32, best: f64, todo: &mut Vec<(NodeRef, f64)>) {
        let node = self.scene.placement.top.node(index);
        let enter = [0, 1].map(|side| slabs.enter(&node.bounds[side], ray.t_min, best));
        let far = usize::from(enter[0] <= enter[1]);
        // The far one first, so that the near one is popped next.
        for side in [far, 1 - far] {
            if let Some(t) = enter[side] {
                todo.push((node.child[side], t));
            }
        }
    }
}

/// Single rays side by side in a scene. Reusable.
pub(crate) struct SceneStream {
    pub(super) tree: Stream,
    /// Shift and scale of each ray in the tree.
    pub(super) moved: Box<[(f64, f64); STREAM]>,
    pub(super) hits: Box<[TriHit; STREAM]>,
    alone: SceneWalk,
    pub(super) unfinished: Vec<u32>,
}

impl Default for SceneStream {
    fn default() -> Self {
        Self {
            tree: Stream::new(),
            moved: Box::new([(0.0, 1.0); STREAM]),
            hits: Box::new([TriHit::none(0.0); STREAM]),
            alone: SceneWalk::default(),
            unfinished: Vec::new(),
        }
    }
}

impl SceneStream {
    /// See [`Stream::of_queries`].
    pub fn of_queries() -> Self {
        Self { tree: Stream::of_queries(), ..Self::default() }
    }

    /// Rays of the last call without an answer.
    pub fn unfinished(&self) -> &[u32] {
        &self.unfinished
    }
}

/// The state of a packet's rays in a scene. Reusable.
pub(crate) struct ScenePacket {
    todo: Vec<(NodeRef, u32)>,
    at: Option<u32>,
    /// Shift and scale of each ray in the tree that the packet is in.
    moved: [(f64, f64); PACKET],
    inside: u32,
    tree: PacketWalk,
    best: [Found; PACKET],
    slabs: Vec<Slabs>,
    /// Rays that still look for something.
    active: u32,
}

impl Default for ScenePacket {
    fn default() -> Self {
        Self {
            todo: Vec::new(),
            at: None,
            moved: [(0.0, 1.0); PACKET],
            inside: 0,
            tree: PacketWalk::new(),
            best: [Found::nothing(0.0); PACKET],
            slabs: Vec::new(),
            active: 0,
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
        self.todo.clear();
        self.at = None;
        self.active = 0;
        for (i, it) in rays.iter().enumerate() {
            (self.best[i].t, self.best[i].placed, self.best[i].passed) = (it.t_max, NOTHING, f64::INFINITY);
            self.active |= (active >> i & u32::from(it.can_hit())) << i;
        }
        let Some(root) = view.scene.placement.top.root() else { return };
        if let Target::Inner(_) = root.target() {
            self.slabs.clear();
            self.slabs.extend(rays.iter().map(Slabs::new));
        }
        self.todo.push((root, self.active));
    }

    /// The best hit so far of ray `i`.
    #[inline]
    pub fn best(&self, i: usize) -> &Found {
        &self.best[i]
    }
}

impl SceneView<'_> {
    /// A packet's rays together: the same hits as [`SceneView::trace`] finds for each alone.
    pub fn trace_packet<const ANY: bool>(&self, rays: &[Ray; PACKET], walk: &mut ScenePacket) -> Step {
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
                    let (shift, scale) = walk.moved[i];
                    walk.best[i].offer::<ANY>(self.looks_beyond, placed, walk.tree.best(i), walk.tree.passed()[i], shift, scale);
                    if ANY && walk.best[i].is_hit() {
                        walk.active &= !(1 << i);
                    }
                }
            }
            let Some((node, mask)) = walk.todo.pop() else { return Step::Done };
            match node.target() {
                Target::Placed(placed) => self.enter_packet(rays, placed, mask & walk.active, walk),
                Target::Inner(index) => self.push_children_packet(rays, index, mask & walk.active, walk),
            }
        }
    }

    fn enter_packet(&self, rays: &[Ray; PACKET], placed: u32, mask: u32, walk: &mut ScenePacket) {
        let p = &self.scene.placement.placed[placed as usize];
        let seen_by = self.seen_by(placed);
        walk.inside = 0;
        let mut local = LocalRay::NONE;
        for i in bits(mask) {
            if rays[i].mask & seen_by != 0
                && let Some(moved) = p.local(&rays[i], walk.best[i].t, self.looks_beyond, &mut local)
            {
                walk.tree.set(i, &local);
                walk.moved[i] = moved;
                walk.inside |= 1 << i;
            }
        }
        if walk.inside != 0 {
            walk.tree.start(&self.tree(placed), walk.inside);
            walk.at = Some(placed);
        }
    }

    fn push_children_packet(&self, rays: &[Ray; PACKET], index: u32, mask: u32, walk: &mut ScenePacket) {
        let node = self.scene.placement.top.node(index);
        let mut met = [0u32; 2];
        let mut nearest = [f64::INFINITY; 2];
        for i in bits(mask) {
            for side in 0..2 {
                if let Some(t) = walk.slabs[i].enter(&node.bounds[side], rays[i].t_min, walk.best[i].t) {
                    met[side] |= 1 << i;
                    nearest[side] = nearest[side].min(t);
                }
            }
        }
        let far = usize::from(nearest[0] <= nearest[1]);
        for side in [far, 1 - far] {
            if met[side] != 0 {
                walk.todo.push((node.child[side], met[side]));
            }
        }
    }

    /// The one placed tree of a scene that has one.
    #[inline]
    pub fn only_one(&self) -> Option<u32> {
        match self.scene.placement.top.root()?.target() {
            Target::Placed(placed) => Some(placed),
            Target::Inner(_) => None,
        }
    }

    /// Single rays side by side, but for [`FEW`] and less: what [`SceneView::trace`] finds for each, at less cost where the scene is one placed
    /// tree. `rays`: [`STREAM`] at most; `found`: as many. Rays in [`SceneStream::unfinished`] have no answer: they need
    /// a block, or must go alone; they are to be begun anew.
    pub fn trace_each<const ANY: bool>(&self, rays: &[Ray], walk: &mut SceneStream, found: &mut [Found]) {
        walk.unfinished.clear();
        if let Some(placed) = self.only_one().filter(|_| rays.len() > FEW) {
            return self.each_in_one::<ANY>(placed, rays, walk, found);
        }
        for (i, it) in rays.iter().enumerate() {
            walk.alone.begin(self, it);
            match self.trace::<ANY>(it, &mut walk.alone) {
                Step::Done => found[i] = walk.alone.best(),
                Step::Pending(_) => walk.unfinished.push(i as u32),
            }
        }
    }
}

/// Rays that go one after the other, at most: so few take longer to begin side by side than to walk.
const FEW: usize = 4;
