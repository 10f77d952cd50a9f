//! All errors of the crate, grouped by the party that can act on them: the caller, the installation, the machine, or
//! the maintainers of the crate.
//!
//! A block that is not in memory is not an error but an outcome (`structure::Outcome::Pending`).

use std::fmt;
use std::path::{Path, PathBuf};

/// The result of every fallible call of the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// The place of an error in an input file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The whole file.
    File,
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte of a binary file, counted from 0.
    Byte(u64),
}

/// An error. `#[non_exhaustive]`: later versions add kinds.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// For the caller: an argument is out of its documented range. The call changed nothing.
    BadArgument(String),
    /// For the caller: the call is not possible in the object's present state.
    BadState(String),
    /// The input file of a build cannot be parsed.
    Parse {
        /// The input file.
        file: PathBuf,
        /// The place in the file.
        place: Place,
        /// The reason, in a few words.
        why: String,
    },
    /// A model file is damaged, or is no model file.
    Corrupt {
        /// The file, or a name for a source that has none.
        file: PathBuf,
        /// The block, if the damage is inside one.
        block: Option<u32>,
        /// The reason, in a few words.
        why: String,
    },
    /// For the installation: a newer outcrop wrote the file.
    NewerFormat {
        /// The file.
        file: PathBuf,
        /// Major and minor version of the file.
        found: (u16, u16),
        /// Newest major and minor version that this library reads.
        supported: (u16, u16),
    },
    /// The budget is too small for the work.
    OverBudget {
        /// The work that needs the budget.
        what: String,
        /// The least sufficient budget, in bytes.
        need: u64,
        /// The present budget, in bytes.
        have: u64,
    },
    /// The work exceeds a limit that the caller set for it.
    OverLimit {
        /// The counted objects.
        what: &'static str,
        /// The greatest number that the limit allows.
        most: u64,
        /// The name of the limit.
        limit: &'static str,
    },
    /// For the machine: it cannot provide memory of this size.
    NoMemory {
        /// The object that needs the memory.
        what: String,
        /// Its size in bytes.
        bytes: u64,
    },
    /// The owner of the work cancelled it.
    Cancelled,
    /// For the machine: reading or writing failed.
    Io {
        /// The file, or a name for an object that has none.
        path: PathBuf,
        /// The operation that failed: "open", "read", "write", "sync", "rename", ...
        doing: &'static str,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// For the maintainers: a defect of the crate, for instance a caught panic. The object is poisoned.
    Internal(String),
}

impl Error {
    /// An [`Error::BadArgument`] with any text.
    pub fn bad_argument(what: impl Into<String>) -> Self {
        Error::BadArgument(what.into())
    }

    /// True if no part of the work can be left out because of this error: the work was cancelled, or the system has no
    /// memory, so that another run would have another result.
    pub fn ends_work(&self) -> bool {
        matches!(self, Error::Cancelled | Error::NoMemory { .. })
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
    /// A copy, for several callers that wait for the same work. The copy of an [`Error::Io`] keeps the kind, the text
    /// and the system's error number.
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
            Error::OverLimit { what, most, limit } => Error::OverLimit { what, most: *most, limit },
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
            Error::BadState(what) => write!(f, "invalid state: {what}"),
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
                "{}: written in format {}.{}, but this library reads formats up to {}.{}",
                file.display(),
                found.0,
                found.1,
                supported.0,
                supported.1
            ),
            Error::OverBudget { what, need, have } => {
                write!(f, "{what} needs a memory budget of at least {need} bytes, but the budget is {have} bytes")
            }
            Error::OverLimit { what, most, limit } => write!(f, "{what}: more than {most}, the limit {limit}"),
            Error::NoMemory { what, bytes } => write!(f, "{what}: the system cannot provide {bytes} bytes of memory"),
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
