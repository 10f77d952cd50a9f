//! References: the boxes that the builder sorts, one or more for each triangle.

use crate::math::Bounds;
use crate::structure::par::Par;
use glam::{Vec3, Vec4};

/// A triangle's box, or a part of it. 32 bytes: sorting is memory traffic.
#[derive(Debug, Clone, Copy)]
pub struct Ref {
    /// Least corner; the index of the triangle as bits in `w`.
    pub low: Vec4,
    /// Greatest corner; 1 in `w`: indices are denormal numbers as floats, and sums with 1 are not. Their
    /// products would cost a trap each.
    pub high: Vec4,
}

impl Ref {
    /// Of triangle `index`.
    #[inline]
    pub fn new(bounds: Bounds, index: u32) -> Self {
        Self { low: bounds.min.extend(f32::from_bits(index)), high: bounds.max.extend(1.0) }
    }

    /// Index of its triangle.
    #[inline]
    pub fn triangle(&self) -> usize {
        self.low.w.to_bits() as usize
    }

    /// Its box.
    #[inline]
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.low.truncate(), max: self.high.truncate() }
    }

    /// Twice its middle; `w` means nothing.
    #[inline]
    pub fn center2(&self) -> Vec4 {
        self.low + self.high
    }
}

/// One reference for each triangle, and room for `spare` times as many more behind them.
pub fn make(triangles: &[[Vec3; 3]], spare: f32, par: &Par) -> Vec<Ref> {
    let room = (triangles.len() as f64 * f64::from(spare)) as usize;
    let free = Ref { low: Vec4::ZERO, high: Vec4::ZERO };
    // Written where it stays, by all threads: the first touch of memory costs as much as the rest.
    par.map(triangles.len() + room, |i| triangles.get(i).map_or(free, |t| Ref::new(Bounds::of(t), i as u32)))
}
