//! Acceleration structures, and the contract between them and all rooms above.
//!
//! The contract: `ray` (rays in a tree's frame), `hit` (what walks answer), `filter` (what rays pass through), `place`
//! and `cursor` (walking down a tree of any structure), `walk`, `packet` and `stream` (the state of rays), `tree` (one
//! enum over structures: rays in, hits out), `open` (from a file to trees, and the decoder that residency is handed),
//! `bake` (triangles in, blocks out), `streams` (numbers beside triangles), `fallback` (packets and streams of a
//! structure that walks single rays only).
//!
//! Each structure is a folder with three faces: `build` (triangles in, blocks out), `layout` (the bytes both wings
//! agree on), `trace` (rays in, hits out). A further one is such a folder, a variant of [`Structure`], and an arm in
//! each `match` of `tree`, `open` and `bake`; no room above names one. (`packet` and `stream` hold state of the bvh's
//! own walks beside that of all structures.)
#![forbid(unsafe_code)]

pub mod bake;
#[cfg(any(test, feature = "brute"))]
pub mod brute;
mod bytes;
pub mod bvh;
pub mod cell;
pub mod cursor;
pub mod fallback;
pub mod filter;
pub mod hit;
pub mod open;
pub mod packet;
mod packet_prepare;
pub mod par;
pub mod place;
pub mod ray;
pub mod stream;
pub mod streams;
pub mod surface;
pub mod tree;
pub mod walk;

pub use cursor::{Below, Descent, for_each_triangle};
pub use filter::{PartFilter, Within};
pub use hit::{Counters, Outcome, StandIn, TriHit, Triangle};
pub use packet::PacketWalk;
pub use par::Par;
pub use place::{Place, Rooted};
pub use ray::{LocalRay, USUAL_DIRS};
pub use stream::Stream;
pub use tree::{Bundle, Tree, Visit};
pub use walk::Walk;

/// The acceleration structure of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Structure {
    /// Wide, quantised bounding volume hierarchy.
    #[default]
    Bvh = 1,
    /// List of triangles; for tests.
    #[cfg(any(test, feature = "brute"))]
    Brute = 255,
}

impl Structure {
    /// All of them.
    pub const ALL: [Self; 1 + cfg!(any(test, feature = "brute")) as usize] = [
        Self::Bvh,
        #[cfg(any(test, feature = "brute"))]
        Self::Brute,
    ];

    /// As command lines and benchmarks call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bvh => "bvh",
            #[cfg(any(test, feature = "brute"))]
            Self::Brute => "brute",
        }
    }

    /// The one with a number in files.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|structure| *structure as u32 == number)
    }
}
