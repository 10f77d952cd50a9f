//! A ray prepared for boxes and triangles of a tree, and in the system of a frame.

use super::codes::{Planes, Slabs};
use super::layout::Frame;
use crate::geom::Shear;
use crate::math::Cone;
use crate::simd::{Lanes, Mask, Simd};
use crate::structure::filter::PartFilter;
use crate::structure::ray::{self, LocalRay, SLACK};
use glam::Vec3;

/// A ray with the constants that tests need.
pub struct Prepared<'a> {
    /// The ray.
    pub ray: LocalRay,
    /// Reciprocal direction.
    pub inv: Vec3,
    /// Tolerance of the planes of cells, with the sign of `inv`.
    pub slack: Vec3,
    /// For the triangle test.
    pub shear: Shear,
    /// True if the ray accepts small cells as stand-ins.
    pub is_lod: bool,
    /// Hidden parts, and further tests.
    pub filter: Option<&'a PartFilter<'a>>,
}

/// Tolerance of boxes as a multiple of that of cells. A ray that enters a cell therefore also enters the boxes around
/// it.
const BOXES: f32 = 2.0;

/// Reciprocals of a direction. A component below 1e-18 of the greatest is raised to that magnitude.
#[inline(always)]
fn reciprocal(dir: Vec3) -> Vec3 {
    let least = dir.abs().max_element() * 1e-18;
    Vec3::ONE / dir.abs().max(Vec3::splat(least)).copysign(dir)
}

impl<'a> Prepared<'a> {
    /// Prepares a valid ray for a tree with coordinates of at most `max_coord` in magnitude.
    #[inline(always)]
    pub fn new(ray: LocalRay, max_coord: f32, filter: Option<&'a PartFilter<'a>>) -> Self {
        let inv = reciprocal(ray.dir);
        let of = ray::slack;
        let (org, m) = (ray.org, max_coord);
        let slack = Vec3::new(of(org.x, inv.x, m), of(org.y, inv.y, m), of(org.z, inv.z, m));
        Self { ray, inv, slack, shear: Shear::new(ray.dir), is_lod: ray.cone != Cone::ZERO, filter }
    }

    /// The boxes of eight children that the ray meets from `t_min` to `t_max`, and where it enters them.
    #[inline(always)]
    pub fn boxes<S: Simd>(&self, s: S, rows: &[[f32; 8]; 6], t_max: f32) -> (u32, S::F8) {
        let (mut enter, mut leave) = (s.splat8(self.ray.t_min), s.splat8(t_max));
        for axis in 0..3 {
            let is_positive = self.inv[axis] >= 0.0;
            let (near, far) = if is_positive { (axis, axis + 3) } else { (axis + 3, axis) };
            let (org, inv) = (s.splat8(self.ray.org[axis]), s.splat8(self.inv[axis]));
            let slack = s.splat8(self.slack[axis] * BOXES);
            enter = ((s.load8(&rows[near]) - slack - org) * inv).max(enter);
            leave = ((s.load8(&rows[far]) + slack - org) * inv).min(leave);
        }
        (enter.le(leave).bits(), enter)
    }

    /// Distances at which the ray enters and leaves a cell.
    #[inline(always)]
    pub fn cross(&self, planes: &Planes) -> [f32; 2] {
        let (mut enter, mut leave) = (f32::NEG_INFINITY, f32::INFINITY);
        for axis in 0..3 {
            let is_positive = self.inv[axis] >= 0.0;
            let (near, far) = if is_positive { (axis, axis + 3) } else { (axis + 3, axis) };
            enter = enter.max((planes[near] - self.slack[axis] - self.ray.org[axis]) * self.inv[axis]);
            leave = leave.min((planes[far] + self.slack[axis] - self.ray.org[axis]) * self.inv[axis]);
        }
        [enter, leave]
    }

    /// True if the ray's footprint at `t` covers cells with a projection of this area, times the direction's length.
    #[inline(always)]
    pub fn covers(&self, t: f32, area: f32) -> bool {
        let width = self.ray.cone.a + self.ray.cone.b * t;
        area <= width * width
    }
}

/// A ray in the system of a frame. Its distances count from where it was said to enter the frame.
///
/// The origin of the system's ray is where the ray enters the frame's surroundings, computed in double precision: so
/// its coordinates are small, and rounding moves planes by a few parts in 2^24 of the frame at most.
pub struct FrameRay<S: Simd> {
    org: [f32; 3],
    inv: [f32; 3],
    slack: [f32; 3],
    /// Origin, reciprocal direction and tolerance of the planes of [`Slabs::across`] and of [`Slabs::along`].
    across: [S::F8; 3],
    along: [S::F8; 3],
    /// For each axis, the area of the unit square across it, as the ray sees it, times the direction's length.
    faces: [f32; 3],
}

/// The lesser and the greater of two numbers. (`f32::min` and `f32::max` take three instructions each, for NaN.)
#[inline(always)]
fn ordered(a: f32, b: f32) -> [f32; 2] {
    [if a < b { a } else { b }, if a > b { a } else { b }]
}

impl<S: Simd> FrameRay<S> {
    /// The ray in a frame that it enters at `from` or behind.
    #[inline(always)]
    pub fn new(s: S, ray: &Prepared, frame: &Frame, from: f32) -> Self {
        let (map, centre) = (frame.map(), frame.centre().as_dvec3());
        let linear = map.as_dmat3();
        let LocalRay { org, dir, .. } = ray.ray;
        let at = org.as_dvec3() + dir.as_dvec3() * f64::from(from) - centre;
        let (org, dir) = ((linear * at).as_vec3(), (linear * dir.as_dvec3()).as_vec3());
        let inv = reciprocal(dir);
        let slack = org.abs().max(Vec3::ONE) * SLACK;
        // The cross product of two columns of the inverse is a row of the map over its determinant.
        let faces = if ray.is_lod { (dir.abs().as_dvec3() / linear.determinant().abs()).as_vec3() } else { Vec3::ZERO };
        let (x, y, z) = (slack.x, slack.y, slack.z);
        let two = |a: f32, b: f32| [a, a, a, a, b, b, b, b];
        Self {
            across: [s.load8(&two(org.x, org.y)), s.load8(&two(inv.x, inv.y)), s.load8(&[-x, x, -x, x, -y, y, -y, y])],
            along: [s.splat8(org.z), s.splat8(inv.z), s.load8(&two(-z, z))],
            org: org.to_array(),
            inv: inv.to_array(),
            slack: slack.to_array(),
            faces: faces.to_array(),
        }
    }

    /// Distances at which the ray enters and leaves the boxes of four children. Low planes are lowered and high ones
    /// raised by the tolerance; which of both comes first depends on the direction.
    #[inline(always)]
    pub fn four(&self, s: S, slabs: &Slabs) -> [[f32; 4]; 2] {
        let [org, inv, slack] = self.across;
        let t = ((s.load8(&slabs.across) + slack - org) * inv).to_array();
        let [org, inv, slack] = self.along;
        let z = ((s.load8(&slabs.along) + slack - org) * inv).to_array();
        let (mut enter, mut leave) = ([0.0f32; 4], [0.0f32; 4]);
        for i in 0..4 {
            let (x, y) = (2 * (i & 1), 4 + (i & 2));
            let ends = [ordered(t[x], t[x + 1]), ordered(t[y], t[y + 1]), ordered(z[i], z[i + 4])];
            enter[i] = ordered(ordered(ends[0][0], ends[1][0])[1], ends[2][0])[1];
            leave[i] = ordered(ordered(ends[0][1], ends[1][1])[0], ends[2][1])[0];
        }
        [enter, leave]
    }

    /// The same of one box.
    #[inline(always)]
    pub fn one(&self, planes: &Planes) -> [f32; 2] {
        let (mut enter, mut leave) = (f32::NEG_INFINITY, f32::INFINITY);
        for axis in 0..3 {
            let (org, inv, slack) = (self.org[axis], self.inv[axis], self.slack[axis]);
            let (a, b) = ((planes[axis] - slack - org) * inv, (planes[axis + 3] + slack - org) * inv);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        [enter, leave]
    }

    /// Area of a box as the ray sees it, times the direction's length.
    #[inline(always)]
    pub fn area(&self, planes: &Planes) -> f32 {
        let (x, y, z) = (planes[3] - planes[0], planes[4] - planes[1], planes[5] - planes[2]);
        self.faces[0] * y * z + self.faces[1] * z * x + self.faces[2] * x * y
    }
}
