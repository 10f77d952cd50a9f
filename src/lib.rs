//! **outcrop** ray traces models larger than memory on the CPU.
//!
//! The top-level modules, called rooms, stand in the order in which data flows through them. A room uses only the
//! earlier rooms that `tests/house.rs` allows it.
#![deny(unsafe_op_in_unsafe_fn)]
#![warn(missing_docs)]

pub mod base;
pub mod math;
pub mod simd;
pub mod geom;
pub mod lod;
pub mod store;
pub mod import;
pub mod residency;
pub mod structure;
pub mod build;
pub mod scene;
pub mod query;
pub mod render;
pub mod capi;
pub mod guide;

pub use base::error::{Error, Result};
pub use query::{Hit, HitKind, How, PartOverlap, Plane, Query, QueryOptions, Want};
pub use render::{
    Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Mapped, Outputs, Prefetch, PrefetchState,
    PrefetchStatus,
};
pub use scene::{
    Background, Camera, Context, ContextOptions, Light, LightKind, LogLevel, Look, Model, Scene, SceneState,
};
