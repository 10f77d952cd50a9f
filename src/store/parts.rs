//! The parts of an opened model in little memory: fixed rows, and all names in one text (FORMAT.md, section 5).

use super::sections::{FileRow, NO_PARENT, PartRow, check_part, of_row};
use crate::base::bytes::{ByteReader, Checked, Malformed, ensure};
use crate::base::error::Result;
use crate::base::memory::room;

/// A part of an opened model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part<'a> {
    /// The caller's id.
    pub id: u64,
    /// Name in the input without characters NUL; may be empty.
    pub name: &'a str,
    /// Row of the parent, which is before this one.
    pub parent: Option<u32>,
    /// Row of the material table.
    pub material: u32,
    /// Bounds as in [`PartRow::bounds`].
    pub bounds: [f64; 6],
    /// Number of the part's own triangles in the trees.
    pub triangles: u64,
    /// See [`PartRow::flags`].
    pub flags: u32,
}

impl Part<'_> {
    /// The part as a row to be written.
    pub fn to_row(&self) -> PartRow {
        let Self { id, name, parent, material, bounds, triangles, flags } = *self;
        PartRow { id, name: name.to_owned(), parent, material, bounds, triangles, flags }
    }
}

/// The parts of an opened model.
#[derive(Debug, Default)]
pub struct Parts {
    rows: Vec<Row>,
    /// The names, each with a NUL behind it.
    names: String,
    /// The rows in the order of their ids; empty if the ids ascend from row to row.
    by_id: Vec<u32>,
}

/// A part without its name.
#[derive(Debug, Clone, Copy)]
struct Row {
    id: u64,
    triangles: u64,
    bounds: [f64; 6],
    parent: u32,
    material: u32,
    flags: u32,
    /// Offset of the name.
    name_at: usize,
}

/// What the memory of the parts is for, in errors.
const TABLE: &str = "the table of parts";

impl Parts {
    /// Greatest number of bytes that `rows` parts with `name_bytes` bytes of names take.
    pub(super) fn memory(rows: u64, name_bytes: u64) -> u64 {
        let each = (size_of::<Row>() + size_of::<u32>() + 1) as u64;
        rows.saturating_mul(each).saturating_add(name_bytes)
    }

    /// Number of parts.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True if there are no parts.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The part in row `index`, if there is one.
    #[inline]
    pub fn get(&self, index: usize) -> Option<Part<'_>> {
        let row = self.rows.get(index)?;
        let Row { id, triangles, bounds, parent, material, flags, name_at } = *row;
        // Without the NUL.
        let end = self.rows.get(index + 1).map_or(self.names.len(), |next| next.name_at).saturating_sub(1);
        let name = self.names.get(name_at..end).unwrap_or_default();
        let parent = Some(parent).filter(|&p| p != NO_PARENT);
        Some(Part { id, name, parent, material, bounds, triangles, flags })
    }

    /// The caller's id of the part in row `index`, if there is one.
    #[inline]
    pub fn id(&self, index: usize) -> Option<u64> {
        self.rows.get(index).map(|row| row.id)
    }

    /// All parts; a parent comes before its children.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Part<'_>> + Clone {
        // Each row exists.
        (0..self.len()).map(|index| self.get(index).unwrap_or(NONE))
    }

    /// The name of the part in row `index` with a NUL behind it; empty if there is no such part.
    pub fn name_and_nul(&self, index: usize) -> &str {
        let end = self.rows.get(index + 1).map_or(self.names.len(), |next| next.name_at);
        self.rows.get(index).and_then(|row| self.names.get(row.name_at..end)).unwrap_or("\0")
    }

    /// The first row with this id.
    pub fn index_of(&self, id: u64) -> Option<u32> {
        let index = if self.by_id.is_empty() {
            self.rows.partition_point(|row| row.id < id)
        } else {
            let at = self.by_id.partition_point(|&row| self.rows[row as usize].id < id);
            *self.by_id.get(at)? as usize
        };
        (self.rows.get(index)?.id == id).then_some(index as u32)
    }

    /// All parts as rows to be written.
    pub fn to_rows(&self) -> Vec<PartRow> {
        self.iter().map(|part| part.to_row()).collect()
    }
}

/// The part of a row that does not exist.
const NONE: Part =
    Part { id: 0, name: "", parent: None, material: 0, bounds: super::sections::EMPTY_BOUNDS, triangles: 0, flags: 0 };

/// Parts that are being read: all rows, then all names.
pub(super) struct Reading {
    rows: Vec<Row>,
    names: Vec<u8>,
    /// Number of materials.
    materials: u64,
    /// Number of bytes of the names, according to the rows so far.
    stated: u64,
    /// Sum of the triangles; `None` if it is too large.
    triangles: Option<u64>,
    /// The row whose name comes next, and the number of its bytes that were read.
    next: (usize, usize),
}

impl Reading {
    /// Fails with `NoMemory` if there is no memory for `rows` parts with `name_bytes` bytes of names.
    pub fn new(rows: u64, name_bytes: u64, materials: u64) -> Result<Self> {
        let count = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        let (names, rows) = (room(count(name_bytes.saturating_add(rows)), TABLE)?, room(count(rows), TABLE)?);
        Ok(Self { rows, names, materials, stated: 0, triangles: Some(0), next: (0, 0) })
    }

    /// Adds the row in `bytes`.
    pub fn push_row(&mut self, bytes: &[u8]) -> Checked<()> {
        debug_assert_eq!(bytes.len(), PartRow::LEN);
        let (index, mut r) = (self.rows.len(), ByteReader::new(bytes));
        let (id, triangles, bounds) = (r.u64()?, r.u64()?, r.f64s()?);
        let (parent, material, name_len, flags) = (r.u32()?, r.u32()?, r.u32()?, r.u32()?);
        let known = Some(parent).filter(|&p| p != NO_PARENT);
        check_part(index, known, material, &bounds, flags, self.materials)
            .map_err(|why| of_row("part", index, &why))?;
        self.stated += u64::from(name_len);
        self.triangles = self.triangles.and_then(|sum| sum.checked_add(triangles));
        // The length stands in for the offset until the name is read.
        self.rows.push(Row { id, triangles, bounds, parent, material, flags, name_at: name_len as usize });
        Ok(())
    }

    /// Fails unless the names of all rows together have `len` bytes.
    pub fn end_rows(&self, len: u64) -> Checked<()> {
        ensure(self.stated == len, "the size does not match the lengths of the names")
    }

    /// Adds the next bytes of the names.
    pub fn push_names(&mut self, mut bytes: &[u8]) {
        while let Some(row) = self.rows.get_mut(self.next.0) {
            let (len, had) = (row.name_at, self.next.1);
            let (now, rest) = bytes.split_at(bytes.len().min(len - had));
            if memchr::memchr(0, now).is_some() {
                self.names.extend(now.iter().filter(|&&byte| byte != 0));
            } else {
                self.names.extend_from_slice(now);
            }
            bytes = rest;
            if had + now.len() < len {
                self.next.1 += now.len();
                break;
            }
            self.names.push(0);
            self.next = (self.next.0 + 1, 0);
        }
    }

    /// The table, and the sum of all triangles.
    pub fn finish(mut self) -> Result<Checked<(Parts, Option<u64>)>> {
        // The last names may be empty.
        self.push_names(&[]);
        // A NUL is no part of another character, so the text is valid only if each name is.
        let Ok(names) = String::from_utf8(self.names) else { return Ok(Err(Malformed::new("a name is not UTF-8"))) };
        let mut at = 0;
        for row in &mut self.rows {
            row.name_at = at;
            at += memchr::memchr(0, &names.as_bytes()[at..]).map_or(0, |len| len + 1);
        }
        let mut by_id = Vec::new();
        if !self.rows.is_sorted_by_key(|row| row.id) {
            by_id = room(self.rows.len(), TABLE)?;
            by_id.extend(0..self.rows.len() as u32);
            // Of several parts with one id the first comes first.
            by_id.sort_unstable_by_key(|&row| (self.rows[row as usize].id, row));
        }
        Ok(Ok((Parts { rows: self.rows, names, by_id }, self.triangles)))
    }
}
