//! `resident`: a tree in the form that traces exact rays fastest, for trees that are in memory as a whole.
//!
//! The form is made from a tree of any structure, by its cursor, and only traces: all else goes through the blocks.
//! Boxes are in full precision, nodes refer to each other without blocks, and the triangles of a leaf are laid out for
//! one vector test. It takes about twice the memory of the blocks. Rays with a footprint, and rays whose hits need a
//! test of their own, walk the blocks.
//!
//! The hits are those of the blocks to the bit, and name triangles by block and item. A ray therefore need not know in
//! which form its hit was found. The one exception is a sliver hit edge-on, as in `bvh::trace`.

pub mod build;
mod forms;
pub mod layout;
pub mod trace;

pub use forms::{Forms, Made, MakeForms};
pub use layout::Resident;

/// For error messages.
pub(super) const WHAT: &str = "the form for exact rays of a model";
