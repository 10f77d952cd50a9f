//! The JSON document and the binary chunk of a GLB.

use crate::base::error::{Error, Place, Result};
use crate::import::input::Input;
use ::gltf::json::{Root, Value, deserialize};
use glam::{DAffine3, DMat3, DQuat, DVec3};

/// A parsed file.
pub(crate) struct Document {
    pub(crate) root: Root,
    /// Local transform of each node in double precision; the `gltf` crate keeps single precision.
    pub(crate) local: Vec<DAffine3>,
    /// Offset and length of a GLB's binary chunk in the file.
    pub(crate) binary: Option<(u64, u64)>,
}

const GLB_HEADER: u64 = 12;
const CHUNK_HEADER: u64 = 8;

/// Extensions that add or encode triangles. A file that requires one of them would be shown wrongly, so it is refused.
const GEOMETRY: [&str; 4] =
    ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "EXT_mesh_gpu_instancing"];

/// Reads the document of a `.gltf` or `.glb` file.
pub(crate) fn read(input: &mut Input) -> Result<Document> {
    let is_glb = input.peek(4)? == b"glTF";
    let (json, binary) = if is_glb { chunks(input)? } else { ((0, input.total()), None) };
    let mut text = vec![0; json.1 as usize];
    if !input.read_range(json.0, &mut text)? {
        return Err(input.fault("the file ends inside its JSON"));
    }
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    let place = |e: &::gltf::json::Error| match (is_glb, e.line()) {
        (true, 0 | 1) => Place::Byte(json.0 + e.column().saturating_sub(1) as u64),
        (_, line) => Place::Line(line as u64),
    };
    let fail = |what: &str, e: ::gltf::json::Error| Error::parse(input.path(), place(&e), format!("{what}: {e}"));
    let value: Value = deserialize::from_slice(text).map_err(|e| fail("not valid JSON", e))?;
    let local = local_transforms(&value);
    is_gltf_2(&value).map_err(|why| Error::parse(input.path(), Place::File, why))?;
    drop(value);
    let root: Root = deserialize::from_slice(text).map_err(|e| fail("not valid glTF", e))?;
    if let Some(extension) = root.extensions_required.iter().find(|e| GEOMETRY.contains(&e.as_str())) {
        let why = format!("needs the extension {extension}, which is not supported");
        return Err(Error::parse(input.path(), Place::File, why));
    }
    Ok(Document { root, local, binary })
}

/// Offset and length of the JSON chunk and of the binary chunk.
type Chunks = ((u64, u64), Option<(u64, u64)>);

fn chunks(input: &mut Input) -> Result<Chunks> {
    let header = input.peek(GLB_HEADER as usize)?;
    let word = |at: usize| header.get(at..).and_then(|b| b.first_chunk()).map(|b| u32::from_le_bytes(*b));
    let (version, length) = (word(4), word(8));
    let at = |byte: u64, why: String| Error::parse(input.path(), Place::Byte(byte), why);
    match version {
        Some(2) => {}
        Some(other) => return Err(at(4, format!("is GLB version {other}; only 2 is supported"))),
        None => return Err(at(input.total(), "the file ends inside its header".into())),
    }
    let Some(length) = length.map(u64::from) else {
        return Err(at(input.total(), "the file ends inside its header".into()));
    };
    if length > input.total() {
        return Err(at(input.total(), format!("the file ends before the {length} bytes that its header announces")));
    }
    let Some((json_type, json)) = chunk(input, GLB_HEADER, length)? else {
        return Err(input.fault("the file has no JSON chunk"));
    };
    if json_type != *b"JSON" {
        return Err(Error::parse(input.path(), Place::Byte(GLB_HEADER + 4), "the first chunk is not JSON"));
    }
    // Chunks begin at multiples of four.
    let next = (json.0 + json.1).next_multiple_of(4);
    let binary = chunk(input, next, length)?.filter(|(ty, _)| ty == b"BIN\0").map(|(_, range)| range);
    Ok((json, binary))
}

/// The four letters of a chunk's type.
type ChunkType = [u8; 4];

/// Returns type, offset and length of the chunk with its header at `at`, if there is one before `end`.
fn chunk(input: &mut Input, at: u64, end: u64) -> Result<Option<(ChunkType, (u64, u64))>> {
    if at + CHUNK_HEADER > end {
        return Ok(None);
    }
    let mut header = [0; CHUNK_HEADER as usize];
    if !input.read_range(at, &mut header)? {
        return Ok(None);
    }
    let [a, b, c, d, ty @ ..] = header;
    let length = u64::from(u32::from_le_bytes([a, b, c, d]));
    let data = at + CHUNK_HEADER;
    if data + length > end {
        let why = format!("a chunk of {length} bytes ends outside of the file");
        return Err(Error::parse(input.path(), Place::Byte(at), why));
    }
    Ok(Some((ty, (data, length))))
}

/// Checks that the document is glTF 2, and describes other JSON files in the error.
fn is_gltf_2(value: &Value) -> std::result::Result<(), String> {
    if value.get("geometricError").is_some() && value.get("root").is_some() {
        return Err("is a 3D Tiles tileset, which refers to other files and contains no mesh".into());
    }
    match value.get("asset").and_then(|a| a.get("version")) {
        Some(Value::String(version)) if version.starts_with("2.") => Ok(()),
        Some(version) => Err(format!("is glTF version {version}; only 2.0 is supported")),
        None => Err("is JSON, but not glTF: it has no asset with a version".into()),
    }
}

/// Returns the local transform of each node. Missing or malformed values give the identity; the `gltf` crate's parser
/// reports malformed ones.
fn local_transforms(value: &Value) -> Vec<DAffine3> {
    let nodes = value.get("nodes").and_then(Value::as_array);
    nodes.map_or_else(Vec::new, |nodes| nodes.iter().map(local_transform).collect())
}

fn local_transform(node: &Value) -> DAffine3 {
    if let Some(m) = numbers::<16>(node, "matrix") {
        let column = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
        return DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3));
    }
    let rotation = numbers::<4>(node, "rotation").map_or(DQuat::IDENTITY, DQuat::from_array);
    let length = rotation.length();
    // Values written in single precision are only approximately a unit quaternion.
    let rotation = if length > 0.0 { rotation / length } else { DQuat::IDENTITY };
    let vector = |name, or: f64| numbers::<3>(node, name).map_or(DVec3::splat(or), DVec3::from);
    DAffine3::from_scale_rotation_translation(vector("scale", 1.0), rotation, vector("translation", 0.0))
}

fn numbers<const N: usize>(node: &Value, name: &str) -> Option<[f64; N]> {
    let list = node.get(name)?.as_array().filter(|list| list.len() == N)?;
    let mut numbers = [0.0; N];
    for (number, value) in numbers.iter_mut().zip(list) {
        *number = value.as_f64()?;
    }
    Some(numbers)
}
