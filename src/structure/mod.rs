//! Acceleration structures. Each is a folder with three faces: `build` (triangles in, blocks out),
//! `layout` (the bytes both wings agree on), `trace` (rays in, hits out).
#![forbid(unsafe_code)]

pub mod bvh;
pub mod cell;
pub mod surface;
