//! Catmull-Clark cages: subdivision by the rules of OpenSubdiv 3.5, and their limit surface.
//!
//! [`Cage`] is topology with sharpness, which key frames share; [`Cage::refine`] and [`Cage::refine_points`] are one
//! uniform step. [`CagePatches`] is the limit surface of all faces. A face alone, or one from a file, takes three
//! steps: [`Finder`] or [`Neighbourhood::read`] gives its neighbourhood, [`Plans`] the plan of its subdivision, which
//! faces alike share, and [`QuadSurface`] is the plan with points.
//!
//! The surface is the true limit. Quads are subdivided until they are bicubic; around an irregular vertex, where this
//! never ends, the step that repeats is applied as often as the parameters require, and the vertex itself has masks. So
//! there is no depth to choose. OpenSubdiv's Bfr differs by up to 10⁻³ of the extent within 2⁻¹⁰ of irregular vertices,
//! which it approximates; elsewhere both agree to 10⁻¹⁴ (`tests/surfaces/bfr.rs`).

mod around;
mod bicubic;
mod bicubics;
mod bounds;
mod crease;
mod desc;
mod displaced;
mod evaluate;
mod level;
mod limit;
mod masks;
mod patches;
mod pattern;
mod plan;
mod quads;
mod refine;
mod rules;
mod settled;
mod sparse;
mod surface;
mod topology;
mod words;
#[cfg(test)]
pub(crate) mod tests;

pub use around::{Finder, Neighbourhood};
pub use desc::{Boundary, CageDesc, Creasing, MAX_VALENCE, TriangleRule};
pub use displaced::Displacement;
pub use level::Cage;
pub use patches::CagePatches;
pub use plan::{Plan, Plans};
pub use quads::CageQuads;
pub use rules::INFINITE;
pub use surface::QuadSurface;
