//! Every way in which a call can fail, grouped by who can act on it.
//!
//! A block that is not in memory is not an error but an outcome
//! (`structure::Outcome::Pending`).

use std::fmt;
use std::path::{Path, PathBuf};

/// The result of every fallible call of the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Where in an input file something is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The whole file.
    File,
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte of a binary file, counted from 0.
    Byte(u64),
}

/// What went wrong. `#[non_exhaustive]`: later versions add kinds.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The caller: an argument is out of its documented range; nothing changed.
    BadArgument(String),
    /// The caller: the call is not possible in the object's present state.
    BadState(String),
    /// The input file of a build cannot be understood.
    Parse {
        /// The input file.
        file: PathBuf,
        /// Where in it.
        place: Place,
        /// What is wrong there, in a few words.
        why: String,
    },
    /// A built file is damaged or not one of ours.
    Corrupt {
        /// The file (or a name for a source that has none).
        file: PathBuf,
        /// The block, when the damage is inside one.
        block: Option<u32>,
        /// What is wrong, in a few words.
        why: String,
    },
    /// The installation: the file was written by a newer outcrop.
    NewerFormat {
        /// The file.
        file: PathBuf,
        /// Major and minor version found.
        found: (u16, u16),
        /// Newest major and minor version that this library reads.
        supported: (u16, u16),
    },
    /// The budget in bytes is too small for the work.
    OverBudget {
        /// What needs it.
        what: String,
        /// The least budget, in bytes, that would do.
        need: u64,
        /// The budget in force, in bytes.
        have: u64,
    },
    /// The machine: it gives no memory of this size.
    NoMemory {
        /// What needs it.
        what: String,
        /// How much, in bytes.
        bytes: u64,
    },
    /// The work was cancelled by its owner.
    Cancelled,
    /// The machine: reading or writing failed.
    Io {
        /// The file, or a name for what has none.
        path: PathBuf,
        /// What was being done: "open", "read", "write", "sync", "rename", ...
        doing: &'static str,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// Us: a defect (for instance a caught panic). The object is poisoned.
    Internal(String),
}

impl Error {
    /// A [`Error::BadArgument`] from any text.
    pub fn bad_argument(what: impl Into<String>) -> Self {
        Error::BadArgument(what.into())
    }

    /// An [`Error::Io`] for `path`.
    pub fn io(path: impl AsRef<Path>, doing: &'static str, source: std::io::Error) -> Self {
        Error::Io { path: path.as_ref().to_path_buf(), doing, source }
    }

    /// An [`Error::Parse`] of `file`.
    pub fn parse(file: impl AsRef<Path>, place: Place, why: impl Into<String>) -> Self {
        Error::Parse { file: file.as_ref().to_path_buf(), place, why: why.into() }
    }

    /// An [`Error::Corrupt`] of `file`.
    pub fn corrupt(file: impl AsRef<Path>, block: Option<u32>, why: impl Into<String>) -> Self {
        Error::Corrupt { file: file.as_ref().to_path_buf(), block, why: why.into() }
    }
}

impl Clone for Error {
    /// The same error once more, for several callers that wait for the same work. What an [`Error::Io`] carries
    /// keeps its kind, its text and the system's number.
    fn clone(&self) -> Self {
        match self {
            Error::BadArgument(what) => Error::BadArgument(what.clone()),
            Error::BadState(what) => Error::BadState(what.clone()),
            Error::Parse { file, place, why } => Error::Parse { file: file.clone(), place: *place, why: why.clone() },
            Error::Corrupt { file, block, why } => {
                Error::Corrupt { file: file.clone(), block: *block, why: why.clone() }
            }
            Error::NewerFormat { file, found, supported } => {
                Error::NewerFormat { file: file.clone(), found: *found, supported: *supported }
            }
            Error::OverBudget { what, need, have } => {
                Error::OverBudget { what: what.clone(), need: *need, have: *have }
            }
            Error::NoMemory { what, bytes } => Error::NoMemory { what: what.clone(), bytes: *bytes },
            Error::Cancelled => Error::Cancelled,
            Error::Io { path, doing, source } => Error::Io { path: path.clone(), doing, source: again(source) },
            Error::Internal(what) => Error::Internal(what.clone()),
        }
    }
}

fn again(e: &std::io::Error) -> std::io::Error {
    match e.raw_os_error() {
        Some(number) => std::io::Error::from_raw_os_error(number),
        None => std::io::Error::new(e.kind(), e.to_string()),
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::BadArgument(what) => write!(f, "bad argument: {what}"),
            Error::BadState(what) => write!(f, "not possible now: {what}"),
            Error::Parse { file, place, why } => match place {
                Place::File => write!(f, "{}: {why}", file.display()),
                Place::Line(n) => write!(f, "{}, line {n}: {why}", file.display()),
                Place::Byte(n) => write!(f, "{}, byte {n}: {why}", file.display()),
            },
            Error::Corrupt { file, block: Some(b), why } => {
                write!(f, "{}, block {b}: {why}", file.display())
            }
            Error::Corrupt { file, block: None, why } => write!(f, "{}: {why}", file.display()),
            Error::NewerFormat { file, found, supported } => write!(
                f,
                "{}: written in format {}.{}, this library reads up to {}.{}",
                file.display(),
                found.0,
                found.1,
                supported.0,
                supported.1
            ),
            Error::OverBudget { what, need, have } => {
                write!(f, "{what} needs a budget of at least {need} bytes, it has {have}")
            }
            Error::NoMemory { what, bytes } => write!(f, "{what}: the system gives no {bytes} bytes of memory"),
            Error::Cancelled => write!(f, "cancelled"),
            Error::Io { path, doing, source } => {
                write!(f, "{}: {doing} failed: {source}", path.display())
            }
            Error::Internal(what) => write!(f, "internal error: {what}"),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}
