//! The section table: what follows the blocks, and where (FORMAT.md, sections 5 and 6).

use super::directory::{self, aligned};
use super::sections::{self, FileRow, InstanceRow, MaterialRow, PartRow, Tables, TreeRow};
use crate::base::bytes::{ByteReader, Malformed, PutBytes, ensure};

/// What a section holds. The numbers are those of the file; each file of format 0.1 has each kind
/// once, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// The block directory.
    Directory = 1,
    /// Parts.
    Parts = 2,
    /// Materials.
    Materials = 3,
    /// Instances of shared meshes.
    Assembly = 4,
    /// Trees.
    Trees = 5,
}

/// All kinds in their order in the file.
pub const KINDS: [Kind; 5] = [Kind::Directory, Kind::Parts, Kind::Materials, Kind::Assembly, Kind::Trees];
/// Bytes of a row of the section table.
pub const ROW_LEN: usize = 40;
/// Bytes of the section table.
pub const TABLE_LEN: usize = KINDS.len() * ROW_LEN;

impl Kind {
    /// Bytes of a row of such a section.
    pub fn row_len(self) -> usize {
        match self {
            Kind::Directory => directory::ROW_LEN,
            Kind::Parts => PartRow::LEN,
            Kind::Materials => MaterialRow::LEN,
            Kind::Assembly => InstanceRow::LEN,
            Kind::Trees => TreeRow::LEN,
        }
    }
    /// For messages.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Directory => "directory",
            Kind::Parts => "parts",
            Kind::Materials => "materials",
            Kind::Assembly => "assembly",
            Kind::Trees => "trees",
        }
    }
}

/// Where a section is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// What it holds.
    pub kind: Kind,
    /// Its rows.
    pub count: u64,
    /// First byte in the file.
    pub offset: u64,
    /// Bytes, without padding.
    pub len: u64,
    /// XXH3-64 of these bytes.
    pub checksum: u64,
}

impl Entry {
    /// One past the last byte.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(self.len)
    }
}

/// The bytes of a section table.
pub(super) fn encode(entries: &[Entry]) -> Vec<u8> {
    let mut out = Vec::with_capacity(TABLE_LEN);
    for entry in entries {
        out.put_u32(entry.kind as u32);
        out.put_u32(entry.kind.row_len() as u32);
        out.put_u64(entry.count);
        out.put_u64(entry.offset);
        out.put_u64(entry.len);
        out.put_u64(entry.checksum);
    }
    out
}

/// Reads a section table, whose own offset is `table_at`. The sections follow one another up to
/// it, each at the first aligned offset, and begin where the blocks end, which the caller checks.
pub(super) fn decode(bytes: &[u8], table_at: u64) -> Result<[Entry; KINDS.len()], Malformed> {
    let mut r = ByteReader::new(bytes);
    let mut out = [Entry { kind: Kind::Directory, count: 0, offset: 0, len: 0, checksum: 0 }; KINDS.len()];
    let mut end = None;
    for (entry, kind) in out.iter_mut().zip(KINDS) {
        *entry = decode_entry(&mut r, kind).map_err(|why| of_section(kind, &why))?;
        let in_place = end.is_none_or(|end| entry.offset == aligned(end));
        ensure(in_place, "sections overlap or leave gaps")?;
        end = Some(entry.end());
    }
    ensure(end.map(aligned) == Some(table_at), "the section table is not behind the sections")?;
    r.finish()?;
    Ok(out)
}

fn decode_entry(r: &mut ByteReader, kind: Kind) -> Result<Entry, Malformed> {
    ensure(r.u32()? == kind as u32, "missing, or not in its place")?;
    ensure(r.u32()? as usize == kind.row_len(), "rows of a wrong size")?;
    let entry = Entry { kind, count: r.u64()?, offset: r.u64()?, len: r.u64()?, checksum: r.u64()? };
    let rows_len = entry.count.checked_mul(kind.row_len() as u64);
    let sizes_agree = rows_len.is_some_and(|n| if kind == Kind::Parts { n <= entry.len } else { n == entry.len });
    ensure(sizes_agree, "its size does not fit its count of rows")?;
    Ok(entry)
}

/// `why`, said of a section.
pub(super) fn of_section(kind: Kind, why: &Malformed) -> Malformed {
    Malformed::new(format!("section {}: {why}", kind.name()))
}

/// The bytes of each section, in the order of [`KINDS`], with its count of rows.
pub(super) fn encode_sections(rows: &[directory::Row], tables: &Tables) -> [(Vec<u8>, u64); KINDS.len()] {
    [
        (directory::encode(rows), rows.len() as u64),
        (sections::encode(tables.parts), tables.parts.len() as u64),
        (sections::encode(tables.materials), tables.materials.len() as u64),
        (sections::encode(tables.instances), tables.instances.len() as u64),
        (sections::encode(tables.trees), tables.trees.len() as u64),
    ]
}
