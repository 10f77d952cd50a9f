//! Turns hits in a tree into answers, for rows of up to `N` rays that hit something in the same placed tree. A packet
//! is a row of [`PACKET`] rays, a single ray a row of one. One implementation computes the requested fields for both,
//! so the results are the same to the bit. If the tree is turned or scaled in the world, rows are taken to its frame
//! and back.

mod meeting;
mod meetings;
mod shading;
pub(crate) mod stand_in;
mod tree_hits;
mod triangle;

pub(crate) use meeting::{clamped_weights, distance, meet};
pub(crate) use shading::weights;
use shading::{shading_normal, world_corners};
pub(crate) use tree_hits::TreeHits;
pub(crate) use triangle::WorldNormal;

use super::hit::{Hit, HitKind, NONE, Want};
use crate::base::ids::BlockId;
use crate::math::{Ray, bits};
use crate::scene::placed::Placed;
use crate::scene::walk::{FirstCell, Found, HitTree, Need, SceneView};
use crate::structure::surface::Groups;
use crate::structure::{Rooted, Tree, TriHit};
use glam::{DVec3, Vec3};
use meetings::Meetings;
use shading::Corners;
use stand_in::StandIns;
use triangle::Triangles;

/// A tree that rays of a row have hit.
#[derive(Clone, Copy)]
pub(crate) struct InTree<'a> {
    pub view: &'a SceneView<'a>,
    /// The tree, and its frame.
    pub id: HitTree,
    pub placed: &'a Placed,
}

impl<'a> InTree<'a> {
    #[inline(always)]
    pub fn tree(&self) -> Tree<'a> {
        self.view.tree_with(self.id)
    }

    /// The number of the placed tree; `None` if rays have hit stand-ins for several.
    pub fn number(&self) -> Option<u64> {
        match self.id {
            HitTree::Placed(number) => Some(number),
            HitTree::Top { .. } => None,
        }
    }

    /// The block that a hit in the tree needs first.
    pub fn need_of(&self, hit: &TriHit) -> Need {
        self.need(self.tree().block_of(hit))
    }

    /// A block of the tree. (All blocks of a top tree are in memory.)
    pub fn need(&self, block: BlockId) -> Need {
        self.view.need(self.id.number(), block)
    }
}

/// The surfaces and stand-ins that up to `N` rays hit in a placed tree. Reusable.
#[derive(Debug)]
#[repr(C, align(64))]
pub(crate) struct Seen<const N: usize> {
    triangles: Triangles<N>,
    stand_ins: StandIns<N>,
    groups: Groups<N>,
    corners: Corners<N>,
    meetings: Meetings<N>,
}

impl<const N: usize> Default for Seen<N> {
    fn default() -> Self {
        Self::NONE
    }
}

/// Rays without a complete answer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rest {
    /// Rays with a hit that turned out to lie outside their interval. The hit within the interval remains to be found,
    /// see [`super::beyond::past`].
    pub outside: u32,
    /// Rays that need a block that is not in memory, see [`lacking`].
    pub lacking: u32,
}

impl Rest {
    pub fn is_none(self) -> bool {
        self.outside | self.lacking == 0
    }
}

impl<const N: usize> Seen<N> {
    pub const NONE: Self = Self {
        triangles: Triangles::NONE,
        stand_ins: StandIns::NONE,
        groups: Groups::NONE,
        corners: Corners::NONE,
        meetings: Meetings::NONE,
    };

    /// Loads the data of the hits of `rays`; `dir` gives the rays' directions in the world. Returns the rays whose
    /// hits' blocks have left the snapshot. `normals` requests the normals of triangles; `is_whole`: see
    /// [`StandIns::look`].
    #[inline(always)]
    pub fn look(
        &mut self,
        at: &InTree,
        rays: u32,
        dir: impl Fn(usize) -> Vec3,
        hits: &(impl TreeHits<N> + ?Sized),
        [normals, is_whole]: [bool; 2],
    ) -> u32 {
        let tree = at.tree();
        hits.group(tree.isa(), rays, &mut self.groups);
        let mut gone = 0;
        if self.groups.count != 0 {
            gone |= self.triangles.look(&tree, at.placed, &mut self.groups, |i| hits.hit(i), normals);
        }
        if self.groups.cells != 0 {
            gone |= self.stand_ins.look(at, &tree, self.groups.cells, dir, hits, is_whole);
        }
        self.groups.cells &= !gone;
        gone
    }

    /// Rays that hit stand-ins.
    pub fn cells(&self) -> u32 {
        self.groups.cells
    }

    /// Rays that hit stand-ins for data that is not in memory.
    pub fn missing(&self) -> u32 {
        if self.groups.cells == 0 { 0 } else { self.stand_ins.missing() }
    }

    /// Rays that hit stand-ins with colours of their own.
    pub fn coloured(&self) -> u32 {
        if self.groups.cells == 0 { 0 } else { self.stand_ins.coloured() }
    }

    /// The stand-ins that rays hit.
    pub fn stand_ins(&self) -> &StandIns<N> {
        &self.stand_ins
    }

    /// Writes, for each ray, the unit normal that faces the ray and the model's part. The directions `dir` must be
    /// unit.
    pub fn each(&self, at: &InTree, dir: &[[f32; N]; 3], normals: &mut [[f32; N]; 3], parts: &mut [u32; N]) {
        self.triangles.normals_of_rays(at.view.scene.context().isa(), &self.groups, dir, normals);
        for (column, rays) in self.groups.rays.iter().enumerate().take(self.groups.count) {
            let part = at.placed.first_part.saturating_add(self.triangles.part(column));
            bits(*rays).for_each(|i| parts[i] = part);
        }
        for i in bits(self.cells()) {
            let normal = self.stand_ins.normal(i);
            (normals[0][i], normals[1][i], normals[2][i]) = (normal.x, normal.y, normal.z);
            parts[i] = self.stand_ins.part(i);
        }
    }

    /// Fills in `out` the fields in `want` for the hits of `met`, rays that all hit something in the placed tree. The
    /// entries of `out` must be [`Hit::MISS`] or must have been filled with the same `want`.
    ///
    /// If the view widens intervals, the result includes the rays whose hits lie outside of their intervals. For
    /// triangles, double precision decides this.
    #[inline(always)]
    pub(super) fn answer(
        &mut self,
        at: &InTree,
        want: Want,
        rays: &[Ray],
        hits: &(impl TreeHits<N> + ?Sized),
        met: u32,
        out: &mut [Hit; N],
    ) -> Rest {
        let (widen_interval, p) = (at.view.widen_interval, at.placed);
        let instance = at.number().map(|number| (at.view.scene.instance_id(p.instance), number));
        let (mut rest, mut near_end, mut inside) = (Rest::default(), 0, 0);
        for i in bits(met) {
            let (hit, met, ray, t) = (&mut out[i], hits.hit(i), &rays[i], hits.t(i));
            let uv;
            match met.stand_in() {
                None => {
                    if widen_interval && p.is_near_end(ray, t) {
                        near_end |= 1 << i;
                    }
                    (hit.kind, hit.t, uv) = (HitKind::Exact, t, [met.u, met.v]);
                }
                Some(cell) => {
                    // A stand-in that the ray enters before its interval does not count, unless the triangles below it
                    // are missing: those within the interval are tested one by one.
                    if widen_interval && !(is_within(ray, t) || cell.is_missing && t <= ray.t_max) {
                        rest.outside |= 1 << i;
                    }
                    (hit.kind, hit.t, uv) = (HitKind::Lod, stand_in::within(t, ray), [0.0; 2]);
                    if cell.is_missing {
                        hit.kind = HitKind::Missing;
                        inside |= u32::from(cell.is_inside) << i;
                    }
                }
            }
            if want.has(Want::UV) {
                hit.uv = uv;
            }
            if want.has(Want::INSTANCE) {
                (hit.instance, hit.occurrence) = instance.unwrap_or((NONE, NONE));
            }
        }
        let asks_cells = want.has(Want::INSTANCE) && instance.is_none();
        let is_asked = want.any_of(Want::SURFACE) || asks_cells;
        let looked_at = if is_asked { met } else { near_end | inside } & !rest.outside;
        if looked_at != 0 {
            let asks = [want.any_of(Want::NORMALS), want.has(Want::ERROR)];
            rest.lacking = self.look(at, looked_at, |i| rays[i].dir, hits, asks);
            rest.outside |= self.fill_triangles(at, want, rays, hits, near_end, out);
            if self.groups.cells != 0 {
                self.fill_cells(at, want, rays, hits, out);
            }
            for i in bits(rest.lacking) {
                // The entry may belong to another ray: none of its members may stay.
                out[i] = Hit { t: hits.t(i), ..Hit::MISS };
                promise_nothing(&mut out[i], &rays[i], want);
            }
        }
        if want.has(Want::SHADING_NORMAL) {
            self.fill_shading(at, rays, hits, out, &mut rest);
        }
        if want.has(Want::PRIM) {
            self.fill_prims(at, hits, met, out, &mut rest);
        }
        if want.any_of(Want::UV | Want::PRIM) && at.tree().has_parameters() {
            fill_parameters(at, want, hits, met & !rest.lacking, out);
        }
        rest
    }

    /// Fills the fields of triangle hits. Returns the rays with hits outside of their intervals.
    #[inline(always)]
    fn fill_triangles(
        &mut self,
        at: &InTree,
        want: Want,
        rays: &[Ray],
        hits: &(impl TreeHits<N> + ?Sized),
        near_end: u32,
        out: &mut [Hit; N],
    ) -> u32 {
        let Some(number) = at.number() else { return 0 };
        let parts = at.view.model_of(number).parts();
        let precise = if want.any_of(Want::MEETING) { u32::MAX } else { near_end };
        let mut outside = 0;
        for column in 0..self.groups.count {
            let group = self.groups.rays[column & (N - 1)];
            if want.has(Want::PART) {
                let part = at.placed.first_part.saturating_add(self.triangles.part(column));
                let id = parts.id(part as usize).unwrap_or(NONE);
                bits(group).for_each(|i| out[i].part = id);
            }
            if want.has(Want::NORMAL) {
                let normal = self.triangles.normal(column);
                bits(group).for_each(|i| out[i].normal = normal.facing(rays[i].dir));
            }
        }
        let to_meet = self.meet(at, precise, |i| (rays[i].origin, rays[i].dir), |i| hits.t(i));
        for i in bits(to_meet) {
            self.fill_from_meeting(i, &rays[i], want, &mut out[i]);
            let cell = hits.first_cell(i, at);
            if want.has(Want::ERROR) && cell.is_up_to(hits.t(i)) {
                out[i].t_free = out[i].t_free.min(free_before(at.view, &rays[i], cell));
            }
            outside |= u32::from(at.view.widen_interval && !is_within(&rays[i], out[i].t)) << i;
        }
        outside
    }

    /// Intersects the rays of `among` that hit triangles with these again, in double precision. `ray` returns origin
    /// and direction of a ray, `found` the distance that the walk found. Returns these rays, for [`Seen::meetings`].
    #[inline(always)]
    pub fn meet(
        &mut self,
        at: &InTree,
        among: u32,
        ray: impl Fn(usize) -> (DVec3, Vec3),
        found: impl Fn(usize) -> f64,
    ) -> u32 {
        let Self { groups, triangles, meetings, .. } = self;
        let mut rays = 0;
        for (column, group) in groups.rays.iter().enumerate().take(groups.count) {
            if group & among != 0 {
                rays |= group & among;
                let corners = triangles.corners(column);
                for i in bits(group & among) {
                    let (origin, dir) = ray(i);
                    meetings.set(i, &corners, origin, dir);
                }
            }
        }
        if rays != 0 {
            meetings.meet(at.view.scene.context().isa(), at.placed, rays, found);
        }
        rays
    }

    /// The intersections that [`Seen::meet`] computed last.
    pub fn meetings(&self) -> &Meetings<N> {
        &self.meetings
    }

    /// Fills the fields that need the intersection with the triangle in double precision.
    #[inline(always)]
    fn fill_from_meeting(&self, i: usize, ray: &Ray, want: Want, hit: &mut Hit) {
        let meetings = &self.meetings;
        hit.t = meetings.t(i);
        if want.has(Want::UV) {
            hit.uv = meetings.weights(i).map(|w| w as f32);
        }
        if want.has(Want::POSITION) {
            hit.position = ray.origin + ray.dir.as_dvec3() * hit.t;
        }
        if want.has(Want::ERROR) {
            (hit.error, hit.t_free) = (meetings.error(i), meetings.free(i).max(ray.begins()));
        }
    }

    fn fill_cells(
        &self,
        at: &InTree,
        want: Want,
        rays: &[Ray],
        hits: &(impl TreeHits<N> + ?Sized),
        out: &mut [Hit; N],
    ) {
        let (p, view) = (at.placed, at.view);
        for i in bits(self.groups.cells) {
            let (hit, ray) = (&mut out[i], &rays[i]);
            hit.t = self.stand_ins.t(i, p, ray, hits.t(i));
            if want.any_of(Want::INSTANCE | Want::PART) {
                let (number, part) = view.shown_by(at.id, self.stand_ins.part(i));
                if want.has(Want::PART) {
                    hit.part = view.model_of(number).parts().id(part as usize).unwrap_or(NONE);
                }
                if want.has(Want::INSTANCE) {
                    let instance = view.scene.ids_of(number).instance;
                    (hit.instance, hit.occurrence) = (view.scene.instance_id(instance), number);
                }
            }
            if want.has(Want::NORMAL) {
                hit.normal = self.stand_ins.normal(i);
            }
            if want.has(Want::SHADING_NORMAL) {
                hit.shading_normal = self.stand_ins.normal(i);
            }
            let along = ray.dir.as_dvec3() * hit.t;
            if want.has(Want::POSITION) {
                hit.position = ray.origin + along;
            }
            if want.has(Want::ERROR) {
                hit.error = self.stand_ins.error(i, &at.tree(), p, &hits.hit(i), ray.origin, along);
                let is_inside = self.stand_ins.inside() >> i & 1 == 1;
                hit.t_free = if is_inside { ray.begins() } else { free_before(at.view, ray, hits.first_cell(i, at)) };
            }
        }
    }

    /// Fills the shading normals of triangle hits. Only the blocks of normals may be missing, where the fields before
    /// are known.
    #[inline(never)]
    fn fill_shading(
        &self,
        at: &InTree,
        rays: &[Ray],
        hits: &(impl TreeHits<N> + ?Sized),
        out: &mut [Hit; N],
        rest: &mut Rest,
    ) {
        let tree = at.tree();
        for column in 0..self.groups.count {
            let group = self.groups.rays[column & (N - 1)] & !(rest.outside | rest.lacking);
            let Some(first) = bits(group).next() else { continue };
            let Ok(normals) = tree.normals(&hits.hit(first)) else {
                rest.lacking |= group;
                continue;
            };
            let corners = normals.map(|normals| world_corners(at.placed, &normals));
            let across = self.triangles.normal(column);
            for i in bits(group) {
                let (facing, hit) = (across.facing(rays[i].dir), hits.hit(i));
                out[i].shading_normal =
                    corners.map_or(facing, |corners| shading_normal(&corners, [hit.u, hit.v], facing));
            }
        }
    }

    /// Calls `of` for each ray of `rays` that hit a triangle, with the corners in the tree's frame.
    #[inline(always)]
    pub fn each_triangle(&self, rays: u32, mut of: impl FnMut(usize, [Vec3; 3])) {
        for (column, group) in self.groups.rays.iter().enumerate().take(self.groups.count) {
            if group & rays != 0 {
                let corners = self.triangles.corners(column);
                bits(group & rays).for_each(|i| of(i, corners));
            }
        }
    }

    /// Writes the shading normals of triangle hits, turned to the eye, over the geometric normals in `normals`, where
    /// there are others. `dir` holds the rays' unit directions. Returns the rays whose block of normals is not in
    /// memory.
    pub fn smooth(
        &mut self,
        at: &InTree,
        dir: &[[f32; N]; 3],
        hits: &(impl TreeHits<N> + ?Sized),
        normals: &mut [[f32; N]; 3],
    ) -> u32 {
        let (tree, mut lacking) = (at.tree(), 0);
        self.corners.clear();
        for group in &self.groups.rays[..self.groups.count] {
            let Some(first) = bits(*group).next() else { continue };
            let corners = match tree.normals(&hits.hit(first)) {
                Ok(Some(normals)) => world_corners(at.placed, &normals),
                Ok(None) => continue,
                Err(_) => {
                    lacking |= group;
                    continue;
                }
            };
            for i in bits(*group) {
                let hit = hits.hit(i);
                self.corners.set(i, &corners, [hit.u, hit.v]);
            }
        }
        self.corners.replace(tree.isa(), dir, normals);
        lacking
    }

    /// The normals at the corners of the triangle that ray `i` hit, in the world, as [`Seen::smooth`] found them.
    pub fn corner_normals(&self, i: usize) -> Option<[Vec3; 3]> {
        self.corners.of(i)
    }

    /// Fills primitive ids. This runs last: only their blocks may be missing where all other fields are known.
    fn fill_prims(
        &self,
        at: &InTree,
        hits: &(impl TreeHits<N> + ?Sized),
        met: u32,
        out: &mut [Hit; N],
        rest: &mut Rest,
    ) {
        let tree = at.tree();
        for i in bits(met & !(rest.outside | rest.lacking)) {
            let hit = hits.hit(i);
            let prim = if hit.stand_in().is_some() { Ok(None) } else { tree.prim(&hit) };
            out[i].prim = prim.ok().flatten().map_or(NONE, u64::from);
            rest.lacking |= u32::from(prim.is_err()) << i;
        }
    }
}

/// Returns the missing block that the answer to a hit needs: the hit's own block, or that of its normals or its
/// primitive ids.
#[cold]
pub(super) fn lacking(view: &SceneView, found: &Found, want: Want) -> Need {
    let (tree, hit) = (view.tree_with(found.tree), &found.tri);
    let is_triangle = hit.stand_in().is_none();
    let normals = || tree.normals(hit).err().filter(|_| is_triangle && want.has(Want::SHADING_NORMAL));
    let prims = || tree.prim(hit).err().filter(|_| is_triangle && want.has(Want::PRIM));
    view.need(found.placed(), normals().or_else(prims).unwrap_or(tree.block_of(hit)))
}

/// [`Seen::answer`] of a single ray. Returns false if its hit is outside of its interval; fails with the missing block.
#[inline(never)]
pub(super) fn answer_one(view: &SceneView, ray: &Ray, found: &Found, want: Want, hit: &mut Hit) -> Result<bool, Need> {
    let mut seen = Seen::NONE;
    answer_one_in(&mut seen, view, ray, found, want, hit)
}

/// [`answer_one`] with memory that is reused: to prepare it takes longer than most answers.
#[inline(always)]
pub(super) fn answer_one_in(
    seen: &mut Seen<1>,
    view: &SceneView,
    ray: &Ray,
    found: &Found,
    want: Want,
    hit: &mut Hit,
) -> Result<bool, Need> {
    use std::slice::from_ref;
    let out = std::array::from_mut(hit);
    let (id, placed) = (found.tree, view.frame_of(found.tree));
    let at = InTree { view, id, placed: &placed };
    let rest = seen.answer(&at, want, from_ref(ray), from_ref(found), 1, out);
    if rest.lacking != 0 { Err(lacking(view, found, want)) } else { Ok(rest.outside == 0) }
}

/// The distance before which no original surface lies on a ray that first entered a stand-in there: the cell and its
/// slabs hold all that the stand-in represents.
#[inline(always)]
fn free_before(view: &SceneView, ray: &Ray, cell: FirstCell) -> f64 {
    let placed = view.frame_of(cell.tree);
    (cell.t - placed.slack(ray.origin, ray.dir, cell.t)).max(ray.begins())
}

/// The answer to a ray that hits nothing.
pub(super) fn missed(view: &SceneView, ray: &Ray, found: &Found, want: Want) -> Hit {
    let is_free = !(want.has(Want::ERROR) && found.first_cell.is_up_to(ray.t_max));
    Hit { t_free: if is_free { f64::INFINITY } else { free_before(view, ray, found.first_cell) }, ..Hit::MISS }
}

/// Replaces the weights of triangles' corners by the parameters of the surface, and gives stand-ins of one face that
/// face.
fn fill_parameters<const N: usize>(
    at: &InTree,
    want: Want,
    hits: &(impl TreeHits<N> + ?Sized),
    met: u32,
    out: &mut [Hit; N],
) {
    for i in bits(met) {
        let ([u, v], hit) = (out[i].uv, hits.hit(i));
        let found = at.tree().parameters(&TriHit { u, v, ..hit });
        if want.has(Want::UV) {
            out[i].uv = found.map_or([0.0; 2], |it| it.uv);
        }
        if want.has(Want::PRIM) && hit.stand_in().is_some() {
            out[i].prim = found.map_or(NONE, |it| it.face.into());
        }
    }
}

/// Sets `error` and `t_free` of a hit to values that hold for any content of the missing blocks.
pub(super) fn promise_nothing(hit: &mut Hit, ray: &Ray, want: Want) {
    if want.has(Want::ERROR) {
        (hit.error, hit.t_free) = (f32::INFINITY, ray.begins());
    }
}

/// True if the distance of a hit, in double precision or as given by a stand-in, is within the ray's interval.
#[inline(always)]
pub(super) fn is_within(ray: &Ray, t: f64) -> bool {
    (ray.t_min..=ray.t_max).contains(&t)
}
