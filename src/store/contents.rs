//! The section table, which lists the sections behind the blocks (FORMAT.md, sections 5 and 6).

use super::directory::{self, aligned};
use super::part_sets;
use super::proxies::ProxyRow;
use super::sections::{FileRow, InstanceRow, MaterialRow, PartRow, TreeRow};
use crate::base::bytes::{ByteReader, Malformed, PutBytes, ensure};

/// The content of a section. The numbers are those of the file. Each file has one section of each kind, in this order.
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
    /// Parts of blocks.
    PartSets = 6,
    /// Proxies.
    Proxies = 7,
}

/// All kinds in their order in the file.
pub const KINDS: [Kind; 7] =
    [Kind::Directory, Kind::Parts, Kind::Materials, Kind::Assembly, Kind::Trees, Kind::PartSets, Kind::Proxies];
/// Number of bytes of a row of the section table.
pub const ROW_LEN: usize = 40;
/// Number of bytes of the section table.
pub const TABLE_LEN: usize = KINDS.len() * ROW_LEN;

impl Kind {
    /// Number of bytes of a row of a section of this kind.
    pub fn row_len(self) -> usize {
        match self {
            Kind::Directory => directory::ROW_LEN,
            Kind::Parts => PartRow::LEN,
            Kind::Materials => MaterialRow::LEN,
            Kind::Assembly => InstanceRow::LEN,
            Kind::Trees => TreeRow::LEN,
            Kind::PartSets => part_sets::ROW_LEN,
            Kind::Proxies => ProxyRow::LEN,
        }
    }
    /// True if bytes follow the rows of a section of this kind.
    fn has_tail(self) -> bool {
        matches!(self, Kind::Parts | Kind::PartSets | Kind::Proxies)
    }
    /// The name of the kind, for messages.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Directory => "directory",
            Kind::Parts => "parts",
            Kind::Materials => "materials",
            Kind::Assembly => "assembly",
            Kind::Trees => "trees",
            Kind::PartSets => "parts of blocks",
            Kind::Proxies => "proxies",
        }
    }
}

/// A row of the section table: the place of one section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Content of the section.
    pub kind: Kind,
    /// Number of its rows.
    pub count: u64,
    /// Offset of its first byte in the file.
    pub offset: u64,
    /// Number of its bytes, without padding.
    pub len: u64,
    /// XXH3-64 of these bytes.
    pub checksum: u64,
}

impl Entry {
    /// Offset one past the last byte.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(self.len)
    }
}

/// Returns the bytes of a section table.
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

/// Reads a section table that begins at offset `table_at` of the file. Each section begins at the first aligned offset
/// behind the one before it, and the table behind the last one. The caller checks that the first section begins behind
/// the blocks.
pub(super) fn decode(bytes: &[u8], table_at: u64) -> Result<[Entry; KINDS.len()], Malformed> {
    let mut r = ByteReader::new(bytes);
    let mut out = [Entry { kind: Kind::Directory, count: 0, offset: 0, len: 0, checksum: 0 }; KINDS.len()];
    let mut end = None;
    for (entry, kind) in out.iter_mut().zip(KINDS) {
        *entry = decode_entry(&mut r, kind).map_err(|why| of_section(kind, &why))?;
        let in_place = end.is_none_or(|end| entry.offset == aligned(end));
        ensure(in_place, "there are gaps or overlaps between sections")?;
        end = Some(entry.end());
    }
    ensure(end.map(aligned) == Some(table_at), "the section table does not follow the sections")?;
    r.finish()?;
    Ok(out)
}

fn decode_entry(r: &mut ByteReader, kind: Kind) -> Result<Entry, Malformed> {
    ensure(r.u32()? == kind as u32, "missing or out of order")?;
    ensure(r.u32()? as usize == kind.row_len(), "wrong row size")?;
    let entry = Entry { kind, count: r.u64()?, offset: r.u64()?, len: r.u64()?, checksum: r.u64()? };
    let rows_len = entry.count.checked_mul(kind.row_len() as u64);
    let sizes_agree = rows_len.is_some_and(|n| if kind.has_tail() { n <= entry.len } else { n == entry.len });
    ensure(sizes_agree, "the size does not match the number of rows")?;
    Ok(entry)
}

/// Returns `why` with the name of the section in front.
pub(super) fn of_section(kind: Kind, why: &Malformed) -> Malformed {
    Malformed::new(format!("section {}: {why}", kind.name()))
}
