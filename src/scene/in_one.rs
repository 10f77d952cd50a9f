//! Rays in a scene that is one placed tree, the most frequent kind: there is no top-level tree to walk.

use super::alike::Alike;
use super::placed::{Placed, not_below};
use super::walk::{Found, NOTHING, Need, SceneStream, SceneView, bits};
use crate::math::Ray;
use crate::structure::bvh::trace::{LocalRay, Outcome, PACKET, PacketWalk, PartFilter, TreeView, first_rays};
use glam::DVec3;

/// Shift and scale of rays that were not moved.
const UNMOVED: (f64, f64) = (0.0, 1.0);

/// Up to a packet's rays together in a scene that is one placed tree. Reusable.
pub(crate) struct InOne {
    pub walk: Box<PacketWalk>,
    /// For rays that cannot go together.
    others: Box<PacketWalk>,
    /// Shift and scale of each ray in the tree, if any was moved.
    moved: [(f64, f64); PACKET],
    is_moved: bool,
}

impl Default for InOne {
    fn default() -> Self {
        Self { walk: Box::default(), others: Box::default(), moved: [UNMOVED; PACKET], is_moved: false }
    }
}

impl InOne {
    /// See [`PacketWalk::begin_batch`].
    pub fn begin_batch(&mut self) {
        self.walk.begin_batch();
    }

    /// Traces rays together if they go the same way (see [`PacketWalk::is_coherent`]); else `None`. Returns those that hit
    /// something, or the block that some ray needs: then they are to be begun anew, each alone. The first `count` are rays; `alike`: of
    /// these, maybe with widths that count as none since.
    pub fn trace<const ANY: bool>(
        &mut self,
        view: &SceneView,
        rays: &[Ray; PACKET],
        count: usize,
        alike: &Alike,
        says: bool,
    ) -> Option<Result<u32, Need>> {
        let placed = view.only_one()?;
        let p = &view.scene.placement.placed[placed as usize];
        let (tree, filter) = (view.tree(placed), view.filter(placed));
        let seen_by = view.seen_by(placed);
        let Self { walk, moved, is_moved, .. } = self;
        let taken = set_unmoved(p, &tree, (rays, count), alike, seen_by, walk);
        if taken == Taken::ToPassBy {
            *is_moved = false;
            walk.miss();
            return Some(Ok(0));
        }
        *is_moved = !(taken == Taken::Unmoved && walk.is_within(&tree, count, p.near()));
        let active = if *is_moved { set_moved(p, &rays[..count], seen_by, walk, moved) } else { first_rays(count) };
        walk.start(&tree, active);
        if !walk.is_coherent(&tree, says) {
            return None;
        }
        let outcome = if ANY {
            tree.any_together(filter.as_ref(), walk)
        } else {
            tree.closest_together(filter.as_ref(), walk)
        };
        if let Outcome::Pending(block) = outcome {
            return Some(Err(view.need(placed, block)));
        }
        let mut hits = walk.found();
        for i in bits(hits) {
            // The walk had the greatest distance rounded up: what it found may still be beyond. Where any will do there is no
            // other to fall back on, and it is met to rounding.
            let is_within = ANY || self.distance(i) <= rays[i].t_max;
            hits &= !(u32::from(!is_within) << i);
        }
        Some(Ok(hits))
    }

    /// [`InOne::trace`] of those in `active` of a camera's rays. `None`: they must be traced otherwise.
    pub fn trace_camera(&mut self, view: &SceneView, rays: &CameraRays, active: u32) -> Option<Result<u32, Need>> {
        let camera = CameraTree::of(view)?;
        let Self { walk, others, .. } = self;
        self.is_moved = false;
        let (mut are_apart, mut left) = (false, active);
        loop {
            if !camera.set(rays, walk) {
                return None;
            }
            let class = if are_apart { walk.alike(left) } else { active };
            walk.start(&camera.tree, class);
            if !are_apart && !walk.is_coherent(&camera.tree, true) {
                // Those to either side of a plane through the eye go one after the other.
                are_apart = true;
                continue;
            }
            if let Err(need) = camera.go_on(view, walk) {
                return Some(Err(need));
            }
            if left != active {
                walk.join(class, others);
            }
            left &= !class;
            if left == 0 {
                return Some(Ok(walk.found()));
            }
            std::mem::swap(walk, others);
        }
    }

    /// Takes over a walk of camera's rays, in exchange for another.
    pub fn take(&mut self, walk: &mut Box<PacketWalk>) {
        std::mem::swap(&mut self.walk, walk);
        self.is_moved = false;
    }

    /// How far ray `i` goes to its hit.
    #[inline]
    pub fn distance(&self, i: usize) -> f64 {
        self.in_world(i, self.walk.distances()[i])
    }

    #[inline]
    fn in_world(&self, i: usize, t: f32) -> f64 {
        let (shift, scale) = if self.is_moved { self.moved[i] } else { UNMOVED };
        shift + scale * f64::from(t)
    }

    /// Rays that passed a stand-in on their ways to their hits, or as far as they go.
    #[inline]
    pub fn have_passed(&self) -> u32 {
        let (passed, t) = (self.walk.passed(), self.walk.distances());
        // Not where both are infinite.
        (0..PACKET).fold(0, |all, i| all | u32::from(passed[i] <= t[i].min(f32::MAX)) << i)
    }

    /// What ray `i` finds in `view`; `met`: it hits something.
    #[inline]
    pub fn found(&self, view: &SceneView, i: usize, met: bool) -> Found {
        let placed = view.only_one().filter(|_| met).unwrap_or(NOTHING);
        Found { t: self.distance(i), placed, tri: self.walk.best(i), passed: self.in_world(i, self.walk.passed()[i]) }
    }
}

/// Rays of a camera that all begin at `eye` and are near each other.
pub(crate) struct CameraRays<'a> {
    pub eye: DVec3,
    /// Axis by axis.
    pub dir: &'a [[f32; PACKET]; 3],
    /// Of each at distance 1.
    pub width: &'a [f32; PACKET],
}

/// A placed tree that a camera's rays only have to be shifted into, and that they see.
pub(crate) struct CameraTree<'a> {
    placed: u32,
    offset: DVec3,
    near: f32,
    pub tree: TreeView<'a>,
    pub filter: Option<PartFilter<'a>>,
}

impl<'a> CameraTree<'a> {
    /// That of a scene, if it is one.
    pub fn of(view: &'a SceneView) -> Option<Self> {
        let placed = view.only_one().filter(|&placed| view.seen_by(placed) != 0)?;
        let p = &view.scene.placement.placed[placed as usize];
        let (tree, filter) = (view.tree(placed), view.filter(placed));
        Some(Self { placed, offset: p.only_shifted()?, near: p.near(), tree, filter })
    }

    /// Puts rays into a walk, to be started; false if they must be traced otherwise.
    fn set(&self, rays: &CameraRays, walk: &mut PacketWalk) -> bool {
        let org = (rays.eye - self.offset).as_vec3();
        walk.set_all_but_dirs(&LocalRay { org, t_max: f32::INFINITY, ..LocalRay::NONE });
        walk.set_dirs(rays.dir, rays.width) && walk.is_within(&self.tree, PACKET, self.near)
    }

    /// Starts a walk with those of the rays in `active`; false if they must be traced otherwise.
    pub fn start(&self, rays: &CameraRays, active: u32, walk: &mut PacketWalk) -> bool {
        if !self.set(rays, walk) {
            return false;
        }
        walk.start(&self.tree, active);
        walk.is_coherent(&self.tree, true)
    }

    /// Goes on with a walk to its end: the rays that hit something.
    pub fn go_on(&self, view: &SceneView, walk: &mut PacketWalk) -> Result<u32, Need> {
        match self.tree.closest_together(self.filter.as_ref(), walk) {
            Outcome::Done => Ok(walk.found()),
            Outcome::Pending(block) => Err(view.need(self.placed, block)),
        }
    }
}

impl SceneView<'_> {
    /// [`SceneView::trace_each`] in a scene that is one placed tree: side by side.
    pub(super) fn each_in_one<const ANY: bool>(&self, placed: u32, rays: &[Ray], walk: &mut SceneStream, found: &mut [Found]) {
        let p = &self.scene.placement.placed[placed as usize];
        let seen_by = self.seen_by(placed);
        let SceneStream { tree: stream, moved, hits, unfinished, .. } = walk;
        let hits = &mut hits[..rays.len()];
        let mut local = LocalRay::NONE;
        for (i, it) in rays.iter().enumerate() {
            match if it.mask & seen_by != 0 { p.local(it, it.t_max, &mut local) } else { None } {
                Some(way) => {
                    stream.set(i, &local);
                    moved[i] = way;
                }
                None => stream.set(i, &LocalRay::NONE),
            }
        }
        let (tree, filter) = (self.tree(placed), self.filter(placed));
        if ANY {
            tree.any_each(filter.as_ref(), stream, hits);
        } else {
            tree.closest_each(filter.as_ref(), stream, hits);
        }
        unfinished.extend_from_slice(stream.unfinished());
        for (i, (hit, found)) in hits.iter().zip(found).enumerate() {
            *found = Found::nothing(rays[i].t_max);
            found.offer::<ANY>(placed, *hit, stream.passed()[i], moved[i].0, moved[i].1);
        }
    }
}

/// What became of rays that were to be taken into a tree's frame by nothing but a subtraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Taken {
    /// It does not do for them.
    Not,
    /// They were; whether it does, [`PacketWalk::is_within`] tells.
    Unmoved,
    /// They were, and none comes near the tree.
    ToPassBy,
}

/// By what part of what is far away a tree's bounds are taken larger: several times what single precision and the walks' slack lose.
const ASIDE: f64 = 1.0 / 32_768.0;

/// Whether rays from `origin` whose directions are between `ends` along each axis all pass by a tree: there is no way along any such direction
/// that is within its bounds on all axes at once. (Most of a picture around a model is beside it: these rays need not be prepared.)
#[inline(always)]
fn pass_by(p: &Placed, origin: DVec3, ends: [[f32; 2]; 3]) -> bool {
    let (low, high) = (p.bounds.min - origin, p.bounds.max - origin);
    let aside = ASIDE * (low.abs().max(high.abs()).max_element() + p.extent());
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let [least, greatest] = ends[axis].map(f64::from);
        let (low, high) = (low[axis] - aside, high[axis] + aside);
        // Seen along the axis from where the nearer side is in front; what is behind is met by none.
        let (low, high, least, greatest) = if high < 0.0 { (-high, -low, -greatest, -least) } else { (low, high, least, greatest) };
        if low > 0.0 {
            // The fastest comes there first, the slowest leaves it last.
            enter = if greatest > 0.0 { enter.max(low / greatest) } else { f64::INFINITY };
        }
        if least > 0.0 {
            leave = leave.min(high / least);
        } else if greatest < 0.0 {
            leave = leave.min(low / greatest);
        }
    }
    // Not where anything is not a number.
    enter > leave
}

/// Takes rays into the tree's frame by nothing but a subtraction, if that may do for all.
#[inline(always)]
fn set_unmoved(
    p: &Placed,
    tree: &TreeView,
    (rays, count): (&[Ray; PACKET], usize),
    alike: &Alike,
    seen_by: u32,
    walk: &mut PacketWalk,
) -> Taken {
    let Some(offset) = p.only_shifted() else { return Taken::Not };
    let mut local = LocalRay::NONE;
    if alike.is_one_start() {
        let it = &rays[0];
        if !(it.has_interval() && alike.mask().is_some_and(|mask| mask & seen_by != 0)) {
            return Taken::Not;
        }
        local.org = (it.origin - offset).as_vec3();
        local.t_min = it.t_min as f32;
        local.t_max = not_below(it.t_max);
        walk.set_all_but_dirs(&local);
        let ends = walk.set_dirs_of(tree, rays, alike.is_exact());
        // What fills the lanes of a part of a packet has no say.
        return if count == PACKET && pass_by(p, it.origin, ends) { Taken::ToPassBy } else { Taken::Unmoved };
    }
    let mut is_fine = true;
    for (i, it) in rays.iter().enumerate().take(count) {
        is_fine &= it.mask & seen_by != 0 && it.has_interval();
        local.org = (it.origin - offset).as_vec3();
        local.dir = it.dir;
        local.cone = LocalRay::cone_of(it.cone, it.dir);
        local.t_min = it.t_min as f32;
        local.t_max = not_below(it.t_max);
        walk.set(i, &local);
    }
    if is_fine { Taken::Unmoved } else { Taken::Not }
}

/// Takes rays into the tree's frame, whatever it takes; returns those that can hit something there.
#[inline(never)]
fn set_moved(p: &Placed, rays: &[Ray], seen_by: u32, walk: &mut PacketWalk, moved: &mut [(f64, f64); PACKET]) -> u32 {
    let mut active = 0;
    let mut local = LocalRay::NONE;
    for (i, it) in rays.iter().enumerate().take(PACKET) {
        if it.mask & seen_by != 0
            && let Some(way) = p.local(it, it.t_max, &mut local)
        {
            moved[i] = way;
            active |= 1 << i;
            walk.set(i, &local);
        }
    }
    active
}
