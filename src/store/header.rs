//! The first 256 bytes of a model file, and its last 32 (FORMAT.md, sections 2 and 7).

use super::sections::{check_bounds, is_finite};
use crate::base::bytes::{ByteReader, Malformed, PutBytes, ensure};
use xxhash_rust::xxh3::xxh3_64;

/// First bytes of a file. The high bit, the line ends and the end-of-file character of old systems
/// are what transfers "in text mode" change.
pub const MAGIC: [u8; 8] = *b"\x8fOCR\r\n\x1a\n";
/// First bytes of the footer.
pub const FOOTER_MAGIC: [u8; 8] = *b"\n\x1a\n\rRCO\x8f";
/// Major and minor format version that is written, and the newest that is read.
pub const VERSION: (u16, u16) = (0, 8);
/// Bytes of the header.
pub const HEADER_LEN: usize = 256;
/// Bytes of the footer.
pub const FOOTER_LEN: usize = 32;
/// Blocks and sections begin at multiples of this many bytes.
pub const ALIGN: u64 = 64;

/// Least and greatest [`Header::block_size`].
pub const BLOCK_SIZES: std::ops::RangeInclusive<u32> = 1024..=1 << 24;
/// [`Header::block_size`] unless told otherwise.
pub const DEFAULT_BLOCK_SIZE: u32 = 64 << 10;

const CHECKSUM_AT: usize = HEADER_LEN - 8;
const RESERVED_AT: usize = 180;
const FLAG_COLOURS: u32 = 1;
const FLAG_SPLITS: u32 = 2;

/// Triangles of the input that are not in the tree, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Drops {
    /// A vertex is NaN or infinite.
    pub non_finite: u64,
    /// The area is zero.
    pub degenerate: u64,
    /// A vertex is too far from the tree's origin for an f32.
    pub out_of_range: u64,
}

/// The options of the build that are kept for readers of the file; nothing depends on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Whether triangles were split among leaves.
    pub spatial_splits: bool,
    /// Most triangles in a leaf; 0 if the structure has no such limit.
    pub leaf_triangles: u32,
    /// Memory budget of the build in bytes (it decides on the chunks); 0 if there was none.
    pub memory_budget: u64,
    /// Bytes of one sample of a stand-in; 0 if the structure has none.
    pub sample_bytes: u32,
}

/// What is known of a model before anything else of it is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// The number of the acceleration structure; never 0. Which numbers exist is the business of `structure`.
    pub structure: u32,
    /// Most bytes of a block's trace form, in [`BLOCK_SIZES`].
    pub block_size: u32,
    /// Metres in one unit of length; 0 if unknown. Finite, not negative.
    pub metres_per_unit: f64,
    /// The axis that points up: 0 unknown, 1 x, 2 y, 3 z.
    pub up: u32,
    /// Bounds of all that is placed, in world units: least corner, greatest corner; finite, or
    /// [`EMPTY_BOUNDS`](super::sections::EMPTY_BOUNDS).
    pub bounds: [f64; 6],
    /// Triangles of the input.
    pub triangles_in: u64,
    /// Triangles that are in trees, each counted once.
    pub triangles_kept: u64,
    /// The others, by reason.
    pub drops: Drops,
    /// Geometry blocks of all trees; as many blocks of primitive ids follow.
    pub geometry_blocks: u32,
    /// Whether as many blocks of colours follow those.
    pub has_colours: bool,
    /// How it was built.
    pub options: Options,
}

impl Default for Header {
    fn default() -> Self {
        Self {
            structure: 1,
            block_size: DEFAULT_BLOCK_SIZE,
            metres_per_unit: 0.0,
            up: 0,
            bounds: super::sections::EMPTY_BOUNDS,
            triangles_in: 0,
            triangles_kept: 0,
            drops: Drops::default(),
            geometry_blocks: 0,
            has_colours: false,
            options: Options::default(),
        }
    }
}

impl Header {
    /// Blocks in the directory: geometry, primitive ids and, if there are any, colours.
    pub fn block_count(&self) -> u64 {
        u64::from(self.geometry_blocks) * if self.has_colours { 3 } else { 2 }
    }

    /// Checks the documented range of every field.
    pub(super) fn validate(&self) -> Result<(), Malformed> {
        ensure(self.structure != 0, "no structure")?;
        ensure(BLOCK_SIZES.contains(&self.block_size), "block size out of range")?;
        ensure(self.up <= 3, "unknown up axis")?;
        ensure(self.metres_per_unit.is_finite() && self.metres_per_unit >= 0.0, "bad unit of length")?;
        check_bounds(&self.bounds).map_err(|_| Malformed::new("bad bounds of the model"))?;
        debug_assert!(is_finite(&self.bounds) || self.bounds == super::sections::EMPTY_BOUNDS);
        let Drops { non_finite, degenerate, out_of_range } = self.drops;
        let sum = [non_finite, degenerate, out_of_range].into_iter().try_fold(self.triangles_kept, u64::checked_add);
        ensure(sum.is_some(), "the counts of triangles cannot be right")?;
        ensure(self.block_count() <= u64::from(u32::MAX), "too many blocks")
    }
}

/// Where the parts of the file are; kept by the header beside [`Header`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame {
    /// Bytes of the whole file.
    pub file_len: u64,
    /// Offset of the section table.
    pub table_at: u64,
    /// Checksum of the section table.
    pub table_checksum: u64,
    /// Rows of the section table.
    pub sections: u32,
    /// Rows of the directory.
    pub blocks: u32,
}

/// Why a header was not read.
#[derive(Debug, PartialEq)]
pub(super) enum HeaderError {
    Malformed(Malformed),
    Newer((u16, u16)),
}

impl From<Malformed> for HeaderError {
    fn from(why: Malformed) -> Self {
        Self::Malformed(why)
    }
}

/// The 256 bytes of a header.
pub(super) fn encode(header: &Header, frame: &Frame) -> Vec<u8> {
    let mut out = Vec::with_capacity(HEADER_LEN);
    out.put_bytes(&MAGIC);
    out.put_u16(VERSION.0);
    out.put_u16(VERSION.1);
    out.put_u32(HEADER_LEN as u32);
    out.put_u64(frame.file_len);
    out.put_u64(frame.table_at);
    out.put_u64(frame.table_checksum);
    out.put_u32(frame.sections);
    out.put_u32(frame.blocks);
    out.put_u32(header.structure);
    out.put_u32(header.block_size);
    let colours = if header.has_colours { FLAG_COLOURS } else { 0 };
    let splits = if header.options.spatial_splits { FLAG_SPLITS } else { 0 };
    out.put_u32(colours | splits);
    out.put_u32(header.up);
    out.put_f64(header.metres_per_unit);
    out.put_f64s(&header.bounds);
    out.put_u64(header.triangles_in);
    out.put_u64(header.triangles_kept);
    out.put_u64(header.drops.non_finite);
    out.put_u64(header.drops.degenerate);
    out.put_u64(header.drops.out_of_range);
    out.put_u32(header.geometry_blocks);
    out.put_u32(header.options.leaf_triangles);
    out.put_u64(header.options.memory_budget);
    out.put_u32(header.options.sample_bytes);
    debug_assert_eq!(out.len(), RESERVED_AT);
    out.put_zeros_to(CHECKSUM_AT);
    out.put_u64(xxh3_64(&out));
    out
}

/// Reads a header; `bytes` are the first [`HEADER_LEN`] of the file, or all of a shorter one.
pub(super) fn decode(bytes: &[u8]) -> Result<(Header, Frame), HeaderError> {
    check_magic(bytes)?;
    let mut r = ByteReader::new(bytes);
    r.take(MAGIC.len())?;
    // The version comes before the checksum: a newer header may have its checksum elsewhere.
    check_version((r.u16()?, r.u16()?))?;
    ensure(r.u32()? as usize == HEADER_LEN, "header has a wrong size")?;
    let checked = bytes.get(..CHECKSUM_AT).unwrap_or_default();
    let mut tail = ByteReader::new(bytes);
    tail.take(CHECKSUM_AT)?;
    ensure(tail.u64()? == xxh3_64(checked), "header is damaged (checksum differs)")?;
    tail.finish()?;
    let frame = Frame {
        file_len: r.u64()?,
        table_at: r.u64()?,
        table_checksum: r.u64()?,
        sections: r.u32()?,
        blocks: r.u32()?,
    };
    let header = decode_fields(&mut r)?;
    r.zeros(CHECKSUM_AT - RESERVED_AT)?;
    header.validate()?;
    ensure(u64::from(frame.blocks) == header.block_count(), "counts of blocks disagree")?;
    Ok((header, frame))
}

fn decode_fields(r: &mut ByteReader) -> Result<Header, Malformed> {
    let structure = r.u32()?;
    let block_size = r.u32()?;
    let flags = r.u32()?;
    ensure(flags & !(FLAG_COLOURS | FLAG_SPLITS) == 0, "unknown flags")?;
    let up = r.u32()?;
    let metres_per_unit = r.f64()?;
    let bounds = r.f64s()?;
    let (triangles_in, triangles_kept) = (r.u64()?, r.u64()?);
    let drops = Drops { non_finite: r.u64()?, degenerate: r.u64()?, out_of_range: r.u64()? };
    let geometry_blocks = r.u32()?;
    let options = Options {
        spatial_splits: flags & FLAG_SPLITS != 0,
        leaf_triangles: r.u32()?,
        memory_budget: r.u64()?,
        sample_bytes: r.u32()?,
    };
    Ok(Header {
        structure,
        block_size,
        metres_per_unit,
        up,
        bounds,
        triangles_in,
        triangles_kept,
        drops,
        geometry_blocks,
        has_colours: flags & FLAG_COLOURS != 0,
        options,
    })
}

fn check_magic(bytes: &[u8]) -> Result<(), Malformed> {
    if bytes.starts_with(&MAGIC) {
        return Ok(());
    }
    let name_only = |b: &[u8]| b.get(1..4) == Some(b"OCR".as_slice()) && b[0] & 0x7f == MAGIC[0] & 0x7f;
    ensure(!name_only(bytes), "damaged at the start, as by a transfer in text mode")?;
    ensure(!MAGIC.starts_with(bytes), "cut off, or empty")?;
    Err(Malformed::new("not an outcrop model"))
}

fn check_version(found: (u16, u16)) -> Result<(), HeaderError> {
    if found > VERSION {
        return Err(HeaderError::Newer(found));
    }
    // Format 0.x promises nothing: an older minor is another format.
    ensure(found == VERSION, "written in an early format that is no longer read").map_err(Into::into)
}

/// The last 32 bytes of a file whose header is `header`.
pub(super) fn encode_footer(file_len: u64, header: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(FOOTER_LEN);
    out.put_bytes(&FOOTER_MAGIC);
    out.put_u64(file_len);
    out.put_u64(xxh3_64(header));
    out.put_u64(xxh3_64(&out));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> (Header, Frame) {
        let header = Header {
            metres_per_unit: 0.001,
            up: 3,
            bounds: [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
            triangles_in: 10,
            triangles_kept: 4,
            drops: Drops { non_finite: 1, degenerate: 2, out_of_range: 3 },
            geometry_blocks: 2,
            has_colours: true,
            options: Options { spatial_splits: true, leaf_triangles: 8, memory_budget: 1 << 30, sample_bytes: 8 },
            ..Header::default()
        };
        (header, Frame { file_len: 1000, table_at: 500, table_checksum: 77, sections: 5, blocks: 6 })
    }

    #[test]
    fn a_header_comes_back() {
        let (header, frame) = sample();
        assert_eq!(decode(&encode(&header, &frame)), Ok((header, frame)));
    }

    #[test]
    fn a_newer_format_says_so_whatever_else_changed() {
        let (header, frame) = sample();
        let mut bytes = encode(&header, &frame);
        for (version, at) in [((0, 9), 10), ((1, 8), 8)] {
            let old = bytes[at];
            bytes[at] = if at == 8 { 1 } else { 9 };
            assert_eq!(decode(&bytes), Err(HeaderError::Newer(version)));
            assert_eq!(decode(&bytes[..12]), Err(HeaderError::Newer(version)));
            bytes[at] = old;
        }
    }

    #[test]
    fn text_mode_is_recognised() {
        for damage in [&b"\x8fOCR\n\x1a\n"[..], b"\x8fOCR\r\r\n\x1a\r\n", b"\x0fOCR\r\n\x1a\n"] {
            let Err(HeaderError::Malformed(why)) = decode(damage) else { panic!("accepted {damage:?}") };
            assert!(why.0.contains("text mode"), "{why}");
        }
        let Err(HeaderError::Malformed(why)) = decode(b"ply\nformat ascii 1.0\n") else { panic!("accepted") };
        assert_eq!(why.0, "not an outcrop model");
    }

    #[test]
    fn what_is_reserved_is_zero() {
        let (header, frame) = sample();
        for at in [56, RESERVED_AT, CHECKSUM_AT - 1] {
            let mut bytes = encode(&header, &frame);
            bytes[at] |= 0x80;
            let sum = xxh3_64(&bytes[..CHECKSUM_AT]);
            bytes[CHECKSUM_AT..].copy_from_slice(&sum.to_le_bytes());
            assert!(decode(&bytes).is_err(), "byte {at}");
        }
    }

    #[test]
    fn each_field_has_its_range() {
        let (good, frame) = sample();
        let bad = [
            Header { structure: 0, ..good },
            Header { block_size: 0, ..good },
            Header { block_size: u32::MAX, ..good },
            Header { up: 4, ..good },
            Header { metres_per_unit: f64::NAN, ..good },
            Header { metres_per_unit: -1.0, ..good },
            Header { bounds: [f64::NAN; 6], ..good },
            Header { bounds: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..good },
            Header { geometry_blocks: u32::MAX, ..good },
            Header { triangles_kept: u64::MAX, ..good },
            Header { has_colours: false, ..good },
        ];
        for header in bad {
            assert!(decode(&encode(&header, &frame)).is_err(), "{header:?}");
        }
    }
}
