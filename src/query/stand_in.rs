//! What a hit on a stand-in shows and promises.
//!
//! **Error.** A cell holds some of the original surface, up to what rounding of the input moved it: so some of it lies within
//! the distance from the hit to the cell's farthest corner, plus that. Measured from the hit's position as given, in
//! double precision: what single precision did to `t` does not enter.
//!
//! **t_free.** A cell's box holds all that it stands for, and the walk takes the nearest of all boxes and triangles: no
//! original surface lies on the ray before it enters the box, up to what single precision may have moved (as for exact
//! hits, `finish.rs`). In a stand-in for missing data that the ray begins in nothing is known to be free.

use super::hit::{Hit, HitKind, NONE, Want};
use crate::math::{Bounds, Ray};
use crate::scene::placed::{Placed, not_below};
use crate::scene::walk::{Found, SceneView};
use crate::structure::bvh::layout::Block;
use crate::structure::bvh::trace::StandIn;
use glam::{DVec3, Vec3};

/// A stand-in as a ray sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    /// For want of the block below.
    pub is_missing: bool,
    /// Where it is hit, in units of the ray's direction.
    pub t: f64,
    /// Unit, in the world, facing the ray.
    pub normal: Vec3,
    /// The model's part of which most is seen; none of the model's if that is hidden.
    pub part: u32,
    /// Linear: the mean over all that is seen from this side; `None`: that of the part.
    pub colour: Option<Vec3>,
    /// See the module.
    pub error: f32,
    /// See the module.
    pub t_free: f64,
    /// Where the ray leaves the cell.
    pub leave: f64,
    /// How far the cell reaches above the hit along the normal.
    pub above: f64,
}

/// The stand-in that `found` is, if it is one and its block is there.
#[inline]
pub(crate) fn look(view: &SceneView, ray: &Ray, found: &Found) -> Option<Look> {
    look_at(view, ray, found, found.tri.stand_in()?)
}

#[inline(never)]
fn look_at(view: &SceneView, ray: &Ray, found: &Found, stand_in: StandIn) -> Option<Look> {
    let placed = &view.scene.placement.placed[found.placed as usize];
    let words = view.tree(found.placed).snapshot.block(crate::base::ids::BlockId(found.tri.block))?;
    let block = Block::new(words);
    let cell = block.node(stand_in.node).child_box(stand_in.slot);
    let crossing = Crossing::of(placed, ray, &cell);
    let voxel = block.voxel(stand_in.node, stand_in.slot);
    let side = voxel.side(if stand_in.is_inside { crossing.last } else { crossing.first });
    let (part, _) = voxel.part();
    // Only for want of what is below: what else it holds may be visible.
    let is_hidden = stand_in.is_missing && view.filter(found.placed).is_some_and(|filter| filter.hides(part));
    let dir = ray.dir.as_dvec3();
    let normal = placed.world_normal(side.normal.as_dvec3()).try_normalize().unwrap_or(-dir.normalize_or_zero());
    let normal = if normal.dot(dir) <= 0.0 { normal } else { -normal };
    // In a cell that it begins in, the ray sees the far side.
    let t = if stand_in.is_inside { found.t.max(crossing.leave) } else { found.t };
    let t = t.min(ray.t_max).max(ray.t_min);
    let position = ray.origin + dir * t;
    let here = placed.local_point(position);
    let (low, high) = (cell.min.as_dvec3(), cell.max.as_dvec3());
    let farthest = (here - low).abs().max((here - high).abs()).length();
    let size = ray.origin.abs().max_element() + (dir * t).abs().max_element();
    let error = not_below(placed.stretch * farthest + placed.position_error + placed.rounding(size));
    let slack = placed.stretch * placed.local_slack() * 64.0 / dir.length();
    let free = if stand_in.is_inside { ray.t_min } else { t.min(crossing.enter) - slack };
    let corner = |i: usize| DVec3::new([low, high][i & 1].x, [low, high][i >> 1 & 1].y, [low, high][i >> 2].z);
    let above = (0..8).map(|i| (placed.world_point(corner(i)) - position).dot(normal)).fold(0.0, f64::max);
    Some(Look {
        is_missing: stand_in.is_missing,
        t,
        normal: normal.as_vec3(),
        part: if is_hidden { u32::MAX } else { placed.first_part.saturating_add(part) },
        colour: voxel.has_colours().then_some(side.colour),
        error,
        t_free: free.max(ray.t_min),
        leave: crossing.leave.max(t),
        above,
    })
}

/// Where a ray enters and leaves a cell, in units of the world's ray, and by which sides: low x, y, z, high x, y, z.
struct Crossing {
    enter: f64,
    leave: f64,
    first: usize,
    last: usize,
}

impl Crossing {
    fn of(placed: &Placed, ray: &Ray, cell: &Bounds) -> Self {
        let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
        let mut it = Self { enter: f64::NEG_INFINITY, leave: f64::INFINITY, first: 0, last: 0 };
        for axis in 0..3 {
            let towards = dir[axis] >= 0.0;
            let (low, high) = (f64::from(cell.min[axis]), f64::from(cell.max[axis]));
            let (near, far) = if towards { (low, high) } else { (high, low) };
            // What is seen, on entering and through the cell, is what faces the ray.
            let side = if towards { axis } else { axis + 3 };
            let (from, to) = ((near - org[axis]) / dir[axis], (far - org[axis]) / dir[axis]);
            // Not so for NaN, of rays in a plane of the cell.
            if from > it.enter {
                (it.enter, it.first) = (from, side);
            }
            if to < it.leave {
                (it.leave, it.last) = (to, side);
            }
        }
        it
    }
}

/// Fills what `want` asks of `hit` from a stand-in.
pub(super) fn fill(view: &SceneView, ray: &Ray, found: &Found, look: &Look, want: Want, hit: &mut Hit) {
    let placed = &view.scene.placement.placed[found.placed as usize];
    hit.kind = if look.is_missing { HitKind::Missing } else { HitKind::Lod };
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
        (hit.error, hit.t_free) = (look.error, look.t_free);
    }
    if want.has(Want::PRIM) {
        hit.prim = NONE;
    }
}
