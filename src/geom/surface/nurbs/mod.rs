//! NURBS and Bézier surfaces in double precision: tensor products of any degree, rational or not.
//!
//! A control point P with weight w is kept as (w (P − O), w), around an origin O inside the surface: far from zero no
//! bits are lost. All weights are positive, hence a point is a convex combination of the control points, and their
//! box encloses the surface.
//!
//! Sources: Piegl, Tiller, "The NURBS Book", 2nd edition, 1997, chapters 2 to 5 (definitions, quotient rule,
//! decomposition); Ramshaw, "Blossoms are polar forms", CAGD 6(4), 1989 (control points of pieces as blossoms).

mod basis;
mod bezier;
mod bounds;
mod cone;
mod desc;
mod knots;
mod limit;
mod normals;
mod pieces;
mod quads;
mod surface;
mod tensor;
#[cfg(test)]
pub(crate) mod tests;

pub use bezier::BezierPatch;
pub use cone::NormalCone;
pub use desc::{MAX_COORDINATE, MAX_DEGREE, MAX_WEIGHT_RATIO, MIN_SPAN, NurbsDesc};
pub use quads::NurbsQuads;
pub use surface::Nurbs;
