//! Writing a model file from front to back.

use super::codec::EncodedBlock;
use super::contents::{self, Entry, KINDS, Kind};
use super::directory::{self, Row, aligned};
use super::header::{self, FOOTER_LEN, Frame, HEADER_LEN, Header};
use super::part_sets::PartSets;
use super::proxies::Proxies;
use super::sections::{self, InstanceRow, MaterialRow, PartRow, Tables, TreeRow};
use crate::base::bytes::Malformed;
use crate::base::error::{Error, Result};
use crate::base::ids::BlockId;
use crate::base::inputs::Inputs;
use crate::base::memory;
use crate::base::output::{Medium, OutputFile};
use crate::base::progress::Cancel;
use crate::base::quota::Quota;
use std::path::Path;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Number of bytes written at once: large enough that the disk receives long sequential writes.
const BUFFER_LEN: usize = 1 << 20;

/// Writes a model under a temporary name in the same folder. [`Writer::finish`] gives it its name.
///
/// A writer that is dropped before that, or that has failed, removes the temporary, and an older file of the same name
/// is unchanged. A process that is killed leaves the temporary; the next build to the same name removes it.
pub struct Writer {
    medium: Box<dyn Medium>,
    buffer: Vec<u8>,
    /// Number of bytes written, those in the buffer included.
    at: u64,
    rows: Vec<Row>,
    part_sets: PartSets,
    proxies: Proxies,
    cancel: Cancel,
    failed: bool,
}

impl Writer {
    /// Begins the model that will be `path`.
    ///
    /// Fails with [`Error::Io`] if the folder of `path` is missing or cannot be written, or if `path` exists and is not
    /// a regular file.
    pub fn create(path: &Path) -> Result<Self> {
        Self::through(Box::new(OutputFile::create(path)?))
    }

    /// As [`Writer::create`]. The model replaces none of `inputs`: [`Writer::finish`] also fails with
    /// [`Error::BadArgument`] if `path` is one of them. Its bytes count in `quota`.
    pub fn guarded(path: &Path, inputs: &Inputs, quota: &Quota) -> Result<Self> {
        Self::through(Box::new(OutputFile::create(path)?.guarded(inputs, quota)?))
    }

    fn through(medium: Box<dyn Medium>) -> Result<Self> {
        let buffer = memory::room(BUFFER_LEN, "writing a model")?;
        let (rows, part_sets, proxies, cancel) = (Vec::new(), PartSets::default(), Proxies::default(), Cancel::new());
        let mut writer = Self { medium, buffer, at: 0, rows, part_sets, proxies, cancel, failed: false };
        // The content of the header is known last. Until then the file begins with zeros and is not a valid model.
        writer.append(&[0; HEADER_LEN])?;
        Ok(writer)
    }

    /// Compresses and appends a block; ids count up from 0.
    ///
    /// `payload`: the file form, at least one byte. `decoded_len`: number of bytes of its trace form.
    pub fn block(&mut self, payload: &[u8], decoded_len: u32) -> Result<BlockId> {
        self.encoded_block(EncodedBlock::encode(payload, decoded_len))
    }

    /// Appends a block that was compressed elsewhere; ids count up from 0.
    pub fn encoded_block(&mut self, block: EncodedBlock) -> Result<BlockId> {
        let id = u32::try_from(self.rows.len()).map_err(|_| Error::bad_argument("too many blocks in one model"))?;
        if block.payload_len == 0 {
            return Err(Error::bad_argument("a block's payload must have from 1 to 2^32 - 1 bytes"));
        }
        self.pad()?;
        self.rows.push(Row::of(&block, self.at).map_err(refuse)?);
        self.append(&block.stored)?;
        Ok(BlockId(id))
    }

    /// Sets the parts of all geometry blocks. Without this call the model has none.
    pub fn set_part_sets(&mut self, sets: PartSets) {
        self.part_sets = sets;
    }

    /// Sets the proxies. Without this call the model has none.
    pub fn set_proxies(&mut self, proxies: Proxies) {
        self.proxies = proxies;
    }

    /// Makes [`Writer::finish`] fail with [`Error::Cancelled`] once this is cancelled.
    pub fn stop_with(&mut self, cancel: &Cancel) {
        self.cancel = cancel.clone();
    }

    /// Number of bytes of the file so far.
    pub fn bytes_written(&self) -> u64 {
        self.at
    }

    /// Number of blocks so far.
    pub fn blocks_written(&self) -> u32 {
        self.rows.len() as u32
    }

    /// The directory so far.
    #[cfg(test)]
    pub(super) fn rows(&self) -> Vec<Row> {
        self.rows.clone()
    }

    /// Writes everything behind the blocks, makes the file durable and gives it its name. Returns the file's size in
    /// bytes.
    ///
    /// Fails with [`Error::BadArgument`], which names the place, if a value is outside of the range that [`Header`] or
    /// a row documents. A file that is written can therefore be opened.
    pub fn finish(
        mut self,
        header: &Header,
        parts: &[PartRow],
        materials: &[MaterialRow],
        instances: &[InstanceRow],
        trees: &[TreeRow],
    ) -> Result<u64> {
        let tables = Tables { parts, materials, instances, trees };
        header.validate().and_then(|()| tables.validate(header)).map_err(refuse)?;
        if header.block_count() != self.rows.len() as u64 {
            return Err(Error::bad_argument(format!(
                "model: {} blocks were written, but the header states {}",
                self.rows.len(),
                header.block_count()
            )));
        }
        let sets = self.part_sets.len();
        if sets != 0 && sets != header.geometry_blocks as usize {
            return Err(Error::bad_argument(format!(
                "model: there are {sets} sets of parts for {} blocks",
                header.geometry_blocks
            )));
        }
        directory::check(&self.rows, header.block_size).map_err(refuse)?;
        self.write_sections(header, &tables)?;
        self.cancel.check()?;
        self.medium.publish()?;
        Ok(self.at)
    }

    fn write_sections(&mut self, header: &Header, tables: &Tables) -> Result<()> {
        let (rows, sets) = (std::mem::take(&mut self.rows), std::mem::take(&mut self.part_sets));
        let proxies = std::mem::take(&mut self.proxies);
        let mut entries = Vec::with_capacity(KINDS.len());
        for kind in KINDS {
            entries.push(match kind {
                Kind::Directory => self.section(kind, rows.len(), |take| sections::encode(&rows, take)),
                Kind::Parts => self.section(kind, tables.parts.len(), |take| sections::encode(tables.parts, take)),
                Kind::Materials => {
                    self.section(kind, tables.materials.len(), |take| sections::encode(tables.materials, take))
                }
                Kind::Assembly => {
                    self.section(kind, tables.instances.len(), |take| sections::encode(tables.instances, take))
                }
                Kind::Trees => self.section(kind, tables.trees.len(), |take| sections::encode(tables.trees, take)),
                Kind::PartSets => self.section(kind, sets.len(), |take| sets.encode(take)),
                Kind::Proxies => self.section(kind, proxies.len(), |take| proxies.encode(take)),
            }?);
        }
        self.pad()?;
        let table = contents::encode(&entries);
        let frame = Frame {
            file_len: self.at + table.len() as u64 + FOOTER_LEN as u64,
            table_at: self.at,
            table_checksum: xxh3_64(&table),
            sections: KINDS.len() as u32,
            blocks: rows.len() as u32,
        };
        let head = header::encode(header, &frame);
        self.append(&table)?;
        self.append(&header::encode_footer(frame.file_len, &head))?;
        self.flush()?;
        self.medium.overwrite_start(&head)
    }

    /// Appends a section of `count` rows, whose bytes `encode` makes some at a time. Fails once cancelled.
    fn section(
        &mut self,
        kind: Kind,
        count: usize,
        encode: impl FnOnce(&mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()>,
    ) -> Result<Entry> {
        self.pad()?;
        let (offset, mut hash) = (self.at, Xxh3::new());
        encode(&mut |some| {
            self.cancel.check()?;
            hash.update(some);
            self.append(some)
        })?;
        Ok(Entry { kind, count: count as u64, offset, len: self.at - offset, checksum: hash.digest() })
    }

    /// Appends zeros up to the next offset at which a block or a section may begin.
    fn pad(&mut self) -> Result<()> {
        let zeros = aligned(self.at) - self.at;
        self.append(&[0; super::header::ALIGN as usize][..zeros as usize])
    }

    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        if self.failed {
            return Err(Error::BadState("writing the model failed before".into()));
        }
        memory::make_room(&mut self.buffer, bytes.len(), "writing a model")?;
        self.buffer.extend_from_slice(bytes);
        self.at += bytes.len() as u64;
        if self.buffer.len() >= BUFFER_LEN { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        let written = self.medium.append(&self.buffer);
        self.buffer.clear();
        self.failed = written.is_err();
        written
    }
}

fn refuse(why: Malformed) -> Error {
    Error::bad_argument(format!("model: {why}"))
}

#[cfg(test)]
#[path = "writer_tests.rs"]
mod tests;
