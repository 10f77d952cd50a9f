//! Queries to a scene: closest and any hits of rays in batches, all crossings of rays, overlaps of boxes and frusta
//! with parts, clashes, nearest points and distances. The cursor returns the nodes of a model to programs that walk its
//! trees by themselves.
#![forbid(unsafe_code)]

mod single;
mod answer;
mod among;
pub(crate) mod answers;
mod asks;
pub mod batch;
mod beyond;
mod chunk;
pub mod clash;
pub mod crossings;
pub mod cursor;
pub mod distance;
pub mod evaluate;
mod frames;
pub mod geometry;
pub mod hit;
pub mod inside;
mod located;
pub mod nearest;
pub(crate) mod needs;
pub mod overlap;
mod parked;
mod part_set;
mod rounds;
mod sweep;
mod volume;
mod waiting;

pub use crate::geom::Side;
pub use crate::structure::Node;
pub(crate) use answers::stand_in;
pub use batch::{AHEAD, Hits, PACKET, Policy, Query, QueryOptions, QueryState, QueryStatus, Rays};
pub use crossings::Crossing;
pub use cursor::{CURSOR_BYTES, Cursor, CursorOptions, Found, NodeTriangle, TreePlace};
pub use distance::{DistanceOptions, SetDistance};
pub use evaluate::{Evaluated, SurfaceAt};
pub use geometry::{PartReader, StoredTriangle};
pub use hit::{Hit, HitKind, NONE, Want};
pub use inside::{Holds, PartAt};
pub use nearest::{NearestOptions, NearestPoint};
pub use overlap::{How, PartOverlap, Plane};
pub use part_set::PartSet;
