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
pub mod layout;
pub mod trace;

pub use layout::Resident;

/// For error messages.
pub(super) const WHAT: &str = "the form for exact rays of a model";

/// The resident forms of the trees of a model, in the order of the file's table. Some trees may have none.
#[derive(Debug)]
pub struct Forms(pub Vec<Option<Resident>>);

impl Forms {
    /// The form of a tree.
    #[inline(always)]
    pub fn of(&self, tree: u32) -> Option<&Resident> {
        self.0.get(tree as usize)?.as_ref()
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> u64 {
        let forms: u64 = self.0.iter().flatten().map(Resident::bytes).sum();
        forms + (self.0.capacity() * size_of::<Option<Resident>>()) as u64
    }
}
