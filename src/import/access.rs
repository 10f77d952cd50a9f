//! Files that a mesh file refers to: material libraries, buffers, textures. All readers open them here.
//!
//! A mesh file may come from anywhere, so that the names in it are not trusted. By default it may only refer to files
//! in its own folder and the folders below it, whatever the name looks like and wherever symbolic links lead. The
//! caller may allow more folders, or any file, or resolve names itself ([`Resolver`]).
//!
//! A name is checked and opened in one step: its real path is opened from the handle of an allowed folder, component
//! by component, and no component may be a symbolic link. A link that another program puts there meanwhile is refused.

use super::ReadOptions;
use super::input::{Input, Stamp};
use crate::base::error::{Error, Place, Result};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The files that mesh files may refer to.
#[derive(Clone, Default)]
pub struct Access {
    /// Folders that may be read, with all below them, in addition to the folder of each mesh file.
    pub folders: Vec<PathBuf>,
    /// True if any file may be read.
    pub any: bool,
    /// Resolves names before these rules do.
    pub resolver: Option<Arc<dyn Resolver>>,
}

impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { folders, any, resolver } = self;
        f.debug_struct("Access")
            .field("folders", folders)
            .field("any", any)
            .field("resolver", &resolver.is_some())
            .finish()
    }
}

/// Resolves the names of files that mesh files refer to.
pub trait Resolver: Send + Sync {
    /// Returns the file that `name` means in `file`.
    ///
    /// `name`: the URI or name as it is written. `file`: path of the mesh file or material library that has it, or the
    /// name of a library that came as bytes. The thread that reads the mesh file calls this. An error counts as a file
    /// that cannot be read, except that [`Error::Cancelled`] ends the reading.
    fn resolve(&self, name: &[u8], file: &Path) -> Result<Resolved>;
}

/// The answer of a [`Resolver`].
pub enum Resolved {
    /// The rules of [`Access`] apply.
    Default,
    /// The content of the file.
    Bytes(Box<dyn AsRef<[u8]>>),
    /// A file that may be read, wherever it is.
    Path(PathBuf),
    /// The file must not be read.
    Refused,
}

/// A folder that may be read.
struct Root {
    /// Its path without symbolic links.
    real: PathBuf,
    #[cfg(target_os = "linux")]
    handle: std::os::fd::OwnedFd,
}

/// Opens the files that one mesh file refers to, and keeps the state of each.
pub(crate) struct Files<'a> {
    pub(crate) options: &'a ReadOptions,
    access: &'a Access,
    roots: Vec<Root>,
    /// If the document was opened by a symbolic link: the folder of the link, and that of the document.
    moved: Option<(PathBuf, PathBuf)>,
    /// State of each opened file at its first opening.
    opened: RefCell<BTreeMap<PathBuf, Stamp>>,
}

/// Paths that a name may mean, most literal first, and the path that messages show if there is none.
pub(crate) struct Candidates<'c> {
    pub(crate) paths: Box<dyn Iterator<Item = PathBuf> + 'c>,
    pub(crate) expected: PathBuf,
}

impl<'a> Files<'a> {
    /// Prepares the files that `document` refers to. `document` exists.
    pub(crate) fn new(document: &Path, options: &'a ReadOptions) -> Self {
        let access = &options.access;
        let real = document.canonicalize();
        let own = [folder_of(document), real.as_deref().map_or(Path::new("."), folder_of)];
        let allowed = own.into_iter().chain(access.folders.iter().map(PathBuf::as_path));
        let mut roots: Vec<Root> = Vec::new();
        for folder in allowed.filter(|_| !access.any) {
            // A folder that does not exist allows nothing.
            if let Ok(root) = Root::open(folder)
                && roots.iter().all(|known| known.real != root.real)
            {
                roots.push(root);
            }
        }
        let linked = document.parent().unwrap_or(Path::new(""));
        let moved = match (&real, folder_of(document).canonicalize()) {
            (Ok(real), Ok(folder)) if folder != folder_of(real) => Some((linked.into(), folder_of(real).into())),
            _ => None,
        };
        Self { options, access, roots, moved, opened: RefCell::default() }
    }

    /// Opens the file that `name` means in `file`.
    ///
    /// Fails with `Io` if there is no such file, with `Parse`, naming `file`, if the name is refused, and with the
    /// errors of the resolver.
    pub(crate) fn open<'c>(
        &self,
        name: &[u8],
        file: &Path,
        candidates: impl FnOnce() -> Result<Candidates<'c>>,
    ) -> Result<Input> {
        if let Some(resolver) = &self.access.resolver {
            match resolver.resolve(name, file)? {
                Resolved::Default => {}
                Resolved::Bytes(bytes) => return Ok(Input::of_bytes(&super::text::name(name), bytes)),
                Resolved::Path(path) => return self.keep(Input::open(&path)?),
                Resolved::Refused => return Err(refuse(name, file, "was refused by the host")),
            }
        }
        let Candidates { paths, expected } = candidates()?;
        let mut outside = None;
        for path in self.with_moved(paths).filter(|path| path.is_file()) {
            match self.open_path(&path) {
                Ok(Some(input)) => return self.keep(input),
                Ok(None) => outside = outside.or(Some(path)),
                Err(error) => return Err(error),
            }
        }
        match outside {
            None if self.leaves(&expected) => Err(refuse(name, file, OUTSIDE)),
            // The reason why it is no file.
            None => Err(match Input::open(&expected) {
                Err(error) => error,
                Ok(_) => Error::io(expected, "open", io::ErrorKind::NotFound.into()),
            }),
            Some(_) => Err(refuse(name, file, OUTSIDE)),
        }
    }

    /// Returns the paths, and behind them those in the folder of a document that was opened by a link.
    fn with_moved<'p>(&self, paths: Box<dyn Iterator<Item = PathBuf> + 'p>) -> Box<dyn Iterator<Item = PathBuf> + 'p> {
        let Some((from, to)) = &self.moved else { return paths };
        let all: Vec<PathBuf> = paths.collect();
        let moved = all.iter().filter_map(|path| Some(to.join(path.strip_prefix(from).ok()?)));
        let moved: Vec<PathBuf> = moved.collect();
        Box::new(all.into_iter().chain(moved))
    }

    /// True if files outside of the mesh file's folder may be read.
    pub(crate) fn trusts_more(&self) -> bool {
        self.access.any || !self.access.folders.is_empty()
    }

    /// Opens a file, if the rules allow it.
    fn open_path(&self, path: &Path) -> Result<Option<Input>> {
        if self.access.any {
            return Input::open(path).map(Some);
        }
        let fail = |e| Error::io(path, "open", e);
        let real = path.canonicalize().map_err(fail)?;
        let inside = |root: &&Root| real.starts_with(&root.real);
        let Some(root) = self.roots.iter().find(inside) else { return Ok(None) };
        let file = root.open_below(&real).map_err(fail)?;
        Input::of_file(path, file).map(Some)
    }

    /// True if a path that does not exist leads out of the allowed folders by its letters alone.
    fn leaves(&self, path: &Path) -> bool {
        let Some(real) = path.ancestors().find_map(|folder| folder.canonicalize().ok()) else { return false };
        !self.access.any && !self.roots.iter().any(|root| real.starts_with(&root.real))
    }

    fn keep(&self, input: Input) -> Result<Input> {
        let stamp = input.stamp();
        stamp.report(&self.options.inputs);
        self.opened.borrow_mut().entry(stamp.path().to_path_buf()).or_insert_with(|| stamp.clone());
        Ok(input)
    }

    /// Fails if a file was changed since it was opened.
    pub(crate) fn unchanged(&self) -> Result<()> {
        self.opened.borrow().values().try_for_each(Stamp::unchanged)
    }
}

/// Flags that open a folder as a place to begin at, even if it cannot be listed.
#[cfg(target_os = "linux")]
const FOLDER: rustix::fs::OFlags =
    rustix::fs::OFlags::PATH.union(rustix::fs::OFlags::DIRECTORY).union(rustix::fs::OFlags::CLOEXEC);

const OUTSIDE: &str = "is outside of the folder of the file, and the build does not trust other paths";

fn refuse(name: &[u8], file: &Path, why: &str) -> Error {
    let shown: String = super::text::name(name).chars().take(80).collect();
    Error::parse(file, Place::File, format!("{shown:?} {why}"))
}

/// Returns the folder that contains `file`.
fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

impl Root {
    fn open(folder: &Path) -> io::Result<Self> {
        let real = folder.canonicalize()?;
        #[cfg(target_os = "linux")]
        return Ok(Self { handle: rustix::fs::open(&real, FOLDER, rustix::fs::Mode::empty())?, real });
        #[cfg(not(target_os = "linux"))]
        Ok(Self { real })
    }

    /// Opens a regular file by its real path, which is below the folder.
    #[cfg(target_os = "linux")]
    fn open_below(&self, real: &Path) -> io::Result<File> {
        use rustix::fs::{Mode, OFlags, openat};
        use std::path::Component;
        let below = real.strip_prefix(&self.real).map_err(|_| io::ErrorKind::NotFound)?;
        // A pipe is opened without waiting for its other end.
        let last = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let mut at = self.handle.try_clone()?;
        let mut components = below.components().peekable();
        while let Some(component) = components.next() {
            let Component::Normal(name) = component else { return Err(io::ErrorKind::NotFound.into()) };
            let flags = if components.peek().is_some() { FOLDER } else { last };
            at = openat(&at, name, flags | OFlags::NOFOLLOW, Mode::empty())?;
        }
        Ok(at.into())
    }

    /// Opens a file by its real path, which is below the folder, and makes sure that the path still means it.
    #[cfg(not(target_os = "linux"))]
    fn open_below(&self, real: &Path) -> io::Result<File> {
        use crate::base::inputs::Identity;
        let file = File::open(real)?;
        let same = Identity::of_open(real, &file.metadata()?)? == Identity::of(real)?;
        if same && real.canonicalize()? == real { Ok(file) } else { Err(io::ErrorKind::NotFound.into()) }
    }
}

#[cfg(test)]
#[path = "access_tests.rs"]
mod tests;
