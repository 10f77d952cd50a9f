//! How a pixel gets its colour.

pub mod direct;
pub mod material;
mod shadow;
