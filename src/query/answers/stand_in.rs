//! What hits on stand-ins show and promise: rows of them, in loops that become vectors.
//!
//! **Error.** A cell holds some of the original surface, up to what rounding of the input moved it: so some of it lies
//! within the distance from the hit to the cell's farthest corner, plus that. Measured from the hit's position as
//! given, in double precision: what single precision did to `t` does not enter.
//!
//! Where the cell's level says that all of the region in which it is met is nearer to original surface (`lod::Fill`),
//! that is its error. Not so where a ray begins in a cell, for it is not met there; nor where single precision has
//! moved the hit off that region.
//!
//! **t_free.** A cell's box and slabs hold all that it stands for, and the walk takes the nearest of all of these and
//! of triangles, each where it is entered or before: no original surface lies on the ray before the hit, up to what
//! single precision may have moved (as for exact hits, `meeting.rs`). Where the ray passed stand-ins, that is so of the
//! hit of a walk that passes none, and its `t_free` counts (`beyond::free`). In a stand-in for missing data that the
//! ray begins in nothing is known to be free.

#![allow(clippy::needless_range_loop)] // rows of several arrays at once

use super::{InTree, TreeHits};
use crate::lod::{
    Facing, blended_colour, farthest, holds, limit, shares, stored_likeness, stored_normal, sure_from, visible,
};
use crate::math::{Bounds, Ray, bits};
use crate::scene::placed::{Placed, not_below};
use crate::scene::walk::{Found, SceneView};
use crate::simd::{Op, Simd, dispatch};
use crate::structure::cell::Cells;
use crate::structure::{Rooted, Tree, TriHit};
use glam::{DVec3, Vec3};

/// The stand-ins that up to `N` rays hit in a placed tree, a column for each ray. Reusable: columns of other rays hold
/// anything.
#[derive(Debug)]
#[repr(C)]
pub(crate) struct StandIns<const N: usize> {
    cells: Cells<N>,
    /// The rays' directions in the world.
    dir: [[f32; N]; 3],
    /// Of each of three samples its share of what is seen, and the mean normal that is seen of it, in the world; of
    /// cells of one sample the first counts.
    shares: [[f32; N]; 3],
    sides: [[[f32; N]; 3]; 3],
    /// Unit, in the world, against the rays.
    normal: [[f32; N]; 3],
    /// The mean cosine between the ray and what it sees.
    along: [f32; N],
    /// The model's part that the tree's local part 0 is, and the rays whose cells' parts are hidden.
    first_part: u32,
    hidden: u32,
}

impl<const N: usize> StandIns<N> {
    pub const NONE: Self = Self {
        cells: Cells::NONE,
        dir: [[0.0; N]; 3],
        shares: [[0.0; N]; 3],
        sides: [[[0.0; N]; 3]; 3],
        normal: [[0.0; N]; 3],
        along: [0.0; N],
        first_part: 0,
        hidden: 0,
    };

    /// Looks at the cells that `rays` hit in the placed `tree`; `dir` gives the rays' directions in the world. Returns
    /// the rays whose cells' blocks have left the snapshot. `is_whole`: the data that [`StandIns::error`] takes is
    /// asked for.
    pub fn look(
        &mut self,
        at: &InTree,
        tree: &Tree,
        rays: u32,
        dir: impl Fn(usize) -> Vec3,
        hits: &(impl TreeHits<N> + ?Sized),
        is_whole: bool,
    ) -> u32 {
        let p = at.placed;
        for i in bits(rays) {
            set_column(&mut self.dir, i, dir(i));
        }
        let local = |i: usize| p.local_vector(dir(i).as_dvec3());
        let gone = tree.cells(rays, |i| hits.hit(i), local, is_whole, &mut self.cells);
        (self.first_part, self.hidden) = (p.first_part, 0);
        if self.cells.missing != 0 {
            // Only for want of what is below: what else it holds may be visible.
            let filter = at.view.filter(at.number);
            let is_hidden = |part: u32| filter.as_ref().is_some_and(|filter| filter.hides(part));
            bits(self.cells.missing).for_each(|i| self.hidden |= u32::from(is_hidden(self.cells.part[i])) << i);
        }
        if N == 1 {
            see(self, p);
        } else {
            dispatch(tree.isa(), See { all: self, placed: p });
        }
        gone
    }

    /// The model's part of which ray `i` sees most; none of the model's if that is hidden.
    #[inline(always)]
    pub fn part(&self, i: usize) -> u32 {
        if self.hidden >> i & 1 == 1 { u32::MAX } else { self.first_part.saturating_add(self.cells.part[i]) }
    }

    /// Rays that see stand-ins for what is not in memory.
    pub fn missing(&self) -> u32 {
        self.cells.missing
    }

    /// The unit normal that ray `i` sees, in the world, against the ray.
    #[inline(always)]
    pub fn normal(&self, i: usize) -> Vec3 {
        column(&self.normal, i)
    }

    /// Of each ray the mean cosine between it and what it sees.
    pub fn along(&self) -> &[f32; N] {
        &self.along
    }

    /// Rays that see colours of their cells' own, not those of parts.
    pub fn coloured(&self) -> u32 {
        self.cells.coloured
    }

    /// The linear colour that ray `i` of those sees: the mean over all that is seen.
    #[inline]
    pub fn colour(&self, i: usize) -> Vec3 {
        blended_colour(self.cells.seconds.map(|row| row[i]), self.shares.map(|row| row[i]))
    }

    /// How what ray `i` sees answers light, in the world.
    pub fn facing(&self, i: usize) -> Facing {
        let count = if self.cells.have_three >> i & 1 == 1 { 3 } else { 1 };
        let side = |side: usize| if side < count { column(&self.sides[side], i) } else { Vec3::ZERO };
        Facing::new([side(0), side(1), side(2)], self.shares.map(|row| row[i]))
    }

    /// Where ray `i` is hit that met its cell at `t`: in the ray's interval; in a cell that it begins in, the ray sees
    /// the far side.
    #[inline(always)]
    pub fn t(&self, i: usize, placed: &Placed, ray: &Ray, t: f64) -> f64 {
        let is_inside = self.cells.inside >> i & 1 == 1;
        within(if is_inside { t.max(leave(placed, ray, &self.cells.bounds_of(i))) } else { t }, ray)
    }

    /// Bound of the distance between the position of ray `i`'s answer, `along` from its origin, and original surface:
    /// see the module.
    pub fn error(&self, i: usize, tree: &Tree, placed: &Placed, hit: &TriHit, origin: DVec3, along: DVec3) -> f32 {
        let (here, cell) = (placed.local_point(origin + along), self.cells.bounds_of(i));
        let limit = if self.cells.inside >> i & 1 == 1 { f64::INFINITY } else { limit(self.cells.level[i]) };
        let is_sure =
            limit == f64::INFINITY || diagonal(&cell) >= sure_from(placed.local_point(origin), tree.max_coord());
        let is_near =
            is_sure || tree.oriented_slabs(hit).is_some_and(|slabs| holds(&cell, &slabs, in_cell(here, &cell)));
        error_at(placed, origin, along, here, &cell, if is_near { limit } else { f64::INFINITY })
    }

    /// [`StandIns::error`] of all rays of `rays`, which begin at `eye` and reach their hits at `t`; of other rays
    /// anything.
    pub fn errors(
        &self,
        tree: &Tree,
        placed: &Placed,
        (rays, eye, t): (u32, DVec3, &[f32; N]),
        hits: &(impl TreeHits<N> + ?Sized),
        out: &mut [f32; N],
    ) {
        let doubtful = match placed.only_shifted() {
            Some(offset) => {
                let sure = sure_from(placed.local_point(eye), tree.max_coord());
                dispatch(tree.isa(), Errors { all: self, placed, eye, offset, sure, t, out: &mut *out })
                    | self.cells.inside
            }
            None => u32::MAX,
        };
        for i in bits(rays & doubtful) {
            let along = column(&self.dir, i).as_dvec3() * f64::from(t[i]);
            out[i] = self.error(i, tree, placed, &hits.hit(i), eye, along);
        }
    }

    /// No original surface lies on ray `i` before this, where it reaches its hit at `t`: see the module.
    #[inline(always)]
    pub fn t_free(&self, i: usize, placed: &Placed, ray: &Ray, t: f64) -> f64 {
        let free = if self.cells.inside >> i & 1 == 1 { 0.0 } else { t - placed.slack(ray, t) };
        free.max(ray.begins())
    }
}

#[inline(always)]
fn column<const N: usize>(rows: &[[f32; N]; 3], i: usize) -> Vec3 {
    Vec3::new(rows[0][i], rows[1][i], rows[2][i])
}

#[inline(always)]
fn set_column<const N: usize>(rows: &mut [[f32; N]; 3], i: usize, v: Vec3) {
    (rows[0][i], rows[1][i], rows[2][i]) = (v.x, v.y, v.z);
}

/// Works out how cells face their rays.
struct See<'a, const N: usize> {
    all: &'a mut StandIns<N>,
    placed: &'a Placed,
}

impl<const N: usize> Op for See<'_, N> {
    type Out = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        see(self.all, self.placed);
    }
}

#[inline(always)]
fn see<const N: usize>(all: &mut StandIns<N>, placed: &Placed) {
    if all.cells.have_three == 0 {
        all.shares = [[1.0; N], [0.0; N], [0.0; N]];
        return see_sides::<N, 1>(all, placed);
    }
    let StandIns { cells: Cells { bounds, firsts, seconds, have_three, .. }, dir, shares: rows, .. } = all;
    let moved;
    let dir = if placed.only_shifted().is_some() {
        &*dir
    } else {
        moved = in_tree(placed, dir);
        &moved
    };
    for i in 0..N {
        let low = Vec3::new(bounds[0][i], bounds[1][i], bounds[2][i]);
        let extent = Vec3::new(bounds[3][i], bounds[4][i], bounds[5][i]) - low;
        let firsts = [firsts[0][i], firsts[1][i], firsts[2][i]];
        let seconds = [seconds[0][i], seconds[1][i], seconds[2][i]];
        let [x, y, z] = shares(extent, column(dir, i), firsts, seconds);
        let has_three = *have_three >> i & 1 == 1;
        rows[0][i] = if has_three { x } else { 1.0 };
        rows[1][i] = if has_three { y } else { 0.0 };
        rows[2][i] = if has_three { z } else { 0.0 };
    }
    see_sides::<N, 3>(all, placed);
}

/// Works out what is seen of the first `SIDES` of three samples, in a loop for each step: the others have no share.
#[inline(always)]
fn see_sides<const N: usize, const SIDES: usize>(all: &mut StandIns<N>, placed: &Placed) {
    let StandIns { cells, dir, shares, sides, normal, along, .. } = all;
    let is_turned = placed.only_shifted().is_none();
    let mut to_eye = [[0.0; N]; 3];
    for i in 0..N {
        set_column(&mut to_eye, i, against(column(dir, i)));
    }
    let mut mean = [[0.0; N]; 3];
    for side in 0..SIDES {
        let seen = &mut sides[side];
        for i in 0..N {
            set_column(seen, i, stored_normal(cells.firsts[side][i]));
        }
        if is_turned {
            turn_to_world(placed, dir, seen);
        }
        for i in 0..N {
            let n = column(seen, i);
            let n = if n.dot(column(dir, i)) > 0.0 { -n } else { n };
            let n = visible(n, stored_likeness(cells.firsts[side][i]), column(&to_eye, i));
            set_column(seen, i, n);
            let sum = column(&mean, i) + n * shares[side][i];
            set_column(&mut mean, i, sum);
        }
    }
    for i in 0..N {
        let mean = column(&mean, i);
        // Where nothing is left of opposite normals, against the ray.
        set_column(normal, i, mean.normalize_or(column(&to_eye, i)));
        along[i] = -mean.dot(column(dir, i));
    }
}

/// The unit vector against a direction, which is no vector or infinite at worst.
#[inline(always)]
fn against(dir: Vec3) -> Vec3 {
    -dir.normalize_or_zero()
}

/// Directions of the world in a tree's frame.
#[inline(always)]
fn in_tree<const N: usize>(placed: &Placed, dir: &[[f32; N]; 3]) -> [[f32; N]; 3] {
    let mut out = [[0.0; N]; 3];
    for i in 0..N {
        set_column(&mut out, i, placed.local_vector(column(dir, i).as_dvec3()).as_vec3());
    }
    out
}

/// Takes unit normals of a tree's frame to the world; those that vanish there are against the rays.
#[inline(always)]
fn turn_to_world<const N: usize>(placed: &Placed, dir: &[[f32; N]; 3], normals: &mut [[f32; N]; 3]) {
    for i in 0..N {
        let turned = placed.world_normal(column(normals, i).as_dvec3()).try_normalize();
        let turned = turned.unwrap_or(-column(dir, i).as_dvec3().normalize_or_zero());
        set_column(normals, i, turned.as_vec3());
    }
}

/// Works out [`StandIns::errors`]; returns the rays for which it must be seen where in their cells they hit, of rays
/// without cells anything.
struct Errors<'a, const N: usize> {
    all: &'a StandIns<N>,
    placed: &'a Placed,
    eye: DVec3,
    offset: DVec3,
    sure: f64,
    t: &'a [f32; N],
    out: &'a mut [f32; N],
}

impl<const N: usize> Op for Errors<'_, N> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { all, placed, eye, offset, sure, t, out } = self;
        // A copy: it stays as it is while `out` is written.
        let placed = *placed;
        let mut limits = [0.0; N];
        for i in 0..N {
            limits[i] = limit(all.cells.level[i]);
        }
        let mut is_doubtful = [0; N];
        for i in 0..N {
            let along = column(&all.dir, i).as_dvec3() * f64::from(t[i]);
            let cell = all.cells.bounds_of(i);
            out[i] = error_at(&placed, eye, along, eye + along - offset, &cell, limits[i]);
            is_doubtful[i] = u32::from(limits[i] < f64::INFINITY && diagonal(&cell) < sure) << i;
        }
        is_doubtful.iter().fold(0, |all, it| all | it)
    }
}

/// Where a cell is hit, in the ray's interval: it may be entered before, or be seen where the ray leaves it.
#[inline(always)]
pub(super) fn within(t: f64, ray: &Ray) -> f64 {
    t.min(ray.t_max).max(ray.t_min)
}

#[inline(always)]
fn diagonal(cell: &Bounds) -> f64 {
    (cell.max.as_dvec3() - cell.min.as_dvec3()).length()
}

#[inline(always)]
fn in_cell(here: DVec3, cell: &Bounds) -> DVec3 {
    here.max(cell.min.as_dvec3()).min(cell.max.as_dvec3())
}

/// The error of a hit `along` from a ray's origin, which is `here` in the tree's frame, on a cell, in the world;
/// `near`: original surface is so near to the hit at most, as a part of the cell's diagonal. See the module.
#[inline(always)]
fn error_at(placed: &Placed, origin: DVec3, along: DVec3, here: DVec3, cell: &Bounds, near: f64) -> f32 {
    let (low, high) = (cell.min.as_dvec3(), cell.max.as_dvec3());
    let farthest = (here - low).abs().max((here - high).abs()).length();
    // Not so for NaN, of cells that are points.
    let nearest = (diagonal(cell) * near + here.distance(in_cell(here, cell))).min(farthest);
    not_below(placed.stretch * nearest + placed.position_error + placed.rounding_along(origin, along))
}

/// Where a ray leaves a cell, in units of the world's ray.
fn leave(placed: &Placed, ray: &Ray, cell: &Bounds) -> f64 {
    let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
    let far = DVec3::select(dir.cmpge(DVec3::ZERO), cell.max.as_dvec3(), cell.min.as_dvec3());
    // Not where it goes along a plane of the cell: that is NaN.
    ((far - org) * dir.recip()).to_array().into_iter().fold(f64::INFINITY, f64::min)
}

/// A stand-in as one ray sees it. What few ask for is worked out when asked for.
pub(crate) struct Look<'a> {
    /// Where it is hit, in units of the ray's direction.
    pub t: f64,
    view: &'a SceneView<'a>,
    ray: &'a Ray,
    found: &'a Found,
    one: StandIns<1>,
}

/// The stand-in that `found` is, if it is one and its block is there.
pub(crate) fn look<'a>(view: &'a SceneView<'a>, ray: &'a Ray, found: &'a Found) -> Option<Look<'a>> {
    found.tri.stand_in()?;
    let mut look = Look { t: 0.0, view, ray, found, one: StandIns::NONE };
    let gone = look.one.look(
        &InTree::new(view, found.placed),
        &view.tree(found.placed),
        1,
        |_| ray.dir,
        std::slice::from_ref(found),
        true,
    );
    look.t = look.one.t(0, look.placed(), ray, found.t);
    (gone == 0).then_some(look)
}

/// Asks for the memory of what [`look`] reads of what was found for `rays`: many such waits then go on at once.
pub(crate) fn ask_for(view: &SceneView, found: &[Found], rays: u32) {
    for of_sides in [false, true] {
        for i in bits(rays) {
            view.tree(found[i].placed).prefetch_cell(&found[i].tri, of_sides);
        }
    }
}

impl<'a> Look<'a> {
    fn placed(&self) -> &'a Placed {
        &self.view.scene.placement.placed[self.found.placed as usize]
    }

    /// Unit, in the world, against the ray.
    pub fn normal(&self) -> Vec3 {
        self.one.normal(0)
    }

    /// How it answers light, in the world.
    pub fn facing(&self) -> Facing {
        self.one.facing(0)
    }

    /// The model's part of which most is seen; none of the model's if that is hidden.
    pub fn part(&self) -> u32 {
        self.one.part(0)
    }

    /// Linear: the mean over all that is seen from this side; `None`: that of the part.
    pub fn colour(&self) -> Option<Vec3> {
        (self.one.coloured() != 0).then(|| self.one.colour(0))
    }

    /// For want of the block below.
    pub fn is_missing(&self) -> bool {
        self.one.missing() != 0
    }

    /// See [`StandIns::error`].
    pub fn error(&self) -> f32 {
        let along = self.ray.dir.as_dvec3() * self.t;
        self.one.error(0, &self.view.tree(self.found.placed), self.placed(), &self.found.tri, self.ray.origin, along)
    }

    /// Where the ray leaves the cell.
    pub fn leave(&self) -> f64 {
        leave(self.placed(), self.ray, &self.one.cells.bounds_of(0)).max(self.t)
    }

    /// How far what it stands for reaches above the hit along the normal, or farther.
    pub fn above(&self) -> f64 {
        let here = self.placed().local_point(self.ray.origin + self.ray.dir.as_dvec3() * self.t);
        let normal = self.placed().gradient(self.normal().as_dvec3());
        let slabs = self.view.tree(self.found.placed).oriented_slabs(&self.found.tri);
        slabs.map_or(0.0, |slabs| (farthest(&self.one.cells.bounds_of(0), &slabs, normal) - here.dot(normal)).max(0.0))
    }
}
