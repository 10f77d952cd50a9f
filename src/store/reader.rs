//! Opening a model file and reading its blocks.

use super::codec;
use super::contents::{self, Entry, KINDS, Kind, TABLE_LEN, of_section};
use super::directory::{self, Row};
use super::header::{self, FOOTER_LEN, Frame, HEADER_LEN, Header, HeaderError, VERSION};
use super::part_sets::PartSets;
use super::sections::{self, InstanceRow, MaterialRow, PartRow, Tables, TreeRow};
use super::source::{FileSource, Source};
use crate::base::bytes::{Checked, Malformed, ensure, is_zero};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::progress::{Cancel, Progress};
use std::io;
use std::path::Path;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// Maximum number of bytes that are read at once, so that a false size leads to a failed read before it takes much
/// memory.
const READ_STEP: usize = 4 << 20;

/// An opened model file. All of it except its blocks is in memory and has been checked. It is immutable; any number of
/// threads read from it at once.
pub struct ModelFile {
    source: Arc<dyn Source>,
    header: Header,
    fingerprint: u64,
    file_len: u64,
    /// Offset of the directory. Header, blocks and padding are before it.
    blocks_end: u64,
    rows: Vec<Row>,
    parts: Vec<PartRow>,
    materials: Vec<MaterialRow>,
    instances: Vec<InstanceRow>,
    trees: Vec<TreeRow>,
    /// Place of the parts of blocks, which are read on demand, and the offset of the section table behind them.
    part_sets: Entry,
    table_at: u64,
}

/// Result of [`ModelFile::check`] for an intact file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CheckReport {
    /// Number of bytes of the file, all of which were checked.
    pub bytes: u64,
    /// Number of blocks that were read and decompressed.
    pub blocks: u32,
    /// Number of bytes of all payloads.
    pub payload_bytes: u64,
    /// Number of bytes of all trace forms, according to the directory.
    pub decoded_bytes: u64,
}

impl ModelFile {
    /// Opens the model that `source` reads.
    ///
    /// Reads and checks the header, directory, sections and footer; blocks are checked when they are read. Fails with
    /// [`Error::Corrupt`] or [`Error::NewerFormat`], naming the file, or with [`Error::Io`]. The memory it takes is
    /// proportional to the bytes that were read, whatever sizes the file claims.
    pub fn open(source: Arc<dyn Source>) -> Result<Self> {
        let file = Opening { source: &*source };
        let (header, frame, head) = file.header()?;
        file.footer(&frame, &head)?;
        let entries = file.table(&frame)?;
        let blocks_end = entries[0].offset;
        let tail = file.sections(&entries)?;
        let bytes = |kind: Kind| section(&tail, &entries, blocks_end, kind);
        let damaged = |kind| move |why| file.corrupt(of_section(kind, &why));
        let rows = directory::decode(bytes(Kind::Directory).0).map_err(damaged(Kind::Directory))?;
        let parts = decode_rows(bytes(Kind::Parts)).map_err(damaged(Kind::Parts))?;
        let materials = decode_rows(bytes(Kind::Materials)).map_err(damaged(Kind::Materials))?;
        let instances = decode_rows(bytes(Kind::Assembly)).map_err(damaged(Kind::Assembly))?;
        let trees = decode_rows(bytes(Kind::Trees)).map_err(damaged(Kind::Trees))?;
        let tables = Tables { parts: &parts, materials: &materials, instances: &instances, trees: &trees };
        tables.validate(&header).map_err(|why| file.corrupt(why))?;
        file.check_directory(&rows, &header, blocks_end)?;
        let (fingerprint, file_len, table_at) = (xxh3_64(&head), frame.file_len, frame.table_at);
        let [.., part_sets] = entries;
        let has_all = part_sets.count == 0 || part_sets.count == u64::from(header.geometry_blocks);
        file.ensure(has_all, "section parts of blocks: the number of rows differs from the number of geometry blocks")?;
        Ok(Self {
            source,
            header,
            fingerprint,
            file_len,
            blocks_end,
            rows,
            parts,
            materials,
            instances,
            trees,
            part_sets,
            table_at,
        })
    }

    /// [`ModelFile::open`] for a path of the file system.
    pub fn open_path(path: impl AsRef<Path>) -> Result<Self> {
        Self::open(Arc::new(FileSource::open(path)?))
    }

    /// The path of the file, or the name of its source.
    pub fn name(&self) -> &Path {
        self.source.name()
    }
    /// Number of bytes of the file.
    pub fn file_len(&self) -> u64 {
        self.file_len
    }
    /// A hash over the checksums of all parts of the file: files that differ in any byte have different fingerprints.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }
    /// The content of the header.
    pub fn header(&self) -> &Header {
        &self.header
    }
    /// All parts; a parent comes before its children.
    pub fn parts(&self) -> &[PartRow] {
        &self.parts
    }
    /// All materials.
    pub fn materials(&self) -> &[MaterialRow] {
        &self.materials
    }
    /// All instances of shared meshes.
    pub fn instances(&self) -> &[InstanceRow] {
        &self.instances
    }
    /// All trees.
    pub fn trees(&self) -> &[TreeRow] {
        &self.trees
    }

    /// Number of blocks of every kind; the ids are `0..block_count()`.
    pub fn block_count(&self) -> u32 {
        self.rows.len() as u32
    }
    /// The directory.
    pub fn directory(&self) -> &[Row] {
        &self.rows
    }
    /// Number of bytes of the block's trace form; 0 if there is no such block.
    pub fn decoded_len(&self, id: BlockId) -> u32 {
        self.rows.get(id.0 as usize).map_or(0, |row| row.decoded_len)
    }
    /// Id of the block with the primitive ids of geometry block `id`.
    pub fn prim_block(&self, id: BlockId) -> BlockId {
        BlockId(self.header.geometry_blocks + id.0)
    }
    /// Id of the block with the colours of geometry block `id`, if the model has colours.
    pub fn colour_block(&self, id: BlockId) -> Option<BlockId> {
        self.header.has_colours.then(|| BlockId(2 * self.header.geometry_blocks + id.0))
    }

    /// Greatest number of bytes that [`ModelFile::part_sets`] takes while it reads; half of them stay.
    pub fn part_sets_memory(&self) -> u64 {
        2 * self.part_sets.len
    }

    /// Reads and checks the parts of blocks. Fails with [`Error::Io`] or [`Error::Corrupt`].
    pub fn part_sets(&self) -> Result<PartSets> {
        let file = self.opening();
        let bytes = file.read_vec(self.part_sets.offset, self.table_at - self.part_sets.offset)?;
        let bytes = file.intact(&self.part_sets, &bytes)?;
        let tree_of =
            |block: usize| self.trees.partition_point(|tree| tree.first_block as usize <= block).checked_sub(1);
        let most = |block: usize| tree_of(block).map_or(0, |tree| self.trees[tree].local_parts);
        let sets = PartSets::decode(bytes, self.part_sets.count, most);
        sets.map_err(|why| file.corrupt(of_section(Kind::PartSets, &why)))
    }

    /// Number of bytes of memory that the directory and the tables take.
    pub fn memory(&self) -> u64 {
        let names: usize = self.parts.iter().map(|part| part.name.capacity()).sum();
        let tables = size_of_val(&self.rows[..])
            + size_of_val(&self.parts[..])
            + size_of_val(&self.materials[..])
            + size_of_val(&self.instances[..])
            + size_of_val(&self.trees[..]);
        (names + tables) as u64
    }

    /// Reads a block, checks it, and replaces the content of `out` by its payload. `scratch` is working memory, reused
    /// between calls.
    ///
    /// Fails with [`Error::Corrupt`], naming file and block, if the block is damaged, with [`Error::Io`] if it cannot
    /// be read, and with [`Error::BadArgument`] if there is no such block. The content of `out` is then undefined.
    pub fn read_block(&self, id: BlockId, scratch: &mut Vec<u8>, out: &mut Vec<u8>) -> Result<()> {
        let row = self.rows.get(id.0 as usize).ok_or_else(|| Error::bad_argument("no such block"))?;
        scratch.resize(row.stored_len as usize, 0);
        self.opening().read(row.offset, scratch)?;
        open_block(row, scratch, out).map_err(|why| self.damaged_block(id, why.to_string()))
    }

    /// Reads the stored bytes of blocks `first` to `last`, with the padding between them, and replaces the content of
    /// `out` by them.
    ///
    /// Fails with [`Error::Io`], with [`Error::Corrupt`] if the file ends earlier, or with [`Error::BadArgument`] if
    /// there are no such blocks. The content of `out` is then undefined.
    pub fn read_stored(&self, first: BlockId, last: BlockId, out: &mut Vec<u8>) -> Result<()> {
        let rows = self.rows.get(first.0 as usize..=last.0 as usize).unwrap_or_default();
        let [front, ..] = rows else { return Err(Error::bad_argument("no such blocks")) };
        let end = rows.last().map_or(0, Row::end);
        out.resize((end - front.offset) as usize, 0);
        self.opening().read(front.offset, out)
    }

    /// Checks block `id` in the bytes that [`ModelFile::read_stored`] read from block `first` on, and replaces the
    /// content of `out` by its payload. Fails like [`ModelFile::read_block`].
    pub fn open_stored(&self, id: BlockId, first: BlockId, stored: &[u8], out: &mut Vec<u8>) -> Result<()> {
        let row = |id: BlockId| self.rows.get(id.0 as usize).ok_or_else(|| Error::bad_argument("no such block"));
        let (row, front) = (row(id)?, row(first)?);
        let at = row.offset.checked_sub(front.offset).and_then(|at| usize::try_from(at).ok());
        let bytes = at.and_then(|at| stored.get(at..)?.get(..row.stored_len as usize));
        let bytes = bytes.ok_or_else(|| Error::bad_argument("the block is not among those that were read"))?;
        open_block(row, bytes, out).map_err(|why| self.damaged_block(id, why.to_string()))
    }

    /// Reads the file once more from front to back and checks every byte: checksums and sizes of blocks, sections and
    /// footer, and that padding is zero. Reports its progress, and stops within some milliseconds once cancelled.
    ///
    /// Continues after a damaged block, so that the error can give the number of damaged blocks; it names the first.
    pub fn check(&self, progress: &Progress, cancel: &Cancel) -> Result<CheckReport> {
        let again = Self::open(self.source.clone())?;
        let same = ensure(again.fingerprint == self.fingerprint, "the file was replaced after it was opened");
        same.map_err(|why| self.opening().corrupt(why))?;
        self.part_sets()?;
        let (mut buffer, mut payload) = (Vec::new(), Vec::new());
        let mut damage: Option<(BlockId, Malformed)> = None;
        let mut damaged = 0u32;
        let mut first = 0;
        while first < self.rows.len() {
            cancel.check()?;
            let last = self.run_from(first);
            let (start, end) = (self.rows[first].offset, self.padded_end(last));
            buffer.resize((end - start) as usize, 0);
            self.opening().read(start, &mut buffer)?;
            for i in first..=last {
                if let Err(why) = self.check_block(i, &buffer, start, &mut payload) {
                    damaged += 1;
                    damage.get_or_insert((BlockId(i as u32), why));
                }
            }
            progress.bytes_read.fetch_add(end - start, std::sync::atomic::Ordering::Relaxed);
            progress.advance(end as f64 / self.file_len as f64);
            first = last + 1;
        }
        if let Some((id, why)) = damage {
            let more = if damaged > 1 { format!(" ({} more blocks are damaged)", damaged - 1) } else { String::new() };
            return Err(self.damaged_block(id, format!("{why}{more}")));
        }
        progress.advance(1.0);
        Ok(self.report())
    }

    /// Returns the last block of the run from `first` on that is read at once.
    fn run_from(&self, first: usize) -> usize {
        let limit = self.rows[first].offset + READ_STEP as u64;
        let together = self.rows[first + 1..].iter().take_while(|row| row.end() <= limit).count();
        first + together
    }

    /// Offset of the block behind block `index`, or of the directory behind the last one.
    fn padded_end(&self, index: usize) -> u64 {
        self.rows.get(index + 1).map_or(self.blocks_end, |next| next.offset)
    }

    /// Checks a block and the padding behind it in `buffer`, which begins at offset `start`.
    fn check_block(&self, index: usize, buffer: &[u8], start: u64, payload: &mut Vec<u8>) -> Checked<()> {
        let row = &self.rows[index];
        let range = (row.offset - start) as usize..(self.padded_end(index) - start) as usize;
        let (stored, padding) = buffer[range].split_at(row.stored_len as usize);
        open_block(row, stored, payload)?;
        ensure(is_zero(padding), "the padding behind the block is not zero")
    }

    fn report(&self) -> CheckReport {
        CheckReport {
            bytes: self.file_len,
            blocks: self.block_count(),
            payload_bytes: self.rows.iter().map(|row| u64::from(row.payload_len)).sum(),
            decoded_bytes: self.rows.iter().map(|row| u64::from(row.decoded_len)).sum(),
        }
    }

    fn opening(&self) -> Opening<'_> {
        Opening { source: &*self.source }
    }

    fn damaged_block(&self, id: BlockId, why: String) -> Error {
        Error::corrupt(self.name(), Some(id.0), why)
    }
}

impl std::fmt::Debug for ModelFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelFile").field("name", &self.name()).field("header", &self.header).finish_non_exhaustive()
    }
}

/// Makes the payload of a block from its stored bytes.
fn open_block(row: &Row, stored: &[u8], out: &mut Vec<u8>) -> Checked<()> {
    ensure(xxh3_64(stored) == row.checksum, "damaged (checksum mismatch)")?;
    codec::decode(row.codec, stored, row.payload_len, out)
}

/// Returns the bytes of a section and its number of rows. `tail` begins at offset `tail_at` and contains all sections.
fn section<'a>(tail: &'a [u8], entries: &[Entry], tail_at: u64, kind: Kind) -> (&'a [u8], u64) {
    let entry = entries.iter().find(|entry| entry.kind == kind);
    entry.map_or((&[], 0), |e| (&tail[(e.offset - tail_at) as usize..(e.end() - tail_at) as usize], e.count))
}

fn decode_rows<T: sections::FileRow>((bytes, count): (&[u8], u64)) -> Checked<Vec<T>> {
    sections::decode(bytes, count)
}

/// A file that is being opened.
#[derive(Clone, Copy)]
struct Opening<'a> {
    source: &'a dyn Source,
}

impl Opening<'_> {
    fn corrupt(&self, why: Malformed) -> Error {
        Error::corrupt(self.source.name(), None, why.0)
    }

    fn ensure(&self, holds: bool, why: &'static str) -> Result<()> {
        ensure(holds, why).map_err(|why| self.corrupt(why))
    }

    fn read(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        self.source.read_at(offset, buf).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => {
                self.corrupt(Malformed::new("unexpected end of the file (was it truncated while in use?)"))
            }
            _ => Error::io(self.source.name(), "read", e),
        })
    }

    /// Reads `len` bytes in steps, so that memory grows only with bytes that exist.
    fn read_vec(&self, offset: u64, len: u64) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        while (out.len() as u64) < len {
            let (have, step) = (out.len(), (len - out.len() as u64).min(READ_STEP as u64) as usize);
            let no_memory = |_| Error::io(self.source.name(), "read", io::ErrorKind::OutOfMemory.into());
            out.try_reserve(step).map_err(no_memory)?;
            out.resize(have + step, 0);
            self.read(offset + have as u64, &mut out[have..])?;
        }
        Ok(out)
    }

    fn header(&self) -> Result<(Header, Frame, Vec<u8>)> {
        let len = self.source.len();
        let head = self.read_vec(0, len.min(HEADER_LEN as u64))?;
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
        let footer = self.read_vec(frame.file_len - FOOTER_LEN as u64, FOOTER_LEN as u64)?;
        self.ensure(
            footer == header::encode_footer(frame.file_len, head),
            "the footer is damaged or belongs to another file",
        )
    }

    fn table(&self, frame: &Frame) -> Result<[Entry; KINDS.len()]> {
        let place = frame.file_len - (TABLE_LEN + FOOTER_LEN) as u64;
        let known = frame.sections as usize == KINDS.len() && frame.table_at == place;
        self.ensure(known, "the section table is not at the expected position")?;
        let table = self.read_vec(frame.table_at, TABLE_LEN as u64)?;
        self.ensure(xxh3_64(&table) == frame.table_checksum, "the section table is damaged (checksum mismatch)")?;
        let entries = contents::decode(&table, frame.table_at).map_err(|why| self.corrupt(why))?;
        let [directory, ..] = &entries;
        let begins_well = directory.count == u64::from(frame.blocks) && directory.offset >= HEADER_LEN as u64;
        self.ensure(begins_well, "the directory does not match the header")?;
        Ok(entries)
    }

    /// Returns the bytes of a section out of `bytes`, which also hold the padding behind it; checks checksum and
    /// padding.
    fn intact<'a>(&self, entry: &Entry, bytes: &'a [u8]) -> Result<&'a [u8]> {
        let (bytes, padding) = bytes.split_at(entry.len as usize);
        let intact = ensure(xxh3_64(bytes) == entry.checksum, "damaged (checksum mismatch)")
            .and_then(|()| ensure(is_zero(padding), "the padding behind the section is not zero"));
        intact.map_err(|why| self.corrupt(of_section(entry.kind, &why)))?;
        Ok(bytes)
    }

    /// Reads everything from the directory up to the parts of blocks, and checks checksums and padding.
    fn sections(&self, entries: &[Entry; KINDS.len()]) -> Result<Vec<u8>> {
        let start = entries[0].offset;
        let [before @ .., last] = entries;
        let tail = self.read_vec(start, last.offset - start)?;
        let at = |offset: u64| (offset - start) as usize;
        for (i, entry) in before.iter().enumerate() {
            self.intact(entry, &tail[at(entry.offset)..at(entries[i + 1].offset)])?;
        }
        Ok(tail)
    }

    /// Checks the rows, and that blocks and padding end at the directory, at `blocks_end`.
    fn check_directory(&self, rows: &[Row], header: &Header, blocks_end: u64) -> Result<()> {
        let end = directory::check(rows, header.block_size).map_err(|why| self.corrupt(why))?;
        self.ensure(directory::aligned(end) == blocks_end, "unexpected bytes between blocks and directory")
    }
}
