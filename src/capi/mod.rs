//! The C ABI. Every entry point checks its arguments, catches panics, converts types and calls the crate; it has no
//! other logic.
//!
//! `make header` generates `include/outcrop.h` from this module, including the doc comments: they are written for
//! readers of the header. There is one file for each C object. `guard` handles panics, null pointers and sizes;
//! `handles` the reference counts.
#![allow(non_camel_case_types)]

#[cfg(feature = "reserve")]
mod allocator;
pub(crate) mod background;
pub mod build;
pub mod cages;
pub mod clash;
pub mod contents;
pub mod context;
pub mod crossings;
pub mod cursor;
pub mod evaluate;
pub mod fit;
pub(crate) mod fork;
pub mod frame;
pub mod geometry;
pub(crate) mod guard;
pub(crate) mod handles;
pub mod inside;
pub mod instances;
pub mod job;
pub mod looks;
pub mod model;
pub mod nearest;
pub mod nested;
pub mod nurbs;
pub mod overlap;
pub mod pixels;
pub mod prefetch;
pub mod query;
pub mod query_f32;
pub mod report;
pub mod resolve;
pub mod scene;
pub mod scene_files;
pub mod status;
#[cfg(debug_assertions)]
pub(crate) mod testing;
pub mod triangles;
pub mod version;
pub mod view;
