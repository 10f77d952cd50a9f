//! Cones of normals.

use super::bezier::BezierPatch;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// A cone of directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalCone {
    /// Unit vector.
    pub axis: DVec3,
    /// Greatest angle of a direction to the axis, in radians: under π/2, or π for all directions.
    pub angle: f64,
}

/// Control vectors under this share of the longest are rounding, as those of a collapsed edge are: they count as zero.
const NOISE: f64 = 1e-13;
/// Widening of a cone in radians.
const MARGIN: f64 = 1e-7;
/// Steps towards the narrowest cone: the angle is then within a few percent of it.
const STEPS: u32 = 24;

impl NormalCone {
    /// The cone of all convex combinations of vectors, of any lengths. `None` if all are zero. The axis goes towards
    /// the farthest direction by ever smaller steps (Bădoiu, Clarkson, "Smaller core-sets for balls", SODA 2003, on the
    /// sphere).
    pub fn around(vectors: &[DVec3]) -> Option<Self> {
        let longest = vectors.iter().fold(0.0, |most: f64, v| most.max(v.length()));
        let directions: Vec<DVec3> =
            vectors.iter().filter(|v| v.length() > NOISE * longest).map(|v| *v / v.length()).collect();
        let mut axis = directions.iter().sum::<DVec3>().try_normalize().or(directions.first().copied())?;
        let mut best = (axis, farthest(axis, &directions));
        for step in 2..STEPS {
            axis = (axis + (farthest_direction(axis, &directions) - axis) / f64::from(step)).normalize_or(axis);
            let found = farthest(axis, &directions);
            if found < best.1 {
                best = (axis, found);
            }
        }
        let (axis, angle) = (best.0, best.1 + MARGIN);
        Some(Self { axis, angle: if angle < FRAC_PI_2 { angle } else { PI } })
    }

    /// True if a direction of any length is in the cone.
    pub fn contains(&self, direction: DVec3) -> bool {
        angle_between(self.axis, direction) <= self.angle
    }
}

/// The direction farthest from the axis.
fn farthest_direction(axis: DVec3, directions: &[DVec3]) -> DVec3 {
    directions.iter().copied().fold(axis, |far, d| if d.dot(axis) < far.dot(axis) { d } else { far })
}

fn farthest(axis: DVec3, directions: &[DVec3]) -> f64 {
    angle_between(axis, farthest_direction(axis, directions))
}

/// The angle between two vectors, also of small angles.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

impl BezierPatch {
    /// A cone of the normals du × dv of the patch; `None` if there are none, as of a patch without area.
    ///
    /// It encloses the directions of all control vectors of the normal (see `normals.rs`), rational patches included,
    /// and hence all normals longer than 10⁻⁶ of the longest control vector; rounding can turn shorter ones, beside
    /// poles and collapsed edges.
    pub fn normal_cone(&self) -> Option<NormalCone> {
        let middle = self.points[self.points.len() / 2];
        NormalCone::around(&self.normal_polynomial(middle.truncate() / middle.w).coefficients())
    }
}
