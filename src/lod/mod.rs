//! Stand-ins: what is shown for a part of a tree that is not descended into. `voxel` is what a cell looks like
//! from each side, composited from what lies in it; `slabs` where in the cell that is; `coded` the bytes of both. Where a
//! cell may stand in is decided by the walks (`structure::bvh::trace`); what its hits promise by `query::finish`. Uses base and
//! math.
#![forbid(unsafe_code)]

mod coded;
mod slabs;
mod voxel;

pub use coded::{Coded, SAMPLE_BYTES, SIDES_WORDS, Side, VOXEL_WORDS, stored_colour, stored_normal};
pub use slabs::{Content, Middle, Slab, Slabs, farthest};
pub use voxel::{Facet, Voxel, summary_bit};
