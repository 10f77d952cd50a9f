//! Rays in the form in which callers give them, and cones, which are the rays' footprints.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// A ray's footprint: its width is `a + b * t` at distance parameter `t`, in scene units. A ray accepts a stand-in if
/// the projection of its cell covers at most the square of the width. For p pixels of error, the width is that of a
/// pixel times the square root of p. `ZERO` requires exact answers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Cone {
    /// Width at `t` = 0, >= 0.
    pub a: f32,
    /// Growth of the width per unit of `t`, >= 0.
    pub b: f32,
}

impl Cone {
    /// No footprint: the ray accepts only original triangles.
    pub const ZERO: Self = Self { a: 0.0, b: 0.0 };

    /// Returns the cone that queries use: negative numbers and NaN become 0.
    #[inline]
    pub fn or_zero(self) -> Self {
        Self { a: self.a.max(0.0), b: self.b.max(0.0) }
    }
}

/// A ray with double-precision origin and single-precision direction.
///
/// Distances `t` are in units of `|dir|`. `dir` need not be a unit vector, but must be finite and not zero. Its
/// denormal components (below 1.2e-38) count as zero.
///
/// A ray is 64 bytes, and has the layout of the C struct, so that rays from C are copied as they are.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// The point where the ray starts.
    pub origin: DVec3,
    /// Hits at smaller distances are ignored. A negative value counts as 0; with an infinite one or NaN the ray hits
    /// nothing.
    pub t_min: f64,
    /// Hits at greater distances are ignored; infinity for no limit.
    pub t_max: f64,
    /// Direction.
    pub dir: Vec3,
    /// Footprint.
    pub cone: Cone,
    /// The ray sees the instances whose mask shares a bit with this one: all ones sees everything, 0 nothing.
    pub mask: u32,
}

impl Ray {
    /// True if the ray can hit anything: origin and direction are finite, the direction is not zero, and the interval
    /// is not empty.
    #[inline]
    pub fn can_hit(&self) -> bool {
        let size = self.dir.abs().max_element();
        self.origin.is_finite() && self.dir.is_finite() && size > 0.0 && self.has_interval()
    }

    /// Lower end of the interval.
    #[inline]
    pub fn begins(&self) -> f64 {
        self.t_min.max(0.0)
    }

    /// True if the interval is not empty. The test is in double precision: the ends of an empty interval may change
    /// places when rounded.
    #[inline]
    pub fn has_interval(&self) -> bool {
        self.t_min.abs() < f64::INFINITY && self.begins() <= self.t_max
    }

    /// A ray that hits nothing.
    pub const NONE: Self =
        Self { origin: DVec3::ZERO, t_min: 0.0, t_max: 0.0, dir: Vec3::ZERO, cone: Cone::ZERO, mask: 0 };

    /// A ray from `origin` along `dir`, without limits, that sees everything and requires exact answers.
    pub fn new(origin: DVec3, dir: Vec3) -> Self {
        Self { origin, t_min: 0.0, t_max: f64::INFINITY, dir, cone: Cone::ZERO, mask: u32::MAX }
    }
}
