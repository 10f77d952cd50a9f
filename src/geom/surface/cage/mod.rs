//! Catmull-Clark cages: subdivision by the rules of OpenSubdiv 3.5, and their limit surface.

mod around;
mod bicubic;
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
#[cfg(test)]
mod tests;

pub use around::{Finder, Neighbourhood};
pub use desc::{Boundary, CageDesc, Creasing, MAX_VALENCE, TriangleRule};
pub use displaced::Displacement;
pub use level::Cage;
pub use patches::CagePatches;
pub use plan::{Plan, Plans};
pub use quads::CageQuads;
pub use rules::INFINITE;
pub use surface::QuadSurface;
