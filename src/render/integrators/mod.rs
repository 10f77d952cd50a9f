//! How a pixel gets its colour.

pub mod direct;
pub mod first;
pub mod material;
pub mod plain;
mod sampling;
mod shading;
mod shadow;
mod surface;
