//! Pictures: frames rendered in the background, tile by tile, into buffers that stay whole.
#![forbid(unsafe_code)]

pub mod film;
pub mod frame;
pub mod status;

pub use film::{Buffer, Mapped, Outputs, Target};
pub use frame::{Frame, FrameOptions, FrameSettings};
pub use status::{FrameState, FrameStatus};
