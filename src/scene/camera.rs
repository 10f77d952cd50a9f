//! Cameras in double precision, and the rays of their pixels.

use super::box_ray::BoxRay;
use crate::base::error::{Error, Result};
use crate::base::units::UpAxis;
use crate::math::{Cone, DBounds, Ray};
use glam::{DVec2, DVec3, Vec3};

/// A camera in world space. All lengths are in world units and double precision.
///
/// `up` need not be orthogonal to the view direction, only not parallel to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// Rays leave the eye.
    Perspective {
        /// The eye.
        eye: DVec3,
        /// The target point; it sets the direction only.
        at: DVec3,
        /// Upward in the picture.
        up: DVec3,
        /// Vertical angle of view in degrees, in (0, 180).
        fov_y_degrees: f64,
    },
    /// Parallel rays from a plane through the eye.
    Orthographic {
        /// Middle of the picture's plane; surfaces behind the plane are not visible.
        eye: DVec3,
        /// The target point; it sets the direction only.
        at: DVec3,
        /// Upward in the picture.
        up: DVec3,
        /// Height of the picture in world units, > 0.
        height: f64,
    },
}

impl Camera {
    /// The eye.
    pub fn eye(&self) -> DVec3 {
        match *self {
            Camera::Perspective { eye, .. } | Camera::Orthographic { eye, .. } => eye,
        }
    }

    /// Prepares the camera for pictures of `width` x `height` pixels, 1 or more each.
    ///
    /// Fails with [`Error::BadArgument`] if a number is not finite or out of range, `eye` equals `at`, or `up` is
    /// parallel to the view.
    pub fn prepare(&self, width: u32, height: u32) -> Result<PixelRays> {
        if width == 0 || height == 0 {
            return Err(Error::bad_argument("camera: the picture must have at least one pixel"));
        }
        let (eye, at, up) = match *self {
            Camera::Perspective { eye, at, up, .. } | Camera::Orthographic { eye, at, up, .. } => (eye, at, up),
        };
        let bad = |what: &str| Err(Error::bad_argument(format!("camera: {what}")));
        if !(eye.is_finite() && at.is_finite() && up.is_finite()) {
            return bad("eye, at and up must be finite");
        }
        let Some(forward) = (at - eye).try_normalize() else {
            return bad("eye and at must differ");
        };
        let Some(right) = up.try_normalize().and_then(|u| {
            let side = forward.cross(u);
            if side.length() > 1e-9 { side.try_normalize() } else { None }
        }) else {
            return bad("up must not be zero or parallel to the view");
        };
        let upward = right.cross(forward);
        let (tall, perspective) = match *self {
            Camera::Perspective { fov_y_degrees: f, .. } => {
                if !(f > 0.0 && f < 180.0) {
                    return bad("the angle of view must be above 0 and below 180 degrees");
                }
                (2.0 * (f.to_radians() * 0.5).tan(), true)
            }
            Camera::Orthographic { height: h, .. } => {
                if !(h > 0.0 && h.is_finite()) {
                    return bad("the height of an orthographic picture must be finite and above 0");
                }
                (h, false)
            }
        };
        let pixel = tall / f64::from(height);
        Ok(PixelRays {
            eye,
            forward,
            right: right * pixel,
            down: -upward * pixel,
            half: (f64::from(width) * 0.5, f64::from(height) * 0.5),
            pixel,
            perspective,
        })
    }
}

/// Width of a pixel, as a fraction of the distance, below which directions in single precision are too coarse: 1024
/// roundings.
const FINE: f64 = 1.0 / 16_384.0;

/// A camera prepared for one picture size: it returns the ray of any point of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelRays {
    eye: DVec3,
    forward: DVec3,
    /// One pixel to the right, at distance 1 (perspective) or anywhere (orthographic).
    right: DVec3,
    /// One pixel down.
    down: DVec3,
    half: (f64, f64),
    /// Height of a pixel, at distance 1 (perspective) or anywhere (orthographic).
    pixel: f64,
    perspective: bool,
}

impl PixelRays {
    /// The half spaces that contain the points seen between two picture points: right of the first, left of the second,
    /// below the first, above the second, and ahead of the eye. Each is a normal n and an offset d: n·p + d >= 0
    /// inside.
    pub fn half_spaces(&self, [least, greatest]: [DVec2; 2]) -> [(DVec3, f64); 5] {
        // A point p is in column half + right·(p - eye) / |right|², divided by its distance ahead in perspective.
        let side = |pixel: DVec3, bound: f64, sign: f64| {
            let across = pixel / pixel.length_squared();
            let (normal, offset) =
                if self.perspective { (across - self.forward * bound, 0.0) } else { (across, -bound) };
            let normal = normal * sign;
            (normal, offset * sign - normal.dot(self.eye))
        };
        [
            side(self.right, least.x - self.half.0, 1.0),
            side(self.right, greatest.x - self.half.0, -1.0),
            side(self.down, least.y - self.half.1, 1.0),
            side(self.down, greatest.y - self.half.1, -1.0),
            (self.forward, -self.forward.dot(self.eye)),
        ]
    }

    /// The unit view direction.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// The eye.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Width of a pixel's footprint at distance `t` along the middle ray, in world units.
    #[inline]
    pub fn pixel_width(&self, t: f64) -> f64 {
        if self.perspective { self.pixel * t } else { self.pixel }
    }

    /// The ray through picture point (`x`, `y`): the middle of pixel (i, j) is (i + 0.5, j + 0.5), (0, 0) is the top
    /// left corner. Directions are unit up to rounding; the cone is the pixel's footprint (its width at `t`).
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        if self.perspective {
            let (dir, width) = self.toward(x, y);
            Ray { cone: Cone { a: 0.0, b: width }, ..Ray::new(self.eye, dir) }
        } else {
            Ray { cone: Cone { a: self.pixel as f32, b: 0.0 }, ..Ray::new(self.origin(x, y), self.forward.as_vec3()) }
        }
    }

    /// The least and the greatest picture point of the rays through `bounds`, one pixel farther apart for rounding.
    /// `None` if a corner of the bounds is not in front of the eye, or if a pixel there is not larger than the
    /// rounding.
    pub fn rectangle_of(&self, bounds: &DBounds) -> Option<[DVec2; 2]> {
        let (mut least, mut greatest) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in 0..8 {
            let high = |axis: usize| corner >> axis & 1 == 1;
            let side = |axis: usize| if high(axis) { bounds.max[axis] } else { bounds.min[axis] };
            let from_eye = DVec3::new(side(0), side(1), side(2)) - self.eye;
            // The size of a pixel there relative to its size at distance 1.
            let scale = if self.perspective { from_eye.dot(self.forward) } else { 1.0 };
            let size = from_eye.abs().max_element();
            let is_in_front = !self.perspective || scale > 1e-3 * size;
            let is_fine = self.pixel * scale >= 1e-6 * size;
            if !(from_eye.is_finite() && is_in_front && is_fine) {
                return None;
            }
            let along = |pixel: DVec3, half: f64| from_eye.dot(pixel) / (pixel.length_squared() * scale) + half;
            let point = DVec2::new(along(self.right, self.half.0), along(self.down, self.half.1));
            (least, greatest) = (least.min(point), greatest.max(point));
        }
        Some([least - DVec2::ONE, greatest + DVec2::ONE])
    }

    /// The part of a direction that [`PixelRays::ray`] loses to single precision.
    #[inline]
    pub fn rest(&self, x: f64, y: f64) -> Vec3 {
        let dir = if self.perspective { self.across(x, y).normalize() } else { self.forward };
        (dir - dir.as_vec3().as_dvec3()).as_vec3()
    }

    /// The ray of [`PixelRays::ray`], from shortly before it enters the box, with all digits of its direction. Also
    /// returns the distance from its beginning there to that origin: 0 if single precision does for the direction, or
    /// if the ray begins in the box.
    pub fn ray_from(&self, x: f64, y: f64, bounds: &DBounds) -> (Ray, f64) {
        let ray = self.ray(x, y);
        let dir = ray.dir.as_dvec3() + self.rest(x, y).as_dvec3();
        let enter = BoxRay::of(ray.origin, dir).enter(bounds, 0.0, f64::INFINITY).unwrap_or(0.0);
        if !self.needs_rest(enter) {
            return (ray, 0.0);
        }
        let ahead = (enter - bounds.extent().length()).max(0.0);
        (Ray { origin: ray.origin + dir * ahead, ..ray }, ahead)
    }

    /// True if directions in single precision may miss a point at this distance by more than a thousandth of a pixel,
    /// as those through long lenses do.
    pub fn needs_rest(&self, distance: f64) -> bool {
        self.pixel_width(distance) < distance * FINE
    }

    /// True if rays leave the eye.
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Direction of the ray through a picture point, and its width at distance 1; for perspective cameras.
    #[inline(always)]
    pub fn toward(&self, x: f64, y: f64) -> (Vec3, f32) {
        let dir = self.across(x, y);
        let inverse = 1.0 / dir.length();
        ((dir * inverse).as_vec3(), (self.pixel * inverse) as f32)
    }

    /// The same direction with the length up to the plane at distance 1: it is linear in the point.
    #[inline(always)]
    fn across(&self, x: f64, y: f64) -> DVec3 {
        self.forward + self.offset(x, y)
    }

    /// Origin of the ray through a picture point; for orthographic cameras.
    #[inline(always)]
    pub fn origin(&self, x: f64, y: f64) -> DVec3 {
        self.eye + self.offset(x, y)
    }

    #[inline(always)]
    fn offset(&self, x: f64, y: f64) -> DVec3 {
        self.right * (x - self.half.0) + self.down * (y - self.half.1)
    }
}

/// Directions to the right, to the front and up of something with this up axis; Z if it is unknown.
pub(super) fn axes(axis: UpAxis) -> [DVec3; 3] {
    match axis {
        UpAxis::X => [DVec3::Z, DVec3::Y, DVec3::X],
        UpAxis::Y => [DVec3::X, DVec3::Z, DVec3::Y],
        UpAxis::Z | UpAxis::Unknown => [DVec3::X, -DVec3::Y, DVec3::Z],
    }
}

/// Four views from bounds: two of the whole and two from a quarter of the distance, from left and right of the front.
pub(crate) fn default_views(bounds: &DBounds, up: UpAxis) -> [Camera; 4] {
    let from = default_directions(up);
    let bounds = if bounds.is_empty() { DBounds::of(&[-DVec3::ONE, DVec3::ONE]) } else { *bounds };
    let up = axes(up)[2];
    let radius = (bounds.extent().length() * 0.5).max(f64::MIN_POSITIVE);
    let fov_y_degrees = FOV_Y;
    let distance = radius / (fov_y_degrees.to_radians() * 0.5).sin();
    let at = bounds.center();
    let view = |from: DVec3, distance: f64| Camera::Perspective { eye: at + from * distance, at, up, fov_y_degrees };
    [view(from[0], distance), view(from[1], distance), view(from[0], distance / 4.0), view(from[1], distance / 4.0)]
}

/// Vertical angle of the default views, degrees.
pub const FOV_Y: f64 = 40.0;

/// Unit directions towards the eyes of the default views: from the right of the front, and from the left of the back.
pub fn default_directions(up: UpAxis) -> [DVec3; 2] {
    let [side, front, up] = axes(up);
    [(30.0_f64, 20.0_f64), (-120.0, 35.0)].map(|(azimuth, elevation)| {
        let (az, el) = (azimuth.to_radians(), elevation.to_radians());
        (front * az.cos() + side * az.sin()) * el.cos() + up * el.sin()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        [-10.0..10.0, -10.0..10.0, -10.0..10.0].prop_map(DVec3::from)
    }

    proptest! {
        /// The part of a box that a pixel's ray crosses lies in the box's rectangle.
        #[test]
        fn rays_through_a_box_are_in_its_rectangle(
            eye in point(), at in point(), a in point(), b in point(), inside in [0.0..1.0, 0.0..1.0, 0.0..1.0],
            is_perspective: bool,
        ) {
            let up = DVec3::new(0.1, 0.2, 1.0);
            let camera = match is_perspective {
                true => Camera::Perspective { eye, at, up, fov_y_degrees: 60.0 },
                false => Camera::Orthographic { eye, at, up, height: 7.0 },
            };
            let rays = camera.prepare(320, 200);
            prop_assume!(rays.is_ok());
            let rays = rays.expect("a camera");
            let bounds = DBounds::of(&[a, b]);
            let Some([least, greatest]) = rays.rectangle_of(&bounds) else {
                let is_all_before = (0..8).all(|i| {
                    let corner = DVec3::new([a.x, b.x][i & 1], [a.y, b.y][i >> 1 & 1], [a.z, b.z][i >> 2]);
                    (corner - eye).dot(rays.forward()) > 0.05 * (corner - eye).length()
                });
                prop_assert!(is_perspective && !is_all_before);
                return Ok(());
            };
            // A search by angle finds the pixel of a point in the box: its formula is independent of the tested one.
            let target = a + (b - a) * DVec3::from(inside);
            let seen = |x: f64, y: f64| {
                let ray = rays.ray(x, y);
                let along = (target - ray.origin).dot(ray.dir.as_dvec3());
                let apart = (ray.origin + ray.dir.as_dvec3() * along).distance(target);
                match is_perspective {
                    true if along <= 0.0 => f64::INFINITY,
                    true => apart / along,
                    false => apart,
                }
            };
            let (mut x, mut y, mut step) = (160.0, 100.0, 4096.0);
            while step > 1e-3 {
                let better = [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)];
                match better.into_iter().find(|(dx, dy)| seen(x + dx, y + dy) < seen(x, y)) {
                    Some((dx, dy)) => (x, y) = (x + dx, y + dy),
                    None => step /= 2.0,
                }
            }
            prop_assume!(seen(x, y) < 1e-4);
            prop_assert!(least.x <= x && x <= greatest.x && least.y <= y && y <= greatest.y, "{x} {y}: {least} {greatest}");
        }
    }
}
