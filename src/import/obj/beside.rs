//! Files that OBJ and MTL lines name.

use crate::import::text;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Returns the file that `name` means in a line of `file`, if it exists.
///
/// Files are written on one system and read on another, so names need not be exact: `\` separates folders too, a name
/// may be quoted or have a comment behind it, a path that does not exist here is reduced to its last name in the
/// folder of `file`, and the case of letters counts only if two names differ in nothing else.
pub(crate) fn find(file: &Path, name: &[u8]) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let spellings = spellings(name);
    let whole = spellings.iter().map(|path| folder.join(path)).find(|path| path.is_file());
    whole.or_else(|| {
        let last = || spellings.iter().filter_map(|path| path.file_name());
        last().map(|name| folder.join(name)).find(|path| path.is_file()).or_else(|| {
            let places = spellings.iter().filter_map(|path| Some(folder.join(path.parent()?)));
            let places = places.chain([folder.to_path_buf()]);
            places.into_iter().find_map(|place| last().find_map(|name| in_any_case(&place, name)))
        })
    })
}

/// Returns the path of `name` in the folder of `file`, for messages about a file that does not exist.
pub(crate) fn expected(file: &Path, name: &[u8]) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(text::name(name).replace('\\', "/"))
}

/// Returns the paths that a name may mean, the most literal first.
fn spellings(name: &[u8]) -> Vec<PathBuf> {
    let mut paths = Vec::new();
    for name in [Some(name), text::name_before_comment(name)].into_iter().flatten() {
        let name = name.strip_prefix(b"\"").and_then(|n| n.strip_suffix(b"\"")).unwrap_or(name);
        if name.is_empty() {
            continue;
        }
        paths.push(path(name));
        // In some codings a backslash is the second byte of a letter: the literal name comes first.
        let slashes: Vec<u8> = name.iter().map(|&b| if b == b'\\' { b'/' } else { b }).collect();
        paths.push(path(&slashes));
    }
    paths
}

#[cfg(unix)]
fn path(name: &[u8]) -> PathBuf {
    use std::os::unix::ffi::OsStrExt;
    PathBuf::from(OsStr::from_bytes(name))
}
#[cfg(not(unix))]
fn path(name: &[u8]) -> PathBuf {
    PathBuf::from(text::name(name))
}

fn in_any_case(folder: &Path, name: &OsStr) -> Option<PathBuf> {
    // The folder of a name without one is "".
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut entries = std::fs::read_dir(folder).ok()?.flatten();
    entries.find(|entry| entry.file_name().eq_ignore_ascii_case(name)).map(|entry| entry.path()).filter(|p| p.is_file())
}
