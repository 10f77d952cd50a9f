//! The bake: meshes in, a model file out, as a list of passes.
//!
//! 1. **read** (`spool`): triangles are checked, counted and kept with their parts;
//! 2. **place** (`origin`): each mesh gets an origin, positions become single precision around it,
//!    triangles without area are counted and left out;
//! 3. **build**: each mesh becomes a tree (`structure::bvh::build`);
//! 4. **write** (`seal`): blocks are encoded in parallel and written in order;
//! 5. **seal**: tables, checksums, sync, rename.
//!
//! Everything is kept in memory: the budget is checked as triangles arrive, and refused with the need.
#![forbid(unsafe_code)]

mod builder;
mod origin;
mod report;
mod seal;
mod spool;

pub use builder::Builder;
pub use report::{BuildReport, PhaseSeconds};

use crate::import::UpAxis;
use std::path::PathBuf;

/// Whether triangles may be split between leaves: it pays for long thin ones, and not on scans.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Splits {
    /// Where the shape of the triangles says that it pays.
    #[default]
    Auto,
    /// Never.
    Off,
    /// Always.
    On,
}

/// The acceleration structure of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Structure {
    /// Wide, quantised bounding volume hierarchy.
    #[default]
    Bvh = 1,
}

/// Options of a build. The default is what most models want.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// What to build.
    pub structure: Structure,
    /// Bytes of memory that the build may use; 0 for no limit. Default 0.
    pub memory_budget: u64,
    /// Threads; 0 for as many as the machine has, 1 to stay wholly in the calling thread. Default 0.
    /// The file does not depend on it.
    pub threads: usize,
    /// Where temporaries of readers go; the system's default if `None`.
    pub temp_dir: Option<PathBuf>,
    /// Spatial splits. Default: automatic.
    pub splits: Splits,
    /// Length unit, in place of what the input says; > 0.
    pub metres_per_unit: Option<f64>,
    /// Up axis, in place of what the input says.
    pub up: Option<UpAxis>,
}

#[cfg(test)]
mod tests;
