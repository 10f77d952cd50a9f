//! `brute`: a list of triangles in blocks. It is there to show that the contract does not lean on a structure (tests
//! run on it and on the others alike) and is in no library that ships: it takes time in proportion to the triangles.

pub mod build;
mod cells;
mod decoder;
pub mod layout;
pub mod open;
pub mod trace;

pub use decoder::BruteDecoder;
