//! The block directory: one row of 32 bytes for each block (FORMAT.md, section 4).

use super::codec::{Codec, EncodedBlock, lz4_limit};
use super::header::{ALIGN, HEADER_LEN};
use super::sections::{FileRow, PlainRow};
use crate::base::bytes::{ByteReader, Checked, Malformed, PutBytes, ensure};

/// Number of bytes of a row in the file.
pub const ROW_LEN: usize = 32;

/// The place of a block in the file, and its sizes in its three forms.
///
/// Invariants, which [`check`] tests once: the blocks follow one another in the order of their ids, each at the first
/// multiple of [`ALIGN`] behind the one before, so that they neither overlap nor leave gaps; the sizes are within the
/// limits of [`check`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Offset of its first byte in the file.
    pub offset: u64,
    /// Number of bytes in the file, without padding.
    pub stored_len: u32,
    /// Number of bytes of the payload (the file form), which decompression yields.
    pub payload_len: u32,
    /// Number of bytes of the trace form, which the structure makes of the payload.
    pub decoded_len: u32,
    /// The codec that makes the payload of the stored bytes.
    pub codec: Codec,
    /// XXH3-64 of the stored bytes.
    pub checksum: u64,
}

impl Row {
    /// Returns the row of a `block` that is written at `offset`.
    pub(super) fn of(block: &EncodedBlock, offset: u64) -> Result<Self, Malformed> {
        let stored_len = u32::try_from(block.stored.len()).map_err(|_| Malformed::new("the block is too large"))?;
        Ok(Self {
            offset,
            stored_len,
            payload_len: block.payload_len,
            decoded_len: block.decoded_len,
            codec: block.codec,
            checksum: block.checksum,
        })
    }

    /// Offset one past the last stored byte.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(u64::from(self.stored_len))
    }

    fn check(&self, block_size: u32) -> Result<(), Malformed> {
        ensure(self.stored_len > 0, "the block is empty")?;
        ensure(self.decoded_len <= block_size, "the trace form is larger than the block size")?;
        ensure(
            u64::from(self.payload_len) <= 2 * u64::from(block_size),
            "the payload is larger than twice the block size",
        )?;
        match self.codec {
            Codec::Stored => ensure(self.payload_len == self.stored_len, "stored and payload sizes differ"),
            Codec::Lz4 => ensure(
                self.payload_len > self.stored_len && u64::from(self.payload_len) <= lz4_limit(self.stored_len),
                "the sizes are impossible for LZ4 data",
            ),
        }
    }
}

impl FileRow for Row {
    const LEN: usize = ROW_LEN;
    fn encode(&self, out: &mut Vec<u8>) {
        out.put_u64(self.offset);
        out.put_u32(self.stored_len);
        out.put_u32(self.payload_len);
        out.put_u32(self.decoded_len);
        out.put_u8(self.codec as u8);
        out.put_bytes(&[0; 3]);
        out.put_u64(self.checksum);
    }
}

impl PlainRow for Row {
    fn decode(r: &mut ByteReader) -> Checked<Self> {
        let (offset, stored_len, payload_len, decoded_len) = (r.u64()?, r.u32()?, r.u32()?, r.u32()?);
        let codec = Codec::from_u8(r.u8()?).ok_or(Malformed::new("unknown codec"))?;
        r.zeros(3)?;
        Ok(Self { offset, stored_len, payload_len, decoded_len, codec, checksum: r.u64()? })
    }
}

/// Returns the first multiple of [`ALIGN`] at or after `offset`.
pub(super) fn aligned(offset: u64) -> u64 {
    offset.checked_next_multiple_of(ALIGN).unwrap_or(u64::MAX)
}

/// Checks the invariants of [`Row`]. Returns the offset one past the last block.
pub(super) fn check(rows: &[Row], block_size: u32) -> Result<u64, Malformed> {
    let mut end = HEADER_LEN as u64;
    for (i, row) in rows.iter().enumerate() {
        let at_its_place = ensure(row.offset == aligned(end), "the block does not follow the previous block");
        at_its_place
            .and_then(|()| row.check(block_size))
            .map_err(|why| Malformed::new(format!("directory, block {i}: {why}")))?;
        end = row.end();
    }
    Ok(end)
}

#[cfg(test)]
mod tests {
    use super::super::opening::decode_rows;
    use super::super::sections::encoded;
    use super::*;

    fn rows() -> Vec<Row> {
        let row = |offset, stored_len, payload_len, codec| Row {
            offset,
            stored_len,
            payload_len,
            decoded_len: 1000,
            codec,
            checksum: 0x0123_4567_89ab_cdef,
        };
        vec![row(256, 100, 100, Codec::Stored), row(384, 64, 999, Codec::Lz4), row(448, 1, 1, Codec::Stored)]
    }

    #[test]
    fn a_directory_comes_back() {
        let bytes = encoded(&rows());
        assert_eq!(bytes.len(), 3 * ROW_LEN);
        assert_eq!(decode_rows(&bytes, 3), Ok(rows()));
        assert_eq!(check(&rows(), 1024), Ok(449));
        assert_eq!(check(&[], 1024), Ok(256));
        assert!(decode_rows::<Row>(&bytes[..95], 3).is_err());
    }

    #[test]
    fn overlaps_gaps_and_impossible_sizes_are_refused() {
        type Damage = (&'static str, fn(&mut Row));
        let damage: [Damage; 8] = [
            ("overlap", |r| r.offset -= 64),
            ("gap", |r| r.offset += 64),
            ("far away", |r| r.offset = u64::MAX),
            ("empty", |r| r.stored_len = 0),
            ("expands too much", |r| r.payload_len = 64 * 255 + 1),
            ("does not expand", |r| r.payload_len = 64),
            ("trace form too large", |r| r.decoded_len = 1025),
            ("not LZ4", |r| r.codec = Codec::Stored),
        ];
        for (what, damage) in damage {
            let mut rows = rows();
            damage(&mut rows[1]);
            assert!(check(&rows, 1 << 10).is_err(), "{what}");
        }
        let mut gap = rows();
        gap[1..].iter_mut().for_each(|row| row.offset += 64);
        assert!(check(&gap, 1 << 10).is_err());
        let large = |payload_len| Row { stored_len: payload_len, payload_len, ..rows()[0] };
        assert!(check(&[large(2048)], 1 << 10).is_ok() && check(&[large(2049)], 1 << 10).is_err());
        let mut far = rows();
        far[0].stored_len = u32::MAX;
        assert!(check(&far, 1 << 10).is_err());
    }
}
