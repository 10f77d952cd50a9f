//! What a hit on a stand-in shows and promises.
//!
//! **Error.** A cell holds some of the original surface, up to what rounding of the input moved it: so some of it lies within
//! the distance from the hit to the cell's farthest corner, plus that. Measured from the hit's position as given, in
//! double precision: what single precision did to `t` does not enter.
//!
//! Where the cell's level says that all of the region in which it is met is nearer to original surface (`lod::Fill`), that is its error.
//! Not so where a ray begins in a cell, for it is not met there; nor where single precision has moved the hit off that region.
//!
//! **t_free.** A cell's box and slabs hold all that it stands for, and the walk takes the nearest of all of these and of triangles,
//! each where it is entered or before: no original surface lies on the ray before the hit, up to what single precision may have
//! moved (as for exact hits, `finish.rs`). Where the ray passed stand-ins (`trace::pass`), that is so of the hit of a walk that passes
//! none, and its `t_free` counts (`finish::free`). In a stand-in for missing data that the ray begins in nothing is known to be free.

use super::hit::{Hit, HitKind, NONE, Want};
use crate::lod::{self, Coded, Facing, blended_colour, farthest, holds, limit, sure_from};
use crate::math::{Bounds, Ray};
use crate::scene::placed::{Placed, not_below};
use crate::math::bits;
use crate::scene::walk::{Found, SceneView};
use crate::simd::prefetch;
use crate::structure::bvh::layout::{Block, Node, StoredVoxel};
use crate::structure::{Rooted, StandIn};
use glam::{DVec3, Vec3};

/// A stand-in as a ray sees it. What not everybody asks for is worked out when asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look<'a> {
    /// Where it is hit, in units of the ray's direction.
    pub t: f64,
    /// Unit, in the world, facing the ray.
    pub normal: Vec3,
    /// How it answers light, in the world.
    pub facing: Facing,
    /// The model's part of which most is seen; none of the model's if that is hidden.
    pub part: u32,
    /// Linear: the mean over all that is seen from this side; `None`: that of the part.
    pub colour: Option<Vec3>,
    placed: &'a Placed,
    ray: &'a Ray,
    reach: f32,
    block: Block<'a>,
    place: StandIn,
}

/// Asks for the memory of what [`look`] reads of what was found for the rays of `met`: many such waits then go on at once.
#[inline]
pub(crate) fn ask_for(view: &SceneView, found: &[Found], met: u32) {
    let mut have_sides = 0;
    for i in bits(met) {
        let Some(voxel) = voxel_of(view, &found[i]) else { continue };
        prefetch(voxel.words().as_ptr());
        have_sides |= 1 << i;
    }
    for i in bits(have_sides) {
        let Some(voxel) = voxel_of(view, &found[i]).filter(StoredVoxel::has_sides) else { continue };
        let sides = voxel.sides();
        prefetch(sides.as_ptr());
        prefetch(&sides[sides.len() - 1]);
    }
}

#[inline]
fn voxel_of<'a>(view: &SceneView<'a>, found: &Found) -> Option<StoredVoxel<'a>> {
    let place = found.tri.stand_in()?;
    Some(view.block_of(found)?.voxel(place.node, place.slot))
}

/// The stand-in that `found` is, if it is one and its block is there.
#[inline]
pub(crate) fn look<'a>(view: &SceneView<'a>, ray: &'a Ray, found: &Found) -> Option<Look<'a>> {
    look_at(view, ray, found, found.tri.stand_in()?)
}

#[inline]
fn look_at<'a>(view: &SceneView<'a>, ray: &'a Ray, found: &Found, place: StandIn) -> Option<Look<'a>> {
    let placed = &view.scene.placement.placed[found.placed as usize];
    let block = view.block_of(found)?;
    let voxel = block.voxel(place.node, place.slot);
    let mut t = found.t;
    if place.is_inside {
        // In a cell that it begins in, the ray sees the far side.
        t = t.max(leave(placed, ray, &cell(block, place)));
    }
    let (mut firsts, mut seconds, mut shares) = ([voxel.words()[0]; 3], [voxel.words()[1]; 3], [1.0, 0.0, 0.0]);
    if voxel.has_sides() || voxel.is_along_axes() {
        let dir = placed.local_vector(ray.dir.as_dvec3());
        (firsts, seconds) = three(&voxel, dir);
        shares = lod::shares(cell(block, place).extent(), dir.as_vec3(), firsts, seconds);
    }
    let facing = Facing::of(firsts, shares, to_eye(ray.dir), |normal| facing(placed, normal, ray.dir));
    let (part, _) = voxel.part();
    // Only for want of what is below: what else it holds may be visible.
    let is_hidden = place.is_missing && view.filter(found.placed).is_some_and(|filter| filter.hides(part));
    Some(Look {
        t: within(t, ray),
        normal: unit(facing.mean(), to_eye(ray.dir)),
        facing,
        part: if is_hidden { u32::MAX } else { placed.first_part.saturating_add(part) },
        colour: voxel.has_colours().then(|| blended_colour(seconds, shares)),
        placed,
        ray,
        reach: view.tree(found.placed).reach(),
        block,
        place,
    })
}

/// The samples' words of the sides across x, y and z that face a ray which goes by `dir`, of a voxel that tells them apart.
#[inline(always)]
pub(super) fn three(voxel: &StoredVoxel, dir: DVec3) -> ([u32; 3], [u32; 3]) {
    if !voxel.has_sides() {
        return Coded::along_axes(voxel.words()[0], voxel.words()[1]);
    }
    let at: [usize; 3] = std::array::from_fn(|axis| 2 * side_towards(axis, dir[axis]) as usize);
    (at.map(|at| voxel.sides()[at]), at.map(|at| voxel.sides()[at + 1]))
}

/// Where a cell is hit, in the ray's interval: it may be entered before, or be seen where the ray leaves it.
#[inline(always)]
pub(super) fn within(t: f64, ray: &Ray) -> f64 {
    t.min(ray.t_max).max(ray.t_min)
}

fn cell(block: Block, place: StandIn) -> Bounds {
    block.node(place.node).stored_box(place.slot)
}

/// How far original surface is at most from a hit at `here` on the cell in `slot` of a node, as a part of its diagonal, by what the
/// cell's level says; infinitely far if that says nothing of there. `sure`: see [`sure_from`].
#[inline]
pub(super) fn near(node: &Node, slot: usize, sure: f64, here: DVec3) -> f64 {
    let (limit, cell) = (limit(node.level(slot)), node.stored_box(slot));
    let is_sure = limit == f64::INFINITY || diagonal(&cell) >= sure;
    if is_sure || holds(&cell, &node.stored_slabs(slot), in_cell(here, &cell)) { limit } else { f64::INFINITY }
}

#[inline(always)]
pub(super) fn diagonal(cell: &Bounds) -> f64 {
    (cell.max.as_dvec3() - cell.min.as_dvec3()).length()
}

#[inline(always)]
fn in_cell(here: DVec3, cell: &Bounds) -> DVec3 {
    here.max(cell.min.as_dvec3()).min(cell.max.as_dvec3())
}

/// The error of a hit `along` from a ray's origin, which is `here` in the tree's frame, on a cell; `near` is [`near`]. See the module.
#[inline(always)]
pub(super) fn error_at(placed: &Placed, origin: DVec3, along: DVec3, here: DVec3, cell: &Bounds, near: f64) -> f32 {
    let (low, high) = (cell.min.as_dvec3(), cell.max.as_dvec3());
    let farthest = (here - low).abs().max((here - high).abs()).length();
    // Not so for NaN, of cells that are points.
    let nearest = (diagonal(cell) * near + here.distance(in_cell(here, cell))).min(farthest);
    not_below(placed.stretch * nearest + placed.position_error + placed.rounding_along(origin, along))
}

/// A unit normal of the tree's frame in the world, against `dir`.
#[inline]
fn facing(placed: &Placed, normal: Vec3, dir: Vec3) -> Vec3 {
    let normal = if placed.only_shifted().is_some() {
        normal
    } else {
        let turned = placed.world_normal(normal.as_dvec3()).try_normalize();
        turned.unwrap_or(-dir.as_dvec3().normalize_or_zero()).as_vec3()
    };
    if faces_away(normal, dir) { -normal } else { normal }
}

/// The direction of a sum of normals; `to_eye`, unit, where nothing is left of opposite ones.
#[inline(always)]
pub(super) fn unit(sum: Vec3, to_eye: Vec3) -> Vec3 {
    sum.normalize_or(to_eye)
}

/// The unit vector against a direction, which is no vector or infinite at worst.
#[inline(always)]
pub(super) fn to_eye(dir: Vec3) -> Vec3 {
    -dir.normalize_or_zero()
}

/// Whether a normal faces the way that `dir` goes.
#[inline(always)]
pub(super) fn faces_away(normal: Vec3, dir: Vec3) -> bool {
    normal.dot(dir) > 0.0
}

impl Look<'_> {
    /// For want of the block below.
    pub fn is_missing(&self) -> bool {
        self.place.is_missing
    }

    /// See the module.
    pub fn error(&self) -> f32 {
        let along = self.ray.dir.as_dvec3() * self.t;
        let here = self.placed.local_point(self.ray.origin + along);
        let near = if self.place.is_inside {
            f64::INFINITY
        } else {
            let sure = sure_from(self.placed.local_point(self.ray.origin), self.reach);
            near(self.block.node(self.place.node), self.place.slot, sure, here)
        };
        error_at(self.placed, self.ray.origin, along, here, &cell(self.block, self.place), near)
    }

    /// See the module.
    pub fn t_free(&self) -> f64 {
        let free = if self.place.is_inside { 0.0 } else { self.t - self.placed.slack(self.ray, self.t) };
        free.max(self.ray.begins())
    }

    /// Where the ray leaves the cell.
    pub fn leave(&self) -> f64 {
        leave(self.placed, self.ray, &cell(self.block, self.place)).max(self.t)
    }

    /// How far what it stands for reaches above the hit along the normal, or farther.
    pub fn above(&self) -> f64 {
        let here = self.placed.local_point(self.ray.origin + self.ray.dir.as_dvec3() * self.t);
        let normal = self.placed.gradient(self.normal.as_dvec3());
        let cell = cell(self.block, self.place);
        (farthest(&cell, &self.block.node(self.place.node).stored_slabs(self.place.slot), normal) - here.dot(normal)).max(0.0)
    }
}

/// Where a ray leaves a cell, in units of the world's ray.
fn leave(placed: &Placed, ray: &Ray, cell: &Bounds) -> f64 {
    let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
    let far = DVec3::select(dir.cmpge(DVec3::ZERO), cell.max.as_dvec3(), cell.min.as_dvec3());
    // Not where it goes along a plane of the cell: that is NaN.
    ((far - org) * dir.recip()).to_array().into_iter().fold(f64::INFINITY, f64::min)
}

/// The side of a cell that faces a ray which goes by `dir` along an axis: low x, y, z, high x, y, z.
#[inline(always)]
fn side_towards(axis: usize, dir: f64) -> u32 {
    if dir >= 0.0 { axis as u32 } else { axis as u32 + 3 }
}

/// Fills what `want` asks of `hit` from a stand-in.
pub(super) fn fill(view: &SceneView, ray: &Ray, found: &Found, look: &Look, want: Want, hit: &mut Hit) {
    let placed = &view.scene.placement.placed[found.placed as usize];
    hit.kind = if look.is_missing() { HitKind::Missing } else { HitKind::Lod };
    hit.t = look.t;
    if want.has(Want::INSTANCE) {
        hit.instance = view.scene.instances[placed.instance as usize].id;
    }
    if want.has(Want::UV) {
        hit.uv = [0.0; 2];
    }
    if want.has(Want::PART) {
        hit.part = view.model_of(found.placed).parts().get(look.part as usize).map_or(NONE, |p| p.id);
    }
    if want.has(Want::NORMAL) {
        hit.normal = look.normal;
    }
    if want.has(Want::POSITION) {
        hit.position = ray.origin + ray.dir.as_dvec3() * look.t;
    }
    if want.has(Want::ERROR) {
        (hit.error, hit.t_free) = (look.error(), look.t_free());
    }
    if want.has(Want::PRIM) {
        hit.prim = NONE;
    }
}
