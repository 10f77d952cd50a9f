//! Parametric surfaces in double precision: their points, derivatives and bounds.

pub mod cage;
pub mod dice;
pub mod displacement;
pub mod nurbs;
pub mod point;
pub mod shading;

pub use dice::{Dicing, Quads, dice};
pub use point::SurfacePoint;
pub use shading::ShadingPoint;
