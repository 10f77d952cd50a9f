//! Bytes of buffers: in the GLB, in `data:` URIs, in files next to the document.

use super::container::Document;
use crate::base::error::{Error, Place, Result};
use crate::base::progress::Cancel;
use crate::import::input::{Input, Parsed};
use ::gltf::json::{Root, buffer};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use std::path::{Path, PathBuf};

/// Storage of a buffer's bytes.
enum Bytes {
    /// A range of the glTF file itself: offset and length.
    Here(u64, u64),
    Memory(Vec<u8>),
    File(Input),
}

impl Bytes {
    fn len(&self) -> u64 {
        match self {
            Bytes::Here(_, len) => *len,
            Bytes::Memory(bytes) => bytes.len() as u64,
            Bytes::File(input) => input.total(),
        }
    }
}

/// All buffers of a document, opened at first use.
pub(crate) struct Buffers<'a> {
    input: &'a mut Input,
    binary: Option<(u64, u64)>,
    opened: Vec<Option<Bytes>>,
    cancel: Cancel,
    /// Number of bytes read so far. Progress reports limit it to the size of the file and its buffers.
    read: u64,
}

/// A range of a buffer, checked to be inside of it.
#[derive(Clone, Copy)]
pub(crate) struct Range {
    buffer: usize,
    offset: u64,
    len: u64,
}

impl Range {
    pub(crate) fn len(&self) -> u64 {
        self.len
    }
    /// Returns the `len` bytes from `at`, if they are inside the range.
    pub(crate) fn part(&self, at: u64, len: u64) -> Option<Range> {
        let end = at.checked_add(len)?;
        (end <= self.len).then_some(Range { buffer: self.buffer, offset: self.offset + at, len })
    }
}

impl<'a> Buffers<'a> {
    /// Creates the unopened buffers of a document. `cancel` is checked before each read.
    pub(crate) fn new(input: &'a mut Input, document: &Document, cancel: Cancel) -> Self {
        let opened = document.root.buffers.iter().map(|_| None).collect();
        Self { input, binary: document.binary, opened, cancel, read: 0 }
    }

    pub(crate) fn path(&self) -> &Path {
        self.input.path()
    }

    /// Size of the file in bytes.
    pub(crate) fn total(&self) -> u64 {
        self.input.total()
    }

    /// Returns the bytes read so far and the total of the file and the buffers opened so far.
    pub(crate) fn progress(&self) -> (u64, u64) {
        let total = self.input.total()
            + self
                .opened
                .iter()
                .flatten()
                .map(|b| match b {
                    Bytes::File(input) => input.total(),
                    _ => 0,
                })
                .sum::<u64>();
        (self.read.min(total), total)
    }

    /// Returns the range and the stride of a buffer view.
    pub(crate) fn view(&mut self, root: &Root, index: usize) -> Parsed<(Range, Option<u64>)> {
        let Some(view) = root.buffer_views.get(index) else {
            return Err(format!("bufferViews[{index}] does not exist (there are {})", root.buffer_views.len()).into());
        };
        let buffer = view.buffer.value();
        let Some(described) = root.buffers.get(buffer) else {
            return Err(format!("buffers[{buffer}] does not exist (there are {})", root.buffers.len()).into());
        };
        let there = self.open(buffer, described)?;
        let announced = described.byte_length.0;
        if there < announced {
            return Err(format!("buffers[{buffer}] has only {there} of the {announced} bytes of its byteLength").into());
        }
        let whole = Range { buffer, offset: 0, len: announced };
        let (offset, len) = (view.byte_offset.map_or(0, |o| o.0), view.byte_length.0);
        match whole.part(offset, len) {
            Some(range) => Ok((range, view.byte_stride.map(|s| s.0 as u64))),
            None => Err(format!(
                "bufferViews[{index}] ends outside of buffers[{buffer}] ({len} bytes from {offset} of {announced})"
            )
            .into()),
        }
    }

    /// Fills `out` from `range`, which has the same length.
    pub(crate) fn read(&mut self, range: Range, out: &mut [u8]) -> Parsed<()> {
        debug_assert_eq!(range.len, out.len() as u64);
        self.cancel.check()?;
        let there = match &mut self.opened[range.buffer] {
            Some(Bytes::Here(start, _)) => {
                let at = *start + range.offset;
                self.input.read_range(at, out)?
            }
            Some(Bytes::Memory(bytes)) => {
                let from = bytes.get(range.offset as usize..).and_then(|b| b.get(..out.len()));
                from.map(|from| out.copy_from_slice(from)).is_some()
            }
            Some(Bytes::File(input)) => input.read_range(range.offset, out)?,
            None => false,
        };
        self.read += out.len() as u64;
        if there { Ok(()) } else { Err(format!("buffers[{}] became shorter while being read", range.buffer).into()) }
    }

    /// Opens a buffer if necessary. Returns its size in bytes.
    fn open(&mut self, index: usize, buffer: &buffer::Buffer) -> Parsed<u64> {
        if let Some(bytes) = &self.opened[index] {
            return Ok(bytes.len());
        }
        let bytes = match (&buffer.uri, self.binary) {
            (Some(uri), _) => match data_uri(uri) {
                Some(bytes) => Bytes::Memory(bytes.map_err(|why| format!("buffers[{index}]: {why}"))?),
                None => Bytes::File(Input::open(&self.beside(uri)?)?),
            },
            (None, Some((start, len))) if index == 0 => Bytes::Here(start, len),
            (None, _) => return Err(format!("buffers[{index}] has no uri, and the file has no binary chunk").into()),
        };
        let len = bytes.len();
        self.opened[index] = Some(bytes);
        Ok(len)
    }

    /// Returns the bytes of an image's URI.
    pub(crate) fn uri(&self, uri: &str) -> Parsed<Vec<u8>> {
        match data_uri(uri) {
            Some(bytes) => Ok(bytes?),
            None => {
                let mut input = Input::open(&self.beside(uri)?)?;
                let mut bytes = vec![0; input.total() as usize];
                if !input.read_range(0, &mut bytes)? {
                    return Err("the file became shorter while being read".into());
                }
                Ok(bytes)
            }
        }
    }

    /// Returns the path for a relative URI. Absolute paths and other schemes are errors.
    fn beside(&self, uri: &str) -> Result<PathBuf> {
        let name = percent_decoded(uri).replace('\\', "/");
        let scheme = name.split('/').next().is_some_and(|first| first.contains(':'));
        if scheme || Path::new(&name).is_absolute() || name.is_empty() {
            let why =
                format!("\"{}\" is not a path relative to the document", uri.chars().take(80).collect::<String>());
            return Err(Error::parse(self.input.path(), Place::File, why));
        }
        Ok(self.input.path().parent().unwrap_or(Path::new("")).join(name))
    }
}

/// Returns the bytes in a `data:` URI, or `None` for other kinds of URI.
fn data_uri(uri: &str) -> Option<std::result::Result<Vec<u8>, String>> {
    let rest = uri.strip_prefix("data:")?;
    let Some((kind, data)) = rest.split_once(',') else { return Some(Err("a data URI without a comma".into())) };
    if !kind.ends_with(";base64") {
        return Some(Ok(percent_bytes(data)));
    }
    let data = data.trim_end_matches('=');
    Some(STANDARD_NO_PAD.decode(data).map_err(|e| format!("an invalid data URI: {e}")))
}

fn percent_decoded(text: &str) -> String {
    String::from_utf8_lossy(&percent_bytes(text)).into_owned()
}

fn percent_bytes(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let hex = bytes.get(at + 1..at + 3).and_then(|h| u8::from_str_radix(str::from_utf8(h).ok()?, 16).ok());
        match (byte, hex) {
            (b'%', Some(value)) => {
                out.push(value);
                at += 3;
            }
            _ => {
                out.push(byte);
                at += 1;
            }
        }
    }
    out
}
