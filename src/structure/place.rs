//! Places in a tree: where a walk is, or may go.

use crate::simd::Isa;

/// Something in a tree, by the block that it is in. Ordered by block, so that what is read together is visited
/// together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// The block.
    pub block: u32,
    /// What in it; the structure's own count.
    pub(super) item: u32,
}

/// What walks have to know of a tree before they begin.
pub trait Rooted {
    /// Where they begin; `None` for a tree with nothing in it.
    fn root(&self) -> Option<Place>;
    /// Greatest magnitude of a coordinate of the tree.
    fn max_coord(&self) -> f32;
    /// Vectors to trace with.
    fn isa(&self) -> Isa;
}
