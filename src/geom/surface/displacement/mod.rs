//! Displacement of a surface along its normal by heights in a texture or in a grid for each face.

mod heights;
mod offset;
mod range;
#[cfg(test)]
mod tests;

pub use heights::{HeightSample, Heights, Wrap};
pub use offset::{Displaced, NormalFrame, displace};
