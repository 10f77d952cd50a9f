//! The JSON document and the binary chunk of a GLB.

use super::model::{Model, Node};
use super::{parse, repair};
use crate::base::account::Claim;
use crate::base::error::{Error, Place, Result};
use crate::base::progress::Cancel;
use crate::import::input::Input;
use serde_json::Value;

/// A parsed file.
pub(crate) struct Document {
    pub(crate) model: Model,
    /// Offset and length of a GLB's binary chunk in the file.
    pub(crate) binary: Option<(u64, u64)>,
    /// True if texts in the JSON are not UTF-8.
    pub(crate) has_other_texts: bool,
    /// True if values in the JSON that it does not know were replaced by `null`.
    pub(crate) is_repaired: bool,
    /// The memory of the document.
    _claim: Claim,
}

/// Number of bytes of the JSON that are read, or examined, at once.
const PIECE: usize = 4 << 20;

const GLB_HEADER: u64 = 12;
const CHUNK_HEADER: u64 = 8;

/// Reads the document of a `.gltf` or `.glb` file.
pub(crate) fn read(input: &mut Input, mut claim: Claim, cancel: &Cancel) -> Result<Document> {
    let is_glb = input.peek(4)? == b"glTF";
    let (json, binary) = if is_glb { chunks(input)? } else { ((0, input.total()), None) };
    let too_large = |claim: &Claim, input: &Input| {
        claim.over(1.0, 0, format!("reading the JSON of {} ({} bytes)", input.path().display(), json.1))
    };
    if !claim.grow(json.1) {
        return Err(too_large(&claim, input));
    }
    let mut text = vec![0; json.1 as usize];
    for (i, piece) in text.chunks_mut(PIECE).enumerate() {
        cancel.check()?;
        if !input.read_range(json.0 + (i * PIECE) as u64, piece)? {
            return Err(input.fault("the file ends inside its JSON"));
        }
    }
    let mut parsed = 0;
    for piece in text.chunks(PIECE) {
        cancel.check()?;
        parsed += parsed_bytes(piece);
    }
    if !claim.grow(parsed) {
        return Err(too_large(&claim, input));
    }
    let trimmed = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    // Some exporters fill the last bytes with zeros.
    let end = trimmed.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
    // A name in another coding is shown with replacement characters.
    let decoded = String::from_utf8_lossy(&trimmed[..end]);
    let place = |e: &serde_json::Error| match (is_glb, e.line()) {
        (true, 0 | 1) => Place::Byte(json.0 + e.column().saturating_sub(1) as u64),
        (_, line) => Place::Line(line as u64),
    };
    let fail = |e| Error::parse(input.path(), place(&e), format!("not valid JSON: {e}"));
    let mut is_repaired = false;
    let parsed = parse::document(&decoded, cancel).or_else(|e| {
        is_repaired = !cancel.is_cancelled() && claim.grow(json.1);
        let text = if is_repaired { repair::repaired(&decoded, cancel) } else { None };
        text.and_then(|text| parse::document(&text, cancel).ok()).ok_or(e)
    });
    cancel.check()?;
    let (model, rest) = parsed.map_err(fail)?;
    let has_other_texts = matches!(decoded, std::borrow::Cow::Owned(_));
    is_gltf_2(&rest).map_err(|why| Error::parse(input.path(), Place::File, why))?;
    Ok(Document { model, binary, has_other_texts, is_repaired, _claim: claim })
}

/// Returns the greatest memory of the model of a document, about: a node takes more than any other object.
fn parsed_bytes(text: &[u8]) -> u64 {
    let (object, list, value) = (size_of::<Node>() as u64 * 9 / 8 + 64, 32, 24);
    let brackets = memchr::memchr3_iter(b'{', b'[', b',', text);
    brackets.map(|at| [object, list, value][usize::from(text[at] == b'[') + 2 * usize::from(text[at] == b',')]).sum()
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
        Some(Value::String(version)) if version == "2" || version.starts_with("2.") => Ok(()),
        Some(Value::Number(version)) if version.as_f64().is_some_and(|v| (2.0..3.0).contains(&v)) => Ok(()),
        Some(version) => Err(format!("is glTF version {version}; only 2.0 is supported")),
        None => Err("is JSON, but not glTF: it has no asset with a version".into()),
    }
}
