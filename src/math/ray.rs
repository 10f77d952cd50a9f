//! Rays as callers give them, and the cone that is a ray's footprint.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// A ray's footprint: width `a + b * t` at distance parameter `t`, in scene units. A stand-in is accepted where the
/// area of its cell's projection is at most the square of the width: for p pixels of error take the pixel's width times
/// the square root of p. `ZERO` asks for exact answers.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Cone {
    /// Width at `t` = 0, >= 0.
    pub a: f32,
    /// Growth of the width per unit of `t`, >= 0.
    pub b: f32,
}

impl Cone {
    /// No footprint: only original triangles may answer.
    pub const ZERO: Self = Self { a: 0.0, b: 0.0 };

    /// With 0 for what is below 0 or not a number: so queries take cones.
    #[inline]
    pub fn or_zero(self) -> Self {
        Self { a: self.a.max(0.0), b: self.b.max(0.0) }
    }
}

/// A ray in double-precision origin and single-precision direction.
///
/// Distances `t` are in units of `|dir|`; `dir` need not be unit, but must be finite and not zero. Denormal
/// components (below 1.2e-38) count as zero.
///
/// One cache line, laid out as the C struct is: taking rays over from C is a copy.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Hits before this are ignored. Below 0 it counts as 0; infinite, or NaN, nothing is hit.
    pub t_min: f64,
    /// Hits beyond this are ignored; infinity for none.
    pub t_max: f64,
    /// Where it goes.
    pub dir: Vec3,
    /// Its footprint.
    pub cone: Cone,
    /// It sees the instances whose mask has a bit in common with this: all ones sees everything, 0 nothing.
    pub mask: u32,
}

impl Ray {
    /// Whether it can hit anything at all: finite, with a direction and an interval.
    #[inline]
    pub fn can_hit(&self) -> bool {
        let size = self.dir.abs().max_element();
        self.origin.is_finite() && self.dir.is_finite() && size > 0.0 && self.has_interval()
    }

    /// Where its interval begins.
    #[inline]
    pub fn begins(&self) -> f64 {
        self.t_min.max(0.0)
    }

    /// Whether there is anything between its ends. Looked at in double precision: rounded, the ends of an empty
    /// interval may change places.
    #[inline]
    pub fn has_interval(&self) -> bool {
        self.t_min.abs() < f64::INFINITY && self.begins() <= self.t_max
    }

    /// Not a ray: nothing is hit.
    pub const NONE: Self =
        Self { origin: DVec3::ZERO, t_min: 0.0, t_max: 0.0, dir: Vec3::ZERO, cone: Cone::ZERO, mask: 0 };

    /// From `origin` along `dir`, unbounded, exact, seeing everything.
    pub fn new(origin: DVec3, dir: Vec3) -> Self {
        Self { origin, t_min: 0.0, t_max: f64::INFINITY, dir, cone: Cone::ZERO, mask: u32::MAX }
    }
}
