//! Parametric surfaces in double precision: their points, derivatives and bounds.

pub mod displacement;
pub mod nurbs;
pub mod point;

pub use point::SurfacePoint;
