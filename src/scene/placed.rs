//! Trees placed in the world, and the transformation of rays into their frames.

use super::box_ray::BoxRay;
use super::measures::{Measures, largest_singular_value};
use super::placement::PlacedIds;
use crate::math::{Bounds, Cone, DBounds, Ray};
use crate::structure::open::StoredTree;
use crate::structure::{LocalRay, USUAL_DIRS};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::ops::Deref;

/// A tree with an affine map from its frame to the world: x -> `linear` x + `offset`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    ids: PlacedIds,
    linear: DMat3,
    inverse: DMat3,
    offset: DVec3,
    /// Position of the origin of the mesh, which its trees share.
    mesh_origin: DVec3,
    /// True if `linear` is the identity.
    unturned: bool,
    /// Greatest magnitude of a coordinate in the tree's frame. Comments call it the tree's reach.
    max_coord: f64,
    local_bounds: DBounds,
    /// Largest singular value of `linear`: no distance grows by a larger factor.
    pub stretch: f64,
    /// Relative rounding error of a transformation to the tree's frame and back.
    loss: f64,
    /// Greatest distance of stored vertices from the input's vertices, in the world.
    pub position_error: f64,
    /// Bounds of the triangles in the world, rounding included.
    pub bounds: DBounds,
}

impl Deref for Placed {
    type Target = PlacedIds;

    #[inline(always)]
    fn deref(&self) -> &PlacedIds {
        &self.ids
    }
}

/// Bounds of a box that was placed elsewhere, rounding included. `greatest`: bounds of the magnitudes of its
/// coordinates.
pub(super) fn placed_bounds(b: &DBounds, map: &DAffine3, greatest: DVec3) -> DBounds {
    let placed = b.transformed(map);
    if placed.is_empty() {
        return placed;
    }
    // The slack covers a few roundings of each coordinate's terms.
    let slack = (map.translation.abs() + map.matrix3.abs() * greatest) * (16.0 * f64::EPSILON);
    DBounds { min: placed.min - slack, max: placed.max + slack }
}

/// Growth of the bounds of triangles that makes them hold all that rays may hit, as a fraction of their extents. It
/// applies where the tree's own boxes are unknown: planes of cells are rounded outward by less than a hundredth of
/// their node's size.
const CELLS: f64 = 1.0 / 64.0;

/// Bounds of all that rays may hit in a tree, in its frame.
fn around_hits(tree: &StoredTree) -> DBounds {
    match tree.around_hits {
        Some(b) => DBounds { min: b.min.as_dvec3(), max: b.max.as_dvec3() }.union(tree.bounds),
        None => {
            let grown = tree.bounds.extent() * CELLS;
            DBounds { min: tree.bounds.min - grown, max: tree.bounds.max + grown }
        }
    }
}

/// Further growth of these bounds, as a fraction of the tree's reach. Box tests of a tree may allow 64 h for rays that
/// begin within [`FAR`] reaches (h = 2^-24), and rays from farther away are moved nearer. A structure with a greater
/// allowance would lose hits here.
const GIVE: f64 = 1.0 / 4096.0;

/// The placement of a ray in a placed tree: t in the world is `shift + scale * t` in the tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct At {
    /// Number of the placed tree.
    pub placed: u64,
    pub shift: f64,
    pub scale: f64,
}

impl At {
    /// The placement in no tree.
    pub const NONE: Self = Self { placed: u64::MAX, shift: 0.0, scale: 1.0 };

    /// Converts a distance in the world to one in the tree that is not below it.
    #[inline(always)]
    pub fn in_tree(&self, t: f64) -> f32 {
        not_below((t - self.shift) / self.scale)
    }

    /// Converts a distance in the tree to one in the world.
    #[inline(always)]
    pub fn in_world(&self, t: f32) -> f64 {
        self.shift + self.scale * f64::from(t)
    }
}

/// A ray in a tree's frame: t in the world is `shift + scale * t` here.
struct Local {
    ray: LocalRay,
    shift: f64,
    scale: f64,
}

/// A ray is moved to its entry into the tree if its origin is farther away than this many times the tree's reach.
/// Single precision holds positions to 2⁻²⁴ of the distance, so beyond some reaches it would lose the tree's detail.
/// (Moved rays no longer share an origin and take three times as long. With this limit, cameras that show the whole are
/// not moved.)
const FAR: f64 = 6.0;
/// Greatest distance by which walks may misplace a hit against double precision, as a fraction of the greatest
/// coordinates. It does not hold for triangles met within some 4 degrees of edge-on. It is 64 roundings: four of origin
/// and corners and four of the test itself, each over the cosine.
const BEYOND: f64 = 1.0 / 262_144.0;
impl Placed {
    /// Places `tree` of a model; `world_from_mesh` maps the model's mesh coordinates to the world.
    pub fn new(tree: &StoredTree, ids: PlacedIds, world_from_mesh: &DAffine3) -> Self {
        Self::measured(tree, ids, world_from_mesh, Measures::of(&world_from_mesh.matrix3))
    }

    /// [`Placed::new`] with the measures of the map's linear part, which take longer than all of the rest.
    pub fn measured(tree: &StoredTree, ids: PlacedIds, world_from_mesh: &DAffine3, measures: Measures) -> Self {
        let linear = world_from_mesh.matrix3;
        let offset = world_from_mesh.transform_point3(tree.origin);
        let Measures { stretch, loss } = measures;
        let world = DAffine3 { matrix3: linear, translation: offset };
        let bounds = placed_bounds(&tree.bounds, &world, DVec3::splat(f64::from(tree.max_coord)));
        let (inverse, unturned) = (linear.inverse(), linear == DMat3::IDENTITY);
        Self {
            ids,
            linear,
            inverse,
            offset,
            mesh_origin: world_from_mesh.translation,
            unturned,
            max_coord: f64::from(tree.max_coord),
            local_bounds: tree.bounds,
            stretch,
            loss,
            position_error: tree.position_error * stretch,
            bounds,
        }
    }

    /// The frame of boxes: that of the world around `origin`, divided by `scale`. `bounds`: of the boxes, in the world.
    pub fn of_boxes(origin: DVec3, scale: f64, bounds: &DBounds, max_coord: f32) -> Self {
        let scaled = |by: f64| DMat3::from_diagonal(DVec3::splat(by));
        Self {
            ids: PlacedIds::default(),
            linear: scaled(scale),
            inverse: scaled(1.0 / scale),
            offset: origin,
            mesh_origin: origin,
            unturned: scale == 1.0,
            max_coord: f64::from(max_coord),
            local_bounds: DBounds { min: (bounds.min - origin) / scale, max: (bounds.max - origin) / scale },
            stretch: scale,
            loss: 8.0 * f64::EPSILON,
            position_error: 0.0,
            bounds: *bounds,
        }
    }

    /// The frame of the boxes of a scene which a map takes elsewhere.
    pub fn inside(&self, map: &DAffine3) -> Self {
        let linear = map.matrix3 * self.linear;
        let offset = map.transform_point3(self.offset);
        let (inverse, unturned) = (linear.inverse(), linear == DMat3::IDENTITY);
        let Measures { stretch, loss } = Measures::of(&linear);
        let position_error = self.position_error * Measures::of(&map.matrix3).stretch;
        let bounds = self.bounds.transformed(map);
        Self { linear, inverse, offset, mesh_origin: offset, unturned, stretch, loss, position_error, bounds, ..*self }
    }

    /// A bound below the least singular value of the map to the world: no distance grows by a smaller factor.
    pub fn shrink(&self) -> f64 {
        if self.unturned { 1.0 } else { 1.0 / largest_singular_value(&self.inverse) }
    }

    /// Greatest magnitude of a coordinate in the tree's frame.
    pub fn max_coord(&self) -> f64 {
        self.max_coord
    }

    /// The map from the mesh to the world.
    pub fn world_from_mesh(&self) -> DAffine3 {
        DAffine3 { matrix3: self.linear, translation: self.mesh_origin }
    }

    /// The map from the tree's frame to the world.
    pub fn frame(&self) -> DAffine3 {
        DAffine3 { matrix3: self.linear, translation: self.offset }
    }

    /// Bounds in the world of all that rays may hit in the tree, stand-ins included; `tree` must be the placed tree. A
    /// ray that misses this box hits nothing in the tree.
    pub fn hit_bounds(&self, tree: &StoredTree) -> DBounds {
        let around = around_hits(tree);
        let give = DVec3::splat(self.max_coord * GIVE);
        let local = DBounds { min: around.min - give, max: around.max + give };
        let around = local.transformed(&DAffine3 { matrix3: self.linear, translation: self.offset });
        self.bounds.union(around)
    }

    /// A point of the world in the tree's frame. The subtraction comes first: far from zero it preserves the digits.
    #[inline]
    pub fn local_point(&self, p: DVec3) -> DVec3 {
        let p = p - self.offset;
        if self.unturned { p } else { self.inverse * p }
    }

    /// A direction of the world in the tree's frame.
    #[inline]
    pub fn local_vector(&self, v: DVec3) -> DVec3 {
        if self.unturned { v } else { self.inverse * v }
    }

    /// Origin and direction of a ray in the frame of the mesh: the same for all trees of a mesh that was divided.
    pub fn in_mesh(&self, ray: &Ray) -> (DVec3, DVec3) {
        let (origin, dir) = (ray.origin - self.mesh_origin, ray.dir.as_dvec3());
        if self.unturned { (origin, dir) } else { (self.inverse * origin, self.inverse * dir) }
    }

    /// The map from the tree's frame to that with the axes of the world and its origin at `p`.
    #[inline]
    pub fn frame_around(&self, p: DVec3) -> DAffine3 {
        DAffine3 { matrix3: self.linear, translation: self.offset - p }
    }

    /// True if both are trees of one mesh, which was divided, in one place.
    pub fn is_beside(&self, other: &Self) -> bool {
        let ids = |p: &Self| (p.instance, p.first_part);
        let is_one_place = self.mesh_origin == other.mesh_origin && self.linear == other.linear;
        self.tree != other.tree && ids(self) == ids(other) && is_one_place
    }

    /// The position of the tree's origin, if its frame is only translated.
    #[inline]
    pub fn only_shifted(&self) -> Option<DVec3> {
        self.unturned.then_some(self.offset)
    }

    /// The footprint, in the tree's frame, of a ray that is neither scaled nor moved nearer.
    #[inline(always)]
    pub fn local_cone(&self, cone: Cone) -> Cone {
        if self.unturned { cone } else { self.narrowed([f64::from(cone.a), f64::from(cone.b)]) }
    }

    /// A footprint of the world in the tree's frame. No length grows by more than `stretch`, so no projected area grows
    /// by more than its square.
    #[inline(always)]
    fn narrowed(&self, [a, b]: [f64; 2]) -> Cone {
        Cone { a: (a / self.stretch) as f32, b: (b / self.stretch) as f32 }
    }

    /// Greatest coordinate, in the tree's frame, of an origin that is not moved nearer.
    #[inline]
    pub fn near(&self) -> f32 {
        // With the next lower number, an origin within the limit in single precision is also within it in double
        // precision. Otherwise single rays and packets could differ.
        ((FAR * self.max_coord) as f32).next_down()
    }

    /// True if a ray that begins at `p` is moved nearer to the tree.
    pub fn is_far(&self, p: DVec3) -> bool {
        self.local_point(p).abs().max_element() > FAR * self.max_coord
    }

    /// A point of the tree's frame in the world.
    #[inline]
    pub fn world_point(&self, p: DVec3) -> DVec3 {
        if self.unturned { p + self.offset } else { self.linear * p + self.offset }
    }

    /// Greatest distance from the tree's origin along an axis, in the world.
    #[inline]
    pub fn extent(&self) -> f64 {
        self.stretch * self.max_coord
    }

    /// Bounds in the world of a box in the tree's frame, rounding included.
    pub fn world_bounds(&self, b: &Bounds) -> DBounds {
        let local = DBounds { min: b.min.as_dvec3(), max: b.max.as_dvec3() };
        let world = local.transformed(&DAffine3 { matrix3: self.linear, translation: self.offset });
        let slack = DVec3::splat(self.rounding(0.0));
        DBounds { min: world.min - slack, max: world.max + slack }
    }

    /// Transforms a normal of the tree's frame to the world by the inverse transpose. Neither normal need be unit.
    #[inline]
    pub fn world_normal(&self, n: DVec3) -> DVec3 {
        if self.unturned { n } else { self.inverse.transpose() * n }
    }

    /// Gradient, in the tree's frame, of the dot product of `n` and a point in the world.
    #[inline]
    pub fn gradient(&self, n: DVec3) -> DVec3 {
        if self.unturned { n } else { self.linear.transpose() * n }
    }

    /// Bound of the rounding of `world_point(local_point(p))` for points within `size` of zero in the world.
    #[inline(always)]
    pub fn rounding(&self, size: f64) -> f64 {
        (size + self.offset.abs().max_element() + self.stretch * self.max_coord) * self.loss
    }

    /// Bound of the rounding of a corner's place relative to a point of the world within `size` of zero: some of the
    /// terms of its coordinates, and of those of the tree's origin.
    #[inline]
    pub fn corner_rounding(&self, size: f64) -> f64 {
        let origins = self.offset.abs().max_element() + 2.0 * self.mesh_origin.abs().max_element();
        (size + origins + 2.0 * self.stretch * self.max_coord) * (16.0 * f64::EPSILON)
    }

    /// [`Placed::rounding`] of the point `along` from `origin`.
    #[inline(always)]
    pub fn rounding_along(&self, origin: DVec3, along: DVec3) -> f64 {
        self.rounding(origin.abs().max_element() + along.abs().max_element())
    }

    /// Greatest distance, in units of the ray's direction, from a hit at `t` to a surface before it that walks put
    /// behind it. It is the distance between a ray of [`Placed::local`] and the exact ray, divided by a cosine of 1/64.
    /// The distance is four times the error of single precision; under a transform it includes the rounding on the way
    /// to the tree's frame.
    #[inline(always)]
    pub fn slack(&self, origin: DVec3, dir: Vec3, t: f64) -> f64 {
        let dir = dir.as_dvec3();
        let single = self.stretch * (self.max_coord * (2.0 * FAR + 2.0) * f64::from(f32::EPSILON) * 4.0);
        let apart = if self.unturned { single } else { single + 2.0 * self.rounding_along(origin, dir * t) };
        apart * 64.0 / dir.length()
    }

    /// The ends of a ray's interval for walks in a frame that is only translated. `org` is the ray's origin there,
    /// `dir` returns the greatest component of its direction. See [`Placed::rounded`].
    #[inline(always)]
    pub fn ends(&self, ends: [f64; 2], org: DVec3, dir: impl Fn() -> f32, beyond: bool) -> [f32; 2] {
        // Most rays begin at zero and have no end.
        if !(ends[0] > 0.0 || ends[1] < f64::INFINITY) {
            return [0.0, f32::INFINITY];
        }
        self.rounded(ends, org.abs().max_element(), f64::from(dir()), beyond)
    }

    /// True if a ray begins so near that it is not moved nearer; `org`: the greatest component of its origin in the
    /// tree's frame.
    #[inline(always)]
    pub fn is_near_by(&self, org: f64) -> bool {
        org <= FAR * self.max_coord
    }

    /// The ends of an interval in single precision. With `beyond` they are so much farther apart that no hit within the
    /// exact interval is lost, and hits may lie outside. Otherwise both become the least numbers not below them. `org`
    /// and `dir` are the greatest components of origin and direction in the tree's frame.
    #[inline(always)]
    pub fn rounded(&self, [t_min, t_max]: [f64; 2], org: f64, dir: f64, beyond: bool) -> [f32; 2] {
        if !beyond {
            return [not_below(t_min.max(0.0)), not_below(t_max)];
        }
        // For directions of about unit length this saves a division. Wherever a ray can hit anything, the rounding of
        // both ends is less than `by`.
        let over = if (0.5..=2.0).contains(&dir) { 2.0 } else { 1.0 / dir };
        let by = BEYOND * (org + self.max_coord) * over;
        [(t_min - by).max(0.0) as f32, (t_max + by) as f32]
    }

    /// True if double precision may put a triangle's hit at `t` outside of the ray's interval, for a hit of a walk that
    /// searched beyond the interval.
    #[inline(always)]
    pub fn is_near_end(&self, ray: &Ray, t: f64) -> bool {
        let (begins, ends) = (ray.t_min > 0.0, ray.t_max < f64::INFINITY);
        if !(begins || ends) {
            return false;
        }
        // A direction's greatest component in the world is at most 3^0.5 `stretch` times that in the tree's frame.
        let times = if self.unturned { 1.0 } else { 2.0 * self.stretch };
        let far = BEYOND
            * times
            * (self.local_point(ray.origin).abs().max_element().min(FAR * self.max_coord) + self.max_coord);
        let dir = f64::from(ray.dir.abs().max_element());
        // NaN in any operand returns true.
        let is_inside = (!begins || (t - ray.t_min) * dir > far) && (!ends || (ray.t_max - t) * dir > far);
        !is_inside
    }

    /// Writes the ray in the tree's frame, up to world distance `best`, to `local`, and returns shift and scale: t in
    /// the world is `shift + scale * t` there. `None` if the ray certainly misses, or cannot hit anything at all.
    /// `beyond`: see [`super::walk::SceneView::widen_interval`].
    ///
    /// The function writes each field to the caller's memory. A struct passed by value is stored in small pieces and at
    /// once loaded in large ones, and that stall takes longer than all of the rest.
    #[inline(always)]
    pub fn local(&self, ray: &Ray, best: f64, beyond: bool, local: &mut LocalRay) -> Option<(f64, f64)> {
        self.local_of(ray, Vec3::ZERO, best, beyond, local)
    }

    /// [`Placed::local`] for a ray with the direction `ray.dir + rest`. The rest matters only if the ray is moved.
    #[inline(always)]
    pub fn local_of(&self, ray: &Ray, rest: Vec3, best: f64, beyond: bool, local: &mut LocalRay) -> Option<(f64, f64)> {
        let size = ray.dir.abs().max_element();
        let org = ray.origin - self.offset;
        let is_near = self.is_near_by(org.abs().max_element());
        if self.unturned && is_near && USUAL_DIRS.contains(&size) && ray.has_interval() {
            // The common case has one rounding only. A NaN passes through: the walk detects it.
            local.org = org.as_vec3();
            local.dir = ray.dir;
            [local.t_min, local.t_max] = self.ends([ray.t_min, best], org, || size, beyond);
            local.cone = LocalRay::cone_of(ray.cone, ray.dir);
            return Some((0.0, 1.0));
        }
        // A sum would lose the signs of zeros.
        let dir = ray.dir.as_dvec3();
        let dir = if rest == Vec3::ZERO { dir } else { dir + rest.as_dvec3() };
        let Local { ray, shift, scale } =
            if ray.can_hit() { self.moved(ray, dir, best, beyond)? } else { return None };
        *local = ray;
        Some((shift, scale))
    }

    /// [`Placed::local`] for a ray that must be turned, scaled, or moved nearer.
    #[inline(never)]
    fn moved(&self, ray: &Ray, dir: DVec3, best: f64, beyond: bool) -> Option<Local> {
        let (mut org, mut dir) = (self.local_point(ray.origin), self.local_vector(dir));
        let (mut shift, mut scale) = (0.0, 1.0);
        if org.abs().max_element() > FAR * self.max_coord {
            shift = self.entry(org, dir, ray.t_min, best)?;
            org += dir * shift;
        }
        let size = dir.abs().max_element() as f32;
        if !USUAL_DIRS.contains(&size) {
            // A power of two scales exactly.
            let size = dir.abs().max_element();
            scale = 0.5f64.powi(size.log2().round().clamp(-1000.0, 1000.0) as i32);
            dir *= scale;
        }
        let (a, b) = (f64::from(ray.cone.a), f64::from(ray.cone.b));
        let cone = self.narrowed([a + b * shift, b * scale]);
        let ends = [ray.t_min, best].map(|t| (t - shift) / scale);
        let [mut t_min, t_max] = self.rounded(ends, org.abs().max_element(), dir.abs().max_element(), beyond);
        // The rounding of the sum must not put the first t before the ray's begin.
        while !beyond && shift + scale * f64::from(t_min) < ray.t_min {
            t_min = t_min.next_up();
        }
        let ray = LocalRay {
            org: org.as_vec3(),
            dir: dir.as_vec3(),
            t_min,
            t_max,
            cone: LocalRay::cone_of(cone, dir.as_vec3()),
        };
        Some(Local { ray, shift, scale })
    }

    /// A distance slightly before the ray enters the tree's bounds; `None` if it does not enter them.
    #[cold]
    fn entry(&self, org: DVec3, dir: DVec3, t_min: f64, best: f64) -> Option<f64> {
        // The margin is so large that rounding puts nothing of the tree behind the new origin, and a hit at `best` that
        // rounding has put before the bounds is still met.
        let before = 0.25 * self.max_coord / dir.abs().max_element();
        let enter = BoxRay::of(org, dir).enter(&self.local_bounds, 0.0, best + before)?;
        Some((enter - before).max(0.0).max((t_min - before).min(enter)))
    }
}

/// The least single-precision number not below `x`.
#[inline(always)]
pub(crate) fn not_below(x: f64) -> f32 {
    let single = x as f32;
    if f64::from(single) < x { single.next_up() } else { single }
}

#[cfg(test)]
impl Placed {
    /// A tree around `origin` with coordinates up to `max_coord`.
    pub fn for_tests(origin: DVec3, max_coord: f32, world_from_mesh: &DAffine3) -> Self {
        let corner = DVec3::splat(f64::from(max_coord));
        let bounds = DBounds { min: -corner, max: corner };
        let tree = StoredTree::for_tests(origin, bounds, max_coord);
        Self::new(&tree, PlacedIds::default(), world_from_mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn round_trip_error_is_within_its_bound() {
        let turns = [DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(-1.1), DQuat::from_rotation_z(2.3)];
        let [first, second] = turns.map(DMat3::from_quat);
        for skew in [1.0, 30.0, 1e4, 1e8, 1e11] {
            let linear = first * DMat3::from_diagonal(DVec3::new(skew, 1.0, skew.sqrt())) * second;
            let placed = Placed::for_tests(
                DVec3::ZERO,
                1.0,
                &DAffine3 { matrix3: linear, translation: DVec3::new(5.0, -7.0, 3.0) },
            );
            let bound = placed.rounding(7.0 + skew);
            let mut worst = 0.0f64;
            for i in 0..1000 {
                let at =
                    DVec3::new(f64::from(i) * 0.618, f64::from(i) * 0.755, f64::from(i) * 0.57).fract() * (7.0 + skew);
                worst = worst.max(placed.world_point(placed.local_point(at)).distance(at));
            }
            assert!(worst <= bound && bound < 1e4 * worst, "{skew}: {worst:e}, said {bound:e}");
            // A bound of eight roundings of coordinates, independent of the transform, would be too small.
            assert!(skew < 1e4 || worst > (14.0 + 2.0 * skew) * 8.0 * f64::EPSILON, "{skew}: {worst:e}");
        }
    }

    #[test]
    fn distances_round_up() {
        assert_eq!(not_below(f64::INFINITY), f32::INFINITY);
        assert_eq!(not_below(1.0), 1.0);
        assert_eq!(not_below(1.0 + 1e-12), 1.0f32.next_up());
    }
}
