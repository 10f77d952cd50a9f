//! Places in a tree: where a walk is, or may go.

use crate::simd::Isa;

/// An item of a tree, with the block that it is in. Places are ordered by block, so that items of one block are visited
/// together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// The block.
    pub block: u32,
    /// The item in the block, as the structure counts.
    pub(super) item: u32,
}

/// Properties of a tree that a walk needs before it begins.
pub trait Rooted {
    /// Place where walks begin; `None` for an empty tree.
    fn root(&self) -> Option<Place>;
    /// Greatest magnitude of a coordinate of the tree.
    fn max_coord(&self) -> f32;
    /// Instruction set to trace with.
    fn isa(&self) -> Isa;
}
