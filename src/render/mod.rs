//! Rendering: frames are rendered in the background, tile by tile, into buffers that always hold complete pictures.
#![forbid(unsafe_code)]

pub mod film;
pub mod frame;
mod integrators;
mod job;
mod merged;
mod panes;
mod passes;
mod pick;
pub mod prefetch;
pub mod status;
mod tile;
mod tone;
pub(crate) mod wants;

pub use film::{Buffer, Mapped, Outputs, Target};
pub use frame::{Frame, FrameOptions, FrameSettings};
pub use prefetch::{Prefetch, PrefetchState, PrefetchStatus};
pub use status::{FrameState, FrameStatus};
