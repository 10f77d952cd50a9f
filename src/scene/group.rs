//! Groups of rays in a scene: finds the placed trees that they enter, and traces them as a packet through each. Most
//! groups enter one tree or none, however many trees the scene has. The beam of the group finds that tree, and SIMD
//! code transforms the rays into its frame.

use super::alike::Alike;
use super::beam::Beam;
use super::entered::{Entered, EnteredTree};
use super::frame::{Scenes, Target};
use super::packet::ScenePacket;
use super::placed::Placed;
use super::ray_rows::RayRows;
use super::walk::{FirstCell, Found, HitTree, NOTHING, Need, SceneView, Step};
use super::widths::Width;
use crate::math::{PACKET, Ray, bits, first_rays};
use crate::structure::{LocalRay, LocalRays, Outcome, PacketWalk, PartFilter, Rooted, Tree};
use glam::DVec3;
use std::borrow::Cow;

/// Shift and scale of rays that were not moved.
const UNMOVED: (f64, f64) = (0.0, 1.0);

/// Up to a packet's rays, traced as one packet in a scene. Reusable.
pub(crate) struct Group {
    walk: Box<PacketWalk>,
    rows: Box<RayRows>,
    local: Box<LocalRays<PACKET>>,
    /// A second walk, for rays that cannot go in the same packet.
    others: Box<PacketWalk>,
    /// The placed tree that `walk` was in, if the rays enter no other.
    only: Option<u64>,
    /// Shift and scale of each ray in that tree, if any ray was moved.
    moved: [(f64, f64); PACKET],
    is_moved: bool,
    /// The packet of rays that enter several trees.
    scene: Box<ScenePacket>,
    entered: Entered,
}

impl Default for Group {
    fn default() -> Self {
        Self {
            walk: Box::default(),
            rows: Box::new(RayRows::NONE),
            local: Box::new(LocalRays::NONE),
            others: Box::default(),
            only: None,
            moved: [UNMOVED; PACKET],
            is_moved: false,
            scene: Box::default(),
            entered: Entered::default(),
        }
    }
}

impl Group {
    /// See [`PacketWalk::begin_batch`].
    pub fn begin_batch(&mut self) {
        self.walk.begin_batch();
        self.scene.begin_batch();
    }

    /// Traces rays as a packet if they are coherent (see [`PacketWalk::is_coherent`]) or miss all trees; else returns
    /// `None`. Returns the rays that hit something, or a block that some ray needs: the rays must then be begun again
    /// one by one. The first `count` entries are rays. `alike` describes these; their widths may have been set to zero
    /// since. `says` is the caller's statement that the rays are coherent.
    pub fn trace<const ANY: bool>(
        &mut self,
        view: &SceneView,
        rays: &[Ray; PACKET],
        count: usize,
        alike: &Alike,
        says: bool,
    ) -> Option<Result<u32, Need>> {
        debug_assert!(view.within.is_none(), "a double-precision interval belongs to a single ray");
        // The lengths of the rays are ignored: most have no end.
        let root = view.scene.root(Scenes::All);
        if let (Some(Target::Placed(placed)), false) = (root, alike.is_one_start()) {
            // The tree finds out as fast as a beam of many origins whether any ray meets it.
            return self.trace_in::<ANY>(view, placed, (rays, count), alike, says);
        }
        let (beam, width) = (Beam::of(&rays[..count], alike), Width::of(&rays[..count], alike));
        let is_few = view.entered(&beam, width, f64::INFINITY, &mut self.entered);
        match self.entered.trees[..] {
            [] if is_few => {
                (self.only, self.is_moved) = (Some(NOTHING), false);
                self.walk.miss();
                Some(Ok(0))
            }
            [EnteredTree { placed, .. }] if is_few => self.trace_in::<ANY>(view, placed, (rays, count), alike, says),
            _ => {
                if !(says || is_few && self.are_near(view, self.entered.trees[0].placed, (rays, count), alike)) {
                    return None;
                }
                self.only = None;
                self.scene.begin(view, rays, first_rays(count));
                if let Step::Pending(need) = view.trace_packet::<ANY>(rays, &mut self.scene) {
                    return Some(Err(need));
                }
                Some(Ok((0..count).fold(0, |all, i| all | u32::from(self.scene.best(i).is_hit()) << i)))
            }
        }
    }

    /// Traces the rays of `among` as a packet, or singly where they are not coherent; overwrites the others. Returns
    /// the rays that hit something.
    pub fn trace_among<const ANY: bool>(
        &mut self,
        view: &SceneView,
        rays: &mut [Ray; PACKET],
        among: u32,
    ) -> Result<u32, Need> {
        let Some(first) = bits(among).next() else { return Ok(0) };
        // A packet's rays are alike.
        let first = rays[first];
        bits(!among).for_each(|i| rays[i] = first);
        if let Some(met) = self.trace::<ANY>(view, rays, PACKET, &Alike::of(rays), true) {
            return met.map(|met| met & among);
        }
        self.only = None;
        self.scene.begin(view, rays, among);
        match view.trace_packet::<ANY>(rays, &mut self.scene) {
            Step::Pending(need) => Err(need),
            Step::Done => Ok(bits(among).filter(|&i| self.scene.best(i).is_hit()).fold(0, |all, i| all | 1 << i)),
        }
    }

    /// True if the rays are coherent in the first of the trees that they enter.
    fn are_near(&mut self, view: &SceneView, placed: u64, rays: (&[Ray; PACKET], usize), alike: &Alike) -> bool {
        let (stand, p) = view.scene.stand_placed(placed);
        if are_apart(&p, &rays.0[..rays.1], alike) {
            return false;
        }
        let tree = view.tree_at(&stand);
        self.begin_in(view, (&p, view.scene.seen_at(&stand)), &tree, rays, alike);
        self.walk.is_coherent(&tree, false)
    }

    /// Starts rays in a placed tree; `seen_by`: the mask of the rays that see it.
    #[inline(always)]
    fn begin_in(
        &mut self,
        view: &SceneView,
        (p, seen_by): (&Placed, u32),
        tree: &Tree,
        (rays, count): (&[Ray; PACKET], usize),
        alike: &Alike,
    ) {
        let Self { walk, rows, local, moved, is_moved, .. } = self;
        if let Some(start) = one_start(p, &rays[0], alike, seen_by)
            && set_from(start, p, tree, (rays, count), (alike, view.widen_interval), walk)
        {
            *is_moved = false;
            return walk.start(tree, first_rays(count));
        }
        let (mut among, mut best) = (0, [0.0; PACKET]);
        for (i, ray) in rays.iter().enumerate().take(count) {
            rows.set(i, ray);
            best[i] = ray.t_max;
            among |= u32::from(ray.mask & seen_by != 0) << i;
        }
        *is_moved = false;
        let inside = rows.take_all_into_tree(tree.isa(), p, among, (&best, view.widen_interval), local, |i, way| {
            if !*is_moved {
                (*is_moved, *moved) = (true, [UNMOVED; PACKET]);
            }
            moved[i] = way;
        });
        walk.set_rows(local);
        walk.start(tree, inside);
    }

    /// [`Group::trace`] of rays that enter one placed tree.
    fn trace_in<const ANY: bool>(
        &mut self,
        view: &SceneView,
        placed: u64,
        rays: (&[Ray; PACKET], usize),
        alike: &Alike,
        says: bool,
    ) -> Option<Result<u32, Need>> {
        let (stand, p) = view.scene.stand_placed(placed);
        if !says && are_apart(&p, &rays.0[..rays.1], alike) {
            return None;
        }
        let (tree, filter) = (view.tree_at(&stand), view.filter_at(&stand));
        self.only = Some(placed);
        self.begin_in(view, (&p, view.scene.seen_at(&stand)), &tree, rays, alike);
        if !self.walk.is_coherent(&tree, says) {
            return None;
        }
        let outcome = if ANY {
            tree.any_together(filter.as_ref(), &mut self.walk)
        } else {
            tree.closest_together(filter.as_ref(), &mut self.walk)
        };
        if let Outcome::Pending(block) = outcome {
            return Some(Err(view.need(placed, block)));
        }
        let mut hits = self.walk.found();
        for i in bits(hits) {
            // The walk had the greatest distance rounded up, so its hit may still be beyond. An any-hit walk has no
            // other hit to fall back on, and applies the distance up to rounding. Hits of walks with widened intervals
            // are tested later.
            let is_within = ANY || view.widen_interval || self.distance(i) <= rays.0[i].t_max;
            hits &= !(u32::from(!is_within) << i);
        }
        Some(Ok(hits))
    }

    /// The placed tree that all rays went through in [`Group::walk`]; an index of none if all missed the scene's trees;
    /// `None` if the rays went through several trees.
    #[inline]
    pub fn only(&self) -> Option<u64> {
        self.only
    }

    /// The walk through the [only](Self::only) tree.
    #[inline]
    pub fn walk(&self) -> &PacketWalk {
        &self.walk
    }

    /// [`Group::trace`] of the camera rays in `active`, which enter one placed tree. `None`: they must be traced
    /// otherwise.
    pub fn trace_camera(
        &mut self,
        view: &SceneView,
        camera: &CameraTree,
        rays: &CameraRays,
        active: u32,
    ) -> Option<Result<u32, Need>> {
        self.only = Some(camera.number);
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
                // Rays on either side of a plane through the eye go in separate packets, one after the other.
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

    /// Takes over a walk of camera rays through a placed tree, in exchange for another.
    pub fn take(&mut self, placed: u64, walk: &mut Box<PacketWalk>) {
        std::mem::swap(&mut self.walk, walk);
        (self.only, self.is_moved) = (Some(placed), false);
    }

    /// The distance of ray `i` to its hit.
    #[inline]
    pub fn distance(&self, i: usize) -> f64 {
        if self.only.is_none() { self.scene.best(i).t } else { self.in_world(i, self.walk.distances()[i]) }
    }

    /// The distances of all rays to their hits in the [only](Self::only) tree.
    #[inline]
    pub fn distances_in_tree(&self, out: &mut [f64; PACKET]) {
        let t = self.walk.distances();
        if self.is_moved {
            (0..PACKET).for_each(|i| out[i] = self.in_world(i, t[i]));
        } else {
            (0..PACKET).for_each(|i| out[i] = f64::from(t[i]));
        }
    }

    #[inline]
    fn in_world(&self, i: usize, t: f32) -> f64 {
        let (shift, scale) = if self.is_moved { self.moved[i] } else { UNMOVED };
        shift + scale * f64::from(t)
    }

    /// Rays that entered stand-ins before their hits or ends.
    #[inline]
    pub fn behind_cells(&self) -> u32 {
        if self.only.is_none() {
            return (0..PACKET).fold(0, |all, i| all | u32::from(self.scene.best(i).is_behind_cell()) << i);
        }
        let (first_cell, t) = (self.walk.first_cell(), self.walk.distances());
        // The bound excludes the case that both are infinite.
        (0..PACKET).fold(0, |all, i| all | u32::from(first_cell[i] <= t[i].min(f32::MAX)) << i)
    }

    /// True if one of the rays entered a stand-in before its interval.
    pub fn passes_early(&self, rays: &[Ray]) -> bool {
        let first_cell = |i: usize| {
            if self.only.is_none() {
                self.scene.best(i).first_cell.t
            } else {
                self.in_world(i, self.walk.first_cell()[i])
            }
        };
        rays.iter().enumerate().any(|(i, ray)| ray.t_min > 0.0 && first_cell(i) < ray.t_min)
    }

    /// Where ray `i` first entered a stand-in of the [only](Self::only) tree, which is `placed`.
    #[inline]
    pub fn first_cell(&self, i: usize, placed: u64) -> FirstCell {
        FirstCell { t: self.in_world(i, self.walk.first_cell()[i]), tree: HitTree::Placed(placed) }
    }

    /// The hit of ray `i`. `met`: true if it hits something.
    #[inline]
    pub fn found(&self, i: usize, met: bool) -> Found {
        let Some(only) = self.only else { return *self.scene.best(i) };
        let tree = if met { HitTree::Placed(only) } else { HitTree::NONE };
        Found { t: self.distance(i), tree, tri: self.walk.best(i), first_cell: self.first_cell(i, only) }
    }
}

/// Rays of a camera that are near each other.
pub(crate) struct CameraRays<'a> {
    /// The rays, with unit directions.
    pub rays: &'a RayRows,
    /// Their common origin, if they share one.
    pub eye: Option<DVec3>,
}

/// A placed tree that is visible to a camera's rays and in which they have the same distances as in the world.
pub(crate) struct CameraTree<'a> {
    pub number: u64,
    placed: Cow<'a, Placed>,
    pub tree: Tree<'a>,
    pub filter: Option<PartFilter<'a>>,
}

impl<'a> CameraTree<'a> {
    /// The placed tree `number`.
    pub fn of(view: &SceneView<'a>, number: u64) -> Self {
        let (stand, placed) = view.scene.stand_placed(number);
        Self { number, placed, tree: view.tree_at(&stand), filter: view.filter_at(&stand) }
    }

    /// True if the tree's frame is not only translated.
    pub fn is_turned(&self) -> bool {
        self.placed.only_shifted().is_none()
    }

    /// Puts rays into a walk that is still to be started; false if they must be traced otherwise.
    fn set(&self, rays: &CameraRays, walk: &mut PacketWalk) -> bool {
        if let (Some(offset), Some(eye)) = (self.placed.only_shifted(), rays.eye) {
            let org = (eye - offset).as_vec3();
            walk.set_all_but_dirs(&LocalRay { org, t_max: f32::INFINITY, ..LocalRay::NONE });
            return walk.set_dirs(&rays.rays.dir, &rays.rays.cone[1])
                && walk.is_within(&self.tree, PACKET, self.placed.near());
        }
        let mut local = LocalRays::NONE;
        let best = [f64::INFINITY; PACKET];
        let isa = self.tree.isa();
        let are_all = rays.rays.take_into_tree(isa, &self.placed, u32::MAX, (&best, false), &mut local) == u32::MAX;
        walk.set_rows(&local);
        are_all
    }

    /// Starts a walk with the rays in `active`; false if they must be traced otherwise.
    pub fn start(&self, rays: &CameraRays, active: u32, walk: &mut PacketWalk) -> bool {
        if !self.set(rays, walk) {
            return false;
        }
        walk.start(&self.tree, active);
        walk.is_coherent(&self.tree, true)
    }

    /// Continues a walk to its end; returns the rays that hit something.
    pub fn go_on(&self, view: &SceneView, walk: &mut PacketWalk) -> Result<u32, Need> {
        match self.tree.closest_together(self.filter.as_ref(), walk) {
            // The tree of a model has no members.
            Outcome::Done | Outcome::Member(_) => Ok(walk.found()),
            Outcome::Pending(block) => Err(view.need(self.number, block)),
        }
    }
}

/// The common origin of the rays in the tree's frame, if they share one, a subtraction alone takes them there, they
/// have an interval, and the tree is visible to them.
#[inline(always)]
fn one_start(p: &Placed, first: &Ray, alike: &Alike, seen_by: u32) -> Option<DVec3> {
    let offset = p.only_shifted()?;
    let do_see = alike.mask().is_some_and(|mask| mask & seen_by != 0);
    (alike.is_one_start() && first.has_interval() && do_see).then(|| first.origin - offset)
}

/// True if the origins of some rays differ by so much that [`PacketWalk::is_coherent`] is certainly false in the tree:
/// then the rays need not be taken there to find out. Looks at a few rays.
#[inline]
fn are_apart(p: &Placed, rays: &[Ray], alike: &Alike) -> bool {
    if alike.is_one_start() {
        return false;
    }
    // In a turned frame a distance along an axis may be smaller by the root of 3.
    let most = p.extent() * f64::from(PacketWalk::NEAR) * if p.only_shifted().is_some() { 1.01 } else { 1.75 };
    let (first, last) = (rays[0].origin, rays.len() - 1);
    [last / 4, last / 2, last - last / 4, last].iter().any(|&i| (rays[i].origin - first).abs().max_element() > most)
}

/// Puts rays with a common origin and interval into a walk through a tree with a frame that is only translated; false
/// if that is wrong for some ray. `origin`: their origin there.
#[inline(always)]
fn set_from(
    origin: DVec3,
    p: &Placed,
    tree: &Tree,
    (rays, count): (&[Ray; PACKET], usize),
    (alike, beyond): (&Alike, bool),
    walk: &mut PacketWalk,
) -> bool {
    let (mut local, first) = (LocalRay::NONE, &rays[0]);
    local.org = origin.as_vec3();
    let least = || rays[..count].iter().fold(f32::INFINITY, |least, it| least.min(it.dir.abs().max_element()));
    [local.t_min, local.t_max] = p.ends([first.t_min, first.t_max], origin, least, beyond);
    walk.set_all_but_dirs(&local);
    walk.set_dirs_of(tree, rays, alike.is_exact());
    walk.is_within(tree, count, p.near())
}
