//! Camera positions by formula.

use super::DBounds;
use glam::DVec3;

/// Where a camera stands and looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The eye, world units.
    pub eye: DVec3,
    /// The point looked at.
    pub at: DVec3,
    /// Up; not parallel to the line of sight, need not be perpendicular.
    pub up: DVec3,
    /// Whole vertical angle of view, degrees.
    pub fov_y_degrees: f64,
}

/// Vertical angle of the default views, degrees.
const FOV_Y: f64 = 45.0;

impl View {
    /// The view of `at` from the direction `from` (any length) at `distance`.
    pub fn looking(at: DVec3, from: DVec3, distance: f64, up: DVec3) -> Self {
        Self { eye: at + from.normalize_or(DVec3::X) * distance, at, up, fov_y_degrees: FOV_Y }
    }

    /// Four views of a box, `up` being the unit vector of the axis that points up: two of the whole,
    /// from above the one corner and from the other side below, far enough that the sphere around the
    /// box fits in a square picture; then two at a quarter of that distance, aimed at points half way
    /// to the near corners. An empty box is taken as a point, and a point as a box of edge 1.
    pub fn four(bounds: &DBounds, up: DVec3) -> [Self; 4] {
        let bounds = if bounds.is_empty() { DBounds::of(&[DVec3::ZERO]) } else { *bounds };
        let (center, half) = (bounds.center(), bounds.extent() * 0.5);
        let radius = if half.length() > 0.0 { half.length() } else { 0.5 * 3f64.sqrt() };
        let distance = radius / (FOV_Y.to_radians() * 0.5).sin();
        let side = up.any_orthonormal_vector();
        let front = up.cross(side);
        let from = |a: f64, b: f64, c: f64| (side * a + front * b + up * c).normalize();
        let (first, second) = (from(0.8, 0.55, 0.35), from(-0.45, 0.85, -0.2));
        let near = |f: DVec3| center + f.signum() * half * 0.5;
        [
            Self::looking(center, first, distance, up),
            Self::looking(center, second, distance, up),
            Self::looking(near(first), first, distance / 4.0, up),
            Self::looking(near(second), second, distance / 4.0, up),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_around_the_box_fits_the_first_two_views() {
        let b = DBounds { min: DVec3::new(-3.0, 1.0, 5.0), max: DVec3::new(4.0, 2.0, 25.0) };
        for v in &View::four(&b, DVec3::Z)[..2] {
            let angle = (b.extent().length() / 2.0 / v.eye.distance(v.at)).asin();
            assert!(angle.to_degrees() * 2.0 <= v.fov_y_degrees + 1e-9);
        }
    }

    #[test]
    fn views_of_nothing_and_of_a_point_are_finite() {
        for b in [DBounds::EMPTY, DBounds::of(&[DVec3::splat(7.0)])] {
            for v in View::four(&b, DVec3::Y) {
                assert!(v.eye.is_finite() && v.eye.distance(v.at) > 0.0);
            }
        }
    }

    #[test]
    fn the_near_views_are_at_a_quarter() {
        let b = DBounds { min: DVec3::ZERO, max: DVec3::ONE };
        let v = View::four(&b, DVec3::Z);
        for (far, near) in [(v[0], v[2]), (v[1], v[3])] {
            assert!((near.eye.distance(near.at) * 4.0 - far.eye.distance(far.at)).abs() < 1e-9);
        }
    }
}
