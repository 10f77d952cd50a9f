//! Opening a model file and reading its blocks.

use super::codec;
use super::contents::{Entry, Kind, of_section};
use super::directory::Row;
use super::header::Header;
use super::opening::{FileTables, Opening, Outline};
use super::part_sets::PartSets;
use super::parts::Parts;
use super::proxies::Proxies;
use super::sections::{InstanceRow, MaterialRow, TreeRow};
use super::source::{FileSource, Source};
use crate::base::bytes::{Checked, Malformed, ensure, is_zero};
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::memory::zeroed;
use crate::base::progress::{Cancel, Progress};
use std::path::Path;
use std::sync::Arc;
use xxhash_rust::xxh3::xxh3_64;

/// Greatest number of bytes that a check reads at once.
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
    parts: Parts,
    materials: Vec<MaterialRow>,
    instances: Vec<InstanceRow>,
    trees: Vec<TreeRow>,
    /// Place of the parts of blocks, which are read on demand.
    part_sets: Entry,
    proxies: Proxies,
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
    /// [`Error::Corrupt`] or [`Error::NewerFormat`], naming the file, or with [`Error::Io`]. Takes as much memory as
    /// the tables of the file need; [`Outline`] states that before they are read.
    pub fn open(source: Arc<dyn Source>) -> Result<Self> {
        Outline::read(source)?.open(&Cancel::new())
    }

    /// The file with this outline and its checked tables. `frame`: fingerprint, length, and offset of the directory.
    pub(super) fn of(source: Arc<dyn Source>, header: Header, frame: (u64, u64, u64), tables: FileTables) -> Self {
        let (fingerprint, file_len, blocks_end) = frame;
        let FileTables { rows, parts, materials, instances, trees, part_sets, proxies } = tables;
        Self {
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
            proxies,
        }
    }

    /// [`ModelFile::open`] for a path of the file system.
    pub fn open_path(path: impl AsRef<Path>) -> Result<Self> {
        Self::open(Arc::new(FileSource::open(path)?))
    }

    /// The path of the file, or the name of its source.
    pub fn name(&self) -> &Path {
        self.source.name()
    }
    /// The absolute path of the file; `None` if its source is none.
    pub fn path(&self) -> Option<&Path> {
        self.source.path()
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
    pub fn parts(&self) -> &Parts {
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

    /// All proxies, and the nodes that show them.
    pub fn proxies(&self) -> &Proxies {
        &self.proxies
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
        self.header.colours_at().map(|at| BlockId(at + id.0))
    }
    /// Id of the block with the normals of geometry block `id`, if the model has normals.
    pub fn normal_block(&self, id: BlockId) -> Option<BlockId> {
        self.header.normals_at().map(|at| BlockId(at + id.0))
    }

    /// Greatest number of bytes that [`ModelFile::part_sets`] takes while it reads. [`PartSets::memory`] of them stay.
    pub fn part_sets_memory(&self) -> u64 {
        self.part_sets.len.saturating_mul(2)
    }

    /// Reads and checks the parts of blocks. Fails with [`Error::Io`], [`Error::Corrupt`] or [`Error::NoMemory`].
    pub fn part_sets(&self) -> Result<PartSets> {
        let (file, entry) = (self.opening(), &self.part_sets);
        let len = usize::try_from(entry.len).unwrap_or(usize::MAX);
        let mut bytes = zeroed(len, "the parts of blocks")?;
        file.read(entry.offset, &mut bytes)?;
        let tree_of =
            |block: usize| self.trees.partition_point(|tree| tree.first_block as usize <= block).checked_sub(1);
        let most = |block: usize| tree_of(block).map_or(0, |tree| self.trees[tree].local_parts);
        let fail = |why: Malformed| file.corrupt(of_section(Kind::PartSets, &why));
        ensure(xxh3_64(&bytes) == entry.checksum, "damaged (checksum mismatch)").map_err(fail)?;
        PartSets::decode(&bytes, entry.count, most)?.map_err(fail)
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
        let again = Outline::read(self.source.clone())?;
        let same = ensure(again.fingerprint() == self.fingerprint, "the file was replaced after it was opened");
        same.map_err(|why| self.opening().corrupt(why))?;
        again.check_tables(cancel)?;
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
