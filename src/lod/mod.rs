//! (lod: being built.)
