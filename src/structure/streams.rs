//! Values of triangles in blocks of their own, which are read only on request; their file form.
//!
//! `src/store/FORMAT.md` describes the bytes in "Primitive ids", "Colours" and "Normals". Ids and colours have the same
//! form for all structures; each structure has its own trace form of normals. Each block of triangles has one block of
//! each stream, in the order of its triangles.

use super::bytes::{Reader, unzigzag, zigzag};
use crate::base::bytes::push_varint;
use crate::base::ids::BlockId;
use crate::store::Header;

/// Result of decoding, or the fault in a few words.
type Checked<T> = Result<T, String>;

/// First byte of a payload. The blocks of a structure begin with other values.
const PRIMS: u8 = 4;
const COLOURS: u8 = 5;
const NORMALS: u8 = 6;

/// The streams of a model.
#[derive(Debug, Clone, Copy)]
pub struct Streams {
    geometry_blocks: u32,
    has_colours: bool,
}

/// A kind of blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Nodes and triangles.
    Geometry,
    /// Primitive ids.
    Prims,
    /// Colours.
    Colours,
    /// Normals.
    Normals,
}

impl Streams {
    /// The streams of a model with this header.
    pub fn of(header: &Header) -> Self {
        Self { geometry_blocks: header.geometry_blocks, has_colours: header.has_colours }
    }

    /// The kind of a block.
    pub fn kind(&self, id: BlockId) -> Kind {
        match id.0 / self.geometry_blocks.max(1) {
            0 => Kind::Geometry,
            1 => Kind::Prims,
            2 if self.has_colours => Kind::Colours,
            _ => Kind::Normals,
        }
    }

    /// True if a block is read before it is requested, where there is memory.
    pub fn is_read_ahead(&self, id: BlockId) -> bool {
        matches!(self.kind(id), Kind::Geometry | Kind::Colours)
    }
}

/// Decodes a block of any kind but geometry, `words` by its directory.
pub fn decode(kind: Kind, payload: &[u8], words: usize) -> Checked<Vec<u32>> {
    match kind {
        Kind::Geometry => wrong("not a block of a stream"),
        Kind::Prims => decode_prims(payload, words),
        Kind::Colours => decode_colours(payload, words),
        Kind::Normals => decode_normals(payload, words),
    }
}

fn wrong<T>(why: &str) -> Checked<T> {
    Err(why.to_string())
}

/// Reads the kind and the count, with which each of these payloads begins. The count must be that of the directory.
fn begin<'a>(payload: &'a [u8], kind: u8, words: usize, other: &str) -> Checked<(Reader<'a>, usize)> {
    let mut reader = Reader::new(payload);
    if reader.u8()? != kind {
        return wrong(other);
    }
    let count = reader.u32()? as usize;
    if count != words {
        return wrong("the number of words differs from that in the directory");
    }
    Ok((reader, count))
}

/// Encodes the primitive ids of a block.
pub fn encode_prims(prims: &[u32]) -> Vec<u8> {
    let mut out = vec![PRIMS];
    out.extend((prims.len() as u32).to_le_bytes());
    let mut before = 0u32;
    for &p in prims {
        push_varint(&mut out, zigzag(p.wrapping_sub(before) as i32));
        before = p;
    }
    out
}

/// Decodes the primitive ids of a block, `words` by its directory: one word each.
pub fn decode_prims(payload: &[u8], words: usize) -> Checked<Vec<u32>> {
    let (mut reader, count) = begin(payload, PRIMS, words, "not a block of primitive ids")?;
    if count > reader.left() {
        return wrong("there are fewer ids than stated");
    }
    let mut prims = Vec::with_capacity(count);
    let mut before = 0u32;
    for _ in 0..count {
        before = before.wrapping_add(unzigzag(reader.varint()?) as u32);
        prims.push(before);
    }
    reader.end()?;
    Ok(prims)
}

/// Encodes the colours of a block's triangles: one for each triangle, or one for each corner. Returns the payload and
/// the number of words of the trace form.
pub fn encode_colours(colours: &[[[u8; 4]; 3]]) -> (Vec<u8>, usize) {
    let is_plain = colours.iter().all(|[a, b, c]| a == b && a == c);
    let each: usize = if is_plain { 1 } else { 3 };
    let mut out = vec![COLOURS];
    out.extend(((each * colours.len()) as u32).to_le_bytes());
    out.push(each as u8);
    for corner in 0..each {
        (0..4).for_each(|channel| out.extend(colours.iter().map(|c| c[corner][channel])));
    }
    (out, 1 + each * colours.len())
}

/// Decodes the colours of a block's triangles, `words` by its directory: the number of colours of a triangle, and a
/// word for each colour, red in the lowest byte.
pub fn decode_colours(payload: &[u8], words: usize) -> Checked<Vec<u32>> {
    let (mut reader, all) = begin(payload, COLOURS, words.saturating_sub(1), "not a block of colours")?;
    let each = usize::from(reader.u8()?);
    if each != 1 && each != 3 {
        return wrong("the number of colours of a triangle is neither 1 nor 3");
    }
    let count = all / each;
    if words == 0 || count * each != all || reader.left() != all.saturating_mul(4) {
        return wrong("the number of colours does not match the size");
    }
    let runs = reader.take(4 * all)?;
    let mut out = Vec::with_capacity(words);
    out.push(each as u32);
    for i in 0..count {
        let colour = |corner: usize| [0, 1, 2, 3].map(|channel| runs[(4 * corner + channel) * count + i]);
        out.extend((0..each).map(|corner| u32::from_le_bytes(colour(corner))));
    }
    Ok(out)
}

/// Returns the sRGB colours of the corners of triangle `index` of a block of colours. A malformed file may have none.
pub fn colours_of(words: &[u32], index: usize) -> [[u8; 4]; 3] {
    let each = words.first().map_or(1, |each| *each as usize);
    let at = |corner: usize| words.get(1 + each * index + corner.min(each - 1)).map_or([255; 4], |c| c.to_le_bytes());
    [at(0), at(1), at(2)]
}

/// Encodes the trace form of a block's normals.
pub fn encode_normals(words: &[u32]) -> Vec<u8> {
    let mut out = vec![NORMALS];
    out.extend((words.len() as u32).to_le_bytes());
    words.iter().for_each(|word| out.extend(word.to_le_bytes()));
    out
}

/// Decodes the trace form of a block's normals, `words` by its directory. Readers of the words test every access.
fn decode_normals(payload: &[u8], words: usize) -> Checked<Vec<u32>> {
    let (mut reader, count) = begin(payload, NORMALS, words, "not a block of normals")?;
    let (out, rest) = reader.take(reader.left())?.as_chunks();
    if out.len() != count || !rest.is_empty() {
        return wrong("the number of words does not match the size");
    }
    Ok(out.iter().map(|word| u32::from_le_bytes(*word)).collect())
}
