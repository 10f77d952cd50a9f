//! Writer of a generated model as a binary PLY file.
//!
//! The file is binary little-endian. Vertices are `float x y z`. Faces are `list uchar uint vertex_indices`, and with
//! more than one part also `int part`, an index into the table of parts. Data that PLY has no keyword for is in
//! comments. Their fields are separated by single spaces, `-` means none, and names come last and may be empty:
//!
//! ```text
//! comment outcrop units <metres per unit, or -> up <x|y|z|->
//! comment outcrop material <index> <red> <green> <blue> <opacity> <metalness> <roughness> <name>
//! comment outcrop part <index> <id> <index of the parent, or -> <index of the material, or -> <name>
//! ```
//!
//! Indices count from 0 in order. Parents come before their children. Colours are linear. Without the face property
//! `part`, all faces belong to part 0.
//!
//! Vertices go directly to the output file. Faces go to a second file in the same folder, which is appended at the end;
//! then the counts in the header are set. Both files have temporary names until then and are removed if anything fails.

use super::target::Target;
use super::{Generated, Watch};
use crate::base::error::{Error, Result};
use crate::import::{MaterialDesc, MaterialKey, PartDesc, PartKey, UpAxis};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Number of digits reserved for a count.
const COUNT_DIGITS: usize = 12;
/// Size in bytes of the buffer of each of the two files.
const BUFFER: usize = 1 << 20;

/// Writes the model of `produce` to `path`. `watch` receives the number of triangles so far.
///
/// Fails with `Io`, with `BadArgument` for more than 2³² vertices, and with the errors of `produce`. `path` is then
/// unchanged.
pub(super) fn write_ply(
    path: &Path,
    watch: Watch,
    produce: impl FnOnce(&mut dyn Target) -> Result<()>,
) -> Result<Generated> {
    let mut writer = PlyWriter {
        header: String::from("ply\nformat binary_little_endian 1.0\n"),
        vertices: Spill::create(path, "vertices")?,
        faces: Spill::create(path, "faces")?,
        counts_at: None,
        materials: 0,
        generated: Generated::default(),
        watch,
    };
    produce(&mut writer)?;
    writer.finish(path)
}

/// A file under a temporary name, which is removed on drop.
struct Spill {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Spill {
    fn create(beside: &Path, what: &str) -> Result<Self> {
        let name = beside.file_name().ok_or_else(|| Error::bad_argument("the output has no file name"))?;
        let name = format!(".{}.{}.{what}.tmp", name.to_string_lossy(), std::process::id());
        let path = beside.with_file_name(name);
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&path);
        let file = file.map_err(|e| Error::io(&path, "create", e))?;
        Ok(Self { path, file: BufWriter::with_capacity(BUFFER, file) })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|e| Error::io(&self.path, "write", e))
    }
}

impl Drop for Spill {
    fn drop(&mut self) {
        // The file was already renamed, or is useless: a failure to remove it is harmless.
        let _ = std::fs::remove_file(&self.path);
    }
}

struct PlyWriter<'a> {
    header: String,
    vertices: Spill,
    faces: Spill,
    /// File offsets of the two counts, once the header is written.
    counts_at: Option<[u64; 2]>,
    materials: u32,
    generated: Generated,
    watch: Watch<'a>,
}

impl PlyWriter<'_> {
    fn comment(&mut self, text: &str) -> Result<()> {
        if self.counts_at.is_some() {
            return Err(Error::Internal("generator: parts must be added before triangles".into()));
        }
        // Writing to a string cannot fail.
        let _ = writeln!(self.header, "comment outcrop {}", text.replace(['\n', '\r'], " "));
        Ok(())
    }

    /// Writes the header before the first triangle, with space for the counts.
    fn begin(&mut self) -> Result<[u64; 2]> {
        if let Some(at) = self.counts_at {
            return Ok(at);
        }
        let mut header = std::mem::take(&mut self.header);
        header.push_str("element vertex ");
        let vertices_at = header.len() as u64;
        let _ = write!(header, "{:0COUNT_DIGITS$}\n{}element face ", 0, VERTEX_PROPERTIES);
        let faces_at = header.len() as u64;
        let _ = write!(header, "{:0COUNT_DIGITS$}\nproperty list uchar uint vertex_indices\n", 0);
        if self.generated.parts > 1 {
            header.push_str("property int part\n");
        }
        header.push_str("end_header\n");
        self.vertices.write(header.as_bytes())?;
        self.counts_at = Some([vertices_at, faces_at]);
        Ok([vertices_at, faces_at])
    }

    fn write_vertices<'v>(&mut self, vertices: impl Iterator<Item = &'v [f32; 3]>) -> Result<()> {
        self.begin()?;
        for v in vertices {
            self.vertices.write(bytemuck::bytes_of(&v.map(|c| c.to_bits().to_le())))?;
            self.generated.vertices += 1;
        }
        if self.generated.vertices > 1 << 32 {
            return Err(Error::bad_argument("more than 2^32 vertices do not fit a PLY file"));
        }
        Ok(())
    }

    fn write_face(&mut self, part: PartKey, face: [u32; 3]) -> Result<()> {
        let mut row = [0; 17];
        row[0] = 3;
        for (bytes, v) in row[1..13].chunks_exact_mut(4).zip(face) {
            bytes.copy_from_slice(&v.to_le_bytes());
        }
        row[13..].copy_from_slice(&part.to_le_bytes());
        self.generated.triangles += 1;
        let used = if self.generated.parts > 1 { 17 } else { 13 };
        self.faces.write(&row[..used])
    }

    fn finish(mut self, path: &Path) -> Result<Generated> {
        let counts_at = self.begin()?;
        let failed = |doing| move |e| Error::io(path, doing, e);
        let faces = &mut self.faces.file;
        faces.flush().map_err(failed("write"))?;
        faces.seek(SeekFrom::Start(0)).map_err(failed("seek"))?;
        let out = &mut self.vertices.file;
        out.flush().map_err(failed("write"))?;
        std::io::copy(faces.get_mut(), out.get_mut()).map_err(failed("write"))?;
        for (at, count) in counts_at.into_iter().zip([self.generated.vertices, self.generated.triangles]) {
            out.seek(SeekFrom::Start(at)).map_err(failed("seek"))?;
            write!(out, "{count:0COUNT_DIGITS$}").map_err(failed("write"))?;
        }
        out.flush().map_err(failed("write"))?;
        out.get_ref().sync_all().map_err(failed("sync"))?;
        std::fs::rename(&self.vertices.path, path).map_err(failed("rename"))?;
        Ok(self.generated)
    }
}

/// Properties of the vertex element.
const VERTEX_PROPERTIES: &str = "property float x\nproperty float y\nproperty float z\n";

/// Formats a number, or `-` for `None`.
fn or_dash<T: ToString>(value: Option<T>) -> String {
    value.map_or("-".into(), |v| v.to_string())
}

impl Target for PlyWriter<'_> {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) -> Result<()> {
        let up = match up {
            UpAxis::X => "x",
            UpAxis::Y => "y",
            UpAxis::Z => "z",
            UpAxis::Unknown => "-",
        };
        self.comment(&format!("units {} up {up}", or_dash(metres_per_unit)))
    }

    fn material(&mut self, m: MaterialDesc, name: &str) -> Result<MaterialKey> {
        let index = self.materials;
        self.materials += 1;
        let [r, g, b] = m.colour;
        self.comment(&format!("material {index} {r} {g} {b} {} {} {} {name}", m.opacity, m.metalness, m.roughness))?;
        Ok(index)
    }

    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        let index = self.generated.parts as PartKey;
        self.generated.parts += 1;
        let id = part.id.unwrap_or(u64::from(index));
        let (parent, material) = (or_dash(part.parent), or_dash(part.material));
        self.comment(&format!("part {index} {id} {parent} {material} {}", part.name))?;
        Ok(index)
    }

    fn indexed(
        &mut self,
        part: PartKey,
        vertices: &[[f32; 3]],
        faces: &[[u32; 3]],
        _: &dyn Fn(u32) -> [f32; 3],
    ) -> Result<()> {
        self.write_vertices(vertices.iter())?;
        for &face in faces {
            self.write_face(part, face)?;
        }
        (self.watch)(self.generated.triangles);
        Ok(())
    }

    fn soup(&mut self, part: PartKey, triangles: &[[[f32; 3]; 3]]) -> Result<()> {
        let first = self.generated.vertices;
        self.write_vertices(triangles.as_flattened().iter())?;
        for i in 0..triangles.len() as u64 {
            let v = (first + 3 * i) as u32;
            self.write_face(part, [v, v.wrapping_add(1), v.wrapping_add(2)])?;
        }
        (self.watch)(self.generated.triangles);
        Ok(())
    }
}
