//! The header, the first 256 bytes of a model file, and the footer, its last 32 bytes (FORMAT.md, sections 2 and 7).

use super::scene_file::SCENE_MAGIC;
use super::sections::{check_bounds, is_finite};
use crate::base::bytes::{ByteReader, Malformed, PutBytes, ensure};
use xxhash_rust::xxh3::xxh3_64;

/// The first eight bytes of a model file. Its high bit, its line ends and the end-of-file character of old systems
/// (`1A`) change in a transfer "in text mode", so that such a file is recognised as damaged.
pub const MAGIC: [u8; 8] = *b"\x8fOCR\r\n\x1a\n";
/// The first eight bytes of the footer.
pub const FOOTER_MAGIC: [u8; 8] = *b"\n\x1a\n\rRCO\x8f";
/// The format version, major and minor, that the library writes, and the newest that it reads.
pub const VERSION: (u16, u16) = (0, 13);
/// Number of bytes of the header.
pub const HEADER_LEN: usize = 256;
/// Number of bytes of the footer.
pub const FOOTER_LEN: usize = 32;
/// Blocks and sections begin at multiples of this number of bytes.
pub const ALIGN: u64 = 64;

/// Least and greatest value of [`Header::block_size`].
pub const BLOCK_SIZES: std::ops::RangeInclusive<u32> = 1024..=1 << 16;
/// Value of [`Header::block_size`] if the caller does not choose one.
pub const DEFAULT_BLOCK_SIZE: u32 = 64 << 10;

const CHECKSUM_AT: usize = HEADER_LEN - 8;
const RESERVED_AT: usize = 180;
const FLAG_COLOURS: u32 = 1;
const FLAG_NORMALS: u32 = 4;
const FLAG_SPLITS: u32 = 2;

/// Numbers of input triangles that are in no tree, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Drops {
    /// A vertex has a coordinate that is NaN or infinite.
    pub non_finite: u64,
    /// The area of the triangle is zero.
    pub degenerate: u64,
    /// A vertex is too far from the tree's origin for an f32.
    pub out_of_range: u64,
}

/// Options of the build, kept for readers of the file. Nothing depends on them, except that a model is refused if its
/// `sample_bytes` are not those of this version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// True if some triangles are referred to by several leaves.
    pub spatial_splits: bool,
    /// Maximum number of triangles of a leaf; 0 if the structure has no such limit.
    pub leaf_triangles: u32,
    /// Memory budget of the build in bytes, on which the division into chunks depends; 0 if there was none.
    pub memory_budget: u64,
    /// Number of bytes of one sample of a stand-in; 0 if the structure has no stand-ins.
    pub sample_bytes: u32,
}

/// Facts about a model that are known before the rest of the file is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// Number of the acceleration structure that the build asked for, not 0: information only. Each tree's own is
    /// [`TreeRow::structure`](super::TreeRow::structure).
    pub structure: u32,
    /// Maximum number of bytes of a block's trace form, in [`BLOCK_SIZES`].
    pub block_size: u32,
    /// Metres per unit of length, finite and not negative; 0 if unknown.
    pub metres_per_unit: f64,
    /// The axis that points up: 0 unknown, 1 x, 2 y, 3 z.
    pub up: u32,
    /// Bounds, in world units, of all placed triangles: least corner, then greatest corner. Either finite or
    /// [`EMPTY_BOUNDS`](super::sections::EMPTY_BOUNDS).
    pub bounds: [f64; 6],
    /// Number of triangles in the input.
    pub triangles_in: u64,
    /// Number of triangles in the trees, each counted once.
    pub triangles_kept: u64,
    /// Numbers of dropped triangles, by reason.
    pub drops: Drops,
    /// Number of geometry blocks of all trees. As many blocks of primitive ids follow them.
    pub geometry_blocks: u32,
    /// True if as many blocks of colours follow the blocks of primitive ids.
    pub has_colours: bool,
    /// True if as many blocks of normals follow these.
    pub has_normals: bool,
    /// Options of the build.
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
            has_normals: false,
            options: Options::default(),
        }
    }
}

impl Header {
    /// Number of rows of the directory: geometry blocks, blocks of primitive ids and, if there are any, of colours and
    /// of normals.
    pub fn block_count(&self) -> u64 {
        let kinds = 2 + u64::from(self.has_colours) + u64::from(self.has_normals);
        u64::from(self.geometry_blocks) * kinds
    }

    /// Difference between the id of a block of colours and that of its geometry block.
    pub fn colours_at(&self) -> Option<u32> {
        self.has_colours.then_some(2 * self.geometry_blocks)
    }

    /// Difference between the id of a block of normals and that of its geometry block.
    pub fn normals_at(&self) -> Option<u32> {
        self.has_normals.then_some((2 + u32::from(self.has_colours)) * self.geometry_blocks)
    }

    /// Checks the documented range of every field.
    pub(super) fn validate(&self) -> Result<(), Malformed> {
        ensure(self.structure != 0, "the structure is 0")?;
        ensure(BLOCK_SIZES.contains(&self.block_size), "block size out of range")?;
        ensure(self.up <= 3, "unknown up axis")?;
        ensure(self.metres_per_unit.is_finite() && self.metres_per_unit >= 0.0, "invalid unit of length")?;
        check_bounds(&self.bounds).map_err(|_| Malformed::new("invalid bounds of the model"))?;
        debug_assert!(is_finite(&self.bounds) || self.bounds == super::sections::EMPTY_BOUNDS);
        let Drops { non_finite, degenerate, out_of_range } = self.drops;
        let sum = [non_finite, degenerate, out_of_range].into_iter().try_fold(self.triangles_kept, u64::checked_add);
        ensure(sum.is_some(), "the sum of the triangle counts is too large")?;
        ensure(self.block_count() <= u64::from(u32::MAX), "too many blocks")
    }
}

/// Offsets and counts that frame the parts of the file. They are in the header too, but are not part of [`Header`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame {
    /// Number of bytes of the whole file.
    pub file_len: u64,
    /// Offset of the section table.
    pub table_at: u64,
    /// Checksum of the section table.
    pub table_checksum: u64,
    /// Number of rows of the section table.
    pub sections: u32,
    /// Number of rows of the directory.
    pub blocks: u32,
}

/// Reasons why a header cannot be read.
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

/// Returns the 256 bytes of a header.
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
    let normals = if header.has_normals { FLAG_NORMALS } else { 0 };
    out.put_u32(colours | splits | normals);
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

/// Reads a header. `bytes` are the first [`HEADER_LEN`] bytes of the file, or the whole of a shorter file.
pub(super) fn decode(bytes: &[u8]) -> Result<(Header, Frame), HeaderError> {
    check_magic(bytes)?;
    let mut r = ByteReader::new(bytes);
    r.take(MAGIC.len())?;
    // The version comes before the checksum: a newer format may have its checksum elsewhere.
    check_version((r.u16()?, r.u16()?))?;
    ensure(r.u32()? as usize == HEADER_LEN, "the header has a wrong size")?;
    let checked = bytes.get(..CHECKSUM_AT).unwrap_or_default();
    let mut tail = ByteReader::new(bytes);
    tail.take(CHECKSUM_AT)?;
    ensure(tail.u64()? == xxh3_64(checked), "the header is damaged (checksum mismatch)")?;
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
    ensure(u64::from(frame.blocks) == header.block_count(), "the block counts are inconsistent")?;
    Ok((header, frame))
}

fn decode_fields(r: &mut ByteReader) -> Result<Header, Malformed> {
    let structure = r.u32()?;
    let block_size = r.u32()?;
    let flags = r.u32()?;
    ensure(flags & !(FLAG_COLOURS | FLAG_SPLITS | FLAG_NORMALS) == 0, "unknown flags")?;
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
        has_normals: flags & FLAG_NORMALS != 0,
        options,
    })
}

fn check_magic(bytes: &[u8]) -> Result<(), Malformed> {
    if bytes.starts_with(&MAGIC) {
        return Ok(());
    }
    let name_only = |b: &[u8]| b.get(1..4) == Some(b"OCR".as_slice()) && b[0] & 0x7f == MAGIC[0] & 0x7f;
    ensure(!name_only(bytes), "the first bytes are damaged, for example by a transfer in text mode")?;
    ensure(!MAGIC.starts_with(bytes), "truncated or empty")?;
    ensure(!bytes.starts_with(&SCENE_MAGIC), "a scene file, not a model file")?;
    Err(Malformed::new("not an outcrop model"))
}

fn check_version(found: (u16, u16)) -> Result<(), HeaderError> {
    if found > VERSION {
        return Err(HeaderError::Newer(found));
    }
    // An older minor version of format 0.x is another format, which this library does not read.
    ensure(found == VERSION, "written in an early format that is no longer supported").map_err(Into::into)
}

/// Returns the last 32 bytes of a file. `header`: the bytes of its header.
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
            has_normals: true,
            options: Options { spatial_splits: true, leaf_triangles: 8, memory_budget: 1 << 30, sample_bytes: 8 },
            ..Header::default()
        };
        (header, Frame { file_len: 1000, table_at: 500, table_checksum: 77, sections: 5, blocks: 8 })
    }

    #[test]
    fn a_header_comes_back() {
        let (header, frame) = sample();
        assert_eq!(decode(&encode(&header, &frame)), Ok((header, frame)));
    }

    #[test]
    fn a_newer_format_is_reported_whatever_else_changed() {
        let (header, frame) = sample();
        let mut bytes = encode(&header, &frame);
        for (version, at) in [((0, VERSION.1 + 1), 10), ((1, VERSION.1), 8)] {
            let old = bytes[at];
            bytes[at] += 1;
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
    fn reserved_bytes_must_be_zero() {
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
