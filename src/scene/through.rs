//! Rays through everything: all placed trees that a ray may enter, and all triangles of a tree that it crosses. No hit
//! shortens the ray. A ray is taken once to the frame of each mesh, in double precision, and the positions of corners
//! there decide exactly ([`Line`]): triangles that share corners agree on the ray, in whatever block or tree they are.

use super::box_ray::BoxRay;
use super::frame::{Scenes, Search};
use super::state::SceneState;
use super::walk::SceneView;
use crate::geom::{Line, Side};
use crate::math::{Bounds, DBounds, Ray};
use crate::structure::{Descent, Rooted, TriHit, Triangle};
use glam::DVec3;

/// Growth of boxes, as a fraction of the coordinates involved. It is far above the rounding of a ray on its way to a
/// frame and far below the rounding of stored boxes.
const GROWTH: f64 = 1e-12;

/// The placed trees that a ray has still to enter.
#[derive(Debug, Default)]
pub(crate) struct Entrances {
    left: Search,
}

impl Entrances {
    /// Begins with a ray.
    pub fn begin(&mut self, scene: &SceneState, ray: &Ray) {
        if can_cross(ray) { self.left.restart(scene, Scenes::SeenBy(ray.mask)) } else { self.left.end() }
    }

    /// The next placed tree that the ray may enter and that it sees.
    pub fn next(&mut self, scene: &SceneState, ray: &Ray) -> Option<u64> {
        let (around, box_ray) = (scene.placement.top.around(), BoxRay::new(ray));
        let far = around.min.abs().max(around.max.abs()).max(ray.origin.abs()).max_element();
        let enters = |bounds: &DBounds| box_ray.enter(&grown(*bounds, far), ray.begins(), ray.t_max).is_some();
        loop {
            let placed = self.left.next(scene, enters)?;
            if scene.seen_by(placed) & ray.mask != 0 {
                return Some(placed);
            }
        }
    }
}

/// True if a ray can cross anything. Denormal components of its direction count as zero.
fn can_cross(ray: &Ray) -> bool {
    ray.can_hit() && ray.dir.abs().max_element() >= f32::MIN_POSITIVE
}

/// A box grown by the rounding of coordinates up to `size`.
fn grown(b: DBounds, size: f64) -> DBounds {
    let by = DVec3::splat(size * GROWTH);
    DBounds { min: b.min - by, max: b.max + by }
}

/// Receives a triangle that a ray's line crosses, its side, and the span of its corners' distances.
pub(crate) type Crossed<'a> = &'a mut dyn FnMut(&TriHit, &Triangle, Side, [f64; 2]);

impl SceneView<'_> {
    /// Continues a visit to a placed tree as far as its blocks are in memory. Calls `visit` with each triangle that the
    /// ray's line crosses near the ray's interval, its side, and the span of its corners' distances. Hidden parts are
    /// left out. A triangle in several leaves comes several times. The caller tests the interval.
    pub fn through(&self, ray: &Ray, placed: u64, left: &mut Descent, visit: Crossed) {
        let p = self.scene.placed(placed);
        let (tree, filter) = (self.tree(placed), self.filter(placed));
        let tree_origin = self.model_of(placed).trees()[p.tree as usize].origin;
        let (origin, dir) = p.in_mesh(ray);
        let line = Line::new(origin, dir);
        let local = origin - tree_origin;
        let box_ray = BoxRay::of(local, dir);
        let far = local.abs().max_element().max(f64::from(tree.max_coord()));
        let mut enters = |b: &Bounds| {
            let bounds = DBounds { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
            box_ray.enter(&grown(bounds, far), ray.begins(), ray.t_max).is_some()
        };
        left.go_on(&tree, &mut enters, &mut |hit, triangle| {
            let corners = triangle.vertices.map(|v| v.as_dvec3() + tree_origin);
            let Some(side) = line.crosses(&corners) else { return };
            if !filter.as_ref().is_some_and(|filter| filter.hides(triangle.part)) {
                visit(hit, triangle, side, line.span(&corners, dir));
            }
        });
    }
}
