//! Triangles: the watertight ray test. Uses base, math and simd.
#![forbid(unsafe_code)]

pub mod watertight;

pub use watertight::{Shear, TriangleHit};
