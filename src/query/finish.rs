//! From a tree's hit in single precision to the answer in double precision.

use super::hit::{Hit, HitKind, NONE, Want};
use super::stand_in;
use crate::base::ids::BlockId;
use crate::math::Ray;
use crate::scene::placed::Placed;
use crate::scene::walk::{Ends, Found, Need, SceneView, SceneWalk, Step};
use crate::structure::{Tree, Triangle};
use glam::{DVec3, Vec3};

/// What was hit last: the next ray most often hits the same tree, and where rays are denser than triangles, the
/// same triangle.
pub(crate) struct Last<'a> {
    tree: Option<(u32, Tree<'a>)>,
    /// Where `surface` is: placed tree, block and triangle. A block that none is at first.
    place: [u32; 3],
    surface: Surface,
}

/// What all hits of a triangle share.
#[derive(Clone, Copy)]
struct Surface {
    triangle: Triangle,
    normal: WorldNormal,
    /// The caller's id of its part.
    part: u64,
}

/// No surface.
const NOWHERE: [u32; 3] = [u32::MAX; 3];

impl<'a> Last<'a> {
    /// Nothing yet.
    pub fn new() -> Self {
        let triangle = Triangle { vertices: [Vec3::ZERO; 3], part: 0 };
        Self { tree: None, place: NOWHERE, surface: Surface { triangle, normal: WorldNormal::NONE, part: NONE } }
    }

    #[inline(always)]
    fn tree(&mut self, view: &SceneView<'a>, placed: u32) -> &Tree<'a> {
        if self.tree.is_none_or(|(last, _)| last != placed) {
            self.tree = None;
        }
        &self.tree.get_or_insert_with(|| (placed, view.tree(placed))).1
    }

    /// The surface that was found; `None` if its block is not there.
    #[inline(always)]
    fn surface(&mut self, view: &SceneView<'a>, found: &Found, want: Want) -> Option<&Surface> {
        let place = [found.placed, found.tri.block, found.tri.tri];
        if self.place != place {
            self.place = NOWHERE;
            let triangle = self.tree(view, found.placed).triangle(&found.tri)?;
            let placed = &view.scene.placement.placed[found.placed as usize];
            self.surface.triangle = triangle;
            if want.has(Want::PART) {
                let part = placed.first_part.saturating_add(triangle.part) as usize;
                self.surface.part = view.model_of(found.placed).parts().get(part).map_or(NONE, |p| p.id);
            }
            if want.has(Want::NORMAL) {
                self.surface.normal = WorldNormal::new(placed, &triangle);
            }
            self.place = place;
        }
        Some(&self.surface)
    }
}

/// Where a ray meets a triangle, worked out in double precision in the tree's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Meeting {
    /// Distance in units of the world ray's direction.
    pub t: f64,
    /// Weights of the second and third vertex, in the triangle.
    pub weights: [f64; 2],
    /// Distance from the ray's point at `t` to the triangle's point at `weights`, in the tree's frame.
    pub gap: f64,
}

/// The plane of a triangle in double precision. Corners are single-precision numbers, so edges and
/// their products carry few roundings.
struct Plane {
    corner: DVec3,
    edges: [DVec3; 2],
    normal: DVec3,
}

impl Plane {
    #[inline]
    fn new(triangle: &Triangle) -> Self {
        let [a, b, c] = triangle.vertices.map(|v| v.as_dvec3());
        let edges = [b - a, c - a];
        Self { corner: a, edges, normal: edges[0].cross(edges[1]) }
    }

    /// The triangle's point nearest to `p`, as weights; and its distance.
    #[inline]
    fn clamped(&self, p: DVec3) -> ([f64; 2], f64) {
        let from = p - self.corner;
        let inverse = 1.0 / self.normal.length_squared();
        let u = from.cross(self.edges[1]).dot(self.normal) * inverse;
        let v = self.edges[0].cross(from).dot(self.normal) * inverse;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 { self.at_weights(from, [u, v]) } else { self.on_border(from) }
    }

    /// These weights, and the distance of their point to `from` (relative to the corner).
    #[inline]
    fn at_weights(&self, from: DVec3, weights: [f64; 2]) -> ([f64; 2], f64) {
        (weights, (from - self.edges[0] * weights[0] - self.edges[1] * weights[1]).length())
    }

    /// The border's point nearest to `from`. Not just the weights cut to their range: on a sliver that may be
    /// far from the nearest.
    #[cold]
    fn on_border(&self, from: DVec3) -> ([f64; 2], f64) {
        let along = |from: DVec3, edge: DVec3| {
            let s = from.dot(edge) / edge.length_squared();
            if s.is_nan() { 0.0 } else { s.clamp(0.0, 1.0) }
        };
        let [ab, ac] = self.edges;
        let s = along(from - ab, ac - ab);
        let three = [[along(from, ab), 0.0], [0.0, along(from, ac)], [1.0 - s, s]];
        let of_three = three.map(|weights| self.at_weights(from, weights));
        let better = |a: ([f64; 2], f64), b: ([f64; 2], f64)| if b.1 < a.1 { b } else { a };
        better(better(of_three[0], of_three[1]), of_three[2])
    }
}

/// Meets the triangle again, in double precision. `found`: where the walk met it.
///
/// The ray's t is where it meets the triangle's plane. Nearly edge-on that is ill-conditioned, and
/// the walk's own t, or the one nearest to the triangle's point, may leave a smaller gap: the
/// smallest wins. So the answer is judged by its outcome: `gap` is measured, not estimated. The ray's interval has no say: where it meets
/// a triangle is the same in any.
#[inline]
pub(crate) fn meet(placed: &Placed, triangle: &Triangle, ray: &Ray, found: f64) -> Meeting {
    let plane = Plane::new(triangle);
    let (org, dir) = (placed.local_point(ray.origin), placed.local_vector(ray.dir.as_dvec3()));
    let at = |t: f64| {
        let t = t.max(0.0);
        let (weights, gap) = plane.clamped(org + dir * t);
        Meeting { t, weights, gap }
    };
    let t = plane.normal.dot(plane.corner - org) / plane.normal.dot(dir);
    let best = if t.is_finite() { at(t) } else { at(found) };
    // In the plane to rounding, and within the triangle: nothing to gain.
    let rounding = (org.abs().max_element() + dir.abs().max_element() * best.t.abs()) * 1e-14;
    if best.gap <= rounding { best } else { least_gap(&plane, org, dir, [best, at(found)], at) }
}

/// The better of two meetings, and of that with the ray's point nearest to the better's.
#[cold]
fn least_gap(plane: &Plane, org: DVec3, dir: DVec3, two: [Meeting; 2], at: impl Fn(f64) -> Meeting) -> Meeting {
    let better = if two[1].gap < two[0].gap { two[1] } else { two[0] };
    let point = plane.corner + plane.edges[0] * better.weights[0] + plane.edges[1] * better.weights[1];
    let nearest = at((point - org).dot(dir) / dir.length_squared());
    if nearest.gap < better.gap { nearest } else { better }
}

/// A walk for [`past`].
#[cold]
pub(super) fn begin_past(view: &SceneView, ray: &Ray) -> SceneWalk {
    let mut walk = SceneWalk::default();
    walk.begin(view, ray);
    walk
}

/// Whether a ray passed a cell before it begins: whose content, of which some may be behind the begin, nobody has looked at.
#[inline(always)]
pub(super) fn is_early(view: &SceneView, ray: &Ray, found: &Found) -> bool {
    view.looks_beyond && found.passed < ray.t_min
}

/// Goes on with the walk of a ray that found, or passed, something outside of its interval, each hit now seen in double precision, and fills `found` and `hit` with the
/// first within (`any`: with any); fails with the block that is needed to go on again. (Rays that begin right at a surface, as whoever peels off layer after
/// layer asks for them, or end there.)
#[cold]
pub(super) fn past(view: &SceneView, any: bool, ray: &Ray, walk: &mut SceneWalk, want: Want, found: &mut Found, hit: &mut Hit) -> Result<(), Need> {
    *hit = Hit::MISS;
    let judge = Judge { placed: &view.scene.placement.placed, ray };
    let view = SceneView { within: Some(&judge), ..*view };
    let step = if any { view.trace::<true>(ray, walk) } else { view.trace::<false>(ray, walk) };
    if let Step::Pending(need) = step {
        return Err(need);
    }
    *found = walk.best();
    if found.is_hit() {
        let is_within = finish(&view, &mut Last::new(), ray, found, want, hit)?;
        debug_assert!(is_within, "{ray:?}: {found:?}");
    }
    Ok(())
}

/// Which hits are within a ray's interval, as [`finish`] sees it.
#[derive(Debug)]
struct Judge<'a> {
    placed: &'a [Placed],
    ray: &'a Ray,
}

impl Ends for Judge<'_> {
    fn triangle(&self, placed: u32, triangle: &Triangle, t: f64) -> bool {
        is_within(self.ray, meet(&self.placed[placed as usize], triangle, self.ray, t).t)
    }
    fn cell(&self, t: f64) -> bool {
        is_within(self.ray, t)
    }
    fn is_beyond(&self, t: f64) -> bool {
        t > self.ray.t_max
    }
}

#[inline(always)]
pub(super) fn is_within(ray: &Ray, t: f64) -> bool {
    (ray.t_min..=ray.t_max).contains(&t)
}

/// Fills what `want` asks of `hit`, which is [`Hit::MISS`] or was filled with the same `want`; fails with the
/// block that is needed. False where the view looks beyond the ends of rays, and what was found turns out to be outside of the interval: then what is within is
/// to be found, see [`past`].
///
/// **Error bound.** Let M be the placed tree's map to the world, s its largest singular value. The answer is
/// `position` = origin + t · dir, rounded; `meet` knows a triangle's point q with |M⁻¹ position − q| = `gap`. M q
/// lies on the stored triangle, the input's within `position_error` of it (in the world). So an
/// original surface lies within
///
/// `error` = s · gap + position_error + r, r = l (|origin| + |t dir| + |offset| + s · reach),
///
/// where r covers what double precision loses: position has two roundings a component, the way to
/// the tree's frame a subtraction and a product of three terms, and back the same; l is 8 · 2⁻⁵² where M is the identity, otherwise
/// as much of its terms times its inverse's, and what their product differs from the identity by. Single precision
/// does not enter: it chose the triangle, and the gap tells how well.
///
/// **t_free.** A nearer surface that single precision put behind this one: the walk sees ray and
/// triangles moved by at most `Placed::slack` (the origin is within 6 reaches, so it and each vertex
/// relative to it carry at most 2⁻²³ of 14 reaches; 4 times that is given, and 2 r where M is not the identity), so a
/// surface before t is less than that before it, along the ray, divided by the cosine at which it is met:
/// 64 is given for that, which leaves out surfaces met within 0.9° of edge-on.
#[inline(always)]
pub(crate) fn finish<'a>(view: &SceneView<'a>, last: &mut Last<'a>, ray: &Ray, found: &Found, want: Want, hit: &mut Hit) -> Result<bool, Need> {
    if let Some(cell) = found.tri.stand_in() {
        // What a cell that is met before the ray begins holds is met one by one. What is missing cannot be.
        let is_in = if cell.is_missing { found.t <= ray.t_max } else { is_within(ray, found.t) };
        if view.looks_beyond && !is_in {
            return Ok(false);
        }
        let Some(look) = stand_in::look(view, ray, found) else {
            *hit = Hit { t: found.t, ..Hit::MISS };
            let model = view.scene.placement.placed[found.placed as usize].model;
            return Err(Need { model, block: BlockId(found.tri.block) });
        };
        stand_in::fill(view, ray, found, &look, want, hit);
        return Ok(true);
    }
    hit.kind = HitKind::Exact;
    hit.t = found.t;
    let placed = &view.scene.placement.placed[found.placed as usize];
    if want.has(Want::INSTANCE) {
        hit.instance = view.scene.instances[placed.instance as usize].id;
    }
    let need = |block| Need { model: placed.model, block };
    if want.has(Want::UV) {
        hit.uv = [found.tri.u, found.tri.v];
    }
    let mut within = true;
    let is_near_end = view.looks_beyond && !want.any_of(Want::MEETING) && placed.is_near_end(ray, found.t);
    if want.any_of(Want::SURFACE) || is_near_end {
        let Some(surface) = last.surface(view, found, want) else {
            // Nothing of what was there before: that is another ray's.
            *hit = Hit { t: found.t, ..Hit::MISS };
            return Err(need(BlockId(found.tri.block)));
        };
        if want.has(Want::PART) {
            hit.part = surface.part;
        }
        if want.has(Want::NORMAL) {
            hit.normal = surface.normal.facing(ray.dir);
        }
        if want.any_of(Want::MEETING) || is_near_end {
            fill_from_meeting(placed, ray, found, &surface.triangle, want, hit);
            within = !view.looks_beyond || is_within(ray, hit.t);
        }
    }
    if !within {
        return Ok(false);
    }
    // Last: it is what may be missing, and all else is then known.
    if want.has(Want::PRIM) {
        hit.prim = NONE;
        hit.prim = u64::from(last.tree(view, found.placed).prim(&found.tri).map_err(need)?);
    }
    Ok(true)
}

/// A walk for [`free`].
#[cold]
pub(super) fn begin_free(view: &SceneView, ray: &Ray) -> SceneWalk {
    let mut walk = SceneWalk::default();
    walk.begin(&solid(view), ray);
    walk
}

/// With stand-ins that no ray passes. What is a little before a ray begins is not to count as the first on it.
fn solid<'a>(view: &SceneView<'a>) -> SceneView<'a> {
    SceneView { is_solid: true, looks_beyond: false, ..*view }
}

/// Goes on with the walk of a ray that passed stand-ins, now passing none, and takes `t_free` down to where it hits; fails with the block that
/// is needed to go on again.
#[cold]
pub(super) fn free(view: &SceneView, ray: &Ray, walk: &mut SceneWalk, hit: &mut Hit) -> Result<(), Need> {
    let view = solid(view);
    if let Step::Pending(need) = view.trace::<false>(ray, walk) {
        return Err(need);
    }
    let (found, mut first) = (walk.best(), Hit::MISS);
    if found.is_hit() {
        finish(&view, &mut Last::new(), ray, &found, Want::ERROR, &mut first)?;
    }
    hit.t_free = hit.t_free.min(first.t_free);
    Ok(())
}

/// What needs the hit in double precision.
#[inline(never)]
fn fill_from_meeting(placed: &Placed, ray: &Ray, found: &Found, triangle: &Triangle, want: Want, hit: &mut Hit) {
    let meeting = meet(placed, triangle, ray, found.t);
    hit.t = meeting.t;
    if want.has(Want::UV) {
        hit.uv = meeting.weights.map(|w| w as f32);
    }
    let along = ray.dir.as_dvec3() * meeting.t;
    if want.has(Want::POSITION) {
        hit.position = ray.origin + along;
    }
    if want.has(Want::ERROR) {
        let error = placed.stretch * meeting.gap + placed.position_error + placed.rounding_along(ray.origin, along);
        hit.error = crate::scene::placed::not_below(error);
        hit.t_free = (meeting.t - placed.slack(ray, meeting.t)).max(ray.begins());
    }
}

/// The unit geometric normal in the world, against `dir`; the ray's own opposite where a triangle
/// is too thin to have one.
#[inline(always)]
pub(crate) fn facing_normal(placed: &Placed, triangle: &Triangle, dir: Vec3) -> Vec3 {
    WorldNormal::new(placed, triangle).facing(dir)
}

/// A triangle's normal in the world, on the side from which its corners are seen counter-clockwise.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorldNormal {
    /// Of any length.
    pub across: DVec3,
    /// Of length 1.
    pub unit: Vec3,
    /// The square of `across` leaves the range of single precision: `unit` means nothing.
    pub is_extreme: bool,
}

impl WorldNormal {
    const NONE: Self = Self { across: DVec3::ZERO, unit: Vec3::ZERO, is_extreme: true };

    #[inline(always)]
    fn new(placed: &Placed, triangle: &Triangle) -> Self {
        let [a, b, c] = triangle.vertices;
        let a = a.as_dvec3();
        Self::of(placed.world_normal((b.as_dvec3() - a).cross(c.as_dvec3() - a)))
    }

    /// From one of any length.
    #[inline(always)]
    pub fn of(across: DVec3) -> Self {
        let square = across.length_squared();
        // Single precision is what the answer has; a root and a quotient of it take half the time.
        let unit = (across * f64::from(1.0 / (square as f32).sqrt())).as_vec3();
        Self { across, unit, is_extreme: !NORMAL_SQUARES.contains(&square) }
    }

    /// Of length 1, against `dir`; where a triangle is too thin to have a normal, the opposite of `dir`.
    #[inline(always)]
    pub fn facing(&self, dir: Vec3) -> Vec3 {
        let dir = dir.as_dvec3();
        if self.is_extreme {
            return extreme_normal(self.across, dir).as_vec3();
        }
        if self.across.dot(dir) > 0.0 { -self.unit } else { self.unit }
    }
}

/// Squares of lengths whose roots and reciprocals keep all digits of single precision.
const NORMAL_SQUARES: std::ops::Range<f64> = 1e-36..1e36;

/// A normal that is zero, or so long or short that its square leaves the range of single precision.
#[cold]
fn extreme_normal(normal: DVec3, dir: DVec3) -> DVec3 {
    let size = normal.abs().max_element();
    match (normal * (1.0 / size)).try_normalize() {
        Some(n) if n.dot(dir) <= 0.0 => n,
        Some(n) => -n,
        None => -dir.normalize_or_zero(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::placed::Placed;
    use glam::{DAffine3, DMat3, Vec3};

    fn placed(offset: DVec3, linear: DMat3) -> Placed {
        Placed::for_tests(DVec3::ZERO, 2.0, &DAffine3 { matrix3: linear, translation: offset })
    }

    fn triangle(v: [[f32; 3]; 3]) -> Triangle {
        Triangle { vertices: v.map(Vec3::from), part: 0 }
    }

    #[test]
    fn far_from_zero_the_distance_keeps_its_digits() {
        let offset = DVec3::new(1e7, -2e7, 3e7);
        let p = placed(offset, DMat3::IDENTITY);
        let t = triangle([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]);
        let ray = Ray::new(offset + DVec3::new(0.25, 0.25, 4.0), Vec3::new(0.0, 0.0, -1.0));
        let m = meet(&p, &t, &ray, 3.4999);
        assert!((m.t - 3.5).abs() < 1e-8, "{m:?}");
        assert!((m.weights[0] - 0.25).abs() < 1e-8 && m.gap < 1e-8);
    }

    #[test]
    fn beside_a_sliver_the_gap_is_the_true_distance() {
        // Weights cut to their range gave 3e-4 here, and a t that was off by as much.
        let t = triangle([[0.0; 3], [35.0, 0.01, 0.0], [35.0, 0.02, 0.0]]);
        let above = Plane::new(&t).clamped(DVec3::new(20.0, 0.012, 0.0));
        let slope = 0.02f64.atan2(35.0);
        assert!((above.1 - (0.012 - 20.0 * slope.tan()) * slope.cos()).abs() < 1e-9, "{above:?}");
        let behind = Plane::new(&t).clamped(DVec3::new(-3.0, 0.0, 4.0));
        assert_eq!(behind, ([0.0, 0.0], 5.0));
        let beyond = Plane::new(&t).clamped(DVec3::new(36.0, 0.015, 0.0));
        assert!((beyond.1 - 1.0).abs() < 1e-9 && (beyond.0[0] - 0.5).abs() < 1e-3 && (beyond.0[1] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn edge_on_the_gap_stays_small_and_t_sane() {
        // The ray lies in the triangle's plane.
        let p = placed(DVec3::ZERO, DMat3::IDENTITY);
        let t = triangle([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let ray = Ray::new(DVec3::new(-1.0, 0.25, 0.0), Vec3::X);
        let m = meet(&p, &t, &ray, 1.25);
        assert!((1.0..=1.75).contains(&m.t) && m.gap < 1e-6, "{m:?}");
        // And a hair above it, tilted by less than single precision shows.
        let ray = Ray::new(DVec3::new(-1.0, 0.25, 1e-9), Vec3::new(1.0, 0.0, -1e-12));
        let m = meet(&p, &t, &ray, 1.25);
        assert!((1.0..=1.75).contains(&m.t) && m.gap < 1e-8, "{m:?}");
    }

    #[test]
    fn normals_go_by_the_inverse_transpose_and_face_the_ray() {
        let squash = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.5));
        let p = placed(DVec3::ZERO, squash);
        // The plane x + z = 0 becomes x + 2 z = 0.
        let t = triangle([[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [0.0, 1.0, 0.0]]);
        for dir in [-DVec3::Z, DVec3::Z] {
            let n = facing_normal(&p, &t, dir.as_vec3());
            let expected = DVec3::new(1.0, 0.0, 2.0).normalize() * -dir.z.signum();
            assert!(n.as_dvec3().distance(expected) < 2e-7, "{n} {expected}");
        }
        let sliver = triangle([[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        assert_eq!(facing_normal(&p, &sliver, Vec3::X), -Vec3::X);
        // Too small and too large for single precision's squares.
        for size in [1e-30f32, 1e15] {
            let t = triangle([[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]]);
            assert_eq!(facing_normal(&p, &t, Vec3::Z), -Vec3::Z);
        }
    }
}
