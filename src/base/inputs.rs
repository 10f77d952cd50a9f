//! The files that some work has read: its output must replace none of them.

use super::error::{Error, Result};
use std::collections::BTreeMap;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Identity of an existing file: equal for all names and links of one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity(#[cfg(unix)] (u64, u64), #[cfg(not(unix))] PathBuf);

impl Identity {
    /// Returns the identity of the file that `path` names, through links.
    pub fn of(path: &Path) -> io::Result<Self> {
        Self::of_open(path, &fs::metadata(path)?)
    }

    /// Returns the identity of a file that was opened as `path`.
    #[cfg(unix)]
    pub fn of_open(_: &Path, meta: &Metadata) -> io::Result<Self> {
        use std::os::unix::fs::MetadataExt;
        Ok(Self((meta.dev(), meta.ino())))
    }

    /// Returns the identity of a file that was opened as `path`.
    #[cfg(not(unix))]
    pub fn of_open(path: &Path, _: &Metadata) -> io::Result<Self> {
        fs::canonicalize(path).map(Self)
    }
}

/// The files that were read so far. Copies share one list.
#[derive(Debug, Clone, Default)]
pub struct Inputs(Arc<Mutex<BTreeMap<PathBuf, Identity>>>);

impl Inputs {
    /// Adds a file that was opened as `path`.
    pub fn add(&self, path: &Path, identity: Identity) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_path_buf(), identity);
    }

    /// Fails with [`Error::BadArgument`] if `file`, which the caller calls `target`, is one of the files, by whatever
    /// name, link or hard link.
    pub fn check(&self, file: &Path, target: &Path) -> Result<()> {
        let Ok(old) = Identity::of(file) else { return Ok(()) };
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match all.iter().find(|(_, identity)| **identity == old) {
            None => Ok(()),
            Some((input, _)) => Err(same_file(target, input)),
        }
    }
}

/// The error of an output that is an input.
pub(super) fn same_file(target: &Path, input: &Path) -> Error {
    let (target, input) = (target.display(), input.display());
    Error::bad_argument(format!("the output {target} is the same file as the input {input}, which it would overwrite"))
}
