//! Model files as parts that can be changed and put together again with right checksums, whatever they hold.
//!
//! Only the frame of the file is known here: header, directory, section table and footer. (FORMAT.md, sections 2, 4, 6
//! and 7.)

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

const HEADER: usize = 256;
const ALIGN: usize = 64;
/// Bytes of a row of the section table.
const ROW: usize = 40;
const FOOTER: usize = 32;

/// A block as it is stored, and the sizes that the directory states.
#[derive(Clone)]
pub struct RawBlock {
    pub stored: Vec<u8>,
    pub payload_len: u32,
    pub decoded_len: u32,
    pub codec: u8,
}

/// A section, and zeros behind its bytes that are in no memory.
#[derive(Clone)]
pub struct RawSection {
    pub kind: u32,
    pub row_len: u32,
    pub count: u64,
    pub bytes: Vec<u8>,
    pub zeros: u64,
}

/// All of a file.
#[derive(Clone)]
pub struct Raw {
    pub header: Vec<u8>,
    pub blocks: Vec<RawBlock>,
    /// All sections but the directory.
    pub sections: Vec<RawSection>,
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

impl Raw {
    /// Takes a sound file apart.
    pub fn of(bytes: &[u8]) -> Self {
        let (table, count) = (u64_at(bytes, 24) as usize, u32_at(bytes, 40) as usize);
        let section = |i: usize| {
            let row = &bytes[table + ROW * i..][..ROW];
            let (at, len) = (u64_at(row, 16) as usize, u64_at(row, 24) as usize);
            let bytes = bytes[at..at + len].to_vec();
            RawSection { kind: u32_at(row, 0), row_len: u32_at(row, 4), count: u64_at(row, 8), bytes, zeros: 0 }
        };
        let directory = section(0);
        let block = |row: &[u8]| {
            let (at, len) = (u64_at(row, 0) as usize, u32_at(row, 8) as usize);
            let (payload_len, decoded_len, codec) = (u32_at(row, 12), u32_at(row, 16), row[20]);
            RawBlock { stored: bytes[at..at + len].to_vec(), payload_len, decoded_len, codec }
        };
        let blocks = directory.bytes.chunks(directory.row_len as usize).map(block).collect();
        Self { header: bytes[..HEADER].to_vec(), blocks, sections: (1..count).map(section).collect() }
    }

    /// The section of this kind.
    pub fn section(&mut self, kind: u32) -> &mut RawSection {
        self.sections.iter_mut().find(|section| section.kind == kind).unwrap()
    }

    /// Writes the file with right checksums. Zeros behind a section are holes.
    pub fn write(&self, path: &Path) {
        let mut out = Out { file: File::create(path).unwrap(), at: 0 };
        out.put(&self.header, 0);
        let mut directory = Vec::new();
        for block in &self.blocks {
            out.align();
            directory.extend(out.at.to_le_bytes());
            for number in [block.stored.len() as u32, block.payload_len, block.decoded_len, u32::from(block.codec)] {
                directory.extend(number.to_le_bytes());
            }
            directory.extend(xxh3_64(&block.stored).to_le_bytes());
            out.put(&block.stored, 0);
        }
        let count = self.blocks.len() as u64;
        let directory = RawSection { kind: 1, row_len: 32, count, bytes: directory, zeros: 0 };
        let mut table = Vec::new();
        for section in std::iter::once(&directory).chain(&self.sections) {
            out.align();
            table.extend([section.kind, section.row_len].map(u32::to_le_bytes).concat());
            let len = section.bytes.len() as u64 + section.zeros;
            table.extend([section.count, out.at, len, hash(section)].map(u64::to_le_bytes).concat());
            out.put(&section.bytes, section.zeros);
        }
        out.align();
        let len = out.at + (table.len() + FOOTER) as u64;
        let mut header = self.header.clone();
        put(&mut header, 16, &[len, out.at, xxh3_64(&table)].map(u64::to_le_bytes).concat());
        put(&mut header, 44, &(self.blocks.len() as u32).to_le_bytes());
        let checksum = xxh3_64(&header[..HEADER - 8]);
        put(&mut header, HEADER - 8, &checksum.to_le_bytes());
        out.put(&table, 0);
        let mut footer = b"\n\x1a\n\rRCO\x8f".to_vec();
        footer.extend([len, xxh3_64(&header)].map(u64::to_le_bytes).concat());
        footer.extend(xxh3_64(&footer).to_le_bytes());
        out.put(&footer, 0);
        out.file.seek(SeekFrom::Start(0)).unwrap();
        out.file.write_all(&header).unwrap();
    }
}

fn hash(section: &RawSection) -> u64 {
    let (mut hash, zeros) = (Xxh3::new(), vec![0; 1 << 20]);
    hash.update(&section.bytes);
    let mut left = section.zeros as usize;
    while left > 0 {
        let now = left.min(zeros.len());
        hash.update(&zeros[..now]);
        left -= now;
    }
    hash.digest()
}

struct Out {
    file: File,
    at: u64,
}

impl Out {
    fn put(&mut self, bytes: &[u8], zeros: u64) {
        self.file.seek(SeekFrom::Start(self.at)).unwrap();
        self.file.write_all(bytes).unwrap();
        self.at += bytes.len() as u64 + zeros;
    }

    fn align(&mut self) {
        let next = self.at.next_multiple_of(ALIGN as u64);
        self.put(&vec![0; (next - self.at) as usize], 0);
    }
}
