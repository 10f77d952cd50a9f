//! Per-triangle numbers in blocks of their own, which are read only on request; their file form.
//!
//! The form is the same for all structures. `src/store/FORMAT.md` describes the bytes in "Primitive ids" and "Colours".
//! Each block of triangles has one block of each stream, in the order of its triangles.

use super::bytes::{Reader, unzigzag, zigzag};
use crate::base::bytes::push_varint;

/// Result of decoding, or the fault in a few words.
type Checked<T> = Result<T, String>;

/// First byte of a payload. The blocks of a structure begin with other values.
const PRIMS: u8 = 4;
const COLOURS: u8 = 5;

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
        return wrong("the number of ids or colours differs from that in the directory");
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

/// Encodes the colours of a block's triangles.
pub fn encode_colours(colours: &[[u8; 4]]) -> Vec<u8> {
    let mut out = vec![COLOURS];
    out.extend((colours.len() as u32).to_le_bytes());
    (0..4).for_each(|channel| out.extend(colours.iter().map(|c| c[channel])));
    out
}

/// Decodes the colours of a block's triangles, `words` by its directory: one word each, red in the lowest byte.
pub fn decode_colours(payload: &[u8], words: usize) -> Checked<Vec<u32>> {
    let (mut reader, count) = begin(payload, COLOURS, words, "not a block of colours")?;
    if reader.left() != count.saturating_mul(4) {
        return wrong("the number of colours does not match the size");
    }
    let runs = reader.take(4 * count)?;
    let colour = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|c| runs[c * count + i]));
    Ok((0..count).map(colour).collect())
}
