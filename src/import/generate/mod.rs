//! Generators: seeded models of any size, pushed in bounded memory into a [`Sink`] or a PLY file.
//!
//! | name | what | parts |
//! |---|---|---|
//! | `mandelbulb` | a closed fractal surface, about two triangles a vertex | one |
//! | `airliner` | CAD soup: long, thin, overlapping, jittered, no shared vertices | thousands |
//!
//! The same name, size and seed give the same triangles in the same order at any number of threads.
//! The formulas are in the modules' texts. [`views()`] gives four views of each.
#![forbid(unsafe_code)]

mod airliner;
mod mandelbulb;
mod ply_writer;
mod rng;
mod target;
#[cfg(test)]
mod tests;
mod views;

use ply_writer::write_ply;
pub use views::views;

use super::Sink;
use crate::base::error::{Error, Result};
use crate::base::progress::Cancel;
use std::path::Path;
use target::{SinkTarget, Target};

/// The generators' names.
pub const NAMES: [&str; 2] = ["mandelbulb", "airliner"];

/// What to generate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GenerateOptions {
    /// Wanted number of triangles, reached within 2 %: for the `mandelbulb` from 10³ to 4·10⁹, for the
    /// `airliner` from 10⁵ to 1.4·10⁹.
    pub triangles: u64,
    /// Other seeds give other models; 0 is the one in the pictures.
    pub seed: u64,
}

impl Default for GenerateOptions {
    fn default() -> Self {
        Self { triangles: 1_000_000, seed: 0 }
    }
}

/// What was generated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Generated {
    /// Triangles.
    pub triangles: u64,
    /// Vertices: fewer where triangles share them.
    pub vertices: u64,
    /// Parts.
    pub parts: u64,
}

/// Generates the model `name` into `sink`, in bounded memory, on rayon's present pool.
///
/// Fails with `BadArgument` for an unknown name or a size out of range, `Cancelled`, and whatever
/// the sink returns.
pub fn generate(name: &str, options: &GenerateOptions, cancel: &Cancel, sink: &mut dyn Sink) -> Result<Generated> {
    let mut target = SinkTarget::new(sink);
    run(name, options, cancel, &mut target)?;
    Ok(target.generated)
}

fn run(name: &str, options: &GenerateOptions, cancel: &Cancel, target: &mut dyn Target) -> Result<()> {
    match name {
        "mandelbulb" => mandelbulb::generate(options, cancel, target),
        "airliner" => airliner::generate(options, cancel, target),
        _ => Err(Error::bad_argument(format!("no generator {name:?}; there are {}", NAMES.join(", ")))),
    }
}

/// Called now and then with the number of triangles written so far.
pub type Watch<'a> = &'a mut dyn FnMut(u64);

/// [`generate`] into the binary PLY file `path`, which appears when it is complete.
pub fn generate_file(
    name: &str,
    options: &GenerateOptions,
    cancel: &Cancel,
    path: &Path,
    watch: Watch,
) -> Result<Generated> {
    write_ply(path, watch, |target| run(name, options, cancel, target))
}
