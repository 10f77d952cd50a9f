//! References: the boxes that the builder sorts, one or more for each triangle.

use crate::base::error::Result;
use crate::math::Bounds;
use crate::structure::par::Par;
use glam::{Vec3, Vec4};

/// The box of a triangle, or of a part of it. It takes 32 bytes, because sorting is limited by memory traffic.
#[derive(Debug, Clone, Copy)]
pub struct Ref {
    /// Least corner; `w` holds the index of the triangle as bits.
    pub low: Vec4,
    /// Greatest corner; `w` is 1. Indices are denormal numbers as floats, and a product with one would cost a trap;
    /// their sums with 1 are not denormal.
    pub high: Vec4,
}

impl Ref {
    /// Creates the reference of triangle `index`.
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

    /// Twice its centre; `w` is meaningless.
    #[inline]
    pub fn center2(&self) -> Vec4 {
        self.low + self.high
    }
}

/// Creates one reference for each triangle, followed by room for `spare` times as many more. Fails with `NoMemory`.
pub fn make(triangles: &[[Vec3; 3]], spare: f32, par: &Par) -> Result<Vec<Ref>> {
    let room = (triangles.len() as f64 * f64::from(spare)) as usize;
    let free = Ref { low: Vec4::ZERO, high: Vec4::ZERO };
    // All threads write the references in place: the first touch of memory costs as much as the rest.
    let make = |i: usize| triangles.get(i).map_or(free, |t| Ref::new(Bounds::of(t), i as u32));
    par.try_map(triangles.len() + room, "the references of a tree", make)
}
