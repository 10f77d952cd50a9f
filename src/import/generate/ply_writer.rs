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
//! Vertices go directly to the output. Faces go to a scratch file, which is appended at the end; then the counts in the
//! header are set.

use super::target::Target;
use super::{Generated, Watch};
use crate::base::error::{Error, Result};
use crate::base::output::Medium;
use crate::base::scratch::{Scratch, ScratchSpace};
use crate::import::{MaterialDesc, MaterialKey, PartDesc, PartKey, UpAxis};
use std::fmt::Write as _;
use std::path::Path;

/// Number of digits reserved for a count.
const COUNT_DIGITS: usize = 12;
/// Size in bytes of the buffer of each of the two files.
const BUFFER: usize = 1 << 20;

/// Writes the model of `produce` to `out`. `temp`: folder of the scratch file of the faces. `watch` receives the number
/// of triangles so far.
///
/// Fails with `Io`, with `BadArgument` for more than 2³² vertices, and with the errors of `produce`. Nothing is
/// published then.
pub(super) fn write_ply(
    out: &mut dyn Medium,
    temp: Option<&Path>,
    watch: Watch,
    produce: impl FnOnce(&mut dyn Target) -> Result<()>,
) -> Result<Generated> {
    let mut writer = PlyWriter {
        header: String::from("ply\nformat binary_little_endian 1.0\n"),
        vertices: Buffered { to: out, bytes: Vec::with_capacity(BUFFER) },
        faces: Buffered { to: ScratchSpace::new(temp).file()?, bytes: Vec::with_capacity(BUFFER) },
        counts_at: None,
        materials: 0,
        generated: Generated::default(),
        watch,
    };
    produce(&mut writer)?;
    writer.finish()
}

/// A receiver of bytes that is called with large pieces.
struct Buffered<W> {
    to: W,
    bytes: Vec<u8>,
}

/// Appends bytes at the end.
trait Append {
    fn append(&mut self, bytes: &[u8]) -> Result<()>;
}

impl Append for &mut dyn Medium {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        Medium::append(*self, bytes)
    }
}

impl Append for Scratch {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        Scratch::append(self, bytes).map(drop)
    }
}

impl<W: Append> Buffered<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.bytes.extend_from_slice(bytes);
        if self.bytes.len() < BUFFER { Ok(()) } else { self.flush() }
    }

    fn flush(&mut self) -> Result<()> {
        let written = self.to.append(&self.bytes);
        self.bytes.clear();
        written
    }
}

struct PlyWriter<'a> {
    header: String,
    vertices: Buffered<&'a mut dyn Medium>,
    faces: Buffered<Scratch>,
    /// Places of the two counts in the header, once it is complete and written.
    counts_at: Option<[usize; 2]>,
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
    fn begin(&mut self) -> Result<[usize; 2]> {
        if let Some(at) = self.counts_at {
            return Ok(at);
        }
        let header = &mut self.header;
        header.push_str("element vertex ");
        let vertices_at = header.len();
        let _ = write!(header, "{:0COUNT_DIGITS$}\n{}element face ", 0, VERTEX_PROPERTIES);
        let faces_at = header.len();
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

    fn finish(mut self) -> Result<Generated> {
        let counts_at = self.begin()?;
        self.vertices.flush()?;
        self.faces.flush()?;
        let (faces, out) = (&self.faces.to, &mut self.vertices.to);
        let (mut at, mut piece) = (0, vec![0; BUFFER]);
        while at < faces.len() {
            let len = (faces.len() - at).min(BUFFER as u64) as usize;
            faces.read_at(at, &mut piece[..len])?;
            out.append(&piece[..len])?;
            at += len as u64;
        }
        for (at, count) in counts_at.into_iter().zip([self.generated.vertices, self.generated.triangles]) {
            self.header.replace_range(at..at + COUNT_DIGITS, &format!("{count:0COUNT_DIGITS$}"));
        }
        out.overwrite_start(self.header.as_bytes())?;
        out.publish()?;
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
