//! Acceleration structures, and the interface between them and the modules above.
//!
//! The interface consists of these modules: `ray` (rays in a tree's frame), `hit` (results of walks), `filter` (tests
//! that reject hits), `place` and `cursor` (descent through a tree of any structure), `walk`, `packet` and `stream`
//! (the state of rays), `tree` (one enum over all structures: rays in, hits out), `open` (from a file to its trees, and
//! the decoder for residency), `by_tree` (the decoder of a file whose trees have several structures), `nodes` (nodes by
//! their places, for programs that walk trees by themselves), `bake` (triangles in, blocks out), `pairs` (walks through
//! pairs of trees), `rows` (children and triangles of a place, eight at a time), `nearest` (distances from a point to
//! them), `streams` (per-triangle numbers in blocks of their own), `fallback` (packets and streams for a structure that
//! traces single rays only).
//!
//! Each structure is a folder with three main modules: `build` (triangles in, blocks out), `layout` (the bytes of a
//! block, shared by baking and tracing) and `trace` (rays in, hits out). A new structure needs such a folder, a variant
//! of [`Structure`], and an arm in each `match` of `tree`, `open` and `bake`. No module above names a structure.
//! `packet` and `stream` also hold state that only the traversal of the bvh uses.
#![forbid(unsafe_code)]

pub mod bake;
#[cfg(any(test, feature = "brute"))]
pub mod brute;
mod bytes;
pub mod bvh;
mod by_tree;
pub mod cell;
pub mod cursor;
pub mod fallback;
pub mod filter;
pub mod hit;
pub mod nearest;
pub mod nodes;
pub mod open;
mod opened;
pub mod packet;
mod packet_boxes;
mod packet_prepare;
mod packet_triangles;
pub mod pairs;
pub mod par;
pub mod patch;
pub mod place;
mod prepared;
pub mod ray;
mod rays16;
pub mod resident;
pub mod rows;
pub mod stream;
pub mod streams;
pub mod surface;
pub mod tree;
pub mod walk;

pub use cursor::{Below, Descent, for_each_triangle};
pub use filter::{PartFilter, ShownBlock, ShownBlocks, Within};
pub use hit::{Counters, InFace, Outcome, StandIn, TriHit, Triangle};
pub use nodes::{LeafTriangle, Node};
pub use open::Nodes;
pub use packet::PacketWalk;
pub use par::Par;
pub use place::{Place, Rooted};
pub use ray::{LocalRay, LocalRays, USUAL_DIRS};
pub use resident::{Forms, Made, MakeForms, Resident};
pub use rows::{COLUMNS, Lanes, Rows};
pub use stream::Stream;
pub use tree::{Appearance, Blocks, Bundle, MemberChild, MemberLook, Members, Move, NEVER, Tree, Visit};
pub use walk::Walk;

/// Acceleration structure of a tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Structure {
    /// Wide, quantised bounding volume hierarchy.
    #[default]
    Bvh = 1,
    /// Surfaces as grids under quadtrees of quantised boxes, and triangles as in `Bvh`.
    ///
    /// A surface takes about seven bytes of memory for each triangle that it is diced into, if each face has some
    /// thousands (`Bvh` takes 27), and some forty if a face has few. The primitive id of a hit on a surface is its
    /// face's, counted over all surfaces of a build in the order added. Hits are on the triangles, not evaluated on the
    /// surface, and their error includes the tolerance of dicing. Stand-ins are boxes of at least four cells of a grid.
    /// Rays are traced one by one: packets and streams fall back.
    Patch = 4,
    /// List of triangles; for tests.
    #[cfg(any(test, feature = "brute"))]
    Brute = 255,
}

impl Structure {
    /// All structures of this build.
    pub const ALL: [Self; 2 + cfg!(any(test, feature = "brute")) as usize] = [
        Self::Bvh,
        Self::Patch,
        #[cfg(any(test, feature = "brute"))]
        Self::Brute,
    ];

    /// The structure of the trees of triangles of a model with this structure.
    pub fn of_triangles(self) -> Self {
        if self == Self::Patch { Self::Bvh } else { self }
    }

    /// Name in command lines and benchmarks.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bvh => "bvh",
            Self::Patch => "patch",
            #[cfg(any(test, feature = "brute"))]
            Self::Brute => "brute",
        }
    }

    /// Returns the structure with this number in files.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|structure| *structure as u32 == number)
    }
}
