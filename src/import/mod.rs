//! Mesh files and generators as one stream of triangles with parts and materials.
//!
//! Readers push into a [`Sink`] in bounded memory; what becomes of the triangles is the sink's
//! business. Uses base, math and geom.

#![forbid(unsafe_code)]

mod batch;
pub mod collect;
mod colour;
mod detect;
mod files;
pub mod generate;
mod gltf;
mod input;
mod obj;
mod ply;
pub mod raw;
mod stl;
#[cfg(test)]
mod testing;
mod text;
mod vertices;

use crate::base::error::Result;
use crate::base::progress::Cancel;
pub use crate::base::units::UpAxis;
pub use files::read_files;
use glam::{DAffine3, DVec3};
use std::path::Path;

/// A mesh of a [`Sink`]: the triangles placed directly, or a mesh that instances repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshKey(pub u32);

impl MeshKey {
    /// The triangles that are placed directly, in world coordinates.
    pub const DIRECT: Self = Self(0);
}

/// Index of a part that the sink returned.
pub type PartKey = u32;
/// Index of a material that the sink returned.
pub type MaterialKey = u32;

/// How a part looks. Linear colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialDesc {
    /// Linear RGB in [0, 1].
    pub colour: [f32; 3],
    /// 1 is opaque.
    pub opacity: f32,
    /// In [0, 1].
    pub metalness: f32,
    /// In [0, 1].
    pub roughness: f32,
}

impl Default for MaterialDesc {
    fn default() -> Self {
        Self { colour: [0.6, 0.6, 0.6], opacity: 1.0, metalness: 0.0, roughness: 0.6 }
    }
}

/// What a CAD user clicks on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PartDesc {
    /// The caller's id; `None` lets the sink number it (its index in the model).
    pub id: Option<u64>,
    /// As named in the file; may be empty.
    pub name: String,
    /// The part above it.
    pub parent: Option<PartKey>,
    /// `None`: the default material.
    pub material: Option<MaterialKey>,
}

/// Receives a stream of meshes.
///
/// Order: materials and parts before the triangles that use them. A triangle's primitive id is its
/// index in its stream of `triangles` calls, over all meshes, counted from 0: readers therefore pass
/// on *every* triangle of the input, also NaN, infinite and degenerate ones; the sink counts and drops.
pub trait Sink {
    /// Length unit and up axis, where the input states them. The first statement wins.
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis);
    /// Adds a material.
    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey>;
    /// Adds a part.
    fn part(&mut self, part: PartDesc) -> Result<PartKey>;
    /// Begins a mesh that instances will repeat. Its triangles carry *local* parts
    /// `0..local_parts`, which each instance maps to `local_parts` consecutive real parts.
    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey>;
    /// Adds triangles of one part. In [`MeshKey::DIRECT`] `part` is a [`PartKey`]; in a shared
    /// mesh it is a local part. `colours`: one linear RGB for each triangle (an average of its
    /// vertices' colours or of its texture), or `None` for the part's material.
    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        colours: Option<&[[f32; 3]]>,
    ) -> Result<()>;
    /// Places a shared mesh: its local part `i` is the part `first_part + i` here.
    /// `world_from_mesh` must be finite and invertible.
    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()>;
    /// Tells how far the reader is in the present input (bytes, of how many).
    fn at(&mut self, bytes: u64, total: u64);
    /// Something the user should know though the input could be read.
    fn note(&mut self, text: String);
    /// Asked at least once for each batch; readers return its error at once.
    fn cancel(&self) -> &Cancel;
}

/// Options of [`read_file`].
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Where vertices are spilled; the system's default if `None`.
    pub temp_dir: Option<std::path::PathBuf>,
    /// Bytes of positions that a reader may keep in memory, for formats that index globally; 0 for no limit. PLY
    /// keeps to it and spills the others. OBJ keeps 24 bytes a vertex, PLY colours 3 or 12, glTF its buffers.
    pub memory: u64,
}

/// Reads the mesh file at `path` into `sink`; the format is told by content first, by ending second.
///
/// Reads PLY, OBJ, STL, glTF 2.0 (`.gltf`, `.glb`) and our raw soup ([`raw`]). Memory is bounded by the file's size (12
/// or 24 bytes a vertex for formats that index globally, fewer with [`ReadOptions::memory`]), never by what a header
/// claims. A file is a part named after its stem, unless it names parts of its own.
///
/// Fails with [`crate::Error::Parse`] naming line or byte; with `Io` if the file cannot be read; with
/// the sink's own errors. A mesh file without triangles is fine (with a note to the sink); a file
/// that is not a mesh is not. What the sink received before an error stays received.
pub fn read_file(path: &Path, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    let mut input = input::Input::open(path)?;
    let total = input.total();
    sink.at(0, total);
    match detect::format(&mut input)? {
        detect::Format::Ply => ply::read(&mut input, options, sink)?,
        detect::Format::Obj => obj::read(&mut input, sink)?,
        detect::Format::Gltf => gltf::read(&mut input, sink)?,
        detect::Format::Raw => raw::read(&mut input, sink)?,
        detect::Format::StlText => stl::read_text(&mut input, sink)?,
        detect::Format::StlBinary => stl::read_binary(&mut input, sink)?,
    }
    sink.at(total, total);
    Ok(())
}

/// The file's name without folder and ending: the name of a part that has no better one.
fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}
