//! Which parts meet a box or a frustum: exact, by triangle.

use crate::base::error::{Error, Result};
use crate::math::DBounds;
use crate::scene::SceneState;
use glam::DVec3;

/// A half space: the points p with `normal · p + d >= 0`. `normal` need not be unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Points inward.
    pub normal: DVec3,
    /// Offset, in units of `|normal|`.
    pub d: f64,
}

/// How a part meets a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum How {
    /// Some of it is inside or touches.
    Intersects = 1,
    /// All of it is inside.
    Inside = 2,
}

/// A part that meets a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartOverlap {
    /// The caller's id of the instance.
    pub instance: u64,
    /// The caller's id of the part.
    pub part: u64,
    /// How.
    pub how: How,
}

impl SceneState {
    /// The visible parts that meet the closed box, by instance in the order added, then by part in the file's order.
    /// Blocks; may read the disk. Thread-safe. `BadArgument` for NaN; an empty box meets nothing.
    pub fn overlap_box(&self, bounds: &DBounds) -> Result<Vec<PartOverlap>> {
        let _ = bounds;
        Err(Error::BadState("SceneState::overlap_box: being built".into()))
    }

    /// The visible parts that meet the intersection of the half spaces (which must be bounded to be
    /// useful, and convex it always is), in the same order. Blocks; may read the disk. Thread-safe.
    /// `BadArgument` for no or non-finite planes.
    pub fn overlap_frustum(&self, planes: &[Plane]) -> Result<Vec<PartOverlap>> {
        let _ = planes;
        Err(Error::BadState("SceneState::overlap_frustum: being built".into()))
    }
}
