//! Parametric surfaces in double precision: their points, derivatives and bounds.

pub mod dice;
pub mod point;

pub use dice::{Dicing, Quads, dice};
pub use point::SurfacePoint;
