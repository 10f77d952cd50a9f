//! Triangles: the watertight ray test, and the exact test of crossings. Uses base, math and simd.
#![forbid(unsafe_code)]

pub mod crossing;
pub mod watertight;

pub use crossing::{Line, Side};
pub use watertight::{Shear, TriangleHit};
