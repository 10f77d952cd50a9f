//! The codecs of blocks: a payload is stored as it is, or compressed.

use crate::base::bytes::{Malformed, ensure};
use lz4_flex::block;
use xxhash_rust::xxh3::xxh3_64;

/// The codec that makes a block's payload of its stored bytes. The numbers are those of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Codec {
    /// The stored bytes are the payload.
    Stored = 0,
    /// The stored bytes are one LZ4 block, without a size in front.
    Lz4 = 1,
}

impl Codec {
    /// Returns the codec of a number in a file.
    pub fn from_u8(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::Stored),
            1 => Some(Self::Lz4),
            _ => None,
        }
    }
}

/// A block ready to be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EncodedBlock {
    pub(super) stored: Vec<u8>,
    pub(super) payload_len: u32,
    pub(super) decoded_len: u32,
    pub(super) codec: Codec,
    pub(super) checksum: u64,
}

impl EncodedBlock {
    /// Compresses `payload` if that makes it smaller. The same input gives the same bytes on any thread of any machine.
    ///
    /// `payload`: the file form, at least one byte ([`super::Writer`] refuses others, and those larger than four block
    /// sizes). `decoded_len`: number of bytes of the trace form that the structure makes of it.
    pub fn encode(payload: &[u8], decoded_len: u32) -> Self {
        let payload_len = u32::try_from(payload.len()).unwrap_or(0);
        let (stored, codec) = match compress(payload) {
            Some(smaller) => (smaller, Codec::Lz4),
            None => (payload.to_vec(), Codec::Stored),
        };
        let checksum = xxh3_64(&stored);
        Self { stored, payload_len, decoded_len, codec, checksum }
    }

    /// Number of bytes that the block takes in the file, without padding.
    pub fn stored_len(&self) -> usize {
        self.stored.len()
    }
}

/// Returns the LZ4 form of `payload` if that is smaller.
fn compress(payload: &[u8]) -> Option<Vec<u8>> {
    let mut out = vec![0; block::get_maximum_output_size(payload.len())];
    let len = block::compress_into(payload, &mut out).ok()?;
    let out = without_short_matches(&out[..len], payload);
    (out.len() < payload.len()).then_some(out)
}

/// Length of the shortest match that is worth its time. Shorter matches save a byte or two, but take as long to decode
/// as long ones.
const LEAST_MATCH: usize = 6;
/// Length of the shortest match that LZ4 can express.
const LZ4_MATCH: usize = 4;

/// Rewrites LZ4 data of `payload` so that matches shorter than [`LEAST_MATCH`] become literals.
fn without_short_matches(compressed: &[u8], payload: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(compressed.len() + compressed.len() / 16);
    // Offsets in `payload`: of the next byte, and of the first literal that is not yet written.
    let (mut at, mut begin) = (0, 0);
    let mut from = 0;
    while from < compressed.len() {
        let token = compressed[from];
        from += 1;
        let literals = read_length(compressed, &mut from, token >> 4);
        (from, at) = (from + literals, at + literals);
        if from == compressed.len() {
            break;
        }
        let offset = [compressed[from], compressed[from + 1]];
        from += 2;
        let longer = read_length(compressed, &mut from, token & 15);
        if LZ4_MATCH + longer >= LEAST_MATCH {
            push_sequence(&mut out, &payload[begin..at], longer);
            out.extend(offset);
            push_length(&mut out, longer);
            begin = at + LZ4_MATCH + longer;
        }
        at += LZ4_MATCH + longer;
    }
    push_sequence(&mut out, &payload[begin..], 0);
    out
}

/// Reads a length. `short` is its part in the token: 15 if further bytes follow, up to the first that is not 255.
fn read_length(compressed: &[u8], from: &mut usize, short: u8) -> usize {
    let mut length = usize::from(short);
    let mut goes_on = short == 15;
    while goes_on {
        length += usize::from(compressed[*from]);
        goes_on = compressed[*from] == 255;
        *from += 1;
    }
    length
}

/// Writes the bytes of a length behind its part in the token: the inverse of [`read_length`].
fn push_length(out: &mut Vec<u8>, length: usize) {
    if let Some(rest) = length.checked_sub(15) {
        out.extend(std::iter::repeat_n(255, rest / 255));
        out.push((rest % 255) as u8);
    }
}

/// Writes the token and the literals of a sequence. `longer`: the length of its match beyond [`LZ4_MATCH`].
fn push_sequence(out: &mut Vec<u8>, literals: &[u8], longer: usize) {
    out.push((literals.len().min(15) as u8) << 4 | longer.min(15) as u8);
    push_length(out, literals.len());
    out.extend(literals);
}

/// Upper bound of the number of bytes that `stored_len` bytes of LZ4 decode to: each byte of a length adds at most 255.
pub fn lz4_limit(stored_len: u32) -> u64 {
    u64::from(stored_len) * 255
}

/// Replaces the content of `out` by the payload, which has `payload_len` bytes.
pub fn decode(codec: Codec, stored: &[u8], payload_len: u32, out: &mut Vec<u8>) -> Result<(), Malformed> {
    match codec {
        Codec::Stored => {
            ensure(stored.len() == payload_len as usize, "stored and payload sizes differ")?;
            out.clear();
            out.extend_from_slice(stored);
        }
        Codec::Lz4 => {
            out.resize(payload_len as usize, 0);
            let len = block::decompress_into(stored, out).map_err(|_| Malformed::new("invalid LZ4 data"))?;
            ensure(len == out.len(), "the LZ4 data decodes to fewer bytes than the directory states")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn roundtrip(payload: &[u8]) -> Codec {
        let block = EncodedBlock::encode(payload, 7);
        assert!(block.stored_len() <= payload.len());
        assert!(u64::from(block.payload_len) <= lz4_limit(block.stored_len() as u32));
        let mut out = vec![9; 3];
        decode(block.codec, &block.stored, block.payload_len, &mut out).unwrap();
        assert_eq!(out, payload);
        block.codec
    }

    #[test]
    fn the_smaller_of_both_is_chosen() {
        assert_eq!(roundtrip(&[7; 70_000]), Codec::Lz4);
        assert_eq!(roundtrip(&[1, 2, 3]), Codec::Stored);
    }

    proptest! {
        #[test]
        fn any_payload_comes_back(payload in prop::collection::vec(0u8..4, 1..5000)) {
            roundtrip(&payload);
        }

        #[test]
        fn damaged_lz4_is_an_error_or_has_the_right_length(
            payload in prop::collection::vec(0u8..3, 200..1000), at in any::<prop::sample::Index>(), flip in 1u8..,
        ) {
            let mut block = EncodedBlock::encode(&payload, 0);
            let at = at.index(block.stored.len());
            block.stored[at] ^= flip;
            let mut out = Vec::new();
            if decode(block.codec, &block.stored, block.payload_len, &mut out).is_ok() {
                prop_assert_eq!(out.len(), payload.len());
            }
        }
    }
}
