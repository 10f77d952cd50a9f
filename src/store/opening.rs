//! Opening a model file: first its outline, which states the sizes of all tables, then the tables, piece by piece, so
//! that each is in memory once.

use super::contents::{self, Entry, KINDS, Kind, TABLE_LEN, of_section};
use super::directory::{self, Row};
use super::header::{self, FOOTER_LEN, Frame, HEADER_LEN, Header, HeaderError, VERSION};
use super::parts::{Parts, Reading};
use super::proxies::{self, Collecting, Proxies, ProxyRow};
use super::reader::ModelFile;
use super::sections::{FileRow, InstanceRow, MaterialRow, Others, PartRow, PlainRow, TreeRow};
use super::source::Source;
use crate::base::bytes::{ByteReader, Malformed, ensure, is_zero};
use crate::base::error::{Error, Result};
use crate::base::memory::room;
use crate::base::progress::Cancel;
use std::io;
use std::path::Path;
use std::sync::Arc;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Greatest number of bytes of a section that are read at once.
const PIECE: usize = 256 << 10;

/// A model file of which only the header, the section table and the footer were read and checked. It states the sizes
/// of the tables, so that a caller can refuse them before they are read.
pub struct Outline {
    source: Arc<dyn Source>,
    header: Header,
    frame: Frame,
    fingerprint: u64,
    entries: [Entry; KINDS.len()],
}

/// The tables of a file.
pub(super) struct FileTables {
    pub rows: Vec<Row>,
    pub parts: Parts,
    pub materials: Vec<MaterialRow>,
    pub instances: Vec<InstanceRow>,
    pub trees: Vec<TreeRow>,
    /// Place of the parts of blocks, which are read on demand.
    pub part_sets: Entry,
    pub proxies: Proxies,
}

impl Outline {
    /// Reads the outline of the model that `source` reads.
    ///
    /// Fails with [`Error::Corrupt`] or [`Error::NewerFormat`], naming the file, or with [`Error::Io`].
    pub fn read(source: Arc<dyn Source>) -> Result<Self> {
        let file = Opening { source: &*source };
        let (header, frame, head) = file.header()?;
        file.footer(&frame, &head)?;
        let entries = file.table(&frame)?;
        Ok(Self { header, frame, fingerprint: xxh3_64(&head), entries, source })
    }

    /// The path of the file, or the name of its source.
    pub fn name(&self) -> &Path {
        self.source.name()
    }

    /// The content of the header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Number of blocks of every kind.
    pub fn block_count(&self) -> u32 {
        self.frame.blocks
    }

    /// Number of rows of a section.
    pub fn count(&self, kind: Kind) -> u64 {
        self.entry(kind).count
    }

    /// A hash over the checksums of all parts of the file: see [`ModelFile::fingerprint`].
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Greatest number of bytes of memory that the tables take.
    pub fn memory(&self) -> u64 {
        let of = |kind: Kind| {
            let Entry { count, len, .. } = *self.entry(kind);
            let rows = |bytes: usize| count.saturating_mul(bytes as u64);
            match kind {
                Kind::Directory => rows(size_of::<Row>()),
                Kind::Parts => Parts::memory(count, len.saturating_sub(rows(PartRow::LEN))),
                Kind::Materials => rows(size_of::<MaterialRow>()),
                Kind::Assembly => rows(size_of::<InstanceRow>()),
                Kind::Trees => rows(size_of::<TreeRow>()),
                // Read on demand.
                Kind::PartSets => 0,
                Kind::Proxies => {
                    let runs = len.saturating_sub(rows(ProxyRow::LEN)) / proxies::RUN_LEN as u64;
                    Proxies::memory_of(count, runs, self.header.geometry_blocks)
                }
            }
        };
        KINDS.map(of).into_iter().fold(0, u64::saturating_add)
    }

    /// Reads and checks all tables.
    ///
    /// Fails with [`Error::Corrupt`], [`Error::Io`], [`Error::Cancelled`], or with [`Error::NoMemory`] if the system
    /// has no memory for a table.
    pub fn open(self, cancel: &Cancel) -> Result<ModelFile> {
        let tables = self.tables(cancel)?;
        let Self { source, header, frame, fingerprint, entries } = self;
        Ok(ModelFile::of(source, header, (fingerprint, frame.file_len, entries[0].offset), tables))
    }

    /// Reads the tables once more and checks them against their checksums, without keeping them.
    pub fn check_tables(&self, cancel: &Cancel) -> Result<()> {
        let mut tail = self.tail(cancel)?;
        for kind in KINDS {
            tail.begin(kind);
            tail.finish()?;
        }
        Ok(())
    }

    /// Calls `each` with each block's row of the directory, and with the tree that begins with the block. Keeps none of
    /// them, and compares no checksum: for files whose tables do not fit memory. Fails with [`Error::Corrupt`],
    /// [`Error::Io`] or [`Error::Cancelled`].
    pub fn for_each_block(&self, cancel: &Cancel, mut each: impl FnMut(&Row, Option<&TreeRow>)) -> Result<()> {
        let (mut trees, mut rows) = (self.tail(cancel)?, self.tail(cancel)?);
        trees.begin(Kind::Trees);
        rows.begin(Kind::Directory);
        let mut tree = trees.plain::<TreeRow>()?;
        let mut number = 0;
        while let Some(row) = rows.plain()? {
            while tree.is_some_and(|tree| tree.block_count == 0) {
                tree = trees.plain()?;
            }
            let begins = tree.as_ref().filter(|tree| tree.first_block == number);
            each(&row, begins);
            if begins.is_some() {
                tree = trees.plain()?;
            }
            number += 1;
        }
        Ok(())
    }

    fn tables(&self, cancel: &Cancel) -> Result<FileTables> {
        let mut tail = self.tail(cancel)?;
        let rows = tail.rows::<Row>(Kind::Directory)?;
        // The materials follow the parts in the file, but parts are checked against their number only.
        let (parts, triangles) = tail.parts(self.count(Kind::Materials))?;
        let materials = tail.rows::<MaterialRow>(Kind::Materials)?;
        let instances = tail.rows::<InstanceRow>(Kind::Assembly)?;
        let trees = tail.rows::<TreeRow>(Kind::Trees)?;
        let file = self.opening();
        let others =
            Others { parts: parts.len(), triangles, materials: &materials, instances: &instances, trees: &trees };
        others.validate(&self.header).map_err(|why| file.corrupt(why))?;
        file.check_directory(&rows, &self.header, self.entries[0].offset)?;
        let part_sets = *self.entry(Kind::PartSets);
        let has_all = part_sets.count == 0 || part_sets.count == u64::from(self.header.geometry_blocks);
        file.ensure(has_all, "section parts of blocks: the number of rows differs from the number of geometry blocks")?;
        let proxies = tail.proxies(self.header.geometry_blocks)?;
        Ok(FileTables { rows, parts, materials, instances, trees, part_sets, proxies })
    }

    fn tail<'a>(&'a self, cancel: &'a Cancel) -> Result<Tail<'a>> {
        let buffer = room(PIECE, "reading the tables of a model")?;
        let (next, kind) = (self.entries[0].offset, Kind::Directory);
        Ok(Tail { file: self, cancel, next, buffer, at: 0, kind, rows_left: 0, left: 0, hash: Xxh3::new() })
    }

    fn entry(&self, kind: Kind) -> &Entry {
        &self.entries[kind as usize - 1]
    }

    fn opening(&self) -> Opening<'_> {
        Opening { source: &*self.source }
    }
}

impl std::fmt::Debug for Outline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Outline").field("name", &self.name()).field("entries", &self.entries).finish_non_exhaustive()
    }
}

/// The sections of a file, read from front to back.
struct Tail<'a> {
    file: &'a Outline,
    cancel: &'a Cancel,
    /// Offset in the file of the first byte that was not read.
    next: u64,
    /// Bytes that were read, and the offset among them of the first that was not taken.
    buffer: Vec<u8>,
    at: usize,
    /// The present section: the numbers of its rows and bytes that were not taken, and the hash of the others.
    kind: Kind,
    rows_left: u64,
    left: u64,
    hash: Xxh3,
}

impl Tail<'_> {
    /// Begins a section.
    fn begin(&mut self, kind: Kind) {
        let entry = self.file.entry(kind);
        if self.next - (self.buffer.len() - self.at) as u64 != entry.offset {
            self.next = entry.offset;
            self.buffer.clear();
            self.at = 0;
        }
        (self.kind, self.rows_left, self.left) = (kind, entry.count, entry.len);
        self.hash.reset();
    }

    /// Returns all rows of a section without texts.
    fn rows<T: PlainRow>(&mut self, kind: Kind) -> Result<Vec<T>> {
        self.begin(kind);
        let mut rows = room(usize::try_from(self.rows_left).unwrap_or(usize::MAX), kind.name())?;
        while let Some(row) = self.plain()? {
            rows.push(row);
        }
        self.finish()?;
        Ok(rows)
    }

    /// Returns the parts, and the sum of their triangles; `None` if that is too large.
    fn parts(&mut self, materials: u64) -> Result<(Parts, Option<u64>)> {
        self.begin(Kind::Parts);
        let names = self.left.saturating_sub(self.rows_left.saturating_mul(PartRow::LEN as u64));
        let mut reading = Reading::new(self.rows_left, names, materials)?;
        while self.rows_left > 0 {
            if let Err(why) = reading.push_row(self.take_row()?) {
                return Err(self.refuse(&why));
            }
        }
        if let Err(why) = reading.end_rows(names) {
            return Err(self.refuse(&why));
        }
        while self.left > 0 {
            reading.push_names(self.take_text()?);
        }
        self.finish()?;
        reading.finish()?.map_err(|why| self.refuse(&why))
    }

    /// Returns the proxies of a model of `blocks` geometry blocks.
    fn proxies(&mut self, blocks: u32) -> Result<Proxies> {
        self.begin(Kind::Proxies);
        let len = self.left.saturating_sub(self.rows_left.saturating_mul(ProxyRow::LEN as u64));
        let count = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        let mut all = Collecting::new(count(self.rows_left), count(len / proxies::RUN_LEN as u64), blocks)?;
        while self.rows_left > 0 {
            let row = ProxyRow::decode(&mut ByteReader::new(self.take_row()?));
            if let Err(why) = row.and_then(|row| all.push_row(row)) {
                return Err(self.refuse(&why));
            }
        }
        while self.left >= proxies::RUN_LEN as u64 {
            self.read_ahead(proxies::RUN_LEN)?;
            let run = proxies::decode_run(self.take(proxies::RUN_LEN));
            if let Err(why) = run.and_then(|run| all.push_run(run)) {
                return Err(self.refuse(&why));
            }
        }
        if self.left > 0 {
            return Err(self.refuse(&Malformed::new("the last run is cut off")));
        }
        match all.finish() {
            Ok(all) => self.finish().map(|()| all),
            Err(why) => Err(self.refuse(&why)),
        }
    }

    /// The next row of a section without texts, if there is one.
    fn plain<T: PlainRow>(&mut self) -> Result<Option<T>> {
        if self.rows_left == 0 {
            return Ok(None);
        }
        let row = T::decode(&mut ByteReader::new(self.take_row()?));
        row.map(Some).map_err(|why| self.refuse(&why))
    }

    /// Takes a row, which must be left.
    fn take_row(&mut self) -> Result<&[u8]> {
        let len = self.kind.row_len();
        self.read_ahead(len)?;
        self.rows_left -= 1;
        Ok(self.take(len))
    }

    /// Takes some of the section's bytes that are left, of which there must be at least one.
    fn take_text(&mut self) -> Result<&[u8]> {
        self.read_ahead(1)?;
        let most = self.buffer.len() - self.at;
        Ok(self.take(usize::try_from(self.left).map_or(most, |left| left.min(most))))
    }

    /// Takes bytes of the section that were read.
    fn take(&mut self, len: usize) -> &[u8] {
        let bytes = &self.buffer[self.at..self.at + len];
        self.hash.update(bytes);
        (self.at, self.left) = (self.at + len, self.left - len as u64);
        bytes
    }

    /// Reads on until `len` bytes, which the file must have, can be taken.
    fn read_ahead(&mut self, len: usize) -> Result<()> {
        let had = self.buffer.len() - self.at;
        if had >= len {
            return Ok(());
        }
        self.cancel.check()?;
        self.buffer.copy_within(self.at.., 0);
        let more = (self.file.frame.table_at - self.next).min((PIECE - had) as u64);
        self.buffer.resize(had + more as usize, 0);
        self.at = 0;
        self.file.opening().read(self.next, &mut self.buffer[had..])?;
        self.next += more;
        Ok(())
    }

    /// Reads the rest of the section, and checks its checksum and the padding behind it.
    fn finish(&mut self) -> Result<()> {
        while self.left > 0 {
            self.take_text()?;
        }
        let (file, entry) = (self.file.opening(), *self.file.entry(self.kind));
        let corrupt = |why: Malformed| file.corrupt(of_section(entry.kind, &why));
        ensure(self.hash.digest() == entry.checksum, "damaged (checksum mismatch)").map_err(corrupt)?;
        // The next section, or the section table, begins at the next multiple of the alignment.
        let padding = (directory::aligned(entry.end()) - entry.end()) as usize;
        self.read_ahead(padding)?;
        let is_fine = is_zero(&self.buffer[self.at..self.at + padding]);
        self.at += padding;
        ensure(is_fine, "the padding behind the section is not zero").map_err(corrupt)
    }

    /// Returns the error of a section with invalid content: a wrong checksum, unless it is right.
    fn refuse(&mut self, why: &Malformed) -> Error {
        match self.finish() {
            Ok(()) => self.file.opening().corrupt(of_section(self.kind, why)),
            Err(error) => error,
        }
    }
}

/// A file that is being opened.
#[derive(Clone, Copy)]
pub(super) struct Opening<'a> {
    pub source: &'a dyn Source,
}

impl Opening<'_> {
    pub fn corrupt(&self, why: Malformed) -> Error {
        Error::corrupt(self.source.name(), None, why.0)
    }

    fn ensure(&self, holds: bool, why: &'static str) -> Result<()> {
        ensure(holds, why).map_err(|why| self.corrupt(why))
    }

    pub fn read(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        self.source.read_at(offset, buf).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => {
                self.corrupt(Malformed::new("unexpected end of the file (was it truncated while in use?)"))
            }
            _ => Error::io(self.source.name(), "read", e),
        })
    }

    fn header(&self) -> Result<(Header, Frame, Vec<u8>)> {
        let len = self.source.len();
        let mut head = vec![0; len.min(HEADER_LEN as u64) as usize];
        self.read(0, &mut head)?;
        let (header, frame) = header::decode(&head).map_err(|e| match e {
            HeaderError::Malformed(why) => self.corrupt(why),
            HeaderError::Newer(found) => {
                Error::NewerFormat { file: self.source.name().to_path_buf(), found, supported: VERSION }
            }
        })?;
        if frame.file_len != len {
            let why = if len < frame.file_len { "truncated" } else { "unexpected bytes at the end" };
            return Err(self.corrupt(Malformed::new(format!("{why}: {len} bytes instead of {}", frame.file_len))));
        }
        Ok((header, frame, head))
    }

    fn footer(&self, frame: &Frame, head: &[u8]) -> Result<()> {
        let least = (HEADER_LEN + TABLE_LEN + FOOTER_LEN) as u64;
        self.ensure(frame.file_len >= least, "truncated")?;
        let mut footer = [0; FOOTER_LEN];
        self.read(frame.file_len - FOOTER_LEN as u64, &mut footer)?;
        self.ensure(
            footer[..] == header::encode_footer(frame.file_len, head)[..],
            "the footer is damaged or belongs to another file",
        )
    }

    fn table(&self, frame: &Frame) -> Result<[Entry; KINDS.len()]> {
        let place = frame.file_len - (TABLE_LEN + FOOTER_LEN) as u64;
        let known = frame.sections as usize == KINDS.len() && frame.table_at == place;
        self.ensure(known, "the section table is not at the expected position")?;
        let mut table = [0; TABLE_LEN];
        self.read(frame.table_at, &mut table)?;
        self.ensure(xxh3_64(&table) == frame.table_checksum, "the section table is damaged (checksum mismatch)")?;
        let entries = contents::decode(&table, frame.table_at).map_err(|why| self.corrupt(why))?;
        let [directory, ..] = &entries;
        let begins_well = directory.count == u64::from(frame.blocks) && directory.offset >= HEADER_LEN as u64;
        self.ensure(begins_well, "the directory does not match the header")?;
        Ok(entries)
    }

    /// Checks the rows, and that blocks and padding end at the directory, at `blocks_end`.
    fn check_directory(&self, rows: &[Row], header: &Header, blocks_end: u64) -> Result<()> {
        let end = directory::check(rows, header.block_size).map_err(|why| self.corrupt(why))?;
        self.ensure(directory::aligned(end) == blocks_end, "unexpected bytes between blocks and directory")
    }
}

/// For tests of rows: reads `count` rows from `bytes`, which must have no others.
#[cfg(test)]
pub(super) fn decode_rows<T: PlainRow>(bytes: &[u8], count: u64) -> crate::base::bytes::Checked<Vec<T>> {
    let len = count.checked_mul(T::LEN as u64);
    ensure(len == Some(bytes.len() as u64), "the size does not match the number of rows")?;
    bytes.chunks(T::LEN).map(|row| T::decode(&mut ByteReader::new(row))).collect()
}
