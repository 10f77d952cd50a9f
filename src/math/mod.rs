//! Plain geometry on glam's types: bounds, rays and their cones. Uses nothing.

pub mod bounds;
pub mod ray;

pub use bounds::{Bounds, DBounds};
pub use ray::{Cone, Ray};
