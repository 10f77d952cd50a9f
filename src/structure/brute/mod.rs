//! `brute`: a list of triangles in blocks.
//!
//! It shows that the interface does not depend on one structure: tests run on it and on the others alike. No shipped
//! library contains it, because its time grows linearly with the number of triangles.

pub mod build;
mod cells;
mod decoder;
pub mod layout;
pub mod nodes;
pub mod open;
mod rows;
pub mod trace;

pub use decoder::{BruteDecoder, block_parts, holders};
