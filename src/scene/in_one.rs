//! Rays in a scene that is one placed tree, the most frequent kind: there is no top-level tree to walk.

use super::alike::Alike;
use super::placed::Placed;
use super::walk::{Found, NOTHING, Need, SceneStream, SceneView, bits};
use crate::math::{DBounds, PACKET, Ray, first_rays};
use crate::structure::{LocalRay, Outcome, PacketWalk, PartFilter, Tree};
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
    /// Around all that rays of this batch can hit, in the tree's frame; endless where that is not known.
    around: DBounds,
}

const ENDLESS: DBounds = DBounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };

impl Default for InOne {
    fn default() -> Self {
        Self { walk: Box::default(), others: Box::default(), moved: [UNMOVED; PACKET], is_moved: false, around: ENDLESS }
    }
}

impl InOne {
    /// See [`PacketWalk::begin_batch`]; what comes until the next one is asked in `view`.
    pub fn begin_batch(&mut self, view: &SceneView) {
        self.walk.begin_batch();
        self.around = around_hits(view).unwrap_or(ENDLESS);
    }

    /// Traces rays together if they go the same way (see [`PacketWalk::is_coherent`]) or pass by; else `None`. Returns those that hit
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
        let seen_by = view.seen_by(placed);
        let Self { walk, moved, is_moved, around, .. } = self;
        let one_start = one_start(p, &rays[0], alike, seen_by);
        if one_start.is_some_and(|origin| pass_by(around, p.extent(), origin, alike.dirs())) {
            *is_moved = false;
            walk.miss();
            return Some(Ok(0));
        }
        let (tree, filter) = (view.tree(placed), view.filter(placed));
        let is_unmoved = set_unmoved(p, &tree, (rays, count), (alike, one_start), (seen_by, view.looks_beyond), walk);
        *is_moved = !(is_unmoved && walk.is_within(&tree, count, p.near()));
        let active = if *is_moved { set_moved(p, &rays[..count], (seen_by, view.looks_beyond), walk, moved) } else { first_rays(count) };
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
            // other to fall back on, and it is met to rounding; who looks beyond decides later.
            let is_within = ANY || view.looks_beyond || self.distance(i) <= rays[i].t_max;
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

    /// Whether one of the rays passed a cell before it begins.
    pub fn passes_early(&self, rays: &[Ray]) -> bool {
        let passed = self.walk.passed();
        rays.iter().enumerate().any(|(i, ray)| ray.t_min > 0.0 && self.in_world(i, passed[i]) < ray.t_min)
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
    pub tree: Tree<'a>,
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
            match if it.mask & seen_by != 0 { p.local(it, it.t_max, self.looks_beyond, &mut local) } else { None } {
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
            found.offer::<ANY>(self.looks_beyond, placed, *hit, stream.passed()[i], moved[i].0, moved[i].1);
        }
    }
}

/// Around all that rays can hit in a scene that is one placed tree, in that one's frame: the boxes of its root's children, for a ray that meets a
/// cell or a leaf has met those of all above it. (Bounds of triangles will not do: cells are rounded outward, and stand in.)
fn around_hits(view: &SceneView) -> Option<DBounds> {
    let all = view.tree(view.only_one()?).around_hits()?;
    Some(DBounds { min: all.min.as_dvec3(), max: all.max.as_dvec3() })
}

/// By what part of what is far away that is taken larger, 512 h (`h`: 2^-24): boxes give way by 64 h as walks see them, and are rounded by 24 h (see
/// [`crate::structure`]).
const ASIDE: f64 = 1.0 / 32_768.0;

/// Whether rays from `origin` whose directions are between `ends` along each axis all pass by a box: there is no way along any such direction
/// that is within it on all axes at once. `reach`: of the tree whose content the box holds. (Most of a picture around a model is beside it: these rays need not be prepared.)
#[inline(always)]
fn pass_by(around: &DBounds, reach: f64, origin: DVec3, ends: [[f32; 2]; 3]) -> bool {
    let (low, high) = (around.min - origin, around.max - origin);
    let aside = ASIDE * (low.abs().max(high.abs()).max_element() + reach);
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

/// Where rays that all begin where the first does do so in the tree's frame, if they are taken there by nothing but a subtraction, have an interval, and see
/// the tree.
#[inline(always)]
fn one_start(p: &Placed, first: &Ray, alike: &Alike, seen_by: u32) -> Option<DVec3> {
    let offset = p.only_shifted()?;
    let do_see = alike.mask().is_some_and(|mask| mask & seen_by != 0);
    (alike.is_one_start() && first.has_interval() && do_see).then(|| first.origin - offset)
}

/// Takes rays into the tree's frame by nothing but a subtraction; false if that will not do for all. ([`PacketWalk::is_within`] may say so still.)
#[inline(always)]
fn set_unmoved(
    p: &Placed,
    tree: &Tree,
    (rays, count): (&[Ray; PACKET], usize),
    (alike, one_start): (&Alike, Option<DVec3>),
    (seen_by, beyond): (u32, bool),
    walk: &mut PacketWalk,
) -> bool {
    let Some(offset) = p.only_shifted() else { return false };
    let mut local = LocalRay::NONE;
    if alike.is_one_start() {
        let it = &rays[0];
        let Some(origin) = one_start else { return false };
        local.org = origin.as_vec3();
        let least = || rays[..count].iter().fold(f32::INFINITY, |least, it| least.min(it.dir.abs().max_element()));
        [local.t_min, local.t_max] = p.ends([it.t_min, it.t_max], origin, least, beyond);
        walk.set_all_but_dirs(&local);
        walk.set_dirs_of(tree, rays, alike.is_exact());
        return true;
    }
    let mut is_fine = true;
    for (i, it) in rays.iter().enumerate().take(count) {
        is_fine &= it.mask & seen_by != 0 && it.has_interval();
        let origin = it.origin - offset;
        local.org = origin.as_vec3();
        local.dir = it.dir;
        local.cone = LocalRay::cone_of(it.cone, it.dir);
        [local.t_min, local.t_max] = p.ends([it.t_min, it.t_max], origin, || it.dir.abs().max_element(), beyond);
        walk.set(i, &local);
    }
    is_fine
}

/// Takes rays into the tree's frame, whatever it takes; returns those that can hit something there.
#[inline(never)]
fn set_moved(p: &Placed, rays: &[Ray], (seen_by, beyond): (u32, bool), walk: &mut PacketWalk, moved: &mut [(f64, f64); PACKET]) -> u32 {
    let mut active = 0;
    let mut local = LocalRay::NONE;
    for (i, it) in rays.iter().enumerate().take(PACKET) {
        if it.mask & seen_by != 0
            && let Some(way) = p.local(it, it.t_max, beyond, &mut local)
        {
            moved[i] = way;
            active |= 1 << i;
            walk.set(i, &local);
        }
    }
    active
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the slabs of single rays, of all corners of the directions' box and its middle: where one of them meets the box, they do not pass by.
    #[test]
    fn who_meets_a_box_does_not_pass_by() {
        let mut state = 1u32;
        let mut next = |low: f64, high: f64| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * f64::from(state >> 8) / f64::from(1 << 24)
        };
        let (mut meet, mut aside) = (0, 0);
        for _ in 0..50_000 {
            let min = DVec3::new(next(-3.0, 2.0), next(-3.0, 2.0), next(-3.0, 2.0));
            let around = DBounds { min, max: min + DVec3::new(next(0.0, 2.0), next(0.0, 2.0), next(0.0, 2.0)) };
            let origin = DVec3::new(next(-4.0, 4.0), next(-4.0, 4.0), next(-4.0, 4.0));
            let ends = [0; 3].map(|_| {
                let middle = next(-1.0, 1.0);
                let half = if next(0.0, 1.0) < 0.3 { 0.0 } else { next(0.0, 0.3) };
                if next(0.0, 1.0) < 0.1 { [0.0, 0.0] } else { [(middle - half) as f32, (middle + half) as f32] }
            });
            let meets = |dir: DVec3| {
                let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
                for axis in 0..3 {
                    let (low, high) = (around.min[axis] - origin[axis], around.max[axis] - origin[axis]);
                    if dir[axis] == 0.0 {
                        leave = if low <= 0.0 && high >= 0.0 { leave } else { -1.0 };
                    } else {
                        let (a, b) = (low / dir[axis], high / dir[axis]);
                        (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
                    }
                }
                enter <= leave
            };
            let dir = |i: usize, axis: usize| f64::from([ends[axis][0], ends[axis][1], (ends[axis][0] + ends[axis][1]) * 0.5][i / 3usize.pow(axis as u32) % 3]);
            let any = (0..27).any(|i| meets(DVec3::new(dir(i, 0), dir(i, 1), dir(i, 2))));
            let passes = pass_by(&around, 5.0, origin, ends);
            assert!(!(any && passes), "{around:?}, {origin}, {ends:?}");
            (meet, aside) = (meet + usize::from(any), aside + usize::from(passes));
        }
        assert!(meet > 1000 && aside > 30_000, "{meet}, {aside}");
        assert!(!pass_by(&ENDLESS, 1.0, DVec3::ONE, [[1.0, 1.0]; 3]));
        assert!(!pass_by(&DBounds::EMPTY, 1.0, DVec3::ONE, [[1.0, 1.0]; 3]));
    }
}
