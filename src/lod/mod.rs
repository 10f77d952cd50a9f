//! Stand-ins: what is shown for a part of a tree that is not descended into. `voxel` is what a cell looks like
//! from each side, composited from what lies in it; `coded` its bytes. Where a cell may stand in is decided by the
//! walks (`structure::bvh::trace`); what its hits promise by `query::finish`. Uses base and math.
#![forbid(unsafe_code)]

mod coded;
mod voxel;

pub use coded::{Coded, SAMPLE_BYTES, SIDES_WORDS, Side, VOXEL_WORDS, stored_colour, stored_normal};
pub use voxel::{Facet, Voxel, summary_bit};
