//! Walks through a scene: the top-level tree, and inside each instance the walk of its tree. Like
//! those, they can be put down at a missing block and taken up again.
//!
//! A hit is the least (t, placed tree) over what the trees' own walks answer; order of visits,
//! packets and interruptions do not change it.

use super::model::Model;
use super::placed::Local;
use super::state::SceneState;
use super::top::{NodeRef, Slabs, Target};
use crate::base::error::Result;
use crate::base::ids::BlockId;
use crate::base::progress::Cancel;
use crate::math::Ray;
use crate::residency::Snapshot;
use crate::structure::bvh::trace::{LocalRay, Outcome, PACKET, PacketWalk, PartFilter, TreeView, TriHit, Walk};
use std::sync::Arc;

/// A block that a job needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
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
pub(crate) struct Snapshots(Vec<Arc<Snapshot>>);

impl Snapshots {
    /// As it is now.
    pub fn take(scene: &SceneState) -> Self {
        Self(scene.models.iter().map(|m| m.blocks().snapshot()).collect())
    }
}

/// Reads what `needs` names. Blocks; starts no threads.
pub(crate) fn fetch(scene: &SceneState, mut needs: Vec<Need>) -> Result<()> {
    needs.sort_unstable();
    needs.dedup();
    for same_model in needs.chunk_by(|a, b| a.model == b.model) {
        let blocks: Vec<BlockId> = same_model.iter().map(|n| n.block).collect();
        scene.models[same_model[0].model as usize].blocks().fetch(&blocks, 1, &Cancel::new())?;
    }
    Ok(())
}

/// Where a ray meets a placed tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// In units of the world ray's direction.
    pub t: f64,
    /// Index of the placed tree; `NOTHING` for none.
    pub placed: u32,
    pub tri: TriHit,
}

const NOTHING: u32 = u32::MAX;

impl Found {
    /// Nothing up to `t`.
    pub const fn nothing(t: f64) -> Self {
        Self { t, placed: NOTHING, tri: TriHit::none(0.0) }
    }

    pub fn is_hit(&self) -> bool {
        self.placed != NOTHING
    }

    /// Takes over a tree's hit if it is nearer, or as near and of an earlier placed tree.
    #[inline]
    fn offer<const ANY: bool>(&mut self, placed: u32, tri: TriHit, shift: f64, scale: f64) {
        if tri.is_hit() {
            let t = shift + scale * f64::from(tri.t);
            // The tree's walk had the best t rounded up: what it found may still be beyond. Where any
            // will do there is no other to fall back on, and t_max is met to rounding.
            if ANY || t < self.t || t == self.t && placed < self.placed {
                *self = Self { t, placed, tri };
            }
        }
    }
}

/// A scene and what of it is in memory: what rays are traced in.
#[derive(Clone, Copy)]
pub(crate) struct SceneView<'a> {
    pub scene: &'a SceneState,
    pub snapshots: &'a Snapshots,
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

impl SceneWalk {
    /// Puts the ray at the root.
    pub fn begin(&mut self, view: &SceneView, ray: &Ray) {
        self.todo.clear();
        self.at = None;
        self.best = Some(Found::nothing(ray.t_max));
        if is_valid(ray) {
            self.todo.extend(view.scene.placement.top.root().map(|root| (root, 0.0)));
        }
    }

    /// The best hit so far.
    pub fn best(&self) -> Found {
        self.best.unwrap_or(Found::nothing(0.0))
    }
}

/// Whether a ray can hit anything at all.
#[inline]
pub(crate) fn is_valid(ray: &Ray) -> bool {
    let size = ray.dir.abs().max_element();
    ray.origin.is_finite() && ray.dir.is_finite() && size > 0.0 && ray.t_min.max(0.0) <= ray.t_max && ray.t_min.is_finite()
}

impl<'a> SceneView<'a> {
    /// A placed tree's view.
    #[inline]
    pub fn tree(&self, placed: u32) -> TreeView<'a> {
        let p = &self.scene.placement.placed[placed as usize];
        self.model_of(placed).tree_view(p.tree, &self.snapshots.0[p.model as usize])
    }

    /// A placed tree's model.
    #[inline]
    pub fn model_of(&self, placed: u32) -> &'a Model {
        &self.scene.models[self.scene.placement.placed[placed as usize].model as usize]
    }

    #[inline]
    fn filter(&self, placed: u32) -> Option<PartFilter<'a>> {
        let p = &self.scene.placement.placed[placed as usize];
        let hidden = &self.scene.instances[p.instance as usize].parts.hidden;
        (!hidden.is_empty()).then_some(PartFilter { hidden, first_part: p.first_part })
    }

    /// Whether rays with `mask` see the placed tree.
    #[inline]
    fn sees(&self, placed: u32, mask: u32) -> bool {
        let p = &self.scene.placement.placed[placed as usize];
        let instance = &self.scene.instances[p.instance as usize];
        instance.state.visible && instance.mask & mask != 0
    }

    fn need(&self, placed: u32, block: BlockId) -> Need {
        Need { model: self.scene.placement.placed[placed as usize].model, block }
    }

    /// Finds the closest hit of the ray that `walk` was begun with (or any hit, if `ANY`).
    pub fn trace<const ANY: bool>(&self, ray: &Ray, mask: u32, walk: &mut SceneWalk) -> Step {
        let slabs = Slabs::new(ray);
        let mut best = walk.best();
        loop {
            if let Some(At { placed, shift, scale }) = walk.at {
                let (tree, filter) = (self.tree(placed), self.filter(placed));
                let outcome = if ANY {
                    tree.any(filter.as_ref(), &mut walk.tree)
                } else {
                    tree.closest(filter.as_ref(), &mut walk.tree)
                };
                if let Outcome::Pending(block) = outcome {
                    return Step::Pending(self.need(placed, block));
                }
                walk.at = None;
                best.offer::<ANY>(placed, walk.tree.best(), shift, scale);
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
                Target::Placed(placed) => self.enter(ray, mask, placed, best.t, walk),
                Target::Inner(index) => self.push_children(&slabs, ray, index, best.t, &mut walk.todo),
            }
        }
    }

    fn enter(&self, ray: &Ray, mask: u32, placed: u32, best: f64, walk: &mut SceneWalk) {
        if !self.sees(placed, mask) {
            return;
        }
        let p = &self.scene.placement.placed[placed as usize];
        if let Some(Local { ray, shift, scale }) = p.local(ray, best) {
            walk.tree.begin(&self.tree(placed), &ray);
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

/// The state of sixteen rays in a scene. Reusable.
#[derive(Default)]
pub(crate) struct ScenePacket {
    todo: Vec<(NodeRef, u32)>,
    at: Option<u32>,
    /// Of the tree that the packet is in.
    moved: [(f64, f64); PACKET],
    inside: u32,
    tree: PacketWalk,
    best: Vec<Found>,
    slabs: Vec<Slabs>,
    /// Rays that still look for something.
    active: u32,
}

impl ScenePacket {
    /// Puts the rays of `active` (bit `i`: ray `i`) at the root.
    pub fn begin(&mut self, view: &SceneView, rays: &[Ray; PACKET], active: u32) {
        self.todo.clear();
        self.at = None;
        self.best.clear();
        self.best.extend(rays.iter().map(|r| Found::nothing(r.t_max)));
        self.active = (0..PACKET).filter(|&i| active >> i & 1 == 1 && is_valid(&rays[i])).fold(0, |m, i| m | 1 << i);
        let Some(root) = view.scene.placement.top.root() else { return };
        if let Target::Inner(_) = root.target() {
            self.slabs.clear();
            self.slabs.extend(rays.iter().map(Slabs::new));
        }
        self.todo.push((root, self.active));
    }

    /// The best hit so far of ray `i`.
    #[inline]
    pub fn best(&self, i: usize) -> Found {
        self.best[i]
    }
}

impl SceneView<'_> {
    /// Sixteen rays at once: the same hits as [`SceneView::trace`] finds for each alone.
    pub fn trace16<const ANY: bool>(&self, rays: &[Ray; PACKET], masks: &[u32; PACKET], walk: &mut ScenePacket) -> Step {
        loop {
            if let Some(placed) = walk.at {
                let (tree, filter) = (self.tree(placed), self.filter(placed));
                let outcome = if ANY {
                    tree.any16(filter.as_ref(), &mut walk.tree)
                } else {
                    tree.closest16(filter.as_ref(), &mut walk.tree)
                };
                if let Outcome::Pending(block) = outcome {
                    return Step::Pending(self.need(placed, block));
                }
                walk.at = None;
                for i in bits(walk.inside) {
                    let (shift, scale) = walk.moved[i];
                    walk.best[i].offer::<ANY>(placed, walk.tree.best(i), shift, scale);
                    if ANY && walk.best[i].is_hit() {
                        walk.active &= !(1 << i);
                    }
                }
            }
            let Some((node, mask)) = walk.todo.pop() else { return Step::Done };
            match node.target() {
                Target::Placed(placed) => self.enter16(rays, masks, placed, mask & walk.active, walk),
                Target::Inner(index) => self.push_children16(rays, index, mask & walk.active, walk),
            }
        }
    }

    fn enter16(&self, rays: &[Ray; PACKET], masks: &[u32; PACKET], placed: u32, mask: u32, walk: &mut ScenePacket) {
        let p = &self.scene.placement.placed[placed as usize];
        let mut local = [OUTSIDE; PACKET];
        walk.inside = 0;
        for i in bits(mask) {
            if self.sees(placed, masks[i])
                && let Some(l) = p.local(&rays[i], walk.best[i].t)
            {
                local[i] = l.ray;
                walk.moved[i] = (l.shift, l.scale);
                walk.inside |= 1 << i;
            }
        }
        if walk.inside != 0 {
            walk.tree.begin(&self.tree(placed), &local, walk.inside);
            walk.at = Some(placed);
        }
    }

    fn push_children16(&self, rays: &[Ray; PACKET], index: u32, mask: u32, walk: &mut ScenePacket) {
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
}

/// A lane without a ray.
const OUTSIDE: LocalRay = LocalRay {
    org: glam::Vec3::ZERO,
    dir: glam::Vec3::X,
    t_min: 0.0,
    t_max: 0.0,
    cone: crate::math::Cone::ZERO,
};

/// The set bits of a mask, by number.
pub(crate) fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let i = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            i
        })
    })
}
