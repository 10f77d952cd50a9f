//! A file read in large pieces: bytes, lines and how far we are. Never holds more than it must.

use crate::base::error::{Error, Place, Result};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes asked of the operating system at a time; stays in the second-level cache.
const CHUNK: usize = 256 << 10;
/// Longest line (or single record) that is taken for one.
pub(crate) const MAX_LINE: usize = 64 << 20;

/// What is wrong with the record being read, before file and place are known.
pub(crate) enum Fault {
    /// The input.
    Why(String),
    /// Something that already knows its place (the sink, the disk).
    Failed(Error),
}

/// The result of reading one record.
pub(crate) type Parsed<T, E = Fault> = std::result::Result<T, E>;

impl Fault {
    /// The error of `file` at `place`.
    pub(crate) fn at(self, file: &Path, place: Place) -> Error {
        match self {
            Fault::Why(why) => Error::parse(file, place, why),
            Fault::Failed(error) => error,
        }
    }
}

impl From<&str> for Fault {
    fn from(why: &str) -> Self {
        Fault::Why(why.to_owned())
    }
}
impl From<String> for Fault {
    fn from(why: String) -> Self {
        Fault::Why(why)
    }
}
impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Fault::Failed(error)
    }
}

/// Which byte ends a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ends {
    /// `\n`; a `\r` before it is left out of the line.
    Lf,
    /// `\r` alone, as on old Macintoshes.
    Cr,
}

/// An input file with a window of it in memory.
///
/// Invariant: `buf[at..end]` are the bytes of the file that begin at `offset()`.
pub(crate) struct Input {
    file: File,
    path: PathBuf,
    total: u64,
    buf: Vec<u8>,
    at: usize,
    end: usize,
    /// File offset of `buf[end]`: where the next read goes on.
    next: u64,
    ends: Option<Ends>,
    line: u64,
    /// Start and length of the last line in `buf`.
    last: (usize, usize),
}

impl Input {
    /// Opens a regular file; a directory, device or pipe is refused before anything could block.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let info = std::fs::metadata(path).map_err(|e| Error::io(path, "open", e))?;
        if info.is_dir() {
            return Err(Error::parse(path, Place::File, "is a directory, not a mesh file"));
        }
        if !info.is_file() {
            return Err(Error::parse(path, Place::File, "is not a regular file"));
        }
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let total = info.len();
        let window = CHUNK.min(total as usize + 1);
        Ok(Self {
            file,
            path: path.to_path_buf(),
            total,
            buf: vec![0; window],
            at: 0,
            end: 0,
            next: 0,
            ends: None,
            line: 0,
            last: (0, 0),
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
    /// Bytes in the file, as it was when opened.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }
    /// File offset of the next byte.
    pub(crate) fn offset(&self) -> u64 {
        self.next - (self.end - self.at) as u64
    }
    /// Bytes not yet consumed.
    pub(crate) fn remaining(&self) -> u64 {
        self.total.saturating_sub(self.offset())
    }
    /// The number of the line last handed out, from 1.
    pub(crate) fn line(&self) -> u64 {
        self.line
    }
    /// An error at the present byte.
    pub(crate) fn fault(&self, why: impl Into<String>) -> Error {
        Error::parse(&self.path, Place::Byte(self.offset()), why)
    }
    /// An error at the line last handed out.
    pub(crate) fn line_fault(&self, why: impl Into<String>) -> Error {
        Error::parse(&self.path, Place::Line(self.line), why)
    }

    /// What is in the window; at least `want` bytes after [`Input::ensure`] said so.
    #[inline]
    pub(crate) fn available(&self) -> &[u8] {
        &self.buf[self.at..self.end]
    }

    /// Moves on by `n` bytes of [`Input::available`].
    #[inline]
    pub(crate) fn consume(&mut self, n: usize) {
        debug_assert!(n <= self.end - self.at);
        self.at = (self.at + n).min(self.end);
    }

    /// Brings at least `want` bytes into the window; `false` if the file has not that many.
    #[inline]
    pub(crate) fn ensure(&mut self, want: usize) -> Result<bool> {
        if self.end - self.at >= want { Ok(true) } else { self.refill(want) }
    }

    #[cold]
    fn refill(&mut self, want: usize) -> Result<bool> {
        // A claim beyond the end must not make the window grow.
        if want as u64 > self.remaining() {
            return Ok(false);
        }
        self.buf.copy_within(self.at..self.end, 0);
        self.end -= self.at;
        self.at = 0;
        if want > self.buf.len() {
            self.buf.resize(want.next_multiple_of(CHUNK), 0);
        }
        while self.end < want {
            match self.file.read(&mut self.buf[self.end..]) {
                Ok(0) => return Ok(false),
                Ok(n) => {
                    self.end += n;
                    self.next += n as u64;
                }
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.path, "read", e)),
            }
        }
        Ok(true)
    }

    /// Up to `n` bytes from the present place, without moving on.
    pub(crate) fn peek(&mut self, n: usize) -> Result<&[u8]> {
        let n = (n as u64).min(self.remaining()) as usize;
        self.ensure(n)?;
        Ok(&self.available()[..n.min(self.available().len())])
    }

    /// The next `N` bytes, or `None` if the file ends before.
    #[inline]
    pub(crate) fn take<const N: usize>(&mut self) -> Result<Option<[u8; N]>> {
        if !self.ensure(N)? {
            return Ok(None);
        }
        let bytes = self.available().first_chunk::<N>().copied();
        self.consume(N);
        Ok(bytes)
    }

    /// Skips `n` bytes; `false` if the file has not that many.
    pub(crate) fn skip(&mut self, n: u64) -> Result<bool> {
        if n <= (self.end - self.at) as u64 {
            self.consume(n as usize);
            return Ok(true);
        }
        if n > self.remaining() {
            return Ok(false);
        }
        self.seek(self.offset() + n, self.line)?;
        Ok(true)
    }

    /// Goes to a file offset, which comes after `line` lines.
    pub(crate) fn seek(&mut self, offset: u64, line: u64) -> Result<()> {
        self.file.seek(SeekFrom::Start(offset)).map_err(|e| Error::io(&self.path, "seek", e))?;
        (self.at, self.end, self.next) = (0, 0, offset);
        self.line = line;
        Ok(())
    }

    /// Sets what ends a line, where it is known otherwise than from the first chunk.
    pub(crate) fn set_ends(&mut self, ends: Ends) {
        self.ends = Some(ends);
    }

    /// The next line without its end, or `None` at the end of the file.
    ///
    /// Unless told, lines end at `\n` if the first chunk has one, else at `\r`.
    #[inline]
    pub(crate) fn next_line(&mut self) -> Result<Option<&[u8]>> {
        let ends = match self.ends {
            Some(ends) => ends,
            None => self.guess_ends()?,
        };
        let needle = if ends == Ends::Lf { b'\n' } else { b'\r' };
        let (start, len, used) = match memchr::memchr(needle, self.available()) {
            Some(n) => (self.at, n, n + 1),
            None => match self.long_line(needle)? {
                Some((len, used)) => (self.at, len, used),
                None => return Ok(None),
            },
        };
        self.line += 1;
        self.at += used;
        self.last = (start, len);
        Ok(Some(self.last_line()))
    }

    /// The line that [`Input::next_line`] handed out last, while nothing else was read since.
    #[inline]
    pub(crate) fn last_line(&self) -> &[u8] {
        let line = &self.buf[self.last.0..self.last.0 + self.last.1];
        line.strip_suffix(b"\r").unwrap_or(line)
    }

    /// A line that does not end in the window: length without and with its end.
    #[cold]
    fn long_line(&mut self, needle: u8) -> Result<Option<(usize, usize)>> {
        let mut seen = self.available().len();
        loop {
            if seen > MAX_LINE {
                self.line += 1;
                return Err(self.line_fault(format!("a line of more than {MAX_LINE} bytes")));
            }
            if self.remaining() <= seen as u64 || !self.ensure(seen + 1)? {
                return Ok((seen > 0).then_some((seen, seen)));
            }
            if let Some(n) = memchr::memchr(needle, &self.available()[seen..]) {
                return Ok(Some((seen + n, seen + n + 1)));
            }
            seen = self.available().len();
        }
    }

    fn guess_ends(&mut self) -> Result<Ends> {
        let head = self.peek(CHUNK)?;
        let lf = memchr::memchr(b'\n', head).is_some() || memchr::memchr(b'\r', head).is_none();
        let ends = if lf { Ends::Lf } else { Ends::Cr };
        self.ends = Some(ends);
        Ok(ends)
    }

    /// Fills `out` from a file offset, leaving the present place alone; `false` if the file ends before.
    pub(crate) fn read_range(&mut self, offset: u64, out: &mut [u8]) -> Result<bool> {
        let end = offset.checked_add(out.len() as u64);
        if end.is_none_or(|end| end > self.total) {
            return Ok(false);
        }
        let io = |e| Error::io(&self.path, "read", e);
        self.file.seek(SeekFrom::Start(offset)).map_err(io)?;
        let read = self.file.read_exact(out);
        self.file.seek(SeekFrom::Start(self.next)).map_err(io)?;
        match read {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
            Err(e) => Err(io(e)),
        }
    }
}
