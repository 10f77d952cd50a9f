//! Per-triangle numbers in blocks of their own, which are read only on request; their file form.
//!
//! The form is the same for all structures. `src/store/FORMAT.md` describes the bytes in "Primitive ids" and "Colours".
//! Each block of triangles has one block of each stream, in the order of its triangles.

use super::bytes::{Reader, push_varint, unzigzag, zigzag};

/// Result of decoding, or the fault in a few words.
type Checked<T> = Result<T, String>;

/// First byte of a payload. The blocks of a structure begin with other values.
const PRIMS: u8 = 4;
const COLOURS: u8 = 5;

fn wrong<T>(why: &str) -> Checked<T> {
    Err(why.to_string())
}

/// Reads the kind and the count, with which each of these payloads begins.
fn begin<'a>(payload: &'a [u8], kind: u8, other: &str) -> Checked<(Reader<'a>, usize)> {
    let mut reader = Reader::new(payload);
    if reader.u8()? != kind {
        return wrong(other);
    }
    let count = reader.u32()? as usize;
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

/// Decodes the primitive ids of a block: one word each.
pub fn decode_prims(payload: &[u8]) -> Checked<Vec<u32>> {
    let (mut reader, count) = begin(payload, PRIMS, "not a block of primitive ids")?;
    if count > reader.left() {
        return wrong("there are fewer ids than stated");
    }
    let mut before = 0u32;
    let mut next = || -> Checked<u32> {
        before = before.wrapping_add(unzigzag(reader.varint()?) as u32);
        Ok(before)
    };
    let prims = (0..count).map(|_| next()).collect::<Checked<Vec<u32>>>()?;
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

/// Decodes the colours of a block's triangles: one word each, red in the lowest byte.
pub fn decode_colours(payload: &[u8]) -> Checked<Vec<u32>> {
    let (mut reader, count) = begin(payload, COLOURS, "not a block of colours")?;
    if reader.left() != count.saturating_mul(4) {
        return wrong("the number of colours does not match the size");
    }
    let runs = reader.take(4 * count)?;
    let colour = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|c| runs[c * count + i]));
    Ok((0..count).map(colour).collect())
}
