//! Questions to a scene: closest and any hits in batches, overlaps of boxes and frusta by part.
#![forbid(unsafe_code)]

mod alone;
mod answer;
mod asks;
pub mod batch;
mod chunk;
pub(crate) mod finish;
pub mod hit;
pub(crate) mod needs;
pub mod overlap;
mod parked;
mod rounds;
mod simple;
pub(crate) mod stand_in;
pub(crate) mod surfaces;
mod sweep;
mod volume;

pub use batch::{AHEAD, Hits, PACKET, Policy, Query, QueryOptions, QueryState, QueryStatus, Rays};
pub use hit::{Hit, HitKind, NONE, Want};
pub use overlap::{How, PartOverlap, Plane};
