//! Colours, normals and error bounds of hits on stand-ins, for rows of rays in loops that the compiler vectorises.
//!
//! **Error.** A cell holds some original surface, displaced at most by the rounding of the input. Some surface thus
//! lies within the distance from the hit to the cell's farthest corner, plus that rounding. The distance is measured
//! from the answered position in double precision, so an error of `t` does not enter. The cell's level may promise a
//! smaller distance for all points of the region in which rays meet the stand-in (`lod::Fill`). That bound does not
//! hold where a ray begins in the cell, or where single precision has moved the hit off the region.
//!
//! **t_free.** A cell's box and slabs hold all that the stand-in represents, and the walk takes the nearest of all
//! stand-ins and triangles, each at its entry or before. So no original surface lies on the ray before its first entry
//! into a stand-in ([`crate::scene::walk::FirstCell`]), whether that one was hit or transmitted the ray, up to the
//! displacement in single precision (see `meeting.rs`). A ray that begins in a stand-in for missing data has no free
//! part.

#![allow(clippy::needless_range_loop)] // loops index several arrays at once

use super::{InTree, TreeHits};
use crate::lod::{
    Facing, blended_colour, farthest, holds, limit, shares, stored_likeness, stored_normal, sure_from, visible,
};
use crate::math::{Bounds, Ray, bits};
use crate::scene::placed::{Placed, not_below};
use crate::scene::walk::{Found, SceneView};
use crate::simd::{Op, Simd, dispatch};
use crate::structure::cell::{CellParts, Cells};
use crate::structure::{PartFilter, Rooted, Tree, TriHit};
use glam::{DVec3, Vec3};
use std::borrow::Cow;

/// The stand-ins that up to `N` rays hit in a placed tree, one column per ray. Reusable: columns of other rays have
/// arbitrary content.
#[derive(Debug)]
#[repr(C)]
pub(crate) struct StandIns<const N: usize> {
    cells: Cells<N>,
    /// The rays' directions in the world.
    dir: [[f32; N]; 3],
    /// For each of three samples, its share of the visible surface and its mean visible normal in the world. Cells with
    /// one sample use the first entry only.
    shares: [[f32; N]; 3],
    sides: [[[f32; N]; 3]; 3],
    /// Unit normals in the world that face the rays.
    normal: [[f32; N]; 3],
    /// The mean cosine between the reversed ray and the visible normals.
    along: [f32; N],
    /// The model's part that the tree's local part 0 is.
    first_part: u32,
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
    };

    /// Loads the stand-ins that `rays` hit in the placed `tree`; `dir` gives the rays' directions in the world. Returns
    /// the rays whose stand-ins' blocks have left the snapshot. `is_whole` requests the data that [`StandIns::error`]
    /// needs. (Not inlined: its arrays would lie on the stack below deeper calls of its callers.)
    #[inline(never)]
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
        let filter = at.number().and_then(|number| at.view.filter(number));
        let unseen = filter.as_ref().map_or(0, |filter| filter.unseen_bits);
        let gone = tree.cells(rays, |i| hits.hit(i), local, (is_whole, unseen), &mut self.cells);
        self.first_part = p.first_part;
        if let Some(filter) = filter {
            bits(rays & !gone).for_each(|i| self.under_looks(i, at, tree, &filter, &hits.hit(i)));
        }
        if N == 1 {
            see(self, p);
        } else {
            dispatch(tree.isa(), See { all: self, placed: p });
        }
        gone
    }

    /// Adapts the stand-in of ray `i` to the looks of parts. A cell that mixes parts with other looks shows the part
    /// that covers most of it, in that part's colour. Nothing else is known of where the visible surface in it lies. If
    /// that part is hidden, which happens only where data is missing, the cell shows a visible part of the
    /// block whose list has the cell's parts.
    fn under_looks(&mut self, i: usize, at: &InTree, tree: &Tree, filter: &PartFilter, hit: &TriHit) {
        let Some(CellParts { part, is_mixed, summary, listed_by, shown }) = tree.parts_in_cell(hit) else { return };
        let is_touched = is_mixed && summary & filter.touched != 0;
        // The level speaks of all original surface, hidden or not.
        if is_touched && summary & filter.hidden_bits != 0 {
            self.cells.level[i] = 0;
        }
        if self.cells.curtained >> i & 1 == 1 {
            // No part of the curtain is hidden or see-through.
            self.cells.coloured &= if shown & filter.touched == 0 { u32::MAX } else { !(1 << i) };
            return;
        }
        if !is_touched {
            return;
        }
        if !tree.has_colours() || filter.hides(part) {
            self.cells.coloured &= !(1 << i);
        }
        if filter.hides(part) {
            let shown = at.number().and_then(|number| at.view.scene.shown_blocks(number));
            let visible = shown.and_then(|shown| shown.part_in(listed_by));
            self.cells.part[i] = visible.unwrap_or(u32::MAX);
        }
    }

    /// The model's part with the largest visible area of the stand-in of ray `i`, over all directions, or the member of
    /// a top tree; `u32::MAX` if that part is hidden, and no visible one is known.
    #[inline(always)]
    pub fn part(&self, i: usize) -> u32 {
        self.first_part.saturating_add(self.cells.part[i])
    }

    /// Rays that hit stand-ins for data that is not in memory.
    pub fn missing(&self) -> u32 {
        self.cells.missing
    }

    /// Rays that begin in their cells.
    pub fn inside(&self) -> u32 {
        self.cells.inside
    }

    /// Rays that hit stand-ins for loose content, such as leaves.
    pub fn loose(&self) -> u32 {
        self.cells.loose
    }

    /// The unit normal in the world at the hit of ray `i`, facing the ray.
    #[inline(always)]
    pub fn normal(&self, i: usize) -> Vec3 {
        column(&self.normal, i)
    }

    /// For each ray, the mean cosine between the reversed ray and the visible normals.
    pub fn along(&self) -> &[f32; N] {
        &self.along
    }

    /// Rays that hit stand-ins with colours of their own instead of the colours of parts.
    pub fn coloured(&self) -> u32 {
        self.cells.coloured
    }

    /// The linear colour of the stand-in of ray `i`: the mean over the visible surface.
    #[inline]
    pub fn colour(&self, i: usize) -> Vec3 {
        blended_colour(self.cells.seconds.map(|row| row[i]), self.shares.map(|row| row[i]))
    }

    /// The visible normals of the stand-in of ray `i` and their shares, for shading in the world.
    pub fn facing(&self, i: usize) -> Facing {
        let count = if self.cells.have_three >> i & 1 == 1 { 3 } else { 1 };
        let side = |side: usize| if side < count { column(&self.sides[side], i) } else { Vec3::ZERO };
        Facing::new([side(0), side(1), side(2)], self.shares.map(|row| row[i]))
    }

    /// Returns the distance of the hit of ray `i`, which enters its cell at `t`, clamped to the ray's interval. A ray
    /// that begins in the cell hits its far side.
    #[inline(always)]
    pub fn t(&self, i: usize, placed: &Placed, ray: &Ray, t: f64) -> f64 {
        let is_inside = self.cells.inside >> i & 1 == 1;
        within(if is_inside { t.max(leave(placed, ray, &self.cells.bounds_of(i))) } else { t }, ray)
    }

    /// Bound of the distance between original surface and the answered position of ray `i`, which is `along` from its
    /// origin: see the module.
    pub fn error(&self, i: usize, tree: &Tree, placed: &Placed, hit: &TriHit, origin: DVec3, along: DVec3) -> f32 {
        let (here, cell) = (placed.local_point(origin + along), self.cells.bounds_of(i));
        let limit = if self.cells.inside >> i & 1 == 1 { f64::INFINITY } else { limit(self.cells.level[i]) };
        let is_sure =
            limit == f64::INFINITY || diagonal(&cell) >= sure_from(placed.local_point(origin), tree.max_coord());
        let is_near =
            is_sure || tree.oriented_slabs(hit).is_some_and(|slabs| holds(&cell, &slabs, in_cell(here, &cell)));
        error_at(placed, origin, along, here, &cell, if is_near { limit } else { f64::INFINITY })
    }

    /// [`StandIns::error`] of all rays in `rays`, which begin at `eye` and reach their hits at `t`. Values of other
    /// rays are arbitrary.
    pub fn errors(
        &self,
        tree: &Tree,
        placed: &Placed,
        (rays, eye, t): (u32, DVec3, &[f64; N]),
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
            let along = column(&self.dir, i).as_dvec3() * t[i];
            out[i] = self.error(i, tree, placed, &hits.hit(i), eye, along);
        }
    }

    /// The distance at which ray `i`, whose hit is at `t`, leaves the cell.
    pub fn leave(&self, i: usize, placed: &Placed, ray: &Ray, t: f64) -> f64 {
        leave(placed, ray, &self.cells.bounds_of(i)).max(t)
    }

    /// An upper bound of the height of the cell's content above the hit of ray `i`, at `t`, along the normal.
    pub fn above(&self, i: usize, tree: &Tree, placed: &Placed, hit: &TriHit, ray: &Ray, t: f64) -> f64 {
        let here = placed.local_point(ray.origin + ray.dir.as_dvec3() * t);
        let normal = placed.gradient(self.normal(i).as_dvec3());
        let slabs = tree.oriented_slabs(hit);
        slabs.map_or(0.0, |slabs| (farthest(&self.cells.bounds_of(i), &slabs, normal) - here.dot(normal)).max(0.0))
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

/// Computes the visible normals and shares of stand-ins.
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
    let StandIns { cells, dir, shares: rows, .. } = all;
    let Cells { bounds, firsts, seconds, have_three, have_shares, shares: given, .. } = cells;
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
    if *have_shares != 0 {
        for side in 0..3 {
            for i in 0..N {
                rows[side][i] = if *have_shares >> i & 1 == 1 { given[side][i] } else { rows[side][i] };
            }
        }
    }
    see_sides::<N, 3>(all, placed);
}

/// Computes the visible normals of the first `SIDES` of three samples, one loop for each step. The other samples have
/// no share.
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
        // Opposite normals can cancel out: the normal is then the reversed ray.
        set_column(normal, i, mean.normalize_or(column(&to_eye, i)));
        along[i] = -mean.dot(column(dir, i));
    }
}

/// The unit vector opposite to a direction; zero if the direction is zero or not finite.
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

/// Transforms unit normals of a tree's frame to the world. Normals that vanish there become the reversed rays.
#[inline(always)]
fn turn_to_world<const N: usize>(placed: &Placed, dir: &[[f32; N]; 3], normals: &mut [[f32; N]; 3]) {
    for i in 0..N {
        let turned = placed.world_normal(column(normals, i).as_dvec3()).try_normalize();
        let turned = turned.unwrap_or(-column(dir, i).as_dvec3().normalize_or_zero());
        set_column(normals, i, turned.as_vec3());
    }
}

/// Computes [`StandIns::errors`]. Returns the rays for which the position of the hit in the cell decides the bound;
/// bits of rays without stand-ins are arbitrary.
struct Errors<'a, const N: usize> {
    all: &'a StandIns<N>,
    placed: &'a Placed,
    eye: DVec3,
    offset: DVec3,
    sure: f64,
    t: &'a [f64; N],
    out: &'a mut [f32; N],
}

impl<const N: usize> Op for Errors<'_, N> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { all, placed, eye, offset, sure, t, out } = self;
        // A local copy is known not to change while `out` is written.
        let placed = *placed;
        let mut limits = [0.0; N];
        for i in 0..N {
            limits[i] = limit(all.cells.level[i]);
        }
        let mut is_doubtful = [0; N];
        for i in 0..N {
            let along = column(&all.dir, i).as_dvec3() * t[i];
            let cell = all.cells.bounds_of(i);
            out[i] = error_at(&placed, eye, along, eye + along - offset, &cell, limits[i]);
            is_doubtful[i] = u32::from(limits[i] < f64::INFINITY && diagonal(&cell) < sure) << i;
        }
        is_doubtful.iter().fold(0, |all, it| all | it)
    }
}

/// Clamps the distance of a hit on a cell to the ray's interval: the ray may enter the cell earlier, or leave it later.
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

/// The error in the world of a hit on a cell. The hit is `along` from the ray's origin and at `here` in the tree's
/// frame. `near` is the distance to original surface at most, as a fraction of the cell's diagonal. See the module.
#[inline(always)]
fn error_at(placed: &Placed, origin: DVec3, along: DVec3, here: DVec3, cell: &Bounds, near: f64) -> f32 {
    let (low, high) = (cell.min.as_dvec3(), cell.max.as_dvec3());
    let farthest = (here - low).abs().max((here - high).abs()).length();
    // For cells that are points the product is NaN, and `min` takes `farthest`.
    let nearest = (diagonal(cell) * near + here.distance(in_cell(here, cell))).min(farthest);
    not_below(placed.stretch * nearest + placed.position_error + placed.rounding_along(origin, along))
}

/// The distance at which a ray leaves a cell, in units of the world's ray.
fn leave(placed: &Placed, ray: &Ray, cell: &Bounds) -> f64 {
    let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
    let far = DVec3::select(dir.cmpge(DVec3::ZERO), cell.max.as_dvec3(), cell.min.as_dvec3());
    // A ray within a plane of the cell gives NaN there, which `min` ignores.
    ((far - org) * dir.recip()).to_array().into_iter().fold(f64::INFINITY, f64::min)
}

/// The stand-in that one ray hits. Methods compute the rarely needed values on demand.
pub(crate) struct Look<'a> {
    /// Distance of the hit, in units of the ray's direction.
    pub t: f64,
    view: &'a SceneView<'a>,
    ray: &'a Ray,
    found: &'a Found,
    placed: Cow<'a, Placed>,
    one: StandIns<1>,
}

/// The stand-in of the hit `found`; `None` if the hit is no stand-in or its block is missing.
pub(crate) fn look<'a>(view: &'a SceneView<'a>, ray: &'a Ray, found: &'a Found) -> Option<Look<'a>> {
    found.tri.stand_in()?;
    let mut look = Look { t: 0.0, view, ray, found, placed: view.frame_of(found.tree), one: StandIns::NONE };
    let gone = look.one.look(
        &InTree { view, id: found.tree, placed: &look.placed },
        &view.tree_with(found.tree),
        1,
        |_| ray.dir,
        std::slice::from_ref(found),
        true,
    );
    look.t = look.one.t(0, &look.placed, ray, found.t);
    (gone == 0).then_some(look)
}

/// Prefetches the memory that [`look`] reads for the hits of `rays`, so that many cache misses overlap.
pub(crate) fn ask_for(view: &SceneView, found: &[Found], rays: u32) {
    for of_sides in [false, true] {
        for i in bits(rays) {
            view.tree_with(found[i].tree).prefetch_cell(&found[i].tri, of_sides);
        }
    }
}

impl<'a> Look<'a> {
    /// The part with the largest visible area, over all directions: see [`SceneView::shown_by`]. `u32::MAX` if that
    /// part is hidden.
    pub fn part(&self) -> u32 {
        self.one.part(0)
    }

    /// See [`StandIns::error`].
    pub fn error(&self) -> f32 {
        let along = self.ray.dir.as_dvec3() * self.t;
        self.one.error(0, &self.view.tree_with(self.found.tree), &self.placed, &self.found.tri, self.ray.origin, along)
    }

    /// The distance at which the ray leaves the cell.
    pub fn leave(&self) -> f64 {
        self.one.leave(0, &self.placed, self.ray, self.t)
    }
}
