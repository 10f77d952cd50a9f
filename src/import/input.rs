//! A file that is read in large pieces as bytes or lines, with the position for error messages. The window in memory
//! grows only for long lines and records.
//!
//! A file that another program changes while it is read would become a mixture of both contents, or a part of one.
//! The reader of a file therefore calls [`Stamp::unchanged`] after the last read.

use super::text;
use crate::base::error::{Error, Place, Result};
use crate::base::inputs::{Identity, Inputs};
use std::fs::{File, Metadata};
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Bytes per read call; they stay in the second-level cache.
const CHUNK: usize = 256 << 10;
/// Length limit of a line or a single record, in bytes.
pub(crate) const MAX_LINE: usize = 64 << 20;

/// An error in the current record, before file and place are added.
pub(crate) enum Fault {
    /// The input is invalid, for this reason.
    Why(String),
    /// An error that already has its place (of the sink or the disk).
    Failed(Error),
}

/// The result of reading one record.
pub(crate) type Parsed<T, E = Fault> = std::result::Result<T, E>;

impl Fault {
    /// Converts the fault to an error of `file` at `place`.
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

/// The ending of lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ends {
    /// `\n`, `\r\n` or `\r`, also mixed within a file.
    Any,
    /// `\n`; a `\r` before it is not part of the line.
    Lf,
    /// `\r` alone, as on classic Mac OS.
    Cr,
}

impl Ends {
    /// Returns the position of the first ending in `bytes`.
    #[inline]
    fn find(self, bytes: &[u8]) -> Option<usize> {
        match self {
            Ends::Any => memchr::memchr2(b'\n', b'\r', bytes),
            Ends::Lf => memchr::memchr(b'\n', bytes),
            Ends::Cr => memchr::memchr(b'\r', bytes),
        }
    }

    /// Returns the length of the ending at byte `at`; `None` if the window ends between `\r` and a possible `\n`.
    #[inline]
    fn len(self, bytes: &[u8], at: usize) -> Option<usize> {
        match self {
            Ends::Any if bytes[at] == b'\r' => bytes.get(at + 1).map(|&b| if b == b'\n' { 2 } else { 1 }),
            _ => Some(1),
        }
    }
}

fn is_regular(path: &Path, info: &Metadata) -> Result<()> {
    let refuse = |why| Err(Error::parse(path, Place::File, why));
    match info {
        _ if info.is_dir() => refuse("is a directory, not a mesh file"),
        _ if !info.is_file() => refuse("is not a regular file"),
        _ => Ok(()),
    }
}

/// The byte order mark that some programs write before UTF-8 text.
pub(crate) const MARK: &[u8] = b"\xef\xbb\xbf";

/// State of a file when it was opened. Later changes of the file are noticed by it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Stamp {
    path: PathBuf,
    /// `None` for bytes of the host, which promises that they stay as they are.
    state: Option<State>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct State {
    len: u64,
    written: Option<SystemTime>,
    identity: Option<Identity>,
}

impl State {
    fn of(path: &Path, info: &Metadata) -> Self {
        let identity = Identity::of_open(path, info).ok();
        Self { len: info.len(), written: info.modified().ok(), identity }
    }
}

impl Stamp {
    /// Path of the file, or the name of the host's bytes.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// True for a file, false for bytes of the host.
    pub(crate) fn is_file(&self) -> bool {
        self.state.is_some()
    }

    /// Fails if the file was written, cut, replaced or removed since it was opened.
    pub(crate) fn unchanged(&self) -> Result<()> {
        let Some(state) = &self.state else { return Ok(()) };
        match std::fs::metadata(&self.path) {
            Ok(info) if State::of(&self.path, &info) == *state => Ok(()),
            _ => Err(Error::parse(&self.path, Place::File, "was changed or replaced while it was being read")),
        }
    }

    /// Adds the file to those that no output may replace.
    pub(crate) fn report(&self, inputs: &Inputs) {
        if let Some(identity) = self.state.as_ref().and_then(|state| state.identity.clone()) {
            inputs.add(&self.path, identity);
        }
    }
}

/// The source of an input's bytes.
enum Origin {
    File(File),
    Bytes(Cursor<Box<dyn AsRef<[u8]>>>),
}

impl Read for Origin {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(out),
            Self::Bytes(bytes) => {
                let all: &[u8] = (**bytes.get_ref()).as_ref();
                let mut rest = all.get(bytes.position() as usize..).unwrap_or_default();
                let n = rest.read(out)?;
                bytes.set_position(bytes.position() + n as u64);
                Ok(n)
            }
        }
    }
}

impl Origin {
    fn seek(&mut self, to: u64) -> io::Result<()> {
        match self {
            Self::File(file) => file.seek(SeekFrom::Start(to)).map(drop),
            Self::Bytes(bytes) => {
                bytes.set_position(to);
                Ok(())
            }
        }
    }
}

/// An input file with a window of it in memory.
///
/// Invariant: `buf[at..end]` are the bytes of the file that begin at `offset()`.
pub(crate) struct Input {
    file: Origin,
    stamp: Stamp,
    total: u64,
    buf: Vec<u8>,
    at: usize,
    end: usize,
    /// File offset of `buf[end]`, where the next read begins.
    next: u64,
    ends: Ends,
    line: u64,
    /// Start and length of the last line in `buf`.
    last: (usize, usize),
}

impl Input {
    /// Opens a regular file. Directories, devices and pipes are refused first, because reading them could block.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let fail = |e| Error::io(path, "open", e);
        is_regular(path, &std::fs::metadata(path).map_err(fail)?)?;
        Self::of_file(path, File::open(path).map_err(fail)?)
    }

    /// Reads a file that was opened as `path`. Fails if it is not a regular file.
    pub(crate) fn of_file(path: &Path, file: File) -> Result<Self> {
        let info = file.metadata().map_err(|e| Error::io(path, "open", e))?;
        is_regular(path, &info)?;
        let stamp = Stamp { path: path.to_path_buf(), state: Some(State::of(path, &info)) };
        Ok(Self::new(Origin::File(file), stamp, info.len()))
    }

    /// Reads bytes of the host, which calls them `name`.
    pub(crate) fn of_bytes(name: &str, bytes: Box<dyn AsRef<[u8]>>) -> Self {
        let total = (*bytes).as_ref().len() as u64;
        Self::new(Origin::Bytes(Cursor::new(bytes)), Stamp { path: name.into(), state: None }, total)
    }

    fn new(file: Origin, stamp: Stamp, total: u64) -> Self {
        let window = CHUNK.min(usize::try_from(total).unwrap_or(CHUNK) + 1);
        Self {
            file,
            stamp,
            total,
            buf: vec![0; window],
            at: 0,
            end: 0,
            next: 0,
            ends: Ends::Any,
            line: 0,
            last: (0, 0),
        }
    }

    /// State of the file when it was opened.
    pub(crate) fn stamp(&self) -> &Stamp {
        &self.stamp
    }

    pub(crate) fn path(&self) -> &Path {
        &self.stamp.path
    }
    /// Size of the file in bytes when it was opened.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }
    /// File offset of the next byte.
    pub(crate) fn offset(&self) -> u64 {
        self.next - (self.end - self.at) as u64
    }
    /// Number of bytes not yet consumed.
    pub(crate) fn remaining(&self) -> u64 {
        self.total.saturating_sub(self.offset())
    }
    /// Number of the last line that was returned, counted from 1.
    pub(crate) fn line(&self) -> u64 {
        self.line
    }
    /// Creates an error at the current byte.
    pub(crate) fn fault(&self, why: impl Into<String>) -> Error {
        Error::parse(&self.stamp.path, Place::Byte(self.offset()), why)
    }
    /// Creates an error at the last line that was returned.
    pub(crate) fn line_fault(&self, why: impl Into<String>) -> Error {
        Error::parse(&self.stamp.path, Place::Line(self.line), why)
    }

    /// Returns the bytes in the window: at least `want` bytes if [`Input::ensure`] returned `true`.
    #[inline]
    pub(crate) fn available(&self) -> &[u8] {
        &self.buf[self.at..self.end]
    }

    /// Advances by `n` bytes of [`Input::available`].
    #[inline]
    pub(crate) fn consume(&mut self, n: usize) {
        debug_assert!(n <= self.end - self.at);
        self.at = (self.at + n).min(self.end);
    }

    /// Reads at least `want` bytes into the window. Returns `false` if the file has fewer left.
    #[inline]
    pub(crate) fn ensure(&mut self, want: usize) -> Result<bool> {
        if self.end - self.at >= want { Ok(true) } else { self.refill(want) }
    }

    #[cold]
    fn refill(&mut self, want: usize) -> Result<bool> {
        // A length claimed by the file beyond its end must not enlarge the window.
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
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(Error::io(&self.stamp.path, "read", e)),
            }
        }
        Ok(true)
    }

    /// Returns up to `n` bytes from the current position without advancing.
    pub(crate) fn peek(&mut self, n: usize) -> Result<&[u8]> {
        let n = (n as u64).min(self.remaining()) as usize;
        self.ensure(n)?;
        Ok(&self.available()[..n.min(self.available().len())])
    }

    /// Returns the next `N` bytes, or `None` if the file ends earlier.
    #[inline]
    pub(crate) fn take<const N: usize>(&mut self) -> Result<Option<[u8; N]>> {
        if !self.ensure(N)? {
            return Ok(None);
        }
        let bytes = self.available().first_chunk::<N>().copied();
        self.consume(N);
        Ok(bytes)
    }

    /// Skips `n` bytes. Returns `false` if the file has fewer left.
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

    /// Moves to a file offset that is preceded by `line` lines.
    pub(crate) fn seek(&mut self, offset: u64, line: u64) -> Result<()> {
        self.file.seek(offset).map_err(|e| Error::io(&self.stamp.path, "seek", e))?;
        (self.at, self.end, self.next) = (0, 0, offset);
        self.line = line;
        Ok(())
    }

    /// Sets the line ending, for text that is followed by binary data. Without a call each line may end in any way.
    pub(crate) fn set_ends(&mut self, ends: Ends) {
        self.ends = ends;
    }

    /// Returns the next line without its ending, or `None` at the end of the file. A byte order mark before the first
    /// line is not part of it, nor is padding at its end.
    #[inline]
    pub(crate) fn next_line(&mut self) -> Result<Option<&[u8]>> {
        let window = self.available();
        let found = self.ends.find(window).and_then(|n| Some((n, n + self.ends.len(window, n)?)));
        let (start, len, used) = match found {
            Some((len, used)) => (self.at, len, used),
            None => match self.long_line()? {
                Some((len, used)) => (self.at, len, used),
                None => return Ok(None),
            },
        };
        self.line += 1;
        self.at += used;
        self.last = (start, len);
        if self.line == 1 && self.last_line().starts_with(MARK) {
            self.last = (start + MARK.len(), len - MARK.len());
        }
        Ok(Some(self.last_line()))
    }

    /// Returns the last line of [`Input::next_line`]. Valid until anything else is read.
    #[inline]
    pub(crate) fn last_line(&self) -> &[u8] {
        let line = &self.buf[self.last.0..self.last.0 + self.last.1];
        match line.last() {
            Some(b'\r') => &line[..line.len() - 1],
            Some(0 | 0x1a) => text::unpadded(line),
            _ => line,
        }
    }

    /// Reads a line that does not end in the window. Returns its length without and with the ending.
    #[cold]
    fn long_line(&mut self) -> Result<Option<(usize, usize)>> {
        let mut seen = 0;
        loop {
            let window = self.available();
            if let Some(n) = self.ends.find(&window[seen..]).map(|n| seen + n) {
                match self.ends.len(window, n) {
                    Some(ending) => return Ok(Some((n, n + ending))),
                    None if !self.ensure(n + 2)? => return Ok(Some((n, n + 1))),
                    None => seen = n,
                }
                continue;
            }
            seen = window.len();
            if seen > MAX_LINE {
                self.line += 1;
                return Err(self.line_fault(format!("a line is longer than {MAX_LINE} bytes")));
            }
            if self.remaining() <= seen as u64 || !self.ensure(seen + 1)? {
                return Ok((seen > 0).then_some((seen, seen)));
            }
        }
    }

    /// Fills `out` from a file offset and keeps the current position. Returns `false` if the file ends earlier.
    pub(crate) fn read_range(&mut self, offset: u64, out: &mut [u8]) -> Result<bool> {
        let end = offset.checked_add(out.len() as u64);
        if end.is_none_or(|end| end > self.total) {
            return Ok(false);
        }
        let fail = |e| Error::io(&self.stamp.path, "read", e);
        self.file.seek(offset).map_err(fail)?;
        let read = self.file.read_exact(out);
        self.file.seek(self.next).map_err(fail)?;
        match read {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(e) => Err(fail(e)),
        }
    }
}
