//! Encoded blocks, kept until their place in the file is known.

use super::codec::{Codec, EncodedBlock};
use super::writer::Writer;
use crate::base::error::Result;
use crate::base::memory;
use crate::base::progress::Cancel;
use crate::base::scratch::{Scratch, ScratchSpace};
use std::sync::Arc;

/// Approximate number of bytes that are read back from a scratch file at once.
const PIECE: usize = 1 << 20;

/// Blocks in the order in which they were added: in memory up to a limit, in a scratch file beyond it.
pub struct Aside {
    blocks: Vec<Kept>,
    /// Stored bytes of the last blocks, which are not yet in the scratch file.
    buffer: Vec<u8>,
    limit: usize,
    space: Arc<ScratchSpace>,
    file: Option<Scratch>,
}

/// All of a block except its stored bytes.
struct Kept {
    stored_len: u32,
    payload_len: u32,
    decoded_len: u32,
    codec: Codec,
    checksum: u64,
}

impl Aside {
    /// No blocks yet. At most `limit` bytes, and one block, will be in memory.
    pub fn new(limit: usize, space: &Arc<ScratchSpace>) -> Self {
        Self { blocks: Vec::new(), buffer: Vec::new(), limit, space: space.clone(), file: None }
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// True if there are no blocks.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Adds a block. Fails with `Io` if the scratch file cannot be written.
    pub fn push(&mut self, block: EncodedBlock) -> Result<()> {
        let EncodedBlock { stored, payload_len, decoded_len, codec, checksum } = block;
        self.blocks.push(Kept { stored_len: stored.len() as u32, payload_len, decoded_len, codec, checksum });
        self.add(&stored)
    }

    fn add(&mut self, stored: &[u8]) -> Result<()> {
        memory::make_room(&mut self.buffer, stored.len(), "encoded blocks")?;
        self.buffer.extend_from_slice(stored);
        if self.buffer.len() > self.limit {
            let file = match self.file.take() {
                Some(file) => file,
                None => self.space.file()?,
            };
            self.file.insert(file).append(&self.buffer)?;
            self.buffer.clear();
        }
        Ok(())
    }

    /// Adds all blocks of `other`, which has the same limit and scratch folder.
    pub fn append(&mut self, other: Self) -> Result<()> {
        if self.blocks.is_empty() {
            *self = other;
            return Ok(());
        }
        let mut rest = &other.blocks[..];
        if let Some(file) = &other.file {
            let (mut at, mut piece) = (0, Vec::new());
            while at < file.len() {
                let (count, len) = first_piece(rest, file.len() - at);
                let more = len.saturating_sub(piece.len());
                memory::make_room(&mut piece, more, "encoded blocks")?;
                piece.resize(len, 0);
                file.read_at(at, &mut piece)?;
                self.add(&piece)?;
                (rest, at) = (&rest[count..], at + len as u64);
            }
        }
        self.add(&other.buffer)?;
        self.blocks.extend(other.blocks);
        Ok(())
    }

    /// Writes all blocks in their order. Calls `seen` with the fraction that is written, from time to time.
    pub fn write_to(self, writer: &mut Writer, cancel: &Cancel, mut seen: impl FnMut(f64)) -> Result<()> {
        let all = self.blocks.len() as f64;
        let mut rest = &self.blocks[..];
        if let Some(file) = &self.file {
            let (mut at, mut piece) = (0, Vec::new());
            while at < file.len() {
                let (count, len) = first_piece(rest, file.len() - at);
                let more = len.saturating_sub(piece.len());
                memory::make_room(&mut piece, more, "encoded blocks")?;
                piece.resize(len, 0);
                file.read_at(at, &mut piece)?;
                let (now, later) = rest.split_at(count);
                write_all(now, &piece, writer, cancel)?;
                (rest, at) = (later, at + len as u64);
                seen(1.0 - rest.len() as f64 / all);
            }
        }
        write_all(rest, &self.buffer, writer, cancel)?;
        seen(1.0);
        Ok(())
    }
}

/// Returns the number of blocks that make about one piece, and the number of their bytes. `left`: bytes of the scratch
/// file that are not yet read; they end with a whole block.
fn first_piece(blocks: &[Kept], left: u64) -> (usize, usize) {
    let (mut count, mut len) = (0, 0);
    while count < blocks.len() && len < PIECE && (len as u64) < left {
        len += blocks[count].stored_len as usize;
        count += 1;
    }
    (count, len)
}

/// Writes blocks whose stored bytes follow one another in `bytes`.
fn write_all(blocks: &[Kept], mut bytes: &[u8], writer: &mut Writer, cancel: &Cancel) -> Result<()> {
    cancel.check()?;
    for &Kept { stored_len, payload_len, decoded_len, codec, checksum } in blocks {
        let (stored, rest) = bytes.split_at(stored_len as usize);
        bytes = rest;
        let stored = stored.to_vec();
        writer.encoded_block(EncodedBlock { stored, payload_len, decoded_len, codec, checksum })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ids::BlockId;

    #[test]
    fn blocks_come_back_in_order_from_file_and_memory() {
        let dir = tempfile::tempdir().unwrap();
        let space = ScratchSpace::new(Some(dir.path()));
        let block = |i: u32| EncodedBlock::encode(&vec![i as u8; 1 + (i as usize * 7919) % 30_000], i);
        for (limit, blocks) in [(0, 200), (100, 200), (usize::MAX, 200), (1000, 0), (1000, 1)] {
            let files = [false, true].map(|through| {
                let path = dir.path().join(format!("{through}"));
                let mut writer = Writer::create(&path).unwrap();
                let mut aside = Aside::new(limit, &space);
                for i in 0..blocks {
                    if through {
                        aside.push(block(i)).unwrap();
                    } else {
                        assert_eq!(writer.encoded_block(block(i)).unwrap(), BlockId(i));
                    }
                }
                let mut last = 0.0;
                aside.write_to(&mut writer, &Cancel::new(), |done| last = done).unwrap();
                assert_eq!(last, 1.0);
                (writer.bytes_written(), writer.rows())
            });
            assert_eq!(files[0], files[1], "{limit} {blocks}");
        }
        assert!(space.peak() > 1 << 10);
    }
}
