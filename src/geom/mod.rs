//! Triangles: the watertight ray test and clipping. Uses base, math and simd.
#![forbid(unsafe_code)]

pub mod clip;
pub mod watertight;

pub use watertight::{Shear, TriangleHit};
