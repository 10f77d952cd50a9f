//! Queries to a scene: closest and any hits of rays in batches, and overlaps of boxes and frusta with parts.
#![forbid(unsafe_code)]

mod single;
mod answer;
pub(crate) mod answers;
mod asks;
pub mod batch;
mod beyond;
mod chunk;
pub mod geometry;
pub mod hit;
pub(crate) mod needs;
pub mod overlap;
mod parked;
mod rounds;
mod sweep;
mod volume;

pub(crate) use answers::stand_in;
pub use batch::{AHEAD, Hits, PACKET, Policy, Query, QueryOptions, QueryState, QueryStatus, Rays};
pub use geometry::{PartReader, StoredTriangle};
pub use hit::{Hit, HitKind, NONE, Want};
pub use overlap::{How, PartOverlap, Plane};
