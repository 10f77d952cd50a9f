//! **outcrop** ray traces models larger than memory on the CPU.
//!
//! The rooms, in the order in which data flows through them; `tests/house.rs` holds every room
//! to the ones it may use.
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

pub use base::error::{Error, Result};
pub use query::{Hit, HitKind, How, PartOverlap, Plane, Query, QueryOptions, Want};
pub use render::{
    Buffer, Frame, FrameOptions, FrameSettings, FrameState, FrameStatus, Mapped, Outputs, Prefetch, PrefetchState,
    PrefetchStatus,
};
pub use scene::{
    Background, Camera, Context, ContextOptions, Light, LightKind, LogLevel, Look, Model, Scene, SceneState,
};
