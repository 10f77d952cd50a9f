//! Plain geometry on glam's types: bounds, rays and their cones; the coding of colours. Uses nothing.
#![forbid(unsafe_code)]

mod bits;
pub mod bounds;
pub mod ray;
pub mod srgb;
pub mod view;

pub(crate) use bits::bits;
pub use bounds::{Bounds, DBounds};
pub use ray::{Cone, Ray};
pub use view::View;
