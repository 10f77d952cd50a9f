//! Stand-ins: what is shown for a part of a tree that is not descended into. `voxel` is what a cell looks like from
//! each side, composited from what lies in it, `seen` what a ray sees of that; `slabs` where in the cell that is (by
//! how far it `reach`es along `turns` of their axes), and `fill` how near to it all of that; `coded` their bytes. The
//! walks of a structure decide where a cell may stand in; `query` works out the promises of its hits. Uses base, math
//! and simd.
#![forbid(unsafe_code)]

mod coded;
mod fill;
mod support;
mod seen;
mod oriented_slabs;
mod turns;
mod voxel;

pub use coded::{
    Coded, SAMPLE_BYTES, SIDES_WORDS, TRANSMITTING_LEVEL, VOXEL_WORDS, stop_bits, stopped, stored_colour,
    stored_likeness, stored_normal,
};
pub use fill::{Fill, LEAST, LESS, holds, limit, sure_from};
pub use oriented_slabs::{
    Content, FIELDS, LEVEL, Middle, OrientedSlab, OrientedSlabs, fields, normal_bytes, oriented_slabs,
};
pub use seen::{Facing, blended_colour, shares, visible};
pub use support::farthest;
pub use voxel::{Facet, Voxel, summary_bit};
