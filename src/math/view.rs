//! Camera positions.

use glam::DVec3;

/// Position and orientation of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Position of the eye, world units.
    pub eye: DVec3,
    /// The point that the camera looks at.
    pub at: DVec3,
    /// Up direction. It must not be parallel to the line of sight, but need not be perpendicular to it.
    pub up: DVec3,
    /// Full vertical angle of view, degrees.
    pub fov_y_degrees: f64,
}

/// Vertical angle of the default views, degrees.
const FOV_Y: f64 = 45.0;

impl View {
    /// The view of `at` from the direction `from`, of any length, at `distance`.
    pub fn looking(at: DVec3, from: DVec3, distance: f64, up: DVec3) -> Self {
        Self { eye: at + from.normalize_or(DVec3::X) * distance, at, up, fov_y_degrees: FOV_Y }
    }
}
