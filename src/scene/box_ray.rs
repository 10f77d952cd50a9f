//! Slab tests of rays and boxes in double precision, for one ray and for a packet's rays side by side.
#![allow(clippy::needless_range_loop)] // loops index several arrays, and axes of several vectors

use crate::math::{DBounds, PACKET, Ray};
use crate::simd::{Isa, Op, Simd, dispatch};
use glam::{DVec3, Vec3};

/// Relative tolerance of distances to planes.
const GIVE: f64 = 4.0 * f64::EPSILON;

/// A ray prepared for box tests in double precision.
#[derive(Debug, Clone, Copy)]
pub struct BoxRay {
    org: DVec3,
    inv: DVec3,
    /// For each axis, true if the direction is negative: the ray then meets the greater plane first.
    down: [bool; 3],
}

impl BoxRay {
    /// From a ray in world space.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        Self::of(ray.origin, ray.dir.as_dvec3())
    }

    /// From an origin and a direction.
    #[inline]
    pub fn of(org: DVec3, dir: DVec3) -> Self {
        let inv = dir.recip();
        Self { org, inv, down: [inv.x < 0.0, inv.y < 0.0, inv.z < 0.0] }
    }

    /// The distance at which the ray enters the box within [`t_min`, `t_max`], slightly decreased to be safe; `None` if
    /// it misses.
    ///
    /// A direction component of 0 makes infinities. Outside the slab they empty the interval, inside they leave it
    /// unchanged, and the NaN on the slab's border is ignored by `min` and `max`. The rounding of three operations is
    /// 1.5 units of 2⁻⁵² relative to each t; 4 are allowed. (The test has no branches: for directions of bounces half
    /// of them would be mispredicted.)
    #[inline]
    pub fn enter(&self, b: &DBounds, t_min: f64, t_max: f64) -> Option<f64> {
        let (planes, mut near, mut far) = ([&b.min, &b.max], t_min, t_max);
        for axis in 0..3 {
            let first = usize::from(self.down[axis]);
            let low = (planes[first][axis] - self.org[axis]) * self.inv[axis];
            let high = (planes[1 - first][axis] - self.org[axis]) * self.inv[axis];
            // The factors widen the interval for either sign.
            near = near.max(low * (1.0 - GIVE.copysign(low)));
            far = far.min(high * (1.0 + GIVE.copysign(high)));
        }
        (near <= far).then_some(near)
    }
}

/// Rays of a packet, prepared for box tests.
pub(super) struct PacketBoxRays {
    org: [[f64; PACKET]; 3],
    inv: [[f64; PACKET]; 3],
    t_min: [f64; PACKET],
}

impl PacketBoxRays {
    pub const NONE: Self = Self { org: [[0.0; PACKET]; 3], inv: [[0.0; PACKET]; 3], t_min: [f64::INFINITY; PACKET] };

    /// Takes over up to [`PACKET`] rays.
    ///
    /// `rest`: parts of the directions that single precision has lost.
    pub fn set(&mut self, rays: &[Ray], rest: Option<&[Vec3; PACKET]>) {
        for (i, ray) in rays.iter().enumerate().take(PACKET) {
            self.t_min[i] = ray.t_min;
            for axis in 0..3 {
                let dir = f64::from(ray.dir[axis]);
                // A sum would lose the sign of a zero.
                let dir = rest.map_or(dir, |rest| dir + f64::from(rest[i][axis]));
                (self.org[axis][i], self.inv[axis][i]) = (ray.origin[axis], dir);
            }
        }
        // This loop compiles to vector code.
        self.inv.as_flattened_mut().iter_mut().for_each(|dir| *dir = dir.recip());
    }

    /// Writes to `enter` the distance at which each ray enters a box, equal to that of [`BoxRay::enter`]. Returns the
    /// rays that enter it at all (bit `i`: ray `i`), and possibly bits of entries that were not [set](Self::set) last.
    /// `t_max`: the end of each ray.
    #[inline]
    pub fn enter(&self, isa: Isa, bounds: &DBounds, t_max: &[f64; PACKET], enter: &mut [f64; PACKET]) -> u32 {
        dispatch(isa, Enter { rays: self, bounds, t_max, enter })
    }
}

/// [`PacketBoxRays::enter`] in loops that compile to vector code.
struct Enter<'a> {
    rays: &'a PacketBoxRays,
    bounds: &'a DBounds,
    t_max: &'a [f64; PACKET],
    enter: &'a mut [f64; PACKET],
}

impl Op for Enter<'_> {
    type Out = u32;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> u32 {
        let (mut near, mut far) = (self.rays.t_min, *self.t_max);
        for axis in 0..3 {
            let (org, inv) = (&self.rays.org[axis], &self.rays.inv[axis]);
            let (min, max) = (self.bounds.min[axis], self.bounds.max[axis]);
            for i in 0..PACKET {
                let is_down = inv[i] < 0.0;
                let first = if is_down { max } else { min };
                let last = if is_down { min } else { max };
                let low = (first - org[i]) * inv[i];
                let high = (last - org[i]) * inv[i];
                let low = low * (1.0 - GIVE.copysign(low));
                let high = high * (1.0 + GIVE.copysign(high));
                // NaN leaves the interval unchanged.
                near[i] = if low > near[i] { low } else { near[i] };
                far[i] = if high < far[i] { high } else { far[i] };
            }
        }
        *self.enter = near;
        (0..PACKET).fold(0, |met, i| met | u32::from(near[i] <= far[i]) << i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn packets_enter_boxes_as_single_rays_do() {
        // Directions include zeros of both signs; origins lie on planes of boxes, inside and outside.
        let steps = [-0.0f32, 0.0, 1.0, -1.0, 0.3, -7e-9];
        let planes = [-1.0, 0.0, 0.5, 2.0, 3.0];
        let mut state = 7u64;
        let mut pick = |n: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % n) as usize
        };
        let mut met = [0; 2];
        for _ in 0..2_000 {
            let rays: Vec<Ray> = (0..PACKET)
                .map(|_| {
                    let org = DVec3::from([planes[pick(5)], planes[pick(5)], planes[pick(5)]]);
                    let dir = Vec3::from([steps[pick(6)], steps[pick(6)], steps[pick(6)]]);
                    Ray { t_min: [0.0, 0.5][pick(2)], ..Ray::new(org, dir) }
                })
                .collect();
            let bounds = DBounds { min: DVec3::from([-1.0, 0.0, 0.5]), max: DVec3::from([2.0, 0.0, 3.0]) };
            let t_max: [f64; PACKET] = std::array::from_fn(|_| [1.5, f64::INFINITY, -1.0][pick(3)]);
            let mut packet = PacketBoxRays::NONE;
            packet.set(&rays, None);
            for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
                let mut enter = [0.0; PACKET];
                let entered = packet.enter(isa, &bounds, &t_max, &mut enter);
                for (i, ray) in rays.iter().enumerate() {
                    let alone = BoxRay::new(ray).enter(&bounds, ray.t_min, t_max[i]);
                    assert_eq!((entered >> i & 1 != 0).then_some(enter[i]), alone, "{ray:?} {}", t_max[i]);
                    met[usize::from(alone.is_some())] += 1;
                }
            }
        }
        assert!(met[0] > 1_000 && met[1] > 1_000, "{met:?}");
    }
}
