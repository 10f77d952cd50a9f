//! Common traits of the rays of a group.

use crate::math::Ray;
use crate::simd::Common;
use bytemuck::must_cast_slice;
use std::mem::offset_of;

/// Offsets of fields among the 32-bit words of a ray.
const INTERVAL_END: usize = offset_of!(Ray, t_max) / 4 + 2;
const DIR: usize = offset_of!(Ray, dir) / 4;
const CONE: usize = offset_of!(Ray, cone) / 4;
const MASK: usize = offset_of!(Ray, mask) / 4;

/// Common traits of some rays, computed from their words with a few operations per ray.
#[derive(Debug, Clone, Copy)]
pub struct Alike(Common);

impl Alike {
    /// The traits of at least one ray.
    #[inline]
    pub fn of(rays: &[Ray]) -> Self {
        Self(Common::of(must_cast_slice::<Ray, [u32; 16]>(rays)))
    }

    /// True if all directions have the same signs, those of zeros included.
    #[inline]
    pub fn is_one_octant(&self) -> bool {
        (DIR..DIR + 3).fold(0, |bits, i| bits | self.0.any[i] & !self.0.all[i]) >> 31 == 0
    }

    /// The least and the greatest of all directions along each axis. NaNs are ignored.
    #[inline]
    pub fn dirs(&self) -> [[f32; 2]; 3] {
        std::array::from_fn(|axis| [self.0.least[DIR - 8 + axis], self.0.greatest[DIR - 8 + axis]])
    }

    /// True if all rays have the same origin and interval, to the bit, as those of a perspective camera have.
    #[inline]
    pub fn is_one_start(&self) -> bool {
        self.0.any[..INTERVAL_END] == self.0.all[..INTERVAL_END]
    }

    /// The common mask of all rays, if they have one.
    #[inline]
    pub fn mask(&self) -> Option<u32> {
        (self.0.any[MASK] == self.0.all[MASK]).then_some(self.0.any[MASK])
    }

    /// True if no ray has a width.
    #[inline]
    pub fn is_exact(&self) -> bool {
        self.0.any[CONE] | self.0.any[CONE + 1] == 0
    }

    /// True if no width is negative or NaN. (It may also be false for valid widths, if very large and very small ones
    /// mix.)
    #[inline]
    pub fn has_sound_cones(&self) -> bool {
        let infinity = f32::INFINITY.to_bits();
        [CONE, CONE + 1].iter().all(|&i| self.0.any[i] & infinity != infinity && self.0.any[i] >> 31 == 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, Vec3};

    #[test]
    fn differences_are_found_in_each_field() {
        let one = Ray::new(DVec3::new(1.0, -2.0, 3.0), Vec3::new(0.5, -0.0, -1.0));
        let with = |change: fn(&mut Ray)| {
            let mut other = one;
            change(&mut other);
            let a = Alike::of(&[one, other, one]);
            (a.is_one_octant(), a.is_one_start(), a.mask().is_some(), a.is_exact(), a.has_sound_cones())
        };
        assert_eq!(with(|_| {}), (true, true, true, true, true));
        assert_eq!(Alike::of(&[one]).mask(), Some(u32::MAX));
        let starts: [fn(&mut Ray); 7] = [
            |r| r.origin.x = 1.5,
            |r| r.origin.y = -2.000_000_000_000_1,
            |r| r.origin.z = -3.0,
            |r| r.t_min = 1e-300,
            |r| r.t_min = -0.0,
            |r| r.t_max = 7.0,
            |r| r.t_max = f64::NAN,
        ];
        for change in starts {
            assert_eq!(with(change), (true, false, true, true, true));
        }
        let signs: [fn(&mut Ray); 3] = [|r| r.dir.x = -0.5, |r| r.dir.y = 0.0, |r| r.dir.z = 1.0];
        for change in signs {
            assert_eq!(with(change), (false, true, true, true, true));
        }
        assert_eq!(with(|r| r.dir = Vec3::new(9.0, -1.0, -2.0)), (true, true, true, true, true));
        assert_eq!(with(|r| r.mask = 1), (true, true, false, true, true));
        let dirs = |others: [Vec3; 2]| {
            let mut rays = [one; 3];
            (rays[1].dir, rays[2].dir) = (others[0], others[1]);
            Alike::of(&rays).dirs()
        };
        assert_eq!(dirs([one.dir; 2]), [[0.5, 0.5], [0.0, 0.0], [-1.0, -1.0]]);
        assert_eq!(
            dirs([Vec3::new(0.25, f32::NAN, -3.0), Vec3::new(7.0, -2.0, 5.0)]),
            [[0.25, 7.0], [-2.0, 0.0], [-3.0, 5.0]]
        );
        let widths: [fn(&mut Ray); 2] = [|r| r.cone.a = 1e-30, |r| r.cone.b = 2.0];
        for change in widths {
            assert_eq!(with(change), (true, true, true, false, true));
        }
        let odd: [fn(&mut Ray); 4] =
            [|r| r.cone.a = -1.0, |r| r.cone.b = -1e-40, |r| r.cone.a = f32::NAN, |r| r.cone.b = -f32::NAN];
        for change in odd {
            assert_eq!(with(change), (true, true, true, false, false));
        }
    }
}
