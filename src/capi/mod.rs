//! The C ABI: every entry point checks, catches, converts and calls; nothing else happens here.
//!
//! `include/outcrop.h` is generated from this room (`make header`).
#![allow(non_camel_case_types)]

pub mod version;
