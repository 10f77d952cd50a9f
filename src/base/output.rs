//! Output files: a file that appears under its name only when it is complete, and the rules for names that may be
//! written.
//!
//! A target is a regular file or does not exist. A symbolic link is followed: the file that it names is replaced, and
//! the link stays. Devices, pipes, sockets, folders, links of `/proc` (`/dev/stdout`), and files that are read-only or
//! that are inputs of the same work are refused. A file that replaces another has its owner, group and permissions.

use super::error::{Error, Result};
use super::faults;
use super::inputs::{self, Identity, Inputs};
use super::quota::Quota;
use super::scratch::{Scratch, ScratchSpace};
use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use xxhash_rust::xxh3::xxh3_64;

/// The receiver of an output that is written from front to back, except for its first bytes, which are known last. If
/// it is dropped before it is published, an older file of the same name is unchanged.
pub trait Medium: Send {
    /// Writes at the end.
    fn append(&mut self, bytes: &[u8]) -> Result<()>;
    /// Overwrites the first bytes; nothing is appended after that.
    fn overwrite_start(&mut self, bytes: &[u8]) -> Result<()>;
    /// Makes the bytes durable and gives the file its name.
    fn publish(&mut self) -> Result<()>;
}

/// Fails if `target` must not be written, before any work is done: with [`Error::BadArgument`] if it is one of `inputs`
/// (the same file, by whatever name, link or hard link), with [`Error::Io`] if it is not a regular file. An input that
/// does not exist is ignored.
pub fn check(target: &Path, inputs: &[impl AsRef<Path>]) -> Result<()> {
    let file = resolve(target).map_err(|e| Error::io(target, "create", e))?;
    let Ok(old) = Identity::of(&file) else { return Ok(()) };
    match inputs.iter().find(|input| Identity::of(input.as_ref()).is_ok_and(|input| input == old)) {
        None => Ok(()),
        Some(input) => Err(inputs::same_file(target, input.as_ref())),
    }
}

/// A temporary file in the folder of `target`: removed when dropped, renamed when published.
///
/// The file is locked (`flock`) while it is written, so that the next build to the same target can tell it from the
/// file of a process that was killed, and removes the latter. A process id in the name would not suffice: the id can be
/// in use again, or belong to another container or machine.
pub struct OutputFile {
    file: File,
    /// Its present path; `None` once published.
    path: Option<PathBuf>,
    /// The target as the caller calls it, and the file that it means.
    named: PathBuf,
    target: PathBuf,
    folder: PathBuf,
    /// The file that it will replace, as it was at the beginning.
    old: Option<Metadata>,
    inputs: Inputs,
    quota: Quota,
    /// Number of bytes that the quota counts.
    bytes: u64,
}

/// Makes names unique in this process.
static COUNTER: AtomicU32 = AtomicU32::new(0);
const SUFFIX: &str = ".tmp";

impl OutputFile {
    /// Begins a file that will replace the target `named`, which is unchanged until then. Fails with [`Error::Io`] if
    /// the folder is missing or cannot be written, or if the target exists and must not be replaced.
    pub fn create(named: &Path) -> Result<Self> {
        let fail = |e| Error::io(named, "create", e);
        let target_file = resolve(named).map_err(fail)?;
        let folder = folder_of(&target_file).to_path_buf();
        let prefix = prefix(&target_file).map_err(fail)?;
        let old = fs::symlink_metadata(&target_file).ok();
        remove_stale(&folder, &prefix);
        loop {
            let unique = format!("{prefix}{}-{}{SUFFIX}", process::id(), COUNTER.fetch_add(1, Relaxed));
            let path = folder.join(unique);
            let file = match new_file(old.is_some()).open(&path) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
                opened => opened.map_err(fail)?,
            };
            let (target, folder, old) = (target_file.clone(), folder.clone(), old.clone());
            let (inputs, quota) = (Inputs::default(), Quota::default());
            let (path, named) = (Some(path), named.to_path_buf());
            let temporary = Self { file, path, named, target, folder, old, inputs, quota, bytes: 0 };
            if temporary.lock() {
                return Ok(temporary);
            }
        }
    }

    /// Makes sure that the file replaces none of `inputs`, to which others may still be added, and counts its bytes.
    /// Fails with [`Error::BadArgument`] if the target is one of the inputs already; otherwise [`Medium::publish`] may
    /// fail so.
    pub fn guarded(mut self, inputs: &Inputs, quota: &Quota) -> Result<Self> {
        inputs.check(&self.target, &self.named)?;
        (self.inputs, self.quota) = (inputs.clone(), quota.clone());
        Ok(self)
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

impl Medium for OutputFile {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.quota.take(bytes.len() as u64)?;
        self.bytes += bytes.len() as u64;
        faults::writing().and_then(|()| self.file.write_all(bytes)).map_err(|e| Error::io(&self.target, "write", e))
    }
    fn overwrite_start(&mut self, bytes: &[u8]) -> Result<()> {
        let written = faults::writing().and_then(|()| self.file.seek(SeekFrom::Start(0)));
        let written = written.and_then(|_| self.file.write_all(bytes));
        written.map_err(|e| Error::io(&self.target, "write", e))
    }
    fn publish(&mut self) -> Result<()> {
        let Some(path) = &self.path else { return Ok(()) };
        self.inputs.check(&self.target, &self.named)?;
        let old = fs::symlink_metadata(&self.target).ok().or(self.old.take());
        if let Some(old) = old {
            inherit(&self.file, &old).map_err(|e| Error::io(&self.target, "setting the permissions", e))?;
        }
        faults::writing().and_then(|()| self.file.sync_all()).map_err(|e| Error::io(&self.target, "sync", e))?;
        fs::rename(path, &self.target).map_err(|e| Error::io(&self.target, "rename", e))?;
        self.path = None;
        sync_folder(&self.folder).map_err(|e| Error::io(&self.target, "syncing the folder", e))
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        self.quota.give(self.bytes);
        if let Some(path) = self.path.take() {
            // An error cannot be returned here. The next build to this target tries again.
            let _ = fs::remove_file(path);
        }
    }
}

/// An output that goes to a stream, for instance standard output. It is kept in a scratch file until it is published,
/// because its first bytes are known last.
pub struct OutputStream<W: Write + Send> {
    kept: Scratch,
    start: Vec<u8>,
    to: W,
}

impl<W: Write + Send> OutputStream<W> {
    /// Begins an output to `to`. The scratch file is in the system's folder for temporary files.
    pub fn new(to: W) -> Result<Self> {
        Ok(Self { kept: ScratchSpace::new(None).file()?, start: Vec::new(), to })
    }
}

impl<W: Write + Send> Medium for OutputStream<W> {
    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.kept.append(bytes).map(drop)
    }
    fn overwrite_start(&mut self, bytes: &[u8]) -> Result<()> {
        self.start = bytes.to_vec();
        Ok(())
    }
    fn publish(&mut self) -> Result<()> {
        let fail = |e| Error::io("standard output", "write", e);
        self.to.write_all(&self.start).map_err(fail)?;
        let (mut at, mut piece) = (self.start.len() as u64, vec![0; 1 << 20]);
        while at < self.kept.len() {
            let len = (self.kept.len() - at).min(piece.len() as u64) as usize;
            self.kept.read_at(at, &mut piece[..len])?;
            self.to.write_all(&piece[..len]).map_err(fail)?;
            at += len as u64;
        }
        self.to.flush().map_err(fail)
    }
}

/// Largest number of links that lead to a target, as on Linux.
const LINKS: usize = 40;

/// Returns the regular file that `target` names or will name.
fn resolve(target: &Path) -> io::Result<PathBuf> {
    let refuse = |why| Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    if target.as_os_str().as_encoded_bytes().last().is_some_and(|&b| std::path::is_separator(char::from(b))) {
        return refuse("is the name of a folder");
    }
    let mut file = target.to_path_buf();
    for _ in 0..LINKS {
        let meta = match fs::symlink_metadata(&file) {
            Err(e) if e.kind() == io::ErrorKind::NotFound && file == target => return Ok(file),
            Err(e) if e.kind() == io::ErrorKind::NotFound => return refuse("the link leads to no file"),
            meta => meta?,
        };
        if !meta.is_symlink() {
            return if let Some(why) = objection(&meta) { refuse(why) } else { Ok(file) };
        }
        let folder = fs::canonicalize(folder_of(&file))?;
        // A link of /proc to a file that is open somewhere, as /dev/stdout is: its user means the open file.
        if folder.starts_with("/proc") {
            return refuse("not a regular file");
        }
        file = folder.join(fs::read_link(&file)?);
    }
    refuse("too many symbolic links")
}

/// Returns the reason why an existing file must not be replaced. (A rename over `/dev/null` would break the machine.)
fn objection(meta: &Metadata) -> Option<&'static str> {
    match meta {
        _ if meta.is_dir() => Some("is a folder"),
        _ if !meta.is_file() => Some("not a regular file"),
        _ if meta.permissions().readonly() => Some("the file is read-only"),
        _ => None,
    }
}

/// Returns the options that create a file. If it will replace one, only its owner may read it until then.
fn new_file(replaces: bool) -> OpenOptions {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if replaces {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    }
    #[cfg(not(unix))]
    let _ = replaces;
    options
}

/// Gives `file` the group, permissions and owner of `old`, as far as the process may.
#[cfg(unix)]
fn inherit(file: &File, old: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    let has_group = file.metadata()?.gid() == old.gid() || fchown(file, None, Some(old.gid())).is_ok();
    let wanted = permissions(old.mode(), has_group);
    let now = file.metadata()?.mode() & 0o777;
    if now != wanted {
        let set = file.set_permissions(fs::Permissions::from_mode(wanted));
        // Some file systems have one fixed mode for all files.
        set.or_else(|e| if now & !wanted == 0 { Ok(()) } else { Err(e) })?;
    }
    // Last, because the process may change nothing of a file that it has given away. Mostly it may not give it away.
    if file.metadata()?.uid() != old.uid() {
        let _ = fchown(file, Some(old.uid()), None);
    }
    Ok(())
}

/// Returns the permissions of a file that replaces one of this mode. If it could not keep the group, the new group and
/// all others have only permissions that the old group and all others had.
#[cfg(unix)]
fn permissions(mode: u32, has_group: bool) -> u32 {
    let common = mode & (mode >> 3) & 0o7;
    if has_group { mode & 0o777 } else { mode & 0o700 | common << 3 | common }
}

#[cfg(not(unix))]
fn inherit(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Returns the folder that contains `file`.
fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
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
#[path = "output_tests.rs"]
mod tests;
