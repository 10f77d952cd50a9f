//! Intersections in double precision ([`meet`]) for rows of rays, one column each, in loops that the compiler
//! vectorises.
#![allow(clippy::needless_range_loop)] // loops index several arrays at once

use super::meeting::{Meeting, Plane, meet};
use crate::math::{Ray, bits};
use crate::scene::placed::Placed;
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::{DVec3, Vec3};

/// The intersections of up to `N` rays with triangles of a placed tree. Reusable: columns of other rays hold arbitrary
/// values.
#[derive(Debug)]
#[repr(C, align(64))]
pub(crate) struct Meetings<const N: usize> {
    /// Corners of the triangles in the tree's frame: corner, axis, column.
    corners: [[[f32; N]; 3]; 3],
    origin: [[f64; N]; 3],
    dir: [[f32; N]; 3],
    t: [f64; N],
    weights: [[f64; N]; 2],
    error: [f32; N],
    /// See [`Meeting::free`].
    free: [f64; N],
}

impl<const N: usize> Meetings<N> {
    pub const NONE: Self = Self {
        corners: [[[0.0; N]; 3]; 3],
        origin: [[0.0; N]; 3],
        dir: [[0.0; N]; 3],
        t: [0.0; N],
        weights: [[0.0; N]; 2],
        error: [0.0; N],
        free: [0.0; N],
    };

    /// Sets the triangle that ray `i` hits.
    #[inline(always)]
    pub fn set(&mut self, i: usize, corners: &[Vec3; 3], origin: DVec3, dir: Vec3) {
        for (rows, corner) in self.corners.iter_mut().zip(corners) {
            (rows[0][i], rows[1][i], rows[2][i]) = (corner.x, corner.y, corner.z);
        }
        (self.origin[0][i], self.origin[1][i], self.origin[2][i]) = (origin.x, origin.y, origin.z);
        (self.dir[0][i], self.dir[1][i], self.dir[2][i]) = (dir.x, dir.y, dir.z);
    }

    /// Computes the intersections of `rays`, whose triangles are set; `found` returns the distance that the walk found.
    #[inline(always)]
    pub fn meet(&mut self, isa: Isa, placed: &Placed, rays: u32, found: impl Fn(usize) -> f64) {
        let sure = if N == 1 { 0 } else { dispatch(isa, Meet { all: self, placed }) };
        for i in bits(rays & !sure) {
            let ray = Ray::new(self.origin(i), self.dir(i));
            let one = meet(placed, &corners_of(&self.corners, i), &ray, found(i));
            (self.t[i], self.error[i]) = (one.t, one.error(placed, ray.origin, ray.dir));
            (self.weights[0][i], self.weights[1][i]) = (one.weights[0], one.weights[1]);
            self.free[i] = one.free(placed, ray.origin, ray.dir);
        }
    }

    /// Distance of ray `i` in units of its direction.
    #[inline(always)]
    pub fn t(&self, i: usize) -> f64 {
        self.t[i]
    }

    /// Weights of the second and third corner.
    #[inline(always)]
    pub fn weights(&self, i: usize) -> [f64; 2] {
        [self.weights[0][i], self.weights[1][i]]
    }

    /// See [`Meeting::error`].
    #[inline(always)]
    pub fn error(&self, i: usize) -> f32 {
        self.error[i]
    }

    /// See [`Meeting::free`].
    #[inline(always)]
    pub fn free(&self, i: usize) -> f64 {
        self.free[i]
    }

    #[inline(always)]
    fn origin(&self, i: usize) -> DVec3 {
        DVec3::new(self.origin[0][i], self.origin[1][i], self.origin[2][i])
    }

    #[inline(always)]
    fn dir(&self, i: usize) -> Vec3 {
        Vec3::new(self.dir[0][i], self.dir[1][i], self.dir[2][i])
    }
}

#[inline(always)]
fn corners_of<const N: usize>([a, b, c]: &[[[f32; N]; 3]; 3], i: usize) -> [Vec3; 3] {
    [a, b, c].map(|rows| Vec3::new(rows[0][i], rows[1][i], rows[2][i]))
}

/// Computes all columns. Returns those for which the ray's intersection with the triangle's plane is in the triangle,
/// up to rounding: [`meet`] must compute the others.
struct Meet<'a, const N: usize> {
    all: &'a mut Meetings<N>,
    placed: &'a Placed,
}

impl<const N: usize> Op for Meet<'_, N> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let Self { all, placed } = self;
        // A local copy is known not to change while the columns are written.
        let placed = *placed;
        let mut gap = [0.0; N];
        let mut sure = [0; N];
        for i in 0..N {
            let plane = Plane::new(&corners_of(&all.corners, i));
            let org = placed.local_point(all.origin(i));
            let dir = placed.local_vector(all.dir(i).as_dvec3());
            let (t, [u, v], away, is_sure) = plane.through(org, dir);
            (all.t[i], all.weights[0][i], all.weights[1][i], gap[i]) = (t, u, v, away);
            sure[i] = u32::from(is_sure) << i;
        }
        for i in 0..N {
            let one = Meeting { t: all.t[i], weights: [0.0; 2], gap: gap[i] };
            let (origin, dir) = (all.origin(i), all.dir(i));
            (all.error[i], all.free[i]) = (one.error(&placed, origin, dir), one.free(&placed, origin, dir));
        }
        sure.iter().fold(0, |all, it| all | it)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DMat3, DQuat};

    /// Rows give what [`meet`] gives for each ray, to the bit: in frames that are shifted and turned, for hits inside,
    /// beside and edge-on.
    #[test]
    fn rows_are_single_intersections_to_the_bit() {
        let mut state = 7u32;
        let mut next = |low: f64, high: f64| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * f64::from(state >> 8) / f64::from(1 << 24)
        };
        let turned = DMat3::from_quat(DQuat::from_rotation_y(0.7)) * DMat3::from_diagonal(DVec3::new(3.0, 1.0, -0.5));
        let (mut inside, mut beside) = (0, 0);
        for linear in [DMat3::IDENTITY, turned] {
            let to_world = DAffine3 { matrix3: linear, translation: DVec3::new(5.0, -7.0, 3.0) };
            let placed = Placed::for_tests(DVec3::ZERO, 2.0, &to_world);
            for _ in 0..200 {
                let mut all = Meetings::<32>::NONE;
                let mut rays = Vec::new();
                for i in 0..32 {
                    let corners: [Vec3; 3] = std::array::from_fn(|_| {
                        DVec3::new(next(-1.0, 1.0), next(-1.0, 1.0), next(-1.0, 1.0)).as_vec3()
                    });
                    let [a, b, c] = corners.map(|v| v.as_dvec3());
                    let (u, v) = (next(-0.2, 0.9), next(-0.2, 0.4));
                    let to = placed.world_point(a + (b - a) * u + (c - a) * v);
                    let from = placed.world_point(DVec3::new(next(-3.0, 3.0), next(-3.0, 3.0), next(2.0, 4.0)));
                    let dir = if i == 5 { placed.world_point(b) - placed.world_point(a) } else { to - from };
                    let ray = Ray::new(if i == 5 { to } else { from }, dir.as_vec3());
                    all.set(i, &corners, ray.origin, ray.dir);
                    rays.push((corners, ray));
                }
                all.meet(Isa::best(), &placed, u32::MAX, |_| 1.0);
                for (i, (corners, ray)) in rays.iter().enumerate() {
                    let one = meet(&placed, corners, ray, 1.0);
                    let [u, v] = one.weights;
                    if u > 0.0 && v > 0.0 && u + v < 1.0 {
                        inside += 1
                    } else {
                        beside += 1
                    }
                    assert_eq!((all.t(i).to_bits(), all.weights(i)), (one.t.to_bits(), one.weights), "{i}: {one:?}");
                    assert_eq!(all.error(i), one.error(&placed, ray.origin, ray.dir), "{i}: {one:?}");
                    assert_eq!(all.free(i), one.free(&placed, ray.origin, ray.dir), "{i}: {one:?}");
                }
            }
        }
        assert!(inside > 3000 && beside > 1000, "{inside}, {beside}");
    }
}
