//! `outcrop export`.

use crate::common::{self, Failure, Outcome};
use crate::output::Destination;
use glam::{DVec3, Vec3};
use outcrop::Error;
use outcrop::base::output::{Medium, OutputFile};
use outcrop::base::scratch::{Scratch, ScratchSpace};
use outcrop::query::StoredTriangle;
use outcrop::scene::{Context, ContextOptions, Model};
use serde_json::json;
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;

/// Write the triangles of parts of a model as a binary PLY file
///
/// Positions are the stored ones, in double precision and in the model's units. Vertices with equal position and normal
/// are shared. With several parts each face has its part's id.
#[derive(clap::Args)]
pub struct Args {
    /// The model file
    #[arg(value_name = "MODEL.oc")]
    model: PathBuf,
    /// The ids of the parts, without those below them unless --below is given. Default: all parts
    #[arg(long = "part", value_name = "ID,...", value_delimiter = ',')]
    parts: Vec<u64>,
    /// The parts below those of --part too, e.g. those of an assembly, which has no triangles of its own
    #[arg(long)]
    below: bool,
    /// The file to write: a regular file or a new one, and not the model
    #[arg(short, long, value_name = "OUT.ply")]
    output: PathBuf,
    /// Bytes of memory for the model, with suffix K, M, G or T; 0 for three quarters of the machine's memory
    #[arg(long, visible_alias = "cache", value_name = "BYTES", default_value = "0", allow_negative_numbers = true, value_parser = common::byte_size)]
    memory: u64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Outcome {
    let to = Destination::new(&args.output, "ply", "a mesh file", &[&args.model], false)?;
    let cancel = common::cancel_on_ctrl_c();
    let options = ContextOptions { memory_budget: args.memory, read_ahead: false, ..ContextOptions::default() };
    let model = Model::open(&Context::new(options)?, &args.model)?;
    let parts = indices(&model, &args.parts, args.below)?;
    let total: u64 = parts.iter().filter_map(|part| model.parts().get(*part as usize)).map(|part| part.triangles).sum();
    let bar = common::progress_bar(total);
    let mut ply = Ply::create(&args.output, parts.len() > 1)?;
    for &part in &parts {
        let mut reader = model.read_part(part)?;
        loop {
            let triangles = reader.next(4096, &cancel)?;
            if triangles.is_empty() {
                break;
            }
            triangles.iter().try_for_each(|triangle| ply.triangle(triangle))?;
            bar.set_position(ply.triangles);
        }
    }
    let (triangles, vertices) = ply.finish()?;
    bar.finish_and_clear();
    let file = args.output.display().to_string();
    let value = json!({ "file": file, "parts": parts.len(), "triangles": triangles, "vertices": vertices });
    let text = format!(
        "{file}: {}, {}, {}",
        common::counted(parts.len() as u64, "part"),
        common::counted(triangles, "triangle"),
        if vertices == 1 { "1 vertex".into() } else { format!("{vertices} vertices") }
    );
    to.report(args.json, &value, &text)
}

/// Indices of the parts with these ids, each once, and of those below them; of all parts if there are no ids.
fn indices(model: &Model, ids: &[u64], below: bool) -> Result<Vec<u32>, Failure> {
    let refuse = |why: String| Failure::Failed(Error::BadArgument(why));
    let index =
        |&id: &u64| model.part_index(id).ok_or_else(|| refuse(format!("--part: the model has no part with id {id}")));
    let named: BTreeSet<u32> = ids.iter().map(index).collect::<Result<_, _>>()?;
    let mut chosen = vec![ids.is_empty(); model.info().parts as usize];
    // A parent comes before its children.
    for (i, part) in model.parts().iter().enumerate() {
        chosen[i] |=
            named.contains(&(i as u32)) || (below && part.parent.is_some_and(|parent| chosen[parent as usize]));
    }
    let indices: Vec<u32> = (0..model.info().parts).filter(|&i| chosen[i as usize]).collect();
    // PLY has integers of 32 bits at most.
    let id = |part: &u32| model.parts().id(*part as usize).filter(|id| *id > u32::MAX.into());
    match indices.iter().find_map(id).filter(|_| indices.len() > 1) {
        None => Ok(indices),
        Some(id) => Err(refuse(format!("part {id}: a PLY file holds ids below 2^32; export the parts one by one"))),
    }
}

/// Greatest number of vertices among which equal ones are found.
const KNOWN: usize = 1 << 20;
/// Bytes that are written at a time.
const BUFFER: usize = 1 << 20;
/// Digits of the counts in the header.
const DIGITS: usize = 12;

/// A PLY file that is being written: vertices directly, faces by way of a scratch file.
struct Ply {
    out: OutputFile,
    faces: Scratch,
    known: HashMap<([u64; 3], [u32; 3]), u32>,
    vertex_bytes: Vec<u8>,
    face_bytes: Vec<u8>,
    vertices: u64,
    triangles: u64,
    with_parts: bool,
}

impl Ply {
    fn create(path: &std::path::Path, with_parts: bool) -> Result<Self, Error> {
        let mut out = OutputFile::create(path)?;
        out.append(header(0, 0, with_parts).as_bytes())?;
        Ok(Self {
            out,
            faces: ScratchSpace::new(None).file()?,
            known: HashMap::new(),
            vertex_bytes: Vec::new(),
            face_bytes: Vec::new(),
            vertices: 0,
            triangles: 0,
            with_parts,
        })
    }

    fn triangle(&mut self, triangle: &StoredTriangle) -> Result<(), Error> {
        self.face_bytes.push(3);
        for (corner, normal) in triangle.corners.iter().zip(&triangle.normals) {
            let vertex = self.vertex(*corner, *normal)?;
            self.face_bytes.extend(vertex.to_le_bytes());
        }
        if self.with_parts {
            self.face_bytes.extend((triangle.part as u32).to_le_bytes());
        }
        self.triangles += 1;
        if self.face_bytes.len() > BUFFER {
            self.faces.append(&self.face_bytes)?;
            self.face_bytes.clear();
        }
        Ok(())
    }

    /// Returns the number of a vertex, which is written if it is new.
    fn vertex(&mut self, position: DVec3, normal: Vec3) -> Result<u32, Error> {
        let key = (position.to_array().map(f64::to_bits), normal.to_array().map(f32::to_bits));
        if let Some(known) = self.known.get(&key) {
            return Ok(*known);
        }
        let number = u32::try_from(self.vertices)
            .map_err(|_| Error::BadArgument("a PLY file holds at most 2^32 vertices: export fewer parts".into()))?;
        if self.known.len() == KNOWN {
            self.known.clear();
        }
        self.known.insert(key, number);
        self.vertices += 1;
        position.to_array().iter().for_each(|x| self.vertex_bytes.extend(x.to_le_bytes()));
        normal.to_array().iter().for_each(|x| self.vertex_bytes.extend(x.to_le_bytes()));
        if self.vertex_bytes.len() > BUFFER {
            self.out.append(&self.vertex_bytes)?;
            self.vertex_bytes.clear();
        }
        Ok(number)
    }

    /// Completes the file. Returns the numbers of triangles and vertices.
    fn finish(mut self) -> Result<(u64, u64), Error> {
        self.out.append(&self.vertex_bytes)?;
        self.faces.append(&self.face_bytes)?;
        let total = self.triangles * if self.with_parts { 17 } else { 13 };
        let mut buffer = vec![0; BUFFER];
        for at in (0..total).step_by(BUFFER) {
            let some = &mut buffer[..(total - at).min(BUFFER as u64) as usize];
            self.faces.read_at(at, some)?;
            self.out.append(some)?;
        }
        self.out.overwrite_start(header(self.vertices, self.triangles, self.with_parts).as_bytes())?;
        self.out.publish()?;
        Ok((self.triangles, self.vertices))
    }
}

/// The header, of the same length for all counts.
fn header(vertices: u64, triangles: u64, with_parts: bool) -> String {
    let axes = ["double x", "double y", "double z", "float nx", "float ny", "float nz"];
    let properties: String = axes.iter().map(|axis| format!("property {axis}\n")).collect();
    let part = if with_parts { "property uint part\n" } else { "" };
    format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices:0DIGITS$}\n{properties}\
         element face {triangles:0DIGITS$}\nproperty list uchar uint vertex_indices\n{part}end_header\n"
    )
}
