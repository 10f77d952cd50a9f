//! Camera positions by formula.

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
}
