//! Normals with which hits are shaded: interpolated between the corners of the triangle.

use crate::scene::placed::Placed;
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::Vec3;

/// Weights of a triangle's corners, from those of the second and third.
#[inline(always)]
pub(crate) fn weights([u, v]: [f32; 2]) -> [f32; 3] {
    [1.0 - u - v, u, v]
}

/// Returns the normals at the corners of a triangle in the world; `normals` are those in the tree's frame. The longest
/// is of length 1.
#[inline]
pub(crate) fn world_corners(placed: &Placed, normals: &[Vec3; 3]) -> [Vec3; 3] {
    if placed.only_shifted().is_some() {
        return *normals;
    }
    let world = normals.map(|n| placed.world_normal(n.as_dvec3()));
    let longest = world.iter().fold(f64::MIN_POSITIVE, |longest, n| n.length().max(longest));
    world.map(|n| (n / longest).as_vec3())
}

/// Square of the length below which a mean of normals has no direction: the corners' normals are opposite.
const LEAST: f32 = 1e-12;

/// Returns the unit shading normal on the side of `facing`, the unit geometric normal that faces the ray. `corners`:
/// the normals at the corners in the world.
#[inline(always)]
pub(crate) fn shading_normal(corners: &[Vec3; 3], uv: [f32; 2], facing: Vec3) -> Vec3 {
    let [a, b, c] = weights(uv);
    let mixed = corners[0] * a + corners[1] * b + corners[2] * c;
    let square = mixed.dot(mixed);
    let unit = mixed * (1.0 / square.sqrt());
    let unit = if square > LEAST { unit } else { facing };
    if unit.dot(facing) < 0.0 { -unit } else { unit }
}

/// Least cosine between a shading normal and the direction to the eye. A normal that faces away from the eye, as at the
/// outline of coarse facets, would make the surface black.
const LEAST_FACING: f32 = 1.0 / 64.0;

/// Turns a unit shading normal towards the eye if it faces away. `to_eye` is the unit direction to the eye.
#[inline(always)]
pub(crate) fn turned_to(normal: Vec3, to_eye: Vec3) -> Vec3 {
    let lacking = LEAST_FACING - normal.dot(to_eye);
    let turned = normal + to_eye * lacking;
    if lacking > 0.0 { turned * (1.0 / turned.length()) } else { normal }
}

/// The interpolation for rows of rays, one column each. Reusable.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct Corners<const N: usize> {
    /// Normals at the corners in the world: corner, axis, column.
    normals: [[[f32; N]; 3]; 3],
    /// Weights of the second and third corner.
    uv: [[f32; N]; 2],
    /// Rays whose columns are set.
    set: u32,
}

impl<const N: usize> Corners<N> {
    pub const NONE: Self = Self { normals: [[[0.0; N]; 3]; 3], uv: [[0.0; N]; 2], set: 0 };

    /// Clears all columns.
    pub fn clear(&mut self) {
        self.set = 0;
    }

    /// Sets the column of ray `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, corners: &[Vec3; 3], [u, v]: [f32; 2]) {
        for (rows, corner) in self.normals.iter_mut().zip(corners) {
            (rows[0][i], rows[1][i], rows[2][i]) = (corner.x, corner.y, corner.z);
        }
        (self.uv[0][i], self.uv[1][i]) = (u, v);
        self.set |= 1 << i;
    }

    /// The normals at the corners in the world, if the column of ray `i` is set.
    pub fn of(&self, i: usize) -> Option<[Vec3; 3]> {
        let corner = |rows: &[[f32; N]; 3]| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        (self.set >> i & 1 == 1).then(|| self.normals.each_ref().map(corner))
    }

    /// Replaces the geometric normals of the rays whose columns are set by shading normals, turned to the eye. `dir`:
    /// the rays' unit directions.
    pub fn replace(&self, isa: Isa, dir: &[[f32; N]; 3], normals: &mut [[f32; N]; 3]) {
        if self.set != 0 {
            dispatch(isa, Replace { corners: self, dir, normals });
        }
    }
}

struct Replace<'a, const N: usize> {
    corners: &'a Corners<N>,
    dir: &'a [[f32; N]; 3],
    normals: &'a mut [[f32; N]; 3],
}

impl<const N: usize> Op for Replace<'_, N> {
    type Out = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // the loop indexes several arrays
    fn run<S: Simd>(self, _: S) {
        let Self { corners: Corners { normals: [a, b, c], uv, set }, dir, normals } = self;
        let at = |rows: &[[f32; N]; 3], i: usize| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
        for i in 0..N {
            let own = at(normals, i);
            let smooth = shading_normal(&[at(a, i), at(b, i), at(c, i)], [uv[0][i], uv[1][i]], own);
            let smooth = turned_to(smooth, -at(dir, i));
            let one = if set >> i & 1 == 1 { smooth } else { own };
            (normals[0][i], normals[1][i], normals[2][i]) = (one.x, one.y, one.z);
        }
    }
}
