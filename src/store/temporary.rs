//! A file that appears under its name only when it is complete.

use crate::base::error::{Error, Result};
use crate::base::faults;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use xxhash_rust::xxh3::xxh3_64;

/// The target that a model is written to; tests replace it by one that fails. If it is dropped before it is published,
/// an older file of the same name is unchanged.
pub(super) trait Medium: Send {
    /// Writes at the end.
    fn append(&mut self, bytes: &[u8]) -> Result<()>;
    /// Overwrites the first bytes; nothing is appended after that.
    fn overwrite_start(&mut self, bytes: &[u8]) -> Result<()>;
    /// Makes the bytes durable and gives the file its name.
    fn publish(&mut self) -> Result<()>;
}

/// A temporary file in the folder of `target`: removed when dropped, renamed when published.
///
/// The file is locked (`flock`) while it is written, so that the next build to the same target can tell it from the
/// file of a process that was killed, and removes the latter. A process id in the name would not suffice: the id can be
/// in use again, or belong to another container or machine.
pub(super) struct Temporary {
    file: File,
    /// Its present path; `None` once published.
    path: Option<PathBuf>,
    target: PathBuf,
    folder: PathBuf,
}

/// Makes names unique in this process.
static COUNTER: AtomicU32 = AtomicU32::new(0);
const SUFFIX: &str = ".tmp";

impl Temporary {
    /// Begins a file that will replace `target`. `target` may exist as a regular file, and is unchanged until then. If
    /// `target` is a symbolic link, the file that it names is replaced.
    pub(super) fn create(target: &Path) -> Result<Self> {
        let fail = |e| Error::io(target, "create", e);
        let target_file = resolve(target).map_err(fail)?;
        let folder = match target_file.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let prefix = prefix(&target_file).map_err(fail)?;
        remove_stale(&folder, &prefix);
        loop {
            let unique = format!("{prefix}{}-{}{SUFFIX}", process::id(), COUNTER.fetch_add(1, Relaxed));
            let path = folder.join(unique);
            let file = match OpenOptions::new().write(true).create_new(true).open(&path) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
                opened => opened.map_err(fail)?,
            };
            let temporary = Self { file, path: Some(path), target: target_file.clone(), folder: folder.clone() };
            if temporary.lock() {
                return Ok(temporary);
            }
        }
    }

    /// Locks the file. Returns `false` if another build took it for a stale one between its creation and the lock.
    fn lock(&self) -> bool {
        match self.file.try_lock() {
            Err(TryLockError::WouldBlock) => false,
            // On a file system without locks no build takes a file for stale either.
            Err(TryLockError::Error(_)) => true,
            Ok(()) => self.path.as_ref().is_some_and(|path| path.exists()),
        }
    }
}

impl Medium for Temporary {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        faults::writing().and_then(|()| self.file.write_all(bytes)).map_err(|e| Error::io(&self.target, "write", e))
    }
    fn overwrite_start(&mut self, bytes: &[u8]) -> Result<()> {
        let written = faults::writing().and_then(|()| self.file.seek(SeekFrom::Start(0)));
        let written = written.and_then(|_| self.file.write_all(bytes));
        written.map_err(|e| Error::io(&self.target, "write", e))
    }
    fn publish(&mut self) -> Result<()> {
        let Some(path) = &self.path else { return Ok(()) };
        faults::writing().and_then(|()| self.file.sync_all()).map_err(|e| Error::io(&self.target, "sync", e))?;
        fs::rename(path, &self.target).map_err(|e| Error::io(&self.target, "rename", e))?;
        self.path = None;
        sync_folder(&self.folder).map_err(|e| Error::io(&self.target, "syncing the folder", e))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = self.path.take() {
            // An error cannot be returned here. The next build to this target tries again.
            let _ = fs::remove_file(path);
        }
    }
}

/// Returns the regular file that `target` names or will name. Devices, pipes and folders are refused: a rename over
/// `/dev/null` would break the machine.
fn resolve(target: &Path) -> io::Result<PathBuf> {
    let refuse = |why| Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    match fs::symlink_metadata(target) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(target.to_path_buf()),
        Err(e) => Err(e),
        Ok(meta) if meta.is_symlink() => {
            let named = fs::canonicalize(target)?;
            if named.is_file() { Ok(named) } else { refuse("not a regular file") }
        }
        Ok(meta) if meta.is_file() => Ok(target.to_path_buf()),
        Ok(_) => refuse("not a regular file"),
    }
}

/// Returns the common prefix of the names of all temporaries of `target`. It holds a hash, because the name of the
/// target itself may be as long as names can be.
fn prefix(target: &Path) -> io::Result<String> {
    let name = target.file_name().ok_or(io::Error::new(io::ErrorKind::InvalidInput, "no file name"))?;
    Ok(format!(".outcrop-{:016x}-", xxh3_64(name.as_encoded_bytes())))
}

/// Removes temporaries that no build is writing any more. Files that cannot be removed stay.
fn remove_stale(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let ours = name.to_str().is_some_and(|n| n.starts_with(prefix) && n.ends_with(SUFFIX));
        if !ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // The lock is held until after the removal, so that a build that has just created the file would notice.
        if let Ok(file) = OpenOptions::new().write(true).open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Makes a rename in `folder` durable, if the system can do that.
fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(not(unix)) {
        return Ok(());
    }
    match File::open(folder).and_then(|f| f.sync_all()) {
        Err(e) if matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        // The folder can be written but not read. The rename itself has succeeded.
        Err(e) if e.kind() == io::ErrorKind::PermissionDenied => Ok(()),
        synced => synced,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn it_appears_only_when_published() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("a");
        fs::write(&target, "old").unwrap();
        let mut t = Temporary::create(&target).unwrap();
        t.append(b"new").unwrap();
        t.overwrite_start(b"N").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"old");
        assert_eq!(names(dir.path()).len(), 2);
        t.publish().unwrap();
        drop(t);
        assert_eq!(fs::read(&target).unwrap(), b"New");
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn dropped_it_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let mut t = Temporary::create(&dir.path().join("a")).unwrap();
        t.append(b"new").unwrap();
        drop(t);
        assert!(names(dir.path()).is_empty());
    }

    #[test]
    fn stale_ones_go_and_living_ones_stay() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("a");
        let living = Temporary::create(&target).unwrap();
        let stale = dir.path().join(format!("{}1-0{SUFFIX}", prefix(&target).unwrap()));
        let other = dir.path().join(format!("{}1-0{SUFFIX}", prefix(Path::new("b")).unwrap()));
        fs::write(&stale, "x").unwrap();
        fs::write(&other, "x").unwrap();
        let second = Temporary::create(&target).unwrap();
        assert!(!stale.exists() && other.exists());
        assert!(living.path.as_ref().unwrap().exists() && second.path.as_ref().unwrap().exists());
    }

    #[test]
    fn targets_that_must_not_be_replaced_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        for target in [dir.path().to_path_buf(), dir.path().join("none/a"), "/dev/null".into(), "".into(), "/".into()] {
            assert!(Temporary::create(&target).is_err(), "{target:?}");
        }
        assert!(names(dir.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link() {
        let dir = tempfile::tempdir().unwrap();
        let (file, link) = (dir.path().join("file"), dir.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        let mut t = Temporary::create(&link).unwrap();
        t.append(b"new").unwrap();
        t.publish().unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
    }

    #[test]
    fn a_name_as_long_as_names_can_be() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("x".repeat(255));
        Temporary::create(&target).unwrap().publish().unwrap();
        assert!(target.exists());
    }
}
