//! Sources of a model's bytes: a file, memory, or a callback.

#[cfg(unix)]
use super::page_cache;
use crate::base::error::{Error, Result};
use crate::base::inside_read::reading;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Random access to the bytes of a file that does not change. Several threads call it at once.
///
/// The reader does not trust a source: it detects a wrong length and wrong bytes, and reports them.
#[allow(clippy::len_without_is_empty)]
pub trait Source: Send + Sync {
    /// Total number of bytes.
    fn len(&self) -> u64;
    /// Fills `buf` with the bytes at `offset`, or fails. A range past the end gives `UnexpectedEof`.
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()>;
    /// The path of the file, or a name for messages.
    fn name(&self) -> &Path;
    /// The absolute path of the file; `None` for a source that is none.
    fn path(&self) -> Option<&Path> {
        None
    }
}

/// A regular file, read at offsets. Pages that were read do not stay in the system's page cache, where the system
/// accepts such a request.
#[derive(Debug)]
pub struct FileSource {
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: std::sync::Mutex<File>,
    len: u64,
    path: PathBuf,
    /// The path with the folder of the process at the time of opening.
    absolute: PathBuf,
}

impl FileSource {
    /// Opens `path` for reading.
    ///
    /// Fails with [`Error::Io`] if `path` cannot be opened or is not a regular file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let fail = |e| Error::io(path, "open", e);
        // Tested before the file is opened: opening a pipe would wait for its other end.
        let meta = std::fs::metadata(path).map_err(fail)?;
        if !meta.is_file() {
            return Err(fail(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")));
        }
        let file = File::open(path).map_err(fail)?;
        let len = file.metadata().map_err(fail)?.len();
        #[cfg(unix)]
        page_cache::expect_random(&file);
        #[cfg(not(unix))]
        let file = std::sync::Mutex::new(file);
        let absolute = std::path::absolute(path).map_err(fail)?;
        Ok(Self { file, len, path: path.to_path_buf(), absolute })
    }
}

impl Source for FileSource {
    fn len(&self) -> u64 {
        self.len
    }
    #[cfg(unix)]
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, buf, offset)?;
        page_cache::drop_pages(&self.file, offset, buf.len());
        Ok(())
    }
    #[cfg(not(unix))]
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        use std::io::{Read, Seek, SeekFrom};
        let mut file = self.file.lock().unwrap_or_else(|e| e.into_inner());
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(buf)
    }
    fn name(&self) -> &Path {
        &self.path
    }
    fn path(&self) -> Option<&Path> {
        Some(&self.absolute)
    }
}

/// A model whose bytes are already in memory.
#[derive(Debug, Clone)]
pub struct MemorySource {
    bytes: Arc<[u8]>,
    name: PathBuf,
}

impl MemorySource {
    /// A source of `bytes` without a particular name.
    pub fn new(bytes: impl Into<Arc<[u8]>>) -> Self {
        Self::named("(memory)", bytes)
    }
    /// A source of `bytes`; `name` appears in messages.
    pub fn named(name: impl Into<PathBuf>, bytes: impl Into<Arc<[u8]>>) -> Self {
        Self { bytes: bytes.into(), name: name.into() }
    }
}

impl Source for MemorySource {
    fn len(&self) -> u64 {
        self.bytes.len() as u64
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        let found = usize::try_from(offset)
            .ok()
            .and_then(|at| self.bytes.get(at..)?.get(..buf.len()))
            .ok_or(io::ErrorKind::UnexpectedEof)?;
        buf.copy_from_slice(found);
        Ok(())
    }
    fn name(&self) -> &Path {
        &self.name
    }
}

/// A function that fills the buffer with the bytes at an offset, or fails.
pub type ReadCallback = Box<dyn Fn(u64, &mut [u8]) -> io::Result<()> + Send + Sync>;

/// A model whose bytes the caller supplies.
pub struct CallbackSource {
    read: ReadCallback,
    len: u64,
    name: PathBuf,
}

impl CallbackSource {
    /// A source of `len` bytes that calls `read`. Several threads call it at once, and none of them holds a lock of
    /// this library. `read` must not query, open, load, render or wait with this library: such calls fail with
    /// `BadState`. `name` appears in messages.
    pub fn new(name: impl Into<PathBuf>, len: u64, read: ReadCallback) -> Self {
        Self { read, len, name: name.into() }
    }
}

impl Source for CallbackSource {
    fn len(&self) -> u64 {
        self.len
    }
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        let end = offset.checked_add(buf.len() as u64);
        if end.is_none_or(|end| end > self.len) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        reading(|| (self.read)(offset, buf))
    }
    fn name(&self) -> &Path {
        &self.name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn same_bytes(source: &dyn Source) {
        assert_eq!(source.len(), 5);
        let mut buf = [0; 3];
        source.read_at(2, &mut buf).unwrap();
        assert_eq!(buf, [2, 3, 4]);
        source.read_at(5, &mut []).unwrap();
        for offset in [3, 5, 6, u64::MAX] {
            let e = source.read_at(offset, &mut buf).unwrap_err();
            assert!(matches!(e.kind(), io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidInput), "{offset}: {e:?}");
        }
    }

    #[test]
    fn all_sources_read_alike() {
        let bytes = [0, 1, 2, 3, 4];
        let memory = MemorySource::new(bytes);
        same_bytes(&memory);
        let inner = memory.clone();
        same_bytes(&CallbackSource::new("cb", 5, Box::new(move |at, buf| inner.read_at(at, buf))));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("five");
        std::fs::write(&path, bytes).unwrap();
        same_bytes(&FileSource::open(&path).unwrap());
    }

    #[test]
    fn a_path_that_is_no_file_is_an_error_with_its_name() {
        let dir = tempfile::tempdir().unwrap();
        for path in [dir.path().to_path_buf(), dir.path().join("none"), "/dev/zero".into()] {
            let e = FileSource::open(&path).unwrap_err();
            assert!(e.to_string().contains(path.to_str().unwrap()), "{e}");
        }
    }
}
