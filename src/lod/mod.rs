//! (lod: being built.)
#![forbid(unsafe_code)]
