//! `bvh`: a wide bounding volume hierarchy, quantised and clustered into blocks.

pub mod build;
mod bytes;
pub mod codec;
mod decoder;
pub mod layout;
pub mod trace;
mod validate;

pub use decoder::{BvhDecoder, check_links};
pub use validate::validate;
