//! The C ABI: every entry point checks, catches, converts and calls; nothing else happens here.
//!
//! `include/outcrop.h` is generated from this room (`make header`), comments included: they are
//! written for the reader of the header. One file for each C object; `guard` holds panics, nulls and
//! sizes, `handles` the counting.
#![allow(non_camel_case_types)]

pub(crate) mod background;
pub mod build;
pub mod contents;
pub mod context;
pub mod frame;
pub(crate) mod guard;
pub(crate) mod handles;
pub mod job;
pub mod model;
pub mod overlap;
pub mod pixels;
pub mod prefetch;
pub mod query;
pub mod report;
pub mod scene;
pub mod status;
#[cfg(debug_assertions)]
pub(crate) mod testing;
pub mod triangles;
pub mod version;
pub mod view;
