//! `bvh`: a wide bounding volume hierarchy with quantised boxes, divided into blocks.

pub(in crate::structure) mod appearance;
pub mod build;
pub mod codec;
mod codec_leaves;
mod codec_nodes;
#[cfg(test)]
mod codec_tests;
mod decoder;
pub mod layout;
pub mod leaf;
pub(in crate::structure) mod members;
pub(in crate::structure) mod nodes;
pub(in crate::structure) mod normals;
pub mod open;
pub(in crate::structure) mod refit;
pub mod trace;
mod validate;
mod voxel;

pub use decoder::{BvhDecoder, block_parts, check_links, entered_blocks, holders, leaves_at};
pub use validate::validate;
