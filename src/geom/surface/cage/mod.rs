//! Catmull-Clark cages: subdivision by the rules of OpenSubdiv 3.5, and their limit surface.

mod desc;
mod level;
mod masks;
mod refine;
mod rules;
mod topology;

pub use desc::{Boundary, CageDesc, Creasing, MAX_VALENCE, TriangleRule};
pub use level::Cage;
pub use rules::INFINITE;
