//! Plain geometry on glam's types: bounds, rays and their cones, the widths of groups of rays, and the coding of
//! colours and directions. Uses nothing.
#![forbid(unsafe_code)]

pub mod bounds;
pub mod octahedral;
pub mod ray;
pub mod srgb;
pub mod view;
pub mod widths;

pub use bounds::{Bounds, DBounds};
pub use ray::{Cone, Ray};
pub use view::View;
pub use widths::{BUNDLE, PACKET, STREAM, bits, first_rays};
