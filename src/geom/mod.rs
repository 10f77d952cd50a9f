//! Parametric surfaces, and triangles: the watertight ray test, the exact test of crossings, and pairs of triangles:
//! their exact relation, their common points and their distance. Uses base, math and simd.
#![forbid(unsafe_code)]

pub mod crossing;
pub mod distances;
mod flat;
pub mod many;
pub mod pairs;
mod signs;
pub mod surface;
pub mod watertight;
#[cfg(test)]
mod distances_tests;
#[cfg(test)]
mod pairs_tests;

pub use crossing::{Line, Side};
pub use distances::{Between, Nearest, distance_bounds, point_triangle, segment_segment, triangle_triangle};
pub use many::{Eight, Lot, One, Sifted, relate_many, sift};
pub use pairs::{Relation, meeting, relate};
pub use watertight::{Shear, TriangleHit};
