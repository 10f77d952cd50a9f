//! Stand-ins: voxels and proxies shown in place of a part of a tree that a walk does not descend into.
//!
//! `voxel` computes the look of a cell from each side, composited from its content, and `seen` the part of it that a
//! ray sees. `oriented_slabs` bounds the content inside of the cell, by its extents (`support`) along axes that `turns`
//! selects. `fill` bounds the distance from this region to the content. `coded` encodes all of it in bytes. `proxy` has
//! the look of a subtree from eighteen directions, which may replace the look of its voxels. `look` is the enum of all
//! of these. `placed` computes the look of a cell in another frame. The walks of a structure
//! decide where a stand-in is acceptable, and `query` computes the error bounds of its hits. Uses base, math and simd.
#![forbid(unsafe_code)]

mod coded;
mod fill;
mod curtain;
mod look;
mod support;
mod seen;
mod oriented_slabs;
mod placed;
mod proxy;
mod turns;
mod voxel;

pub use coded::{
    Coded, SAMPLE_BYTES, SIDES_WORDS, TRANSMITTING_LEVEL, VOXEL_WORDS, coded_normal, is_loose, loosened, of_sample,
    stop_bits, stop_code, stopped, stored_colour, stored_cover, stored_likeness, stored_normal,
};
pub use curtain::{CURTAIN_WORDS, Curtain, FirstHit, curtain_from, hang_curtains};
pub use fill::{Fill, LEAST, LESS, holds, limit, sure_from};
pub use look::{Look, Seen, Shares};
pub use oriented_slabs::{
    Content, FIELDS, LEVEL, Middle, OrientedSlab, OrientedSlabs, fields, normal_bytes, oriented_slabs,
};
pub use placed::{PlacedSides, placed_sides, side_seen};
pub use proxy::{Looks, Sampler, halton, line_into};
pub use seen::{Facing, blended_colour, mean_cosine, shares, visible};
pub use support::farthest;
pub use voxel::{Facet, Sample, Voxel, summary_bit};
