//! Generators of seeded models of any size, which are pushed in bounded memory into a [`Sink`] or a PLY file.
//!
//! | name | content | parts |
//! |---|---|---|
//! | `mandelbulb` | a closed fractal surface, about two triangles per vertex | one |
//! | `airliner` | CAD soup: long, thin, overlapping, jittered, no shared vertices | thousands |
//! | `plant` | a tree or smaller plant of one of 13 species: closed tubes, and leaves as strips | bark, twigs, leaves |
//!
//! The same name, size and seed give the same triangles in the same order at any number of threads. The documentation
//! of each module has its formulas. [`views()`] returns four views of each model of [`NAMES_WITH_VIEWS`].
//! [`Forest`] places plants.
#![forbid(unsafe_code)]

mod airliner;
mod forest;
mod mandelbulb;
mod plant;
mod ply_writer;
mod rng;
mod target;
#[cfg(test)]
mod tests;
mod turn;
mod views;

pub use forest::{Forest, ForestOptions, Tree};
use ply_writer::write_ply;
pub use views::views;

use super::Sink;
use crate::base::error::{Error, Result};
use crate::base::output::{OutputFile, OutputStream};
use crate::base::progress::Cancel;
use std::io::Write;
use std::path::Path;
use target::{SinkTarget, Target};

/// Names of the generators.
pub const NAMES: [&str; 3] = ["mandelbulb", "airliner", "plant"];
/// Names of the generators whose models have views of their own, see [`views()`].
pub const NAMES_WITH_VIEWS: [&str; 2] = ["mandelbulb", "airliner"];
/// Names of the species of the plant, by number.
pub const SPECIES: [&str; plant::COUNT] = plant::names();

/// Options of a generator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GenerateOptions {
    /// Target number of triangles, reached within 2 %: for the `mandelbulb` from 10³ to 4·10⁹, for the `airliner` from
    /// 10⁵ to 1.4·10⁹, for the `plant` from 2·10³ to 4·10⁶ (its usual size is 25,000).
    pub triangles: u64,
    /// Seed; different seeds give different models. The pictures in the documentation use 0.
    pub seed: u64,
    /// Species of the `plant`, an index into [`SPECIES`]; 0 for other models.
    pub species: u32,
}

impl Default for GenerateOptions {
    fn default() -> Self {
        Self { triangles: 1_000_000, seed: 0, species: 0 }
    }
}

/// Counts of a generated model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Generated {
    /// Number of triangles.
    pub triangles: u64,
    /// Number of vertices; fewer if triangles share them.
    pub vertices: u64,
    /// Number of parts.
    pub parts: u64,
}

/// Generates the model `name` into `sink`, in bounded memory, on the current rayon pool.
///
/// Fails with `BadArgument` for an unknown name, or a size or species out of range, with `Cancelled`, and with the
/// errors of the sink.
pub fn generate(name: &str, options: &GenerateOptions, cancel: &Cancel, sink: &mut dyn Sink) -> Result<Generated> {
    let mut target = SinkTarget::new(sink);
    run(name, options, cancel, &mut target)?;
    Ok(target.generated)
}

fn run(name: &str, options: &GenerateOptions, cancel: &Cancel, target: &mut dyn Target) -> Result<()> {
    if options.species != 0 && name != "plant" {
        return Err(Error::bad_argument(format!("{name}: only the plant has species")));
    }
    match name {
        "mandelbulb" => mandelbulb::generate(options, cancel, target),
        "airliner" => airliner::generate(options, cancel, target),
        "plant" => plant::generate(options, cancel, target),
        _ => Err(Error::bad_argument(format!("unknown generator {name:?}; the names are {}", NAMES.join(", ")))),
    }
}

/// Callback that receives the number of triangles written so far, from time to time.
pub type Watch<'a> = &'a mut dyn FnMut(u64);

/// Generates a model like [`generate`] into the binary PLY file `path`, which appears when it is complete. `path` must
/// not exist, or be a regular file.
pub fn generate_file(
    name: &str,
    options: &GenerateOptions,
    cancel: &Cancel,
    path: &Path,
    watch: Watch,
) -> Result<Generated> {
    let mut out = OutputFile::create(path)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    write_ply(&mut out, Some(folder), watch, |target| run(name, options, cancel, target))
}

/// Generates a model like [`generate`], and writes it to `out` as a binary PLY file once it is complete. Until then it
/// is in the system's folder for temporary files.
pub fn generate_stream(
    name: &str,
    options: &GenerateOptions,
    cancel: &Cancel,
    out: impl Write + Send,
    watch: Watch,
) -> Result<Generated> {
    write_ply(&mut OutputStream::new(out)?, None, watch, |target| run(name, options, cancel, target))
}
