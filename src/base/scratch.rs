//! Scratch files for data that does not fit in memory. They have no name, so that they disappear with the process
//! however it ends.

use super::error::{Error, Result};
use super::faults;
use super::quota::Quota;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};

/// A folder for scratch files, with a count of the bytes that they take. All writers of one purpose share it.
#[derive(Debug)]
pub struct ScratchSpace {
    folder: PathBuf,
    quota: Quota,
    now: AtomicU64,
    peak: AtomicU64,
}

impl ScratchSpace {
    /// Uses `folder`, or the system's folder for temporary files. Writes nothing yet.
    pub fn new(folder: Option<&Path>) -> Arc<Self> {
        Self::limited(folder, Quota::default())
    }

    /// As [`ScratchSpace::new`], with a limit. Writing beyond it fails with [`Error::OverLimit`].
    pub fn limited(folder: Option<&Path>, quota: Quota) -> Arc<Self> {
        let folder = folder.map_or_else(std::env::temp_dir, Path::to_path_buf);
        Arc::new(Self { folder, quota, now: AtomicU64::new(0), peak: AtomicU64::new(0) })
    }

    /// Greatest number of bytes that its files took together at any time.
    pub fn peak(&self) -> u64 {
        self.peak.load(Relaxed)
    }

    /// Creates an empty file. Fails with [`Error::Io`], which names the folder.
    pub fn file(self: &Arc<Self>) -> Result<Scratch> {
        let file = nameless(&self.folder).map_err(|e| Error::io(&self.folder, "creating a temporary file", e))?;
        #[cfg(not(unix))]
        let file = Mutex::new(file);
        Ok(Scratch { file, len: Mutex::new(0), space: self.clone() })
    }

    fn grew(&self, bytes: u64) {
        let now = self.now.fetch_add(bytes, Relaxed) + bytes;
        self.peak.fetch_max(now, Relaxed);
    }
}

/// A scratch file: appended to, and read at any offset by any thread. It disappears when dropped.
#[derive(Debug)]
pub struct Scratch {
    #[cfg(unix)]
    file: File,
    #[cfg(not(unix))]
    file: Mutex<File>,
    /// Number of bytes written. The lock is held during a write.
    len: Mutex<u64>,
    space: Arc<ScratchSpace>,
}

impl Scratch {
    /// Writes at the end; returns the offset of the first byte. Fails with [`Error::Io`], for instance if the disk is
    /// full.
    pub fn append(&self, bytes: &[u8]) -> Result<u64> {
        let fail = |e| Error::io(&self.space.folder, "writing a temporary file", e);
        let mut len = self.len.lock().unwrap_or_else(|e| e.into_inner());
        self.space.quota.take(bytes.len() as u64)?;
        let written = faults::writing().and_then(|()| self.write(bytes));
        written.inspect_err(|_| self.space.quota.give(bytes.len() as u64)).map_err(fail)?;
        let at = *len;
        *len += bytes.len() as u64;
        self.space.grew(bytes.len() as u64);
        Ok(at)
    }

    /// Fills `buf` with the bytes at `offset`, all of which were written before.
    pub fn read_at(&self, offset: u64, buf: &mut [u8]) -> Result<()> {
        self.read(offset, buf).map_err(|e| Error::io(&self.space.folder, "reading a temporary file", e))
    }

    /// Number of bytes written.
    pub fn len(&self) -> u64 {
        *self.len.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// True if nothing was written.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    #[cfg(unix)]
    fn write(&self, bytes: &[u8]) -> io::Result<()> {
        (&self.file).write_all(bytes)
    }

    #[cfg(unix)]
    fn read(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, buf, offset)
    }

    #[cfg(not(unix))]
    fn write(&self, bytes: &[u8]) -> io::Result<()> {
        use std::io::{Seek, SeekFrom};
        let mut file = self.file.lock().unwrap_or_else(|e| e.into_inner());
        file.seek(SeekFrom::End(0))?;
        file.write_all(bytes)
    }

    #[cfg(not(unix))]
    fn read(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        use std::io::{Read, Seek, SeekFrom};
        let mut file = self.file.lock().unwrap_or_else(|e| e.into_inner());
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(buf)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        self.space.now.fetch_sub(self.len(), Relaxed);
        self.space.quota.give(self.len());
    }
}

/// Creates a file and removes its name, or makes the system remove the file when it is closed.
fn nameless(folder: &Path) -> io::Result<File> {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    faults::writing()?;
    loop {
        let name = format!(".outcrop-scratch-{}-{}", process::id(), COUNTER.fetch_add(1, Relaxed));
        let path = folder.join(name);
        let mut options = OpenOptions::new();
        options.read(true).write(true).create_new(true);
        // Others must not open it before its name is gone.
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        #[cfg(windows)]
        {
            const FILE_FLAG_DELETE_ON_CLOSE: u32 = 0x0400_0000;
            std::os::windows::fs::OpenOptionsExt::custom_flags(&mut options, FILE_FLAG_DELETE_ON_CLOSE);
        }
        match options.open(&path) {
            // Another process with the same number, in a container of its own, has created this file.
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
            Err(e) => return Err(e),
            Ok(file) => {
                if !cfg!(windows) {
                    fs::remove_file(&path)?;
                }
                return Ok(file);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_bytes_are_read_back_and_no_name_is_left() {
        let dir = tempfile::tempdir().unwrap();
        let space = ScratchSpace::new(Some(dir.path()));
        let (a, b) = (space.file().unwrap(), space.file().unwrap());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        assert_eq!((a.append(b"one").unwrap(), b.append(b"three").unwrap(), a.append(b"two").unwrap()), (0, 0, 3));
        let mut four = [0; 4];
        a.read_at(1, &mut four).unwrap();
        assert_eq!(&four, b"netw");
        assert!(a.read_at(3, &mut four).is_err());
        drop(b);
        a.append(b"!").unwrap();
        assert_eq!((space.peak(), a.len()), (11, 7));
    }

    #[test]
    fn files_count_in_the_quota_and_belong_to_their_owner_alone() {
        let dir = tempfile::tempdir().unwrap();
        let space = ScratchSpace::limited(Some(dir.path()), Quota::new(8));
        let (a, b) = (space.file().unwrap(), space.file().unwrap());
        a.append(b"four").unwrap();
        assert!(matches!(b.append(b"fives"), Err(Error::OverLimit { most: 8, limit: "max_bytes", .. })));
        b.append(b"four").unwrap();
        drop(a);
        b.append(b"4444").unwrap();
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            assert_eq!(b.file.metadata().unwrap().mode() & 0o777, 0o600);
        }
    }

    #[test]
    fn a_folder_that_is_not_there_is_named() {
        let space = ScratchSpace::new(Some(Path::new("/none/at/all")));
        let error = space.file().unwrap_err().to_string();
        assert!(error.contains("/none/at/all"), "{error}");
    }
}
