//! Files that OBJ and MTL lines name.

use crate::import::access::Candidates;
use crate::import::text;
use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};

/// Returns the files that `name` may mean in a line of `file`.
///
/// Files are written on one system and read on another, so names need not be exact: `\` separates folders too, a name
/// may be quoted or have a comment behind it, a path that does not exist here, or may not be read, is reduced to its
/// last name in the folder of `file`, and the case of letters counts only if two names differ in nothing else.
pub(crate) fn candidates(file: &Path, name: &[u8]) -> Candidates<'static> {
    let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
    let expected = folder.join(text::name(name).replace('\\', "/"));
    let spellings = spellings(name);
    let last = spellings.iter().filter_map(|path| path.file_name().map(OsStr::to_os_string));
    let last: Vec<OsString> = last.collect();
    let exact = spellings.iter().map(PathBuf::as_path).chain(last.iter().map(Path::new));
    let exact: Vec<PathBuf> = exact.map(|path| folder.join(path)).collect();
    let below = spellings.iter().filter_map(|path| path.parent()).filter(|place| goes_down(place));
    let places: Vec<PathBuf> = below.map(|place| folder.join(place)).chain([folder.clone()]).collect();
    let in_any_case =
        places.into_iter().flat_map(move |place| last.clone().into_iter().find_map(|name| in_any_case(&place, &name)));
    Candidates { paths: Box::new(exact.into_iter().chain(in_any_case)), expected }
}

/// Returns a name without a comment behind it and without quotes.
pub(crate) fn plain(name: &[u8]) -> &[u8] {
    unquoted(text::name_before_comment(name).unwrap_or(name).trim_ascii())
}

fn unquoted(name: &[u8]) -> &[u8] {
    name.strip_prefix(b"\"").and_then(|n| n.strip_suffix(b"\"")).unwrap_or(name)
}

/// True if a path leads into folders below only.
fn goes_down(place: &Path) -> bool {
    place.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// Returns the paths that a name may mean, the most literal first.
fn spellings(name: &[u8]) -> Vec<PathBuf> {
    let mut paths = Vec::new();
    for name in [Some(name), text::name_before_comment(name)].into_iter().flatten() {
        let name = unquoted(name);
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
