//! Walks through a scene: through the top-level tree, and in each instance through its tree. Like the walks of single
//! trees, they can stop at a missing block and continue later.
//!
//! A hit is the least pair (t, tree) of the hits in the trees. It does not depend on the order of visits, on packets or
//! on interruptions.

use super::frame::{Frame, Scenes, Target};
use super::model::Model;
use super::placed::{At, Placed};
use super::placement::PlacedIds;
use super::state::{SceneState, Stand};
use super::top_walk::TopWalk;
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::math::Ray;
use crate::residency::{Held, Lease, Shown};
use crate::structure::{
    LocalRay, NEVER, Outcome, PartFilter, ShownBlocks, Tree, TriHit, Triangle, Visit, Walk, Within,
};
use std::borrow::Cow;
use std::sync::atomic::AtomicBool;

/// A block that a job needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Need {
    /// Index of the model in the scene.
    pub model: u32,
    pub block: BlockId,
}

/// The state of a walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    Done,
    /// The walk stopped. The caller calls again with the same walk and a snapshot that has the block.
    Pending(Need),
}

/// The blocks of a scene's models that are in memory at one moment: a snapshot for each model.
#[derive(Default)]
pub(crate) struct Snapshots(Vec<Shown>);

impl Snapshots {
    /// The current snapshots.
    pub fn take(scene: &SceneState) -> Self {
        scene.models.iter().for_each(Model::used);
        Self(scene.models.iter().map(|m| Shown::from_inner(m.blocks().snapshot())).collect())
    }

    /// Loads the current snapshots in the same allocation, for a short time in one thread.
    pub fn lend(&mut self, scene: &SceneState) {
        self.0.clear();
        self.0.extend(scene.models.iter().map(|m| m.blocks().shown()));
    }

    /// Drops the snapshots and keeps the allocation.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// No snapshots: blocks that are not held may be evicted.
    pub fn none() -> Self {
        Self(Vec::new())
    }

    /// The current snapshots with the held blocks; `None` if there is no memory for the tables.
    pub fn holding(scene: &SceneState, hold: &Hold) -> Option<Self> {
        let nothing = Held::new();
        let held = |i: usize| hold.0.get(i).unwrap_or(&nothing);
        let models = scene.models.iter().enumerate();
        models
            .map(|(i, model)| model.blocks().snapshot_with(held(i)).map(Shown::from_inner))
            .collect::<Option<_>>()
            .map(Self)
    }

    /// Snapshots with the blocks of a lease. Fails with `OverBudget` if the lease holds too much.
    pub fn leased(scene: &SceneState, lease: &Lease) -> Result<Self> {
        scene
            .models
            .iter()
            .map(|model| lease.snapshot(model.blocks()).map(Shown::from_inner))
            .collect::<Result<_>>()
            .map(Self)
    }

    /// True if these are still the current snapshots.
    pub fn is_current(&self, scene: &SceneState) -> bool {
        self.0.len() == scene.models.len() && scene.models.iter().zip(&self.0).all(|(m, s)| m.blocks().is_current(s))
    }

    /// True if all geometry blocks are in memory.
    pub fn is_whole(&self, scene: &SceneState) -> bool {
        let is_whole = |(model, snapshot): (&Model, &Shown)| {
            (0..model.info().geometry_blocks).all(|id| snapshot.block(BlockId(id)).is_some())
        };
        scene.models.iter().zip(&self.0).all(is_whole)
    }

    /// True if the block is in memory.
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

/// The tree that a hit is in. The order decides between hits at the same distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum HitTree {
    /// A placed tree, by its number.
    Placed(u64),
    /// The top tree of a scene: the hit is on a stand-in for several of its members. `first`: the number of the scene's
    /// first placed tree; `level`: the number of scenes around it.
    Top { first: u64, level: u32 },
}

impl HitTree {
    /// That of no hit.
    pub const NONE: Self = Self::Placed(NOTHING);

    /// The number of the placed tree; for a top tree, of the first one in its scene.
    #[inline(always)]
    pub fn number(self) -> u64 {
        match self {
            Self::Placed(number) | Self::Top { first: number, .. } => number,
        }
    }
}

/// Where a ray first entered a stand-in, hit or not: see [`Walk::first_cell`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct FirstCell {
    /// Distance in units of the world ray's direction; infinity if the ray entered none.
    pub t: f64,
    /// The tree with the stand-in.
    pub tree: HitTree,
}

impl FirstCell {
    pub const NONE: Self = Self { t: f64::INFINITY, tree: HitTree::NONE };

    /// True if the ray entered a stand-in up to `t`.
    #[inline(always)]
    pub fn is_up_to(&self, t: f64) -> bool {
        // The bound excludes the case that both are infinite.
        self.t <= t.min(f64::MAX)
    }
}

/// The intersection of a ray and a tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Distance in units of the world ray's direction.
    pub t: f64,
    pub tree: HitTree,
    pub tri: TriHit,
    /// Where the ray first entered a stand-in.
    pub first_cell: FirstCell,
}

pub(super) const NOTHING: u64 = u64::MAX;

impl Found {
    /// No hit up to `t`.
    pub const fn nothing(t: f64) -> Self {
        Self { t, tree: HitTree::NONE, tri: TriHit::none(0.0), first_cell: FirstCell::NONE }
    }

    /// The number of the placed tree that was hit; of the first one in the scene, if the hit is on a stand-in for
    /// several.
    pub fn placed(&self) -> u64 {
        self.tree.number()
    }

    pub fn is_hit(&self) -> bool {
        self.tree != HitTree::NONE
    }

    /// The distance up to which a ray may still meet something better. Rounding may put a hit of a widened interval
    /// before the interval; another tree may have an equal one.
    #[inline]
    pub(super) fn reach(&self, ray: &Ray) -> f64 {
        if self.is_hit() { self.t.max(ray.t_min) } else { self.t }
    }

    /// True if the ray entered a stand-in before its hit, or before its end. Then the way to the hit may not be free,
    /// and a miss may not be a true miss.
    #[inline]
    pub fn is_behind_cell(&self) -> bool {
        self.first_cell.is_up_to(self.t)
    }

    /// Takes over a placed tree's hit if it is nearer, or equally near and of an earlier placed tree. Also takes over
    /// the distance at which the ray first entered a stand-in of the tree, if that is nearer.
    #[inline]
    pub(super) fn offer<const ANY: bool>(&mut self, beyond: bool, at: &At, tri: TriHit, first_cell: f32) {
        self.offer_in::<ANY>(beyond, HitTree::Placed(at.placed), at, tri, first_cell);
    }

    /// [`Found::offer`] of any tree.
    #[inline]
    pub(super) fn offer_in<const ANY: bool>(
        &mut self,
        beyond: bool,
        tree: HitTree,
        at: &At,
        tri: TriHit,
        first_cell: f32,
    ) {
        let first_cell = at.in_world(first_cell);
        if first_cell < self.first_cell.t {
            self.first_cell = FirstCell { t: first_cell, tree };
        }
        if tri.is_hit() {
            let t = at.in_world(tri.t);
            // The tree's walk had the best t rounded up, so its hit may still be beyond. An any-hit walk has no other
            // hit to fall back on, so it applies t_max up to rounding. A walk that looks `beyond` takes the first hit
            // too: its caller tests that in double precision.
            let takes_any = ANY || beyond && !self.is_hit();
            if takes_any || t < self.t || t == self.t && tree < self.tree {
                *self = Self { t, tree, tri, first_cell: self.first_cell };
            }
        }
    }
}

/// A scene and the blocks in memory: the view in which rays are traced.
#[derive(Clone, Copy)]
pub(crate) struct SceneView<'a> {
    pub scene: &'a SceneState,
    pub snapshots: &'a Snapshots,
    /// True if stand-ins replace blocks that are not in memory. Otherwise walks stop and request these blocks.
    pub accept_missing: bool,
    /// True if places decide ties between triangles whose primitive ids are not in memory. Otherwise walks stop and
    /// request the ids' blocks.
    pub ties_by_place: bool,
    /// The stamp of the visiting pass, see `residency::View`.
    pub stamp: u32,
    /// Once it is set, walks end soon; their results have no meaning then.
    pub stop: &'a AtomicBool,
    /// True if walks search beyond the ends of intervals, so far that they lose no hit that double precision puts
    /// within. The caller then tests each hit. Otherwise intervals apply in single precision.
    pub widen_interval: bool,
    /// A test of each hit, for rays that are traced singly: see [`PartFilter::within`].
    pub within: Option<&'a dyn Ends>,
}

/// [`Within`] for all placed trees, with distances in the world.
pub(crate) trait Ends: std::fmt::Debug + Sync {
    fn triangle(&self, placed: u64, triangle: &Triangle, t: f64) -> bool;
    fn cell(&self, t: f64) -> bool;
    fn is_beyond(&self, t: f64) -> bool;
}

/// The same test in one of the trees.
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
    /// The walk through the top trees.
    top: TopWalk,
    /// The placed tree that the ray is in, and the walk there.
    inside: Option<At>,
    tree: Walk,
    best: Option<Found>,
}

impl SceneWalk {
    /// Puts the ray at the root.
    pub fn begin(&mut self, view: &SceneView, ray: &Ray) {
        (self.inside, self.best) = (None, Some(Found::nothing(ray.t_max)));
        self.top.begin(view, ray);
    }

    /// Gives back memory that the walk does not need now, because it is going to wait.
    pub fn fit(&mut self) {
        self.top.fit();
        self.tree.fit();
    }

    /// Bytes of memory in addition to the walk itself.
    pub fn bytes(&self) -> u64 {
        self.top.bytes() + self.tree.bytes()
    }

    /// The best hit so far.
    pub fn best(&self) -> Found {
        self.best.unwrap_or(Found::nothing(0.0))
    }
}

impl<'a> SceneView<'a> {
    /// A view for exact walks that wait for blocks.
    pub fn new(scene: &'a SceneState, snapshots: &'a Snapshots, stamp: u32) -> Self {
        Self {
            scene,
            snapshots,
            accept_missing: false,
            ties_by_place: false,
            stamp,
            stop: &NEVER,
            widen_interval: false,
            within: None,
        }
    }

    /// The missing block that a hit on a stand-in replaces, if there is one.
    pub fn wanted(&self, tree: HitTree, hit: &TriHit) -> Option<Need> {
        let HitTree::Placed(placed) = tree else { return None };
        let block = self.tree(placed).wanted(hit)?;
        Some(self.need(placed, BlockId(block)))
    }

    /// The tree that a hit is in, with its blocks in memory.
    #[inline]
    pub fn tree_with(&self, tree: HitTree) -> Tree<'a> {
        match tree {
            HitTree::Placed(number) => self.tree(number),
            // A scene with such a hit has a tree.
            HitTree::Top { first, level } => {
                Frame::with(self.scene, level, first).tree().unwrap_or_else(|| self.tree(first))
            }
        }
    }

    /// The frame of the tree that a hit is in.
    #[inline]
    pub fn frame_of(&self, tree: HitTree) -> Cow<'a, Placed> {
        match tree {
            HitTree::Placed(number) => self.scene.placed(number),
            HitTree::Top { first, level } => {
                let walked = Frame::with(self.scene, level, first).walked();
                walked.map_or_else(|| self.scene.placed(first), |(_, boxes)| boxes)
            }
        }
    }

    /// The placed tree that a hit shows, and the part of its model there. `part`: the part as the hit has it; on a
    /// stand-in for several members it is the number of that with the greatest visible area.
    #[inline]
    pub fn shown_by(&self, tree: HitTree, part: u32) -> (u64, u32) {
        match tree {
            HitTree::Placed(number) => (number, part),
            HitTree::Top { first, level } => {
                let number = Frame::with(self.scene, level, first).first_in(part);
                (number, self.scene.main_part(number))
            }
        }
    }

    /// A placed tree with its blocks in memory.
    #[inline]
    pub fn tree(&self, placed: u64) -> Tree<'a> {
        self.tree_at(&self.scene.stand(placed))
    }

    /// [`SceneView::tree`] of a stand.
    #[inline]
    pub(super) fn tree_at(&self, stand: &Stand<'a>) -> Tree<'a> {
        self.tree_of(stand.ids, self.scene.shown_at(stand))
    }

    /// A placed tree of which walks pass by the blocks that `shown` has no parts of.
    #[inline]
    pub fn tree_showing(&self, placed: u64, shown: Option<&'a ShownBlocks>) -> Tree<'a> {
        self.tree_of(self.scene.ids_of(placed), shown)
    }

    #[inline]
    fn tree_of(&self, p: PlacedIds, shown: Option<&'a ShownBlocks>) -> Tree<'a> {
        let Self { accept_missing, ties_by_place, stamp, stop, .. } = *self;
        let visit = Visit { accept_missing, ties_by_place, stamp, shown, proxies: None, stop };
        self.scene.models[p.model as usize].tree_in(p.tree, &self.snapshots.0[p.model as usize], visit)
    }

    /// The model of a placed tree.
    #[inline]
    pub fn model_of(&self, placed: u64) -> &'a Model {
        &self.scene.models[self.scene.ids_of(placed).model as usize]
    }

    #[inline]
    pub(crate) fn filter(&self, placed: u64) -> Option<PartFilter<'a>> {
        self.filter_at(&self.scene.stand(placed))
    }

    /// [`SceneView::filter`] of a stand.
    #[inline]
    pub(super) fn filter_at(&self, stand: &Stand<'a>) -> Option<PartFilter<'a>> {
        let (p, parts) = (stand.ids, &stand.state.parts);
        let filter = || PartFilter {
            hidden: &parts.looks.hidden,
            first_part: p.first_part,
            touched: parts.touched(p.first_part),
            hidden_bits: parts.hidden_bits(p.first_part),
            unseen_bits: parts.unseen_bits(p.first_part),
            visible_bits: parts.visible_bits(p.first_part),
            within: None,
        };
        (!parts.looks.is_empty()).then(filter)
    }

    /// See [`SceneState::seen_by`].
    #[inline]
    pub(super) fn seen_by(&self, placed: u64) -> u32 {
        self.scene.seen_by(placed)
    }

    /// The triangle that was hit, and its model's part.
    #[inline(always)]
    pub fn triangle(&self, found: &Found) -> std::result::Result<(Triangle, u32), Need> {
        let (tree, placed) = (self.tree_with(found.tree), found.placed());
        let triangle = tree.triangle(&found.tri).ok_or_else(|| self.need(placed, tree.block_of(&found.tri)))?;
        let first_part = self.scene.ids_of(placed).first_part;
        Ok((triangle, first_part.saturating_add(triangle.part)))
    }

    pub(crate) fn need(&self, placed: u64, block: BlockId) -> Need {
        Need { model: self.scene.ids_of(placed).model, block }
    }

    /// Finds the closest hit of a ray, or any hit if `ANY`; `None` if a block is missing.
    #[inline]
    pub fn trace_at_once<const ANY: bool>(&self, ray: &Ray, walk: &mut SceneWalk) -> Option<Found> {
        if let Some(Target::Placed(placed)) = self.scene.root(Scenes::All) {
            return self.trace_in_only_tree::<ANY>(ray, placed, &mut walk.tree);
        }
        walk.begin(self, ray);
        (self.trace::<ANY>(ray, walk) == Step::Done).then(|| walk.best())
    }

    /// [`SceneView::trace_at_once`] in a scene of one placed tree, which needs no stack of places.
    fn trace_in_only_tree<const ANY: bool>(&self, ray: &Ray, placed: u64, walk: &mut Walk) -> Option<Found> {
        let mut best = Found::nothing(ray.t_max);
        if !ray.can_hit() || self.seen_by(placed) & ray.mask == 0 {
            return Some(best);
        }
        let mut local = LocalRay::NONE;
        let p = self.scene.placed(placed);
        let Some((shift, scale)) = p.local(ray, ray.t_max, self.widen_interval, &mut local) else { return Some(best) };
        let (tree, filter) = (self.tree(placed), self.filter(placed));
        walk.begin(&tree, &local);
        let outcome = if ANY { tree.any(filter.as_ref(), walk) } else { tree.closest(filter.as_ref(), walk) };
        if outcome != Outcome::Done {
            return None;
        }
        best.offer::<ANY>(self.widen_interval, &At { placed, shift, scale }, walk.best(), walk.first_cell());
        Some(best)
    }

    /// Finds the closest hit of the ray that `walk` was begun with, or any hit if `ANY`.
    pub fn trace<const ANY: bool>(&self, ray: &Ray, walk: &mut SceneWalk) -> Step {
        let mut best = walk.best();
        // Where the ray has just entered, that is known.
        let mut here = None;
        loop {
            if let Some(at) = walk.inside {
                let stand = here.take().unwrap_or_else(|| self.scene.stand(at.placed));
                if let Outcome::Pending(block) = self.trace_in::<ANY>(at, &stand, &mut walk.tree) {
                    return Step::Pending(self.need(at.placed, block));
                }
                best.offer::<ANY>(self.widen_interval, &at, walk.tree.best(), walk.tree.first_cell());
                (walk.best, walk.inside) = (Some(best), None);
                if ANY && best.is_hit() {
                    walk.top.end();
                    return Step::Done;
                }
            }
            let next = walk.top.next::<ANY>(self, ray, &mut best);
            walk.best = Some(best);
            let Some(placed) = next else { return Step::Done };
            let (stand, inside) = self.enter(ray, placed, best.reach(ray), &mut walk.tree);
            (here, walk.inside) = (Some(stand), inside);
        }
    }

    /// Continues a walk in a placed tree.
    #[inline]
    fn trace_in<const ANY: bool>(&self, at: At, stand: &Stand<'a>, walk: &mut Walk) -> Outcome {
        let (tree, mut filter) = (self.tree_at(stand), self.filter_at(stand));
        let within = self.within.map(|ends| EndsIn { ends, at });
        if let Some(within) = &within {
            filter = Some(PartFilter { within: Some(within), ..filter.unwrap_or_default() });
        }
        if ANY { tree.any(filter.as_ref(), walk) } else { tree.closest(filter.as_ref(), walk) }
    }

    /// Puts a ray into a placed tree; no placement if it certainly hits nothing there before `best`.
    #[inline]
    fn enter(&self, ray: &Ray, placed: u64, best: f64, walk: &mut Walk) -> (Stand<'a>, Option<At>) {
        let (stand, p) = self.scene.stand_placed(placed);
        if self.scene.seen_at(&stand) & ray.mask == 0 {
            return (stand, None);
        }
        let mut local = LocalRay::NONE;
        let way = p.local(ray, best, self.widen_interval, &mut local);
        if way.is_some() {
            walk.begin(&self.tree_at(&stand), &local);
        }
        (stand, way.map(|(shift, scale)| At { placed, shift, scale }))
    }
}
