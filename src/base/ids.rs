//! Internal indices. Ids that the caller chooses, of parts and instances, are plain `u64`.

/// A block of a model: the index into its block directory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct BlockId(pub u32);

/// A row of a model's part table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct PartIndex(pub u32);

/// A row of a model's material table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct MaterialIndex(pub u32);

/// A tree of a model: tree 0 holds the triangles that are placed directly, each further one a shared mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct TreeIndex(pub u32);
