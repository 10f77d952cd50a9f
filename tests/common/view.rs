//! A camera's rays in double precision, made from its description alone.

use super::brute::Ray64;
use glam::DVec3;
use outcrop::Camera;
use rayon::prelude::*;

/// A camera and the size of its picture.
#[derive(Debug, Clone, Copy)]
pub struct View {
    pub width: u32,
    pub height: u32,
    eye: DVec3,
    forward: DVec3,
    /// To the next pixel on the right and below: at distance 1 (perspective), or anywhere.
    right: DVec3,
    down: DVec3,
    is_perspective: bool,
}

impl View {
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let (eye, at, up, tall, is_perspective) = match *camera {
            Camera::Perspective { eye, at, up, fov_y_degrees } => {
                (eye, at, up, 2.0 * (fov_y_degrees / 2.0).to_radians().tan(), true)
            }
            Camera::Orthographic { eye, at, up, height } => (eye, at, up, height, false),
        };
        let forward = (at - eye).normalize();
        let right = forward.cross(up).normalize();
        let pixel = tall / f64::from(height);
        Self { width, height, eye, forward, right: right * pixel, down: forward.cross(right) * pixel, is_perspective }
    }

    /// The ray through a point of the picture, unit; (0, 0) is its upper left corner, (0.5, 0.5) the middle of its
    /// first pixel.
    pub fn ray(&self, x: f64, y: f64) -> Ray64 {
        let (x, y) = (x - f64::from(self.width) / 2.0, y - f64::from(self.height) / 2.0);
        let aside = self.right * x + self.down * y;
        if self.is_perspective {
            Ray64::new(self.eye, (self.forward + aside).normalize())
        } else {
            Ray64::new(self.eye + aside, self.forward)
        }
    }

    /// The distance of a point from the eye along the view, as the depth buffer of a frame has it.
    pub fn depth(&self, point: DVec3) -> f64 {
        (point - self.eye).dot(self.forward)
    }

    /// The width of a pixel at a depth.
    pub fn pixel_width(&self, depth: f64) -> f64 {
        self.right.length() * if self.is_perspective { depth } else { 1.0 }
    }

    /// `of` of every pixel (column, row), row by row from the top, on all threads; the same at any number of them.
    pub fn pixels<T: Send>(&self, of: impl Fn(u32, u32) -> T + Sync) -> Vec<T> {
        (0..self.width * self.height).into_par_iter().map(|i| of(i % self.width, i / self.width)).collect()
    }
}
