//! Bytes of buffers: in the GLB, in `data:` URIs, in files next to the document.

use super::container::Document;
use super::materials::too_large;
use super::model::{Model, View};
use super::uri;
use crate::base::error::{Error, Place, Result};
use crate::base::progress::Cancel;
use crate::import::access::Files;
use crate::import::input::{Input, Parsed};
use std::path::Path;

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
    files: &'a Files<'a>,
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
    /// Buffer, offset in it, and length.
    pub(crate) fn place(&self) -> (usize, u64, u64) {
        (self.buffer, self.offset, self.len)
    }
    /// Returns the `len` bytes from `at`, if they are inside the range.
    pub(crate) fn part(&self, at: u64, len: u64) -> Option<Range> {
        let end = at.checked_add(len)?;
        (end <= self.len).then_some(Range { buffer: self.buffer, offset: self.offset + at, len })
    }
}

impl<'a> Buffers<'a> {
    /// Creates the unopened buffers of a document. `cancel` is checked before each read.
    pub(crate) fn new(input: &'a mut Input, document: &Document, files: &'a Files<'a>, cancel: Cancel) -> Self {
        let opened = (0..document.model.buffers.len()).map(|_| None).collect();
        Self { input, binary: document.binary, opened, files, cancel, read: 0 }
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
    pub(crate) fn view(&mut self, model: &Model, index: usize) -> Parsed<(Range, Option<u64>)> {
        let view = model.views.get(index)?;
        let &View { buffer, offset, len, stride, .. } = view;
        let there = self.open(model, view)?;
        let whole = Range { buffer, offset: 0, len: there };
        if let Some(range) = whole.part(offset, len) {
            return Ok((range, stride));
        }
        let place = format!("bufferViews[{index}] ends outside of buffers[{buffer}] ({len} bytes from {offset}");
        Err(match model.buffers.get(buffer)?.len.filter(|&announced| there < announced) {
            Some(announced) => format!("{place}), which has only {there} of the {announced} bytes of its byteLength"),
            None => format!("{place} of {there})"),
        }
        .into())
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

    /// Opens the buffer of a view if necessary. Returns its size in bytes.
    fn open(&mut self, model: &Model, view: &View) -> Parsed<u64> {
        let index = view.buffer;
        let buffer = model.buffers.get(index)?;
        if let Some(bytes) = &self.opened[index] {
            return Ok(bytes.len());
        }
        let bytes = match (&buffer.uri, self.binary, view.compressed) {
            (Some(uri), _, _) => match uri::data(uri) {
                Some(bytes) => Bytes::Memory(bytes.map_err(|why| format!("buffers[{index}]: {why}"))?),
                None => Bytes::File(self.open_file(uri)?),
            },
            (None, Some((start, len)), _) if index == 0 => Bytes::Here(start, len),
            (None, _, Some(name)) => return Err(format!("has data only for {name}, which is not supported").into()),
            (None, _, None) => {
                return Err(format!("buffers[{index}] has no uri, and the file has no binary chunk").into());
            }
        };
        let len = bytes.len();
        self.opened[index] = Some(bytes);
        Ok(len)
    }

    /// Returns the bytes of an image's URI, if there are at most `most`.
    pub(crate) fn uri(&mut self, uri: &str, most: u64) -> Parsed<Vec<u8>> {
        match uri::data(uri) {
            Some(bytes) => Ok(bytes?),
            None => {
                let mut input = self.open_file(uri)?;
                if input.total() > most {
                    return Err(too_large(input.total(), most).into());
                }
                let mut bytes = vec![0; input.total() as usize];
                if !input.read_range(0, &mut bytes)? {
                    return Err("the file became shorter while being read".into());
                }
                Ok(bytes)
            }
        }
    }

    /// Opens the file of a URI. Other schemes are errors, and so are absolute paths unless the build trusts them.
    fn open_file(&self, uri: &str) -> Result<Input> {
        let path = self.path();
        self.files.open(uri.as_bytes(), path, || {
            let shown: String = uri.chars().take(80).collect();
            let refuse =
                || Error::parse(path, Place::File, format!("\"{shown}\" is not a path relative to the document"));
            uri::candidates(path, uri, self.files.trusts_more()).ok_or_else(refuse)
        })
    }
}
