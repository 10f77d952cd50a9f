//! The bake: meshes in, a model file out, as a list of passes.
//!
//! 1. **read** (`spool`): triangles are checked, counted and kept with their parts; those that do not fit the
//!    memory budget go, coded, to a temporary;
//! 2. **place** (`origin`): each mesh gets an origin, positions become single precision around it, triangles
//!    without area are counted and left out;
//! 3. **distribute** (`survey`, `regions`, `distribute`), of meshes that do not fit: into chunks of triangles
//!    that are near each other, each of which fits;
//! 4. **build** (`mesh`): the structure's baker (`structure::bake`) makes of each chunk a tree and its blocks, which
//!    are put aside; the top of that tree stays, and is joined to the coarse blocks of the mesh;
//! 5. **write** (`output`): coarse blocks, then those of each further class; encoded in parallel, written in order;
//! 6. **seal** (`seal`): ids, colours, tables, checksums, sync, rename.
//!
//! A mesh that fits is one chunk, of which only blocks of the last class are put aside. What a budget is spent on is in
//! `shares`: the chunks, and so the bytes of the file, depend on it and never on the number of threads.
#![forbid(unsafe_code)]

mod batch;
mod builder;
mod coding;
mod distribute;
mod mesh;
mod origin;
mod output;
mod parts;
mod regions;
mod report;
mod seal;
mod shares;
mod spool;
mod survey;

pub use crate::structure::Structure;
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

impl Splits {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Auto, Self::Off, Self::On];

    /// As command lines and benchmarks call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Off => "off",
            Self::On => "on",
        }
    }
}

/// Options of a build. The default is what most models want.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// What to build.
    pub structure: Structure,
    /// Bytes of memory that the build may use, at least 32 MiB; 0 for no limit. Default 0. Triangles that do not fit go
    /// through temporaries, about 20 bytes each, up to 80 where they are split, and their tree is built in chunks:
    /// files of different budgets hold the same triangles in somewhat different trees.
    pub memory_budget: u64,
    /// Threads; 0 for as many as the machine has, 1 to stay wholly in the calling thread. Default 0.
    /// The file does not depend on it.
    pub threads: usize,
    /// Where temporaries go; the system's default if `None`. They have no names there, and are gone when the
    /// build ends in whatever way.
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
