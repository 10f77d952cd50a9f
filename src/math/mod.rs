//! Plain geometry on glam's types: bounds, rays and their cones. Uses nothing.
#![forbid(unsafe_code)]

pub mod bounds;
pub mod ray;
pub mod view;

pub use bounds::{Bounds, DBounds};
pub use ray::{Cone, Ray};
pub use view::View;
