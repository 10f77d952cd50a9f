//! Readers of mesh files and generators of models, as one stream of triangles with parts and materials.
//!
//! Readers push into a [`Sink`] in bounded memory; the sink decides how triangles are used. Uses base, math and geom.

#![forbid(unsafe_code)]

mod access;
mod batch;
#[cfg(test)]
mod change_tests;
pub mod collect;
mod colour;
mod decode;
mod detect;
mod files;
pub mod generate;
mod gltf;
pub mod heights;
mod ignored;
mod input;
mod normals;
mod obj;
mod picture;
mod pictures;
mod ply;
mod png_rows;
pub mod raw;
mod stl;
pub mod surfaces;
#[cfg(test)]
mod testing;
mod text;
mod texture;
mod vertices;

use crate::base::account::Account;
use crate::base::error::{Error, Result};
use crate::base::inputs::Inputs;
use crate::base::progress::Cancel;
use crate::base::quota::Quota;
use crate::base::scratch::ScratchSpace;
pub use crate::base::units::UpAxis;
use access::Files;
pub use access::{Access, Resolved, Resolver};
pub use files::read_files;
use glam::{DAffine3, DVec3, Vec3};
use std::path::Path;
use std::sync::Arc;
pub use surfaces::{CageMesh, Dicing, HeightMap, NurbsMesh};

/// Key of a mesh of a [`Sink`]: the directly placed triangles, or a mesh that instances repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshKey(pub u32);

impl MeshKey {
    /// The directly placed triangles, in world coordinates.
    pub const DIRECT: Self = Self(0);
}

/// Index of a part, returned by the sink.
pub type PartKey = u32;
/// Index of a material, returned by the sink.
pub type MaterialKey = u32;

/// Appearance of a part, with linear colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialDesc {
    /// Linear RGB in [0, 1].
    pub colour: [f32; 3],
    /// Opacity in [0, 1]; 1 is opaque.
    pub opacity: f32,
    /// Metalness in [0, 1].
    pub metalness: f32,
    /// Roughness in [0, 1].
    pub roughness: f32,
}

impl Default for MaterialDesc {
    fn default() -> Self {
        Self { colour: [0.6, 0.6, 0.6], opacity: 1.0, metalness: 0.0, roughness: 0.6 }
    }
}

/// A unit of the model that a CAD user can select.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PartDesc {
    /// Id given by the caller. With `None` the sink uses the part's index in the model.
    pub id: Option<u64>,
    /// Name in the file; may be empty.
    pub name: String,
    /// Parent part, if any.
    pub parent: Option<PartKey>,
    /// Material; `None` for the default material.
    pub material: Option<MaterialKey>,
}

/// Values at the corners of triangles, in the order of the corners: one entry for each triangle.
#[derive(Debug, Clone, Copy, Default)]
pub struct Attributes<'a> {
    /// Linear RGB. Colours between corners are interpolated. `None`: the colour of the part's material.
    pub colours: Option<&'a [[[f32; 3]; 3]]>,
    /// Normals of the surface that the triangles stand for, in the coordinates of the positions, of any length. The
    /// normal of the triangle replaces one that is zero or not finite. `None`: they are made from the triangles, see
    /// [`crate::build::BuildOptions::crease_angle`].
    pub normals: Option<&'a [[Vec3; 3]]>,
}

impl<'a> Attributes<'a> {
    /// No values.
    pub const NONE: Self = Self { colours: None, normals: None };

    /// Colours, and no other values.
    pub fn colours(colours: &'a [[[f32; 3]; 3]]) -> Self {
        Self { colours: Some(colours), ..Self::NONE }
    }

    /// Normals, and no other values.
    pub fn normals(normals: &'a [[Vec3; 3]]) -> Self {
        Self { normals: Some(normals), ..Self::NONE }
    }

    /// Fails unless there is an entry for each of `count` triangles.
    pub fn check(&self, count: usize) -> Result<()> {
        let is_wrong = |len: Option<usize>| len.is_some_and(|len| len != count);
        let differs = |what: &str| {
            Err(Error::BadArgument(format!("triangles: the number of {what} differs from the number of triangles")))
        };
        if is_wrong(self.colours.map(<[_]>::len)) {
            return differs("colours");
        }
        if is_wrong(self.normals.map(<[_]>::len)) { differs("normals") } else { Ok(()) }
    }

    /// The values of some of the triangles.
    pub fn part(&self, of: std::ops::Range<usize>) -> Self {
        Self { colours: self.colours.map(|c| &c[of.clone()]), normals: self.normals.map(|n| &n[of]) }
    }
}

/// Receives a stream of meshes.
///
/// Materials and parts come before the triangles that use them. The primitive id of a triangle is its index in the
/// stream of `triangles` calls, counted from 0 over all meshes. Readers therefore pass on *every* triangle of the
/// input, including NaN, infinite and degenerate ones; the sink counts and drops these.
pub trait Sink {
    /// Sets the length unit and the up axis if the input states them. The first statement wins.
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis);
    /// Adds a material.
    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey>;
    /// Adds a part.
    fn part(&mut self, part: PartDesc) -> Result<PartKey>;
    /// Begins a mesh that instances repeat. Its triangles have *local* parts `0..local_parts`; each instance maps them
    /// to `local_parts` consecutive real parts.
    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey>;
    /// Adds triangles of one part. In [`MeshKey::DIRECT`] `part` is a [`PartKey`], in a shared mesh it is a local part.
    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()>;
    /// Places a shared mesh: its local part `i` becomes the part `first_part + i`. `world_from_mesh` must be finite and
    /// invertible.
    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()>;
    /// How finely surfaces are diced that the sink takes as triangles.
    fn dicing(&self) -> Option<Dicing> {
        None
    }
    /// Adds a subdivision surface. By default it is diced into triangles ([`CageMesh::dice`]), in the order of faces.
    fn cage(&mut self, mesh: MeshKey, cage: &CageMesh<'_>) -> Result<()> {
        let (dicing, cancel) = (self.dicing(), self.cancel().clone());
        cage.dice(dicing, &cancel, &mut |part, micro| {
            self.triangles(mesh, part, &micro.positions, Attributes::normals(&micro.normals))
        })
    }
    /// Adds a NURBS surface, likewise.
    fn nurbs(&mut self, mesh: MeshKey, surface: &NurbsMesh<'_>) -> Result<()> {
        let (dicing, cancel) = (self.dicing(), self.cancel().clone());
        surface.dice(dicing, &cancel, &mut |part, micro| {
            self.triangles(mesh, part, &micro.positions, Attributes::normals(&micro.normals))
        })
    }
    /// Reports the position of the reader in the current input, in bytes, and the total.
    fn at(&mut self, bytes: u64, total: u64);
    /// Reports a message for the user about an input that was readable nevertheless.
    fn note(&mut self, text: String);
    /// Returns the cancel flag. Readers check it at least once per batch and return its error at once.
    fn cancel(&self) -> &Cancel;
}

/// Options of [`read_file`].
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Folder for spilled vertices; the system's default if `None`.
    pub temp_dir: Option<std::path::PathBuf>,
    /// Limit in bytes of the positions that a reader keeps in memory for formats with global indices; 0 for no limit.
    /// PLY respects it and spills the other positions to a scratch file. OBJ positions (24 bytes per vertex) and
    /// texture coordinates (8), PLY colours (3 or 12) and glTF buffers always stay in memory.
    pub memory: u64,
    /// Limit in bytes of decoded textures in memory, and of the memory in which one is decoded; 0 for 256 MiB and no
    /// limit of decoding. Textures beyond it go to a scratch file; one that cannot be decoded in it is left out with a
    /// note. One texture of at most 50 MB is always in memory.
    pub textures: u64,
    /// Faces of OBJ files are the cages of subdivision surfaces.
    pub subdivide: bool,
    /// A map of heights by which these surfaces are moved along their normals, through the texture coordinates.
    pub displacement: Option<HeightMap>,
    /// The files that mesh files may refer to.
    pub access: Access,
    /// Receives each file that was read, so that no output replaces it.
    pub inputs: Inputs,
    /// Counts the bytes of scratch files.
    pub quota: Quota,
    /// Counts the bytes of a reader's tables: names of OBJ files, the document of glTF files and the largest list of
    /// instances in them. If they do not fit, reading fails with [`Error::OverBudget`], which names a budget that
    /// suffices for them.
    pub account: Account,
}

impl ReadOptions {
    /// Returns the folder of scratch files.
    fn scratch(&self) -> Arc<ScratchSpace> {
        ScratchSpace::limited(self.temp_dir.as_deref(), self.quota.clone())
    }
}

/// Reads the mesh file at `path` into `sink`. The format is detected by the content first, then by the file extension.
///
/// Reads PLY, OBJ, STL, glTF 2.0 (`.gltf`, `.glb`), the raw soup of this crate ([`raw`]), Bézier patches (`.bpt`) and
/// NURBS faces without trims (`.trimmed_nurbs.json`, see [`surfaces::trimmed_nurbs`]). Memory grows with the real
/// size of the file (at most 12 or 24 bytes per vertex for formats with global indices, less with
/// [`ReadOptions::memory`]), never with the counts in a header. A file without parts of its own becomes one part with
/// the name of the file, without folder and extension.
///
/// Files that the mesh file refers to are opened as [`ReadOptions::access`] allows. If the geometry needs one that is
/// not allowed or cannot be read (a buffer of glTF), the reading fails; otherwise the file is left out with a note.
///
/// Fails with [`crate::Error::Parse`], naming line or byte, if the content is invalid or not a mesh, and naming the
/// file if another program changes it, or a file that it refers to, meanwhile; with `Io` if the file cannot be read;
/// with the errors of the sink. A mesh file without triangles is valid and adds a note to the sink. Data that the sink
/// received before an error is not withdrawn.
pub fn read_file(path: &Path, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    let mut input = input::Input::open(path)?;
    input.stamp().report(&options.inputs);
    let files = Files::new(path, options);
    let total = input.total();
    sink.at(0, total);
    let outcome = read_open(&mut input, &files, options, sink);
    // A file that changes may also look invalid; the change is the better reason.
    if matches!(outcome, Ok(()) | Err(Error::Parse { .. })) {
        input.stamp().unchanged()?;
        files.unchanged()?;
    }
    outcome?;
    sink.at(total, total);
    Ok(())
}

fn read_open(input: &mut input::Input, files: &Files<'_>, options: &ReadOptions, sink: &mut dyn Sink) -> Result<()> {
    match detect::format(input)? {
        detect::Format::Ply => ply::read(input, options, sink),
        detect::Format::Obj => obj::read(input, files, sink),
        detect::Format::Gltf => gltf::read(input, files, sink),
        detect::Format::Raw => raw::read(input, sink),
        detect::Format::StlText => stl::read_text(input, sink),
        detect::Format::StlBinary => stl::read_binary(input, sink),
        detect::Format::Surfaces(kind) => surfaces::read(input, kind, files, sink),
    }
}

/// Returns the file name without folder and extension, the name of parts that have no better one.
fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}
