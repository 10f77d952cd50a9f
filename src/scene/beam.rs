//! Beams: the extremes of a group's rays. One test of a beam shows that no ray of the group enters a box.

use super::alike::Alike;
use crate::math::{DBounds, Ray};
use glam::DVec3;

/// The extremes of some rays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beam {
    /// Least and greatest origin, axis by axis.
    org: [DVec3; 2],
    /// Least and greatest direction, axis by axis, and their reciprocals.
    dir: [[f64; 2]; 3],
    inv: [[f64; 2]; 3],
    /// The least distance at which a ray begins.
    t_min: f64,
    /// The union of the masks of all rays.
    pub mask: u32,
    /// Bound of the rounding of a difference of coordinates.
    aside: f64,
}

/// A factor above the rounding of a few products and quotients.
const MORE: f64 = 1.0 + 16.0 * f64::EPSILON;

/// Extends the extremes by a point. NaN coordinates are ignored: their rays hit nothing, and must not change the
/// extremes of the others.
#[inline(always)]
fn extend(ends: &mut [DVec3; 2], point: DVec3) {
    // `DVec3::min` would not ignore a NaN in either operand.
    for axis in 0..3 {
        ends[0][axis] = ends[0][axis].min(point[axis]);
        ends[1][axis] = ends[1][axis].max(point[axis]);
    }
}

impl Beam {
    fn between(org: [DVec3; 2], dir: [[f64; 2]; 3], t_min: f64, mask: u32) -> Self {
        let aside = org[0].abs().max(org[1].abs()).max_element() * (4.0 * f64::EPSILON);
        let inv = dir.map(|ends| ends.map(f64::recip));
        Self { org, dir, inv, t_min: if t_min > 0.0 { t_min } else { 0.0 }, mask, aside }
    }

    /// The beam of rays with origins and directions between extremes.
    pub fn from_points(origins: [DVec3; 2], dirs: [[f32; 2]; 3], t_min: f64, mask: u32) -> Self {
        Self::between(origins, dirs.map(|ends| ends.map(f64::from)), t_min, mask)
    }

    /// The beam of `rays`, at least one; `alike` holds their common traits.
    #[inline]
    pub fn of(rays: &[Ray], alike: &Alike) -> Self {
        let first = &rays[0];
        let (mut org, mut t_min, mut mask) = ([first.origin; 2], first.t_min, first.mask);
        if !alike.is_one_start() {
            for ray in rays {
                extend(&mut org, ray.origin);
                t_min = t_min.min(ray.t_min);
            }
        }
        if alike.mask().is_none() {
            mask = rays.iter().fold(0, |all, ray| all | ray.mask);
        }
        Self::between(org, alike.dirs().map(|ends| ends.map(f64::from)), t_min, mask)
    }

    /// The greatest distance of a ray's origin from a point of the box.
    pub fn farthest(&self, b: &DBounds) -> f64 {
        (b.max - self.org[0]).abs().max((b.min - self.org[1]).abs()).length()
    }

    /// Returns a distance before which no ray enters the box; `None` if certainly no ray meets it up to `t_max`. In
    /// that case no direction of the beam is within the box on all axes at once.
    #[inline]
    pub fn enter(&self, b: &DBounds, t_max: f64) -> Option<f64> {
        let (mut enter, mut leave) = (self.t_min, t_max);
        for axis in 0..3 {
            let low = b.min[axis] - self.org[1][axis] - self.aside;
            let high = b.max[axis] - self.org[0][axis] + self.aside;
            let ([least, greatest], [slow, fast]) = (self.dir[axis], self.inv[axis]);
            if low > 0.0 {
                if greatest <= 0.0 {
                    return None;
                }
                // The fastest ray arrives first.
                enter = enter.max(low * fast);
            } else if high < 0.0 {
                if least >= 0.0 {
                    return None;
                }
                enter = enter.max(high * slow);
            }
            // The slowest ray leaves last, unless some ray stays inside.
            if least > 0.0 {
                leave = leave.min(high * slow);
            } else if greatest < 0.0 {
                leave = leave.min(low * fast);
            }
        }
        // NaN does not report a miss.
        if enter > leave * MORE { None } else { Some(enter / MORE) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::box_ray::BoxRay;
    use glam::Vec3;

    /// Compares beams with the box tests of single rays: a beam enters every box that one of its rays enters, and no
    /// later.
    #[test]
    fn a_beam_meets_every_box_that_one_of_its_rays_meets() {
        let mut state = 1u32;
        let mut next = |low: f64, high: f64| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * f64::from(state >> 8) / f64::from(1 << 24)
        };
        let (mut meet, mut missed) = (0, 0);
        for round in 0..30_000 {
            let min = DVec3::new(next(-3.0, 2.0), next(-3.0, 2.0), next(-3.0, 2.0));
            let b = DBounds { min, max: min + DVec3::new(next(0.0, 2.0), next(0.0, 2.0), next(0.0, 2.0)) };
            let (at, toward) = (
                DVec3::new(next(-4.0, 4.0), next(-4.0, 4.0), next(-4.0, 4.0)),
                [next(-1.0, 1.0), next(-1.0, 1.0), next(-1.0, 1.0)],
            );
            let (spread, apart) = (next(0.0, 0.3), if round % 2 == 0 { 0.0 } else { next(0.0, 0.5) });
            let mut rays = [Ray::NONE; 32];
            for ray in &mut rays {
                let dir =
                    Vec3::from(toward.map(|d| if round % 7 == 0 { 0.0 } else { (d + next(-spread, spread)) as f32 }));
                let from = at + DVec3::new(next(0.0, apart), next(0.0, apart), next(0.0, apart));
                *ray = Ray::new(from, if dir == Vec3::ZERO { Vec3::X } else { dir });
            }
            let entered = |ray: &Ray| BoxRay::new(ray).enter(&b, 0.0, 10.0);
            let first = rays.iter().filter_map(entered).fold(f64::INFINITY, f64::min);
            match Beam::of(&rays, &Alike::of(&rays)).enter(&b, 10.0) {
                Some(enter) => assert!(enter <= first, "{b:?}: {enter}, {first}"),
                None => {
                    assert!(first == f64::INFINITY, "{b:?}: {first}");
                    missed += 1;
                }
            }
            meet += usize::from(first < f64::INFINITY);
        }
        assert!(meet > 1000 && missed > 10_000, "{meet}, {missed}");
        // A ray with a NaN origin does not change the extremes of the others.
        let mut rays: [Ray; 32] = std::array::from_fn(|i| Ray::new(DVec3::new(i as f64, 0.5, -9.0), Vec3::Z));
        for at in [0, 16, 31] {
            let whole = rays[at].origin;
            rays[at].origin.x = f64::NAN;
            let beam = Beam::of(&rays, &Alike::of(&rays));
            let first = if at == 0 { 1.0 } else { 0.0 };
            assert!(
                beam.enter(&DBounds { min: DVec3::new(first, 0.0, 0.0), max: DVec3::new(first, 1.0, 1.0) }, 99.0)
                    .is_some(),
                "{at}"
            );
            rays[at].origin = whole;
        }
        let nothing = Beam::from_points([DVec3::ONE; 2], [[f32::NAN; 2]; 3], 0.0, 1);
        assert!(nothing.enter(&DBounds { min: DVec3::ZERO, max: DVec3::ONE }, 1.0).is_some());
    }
}
