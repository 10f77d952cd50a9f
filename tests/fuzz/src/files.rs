//! Input files: several in one string of bytes, written to a folder of the running thread.

use std::cell::RefCell;
use std::path::PathBuf;
use tempfile::TempDir;

/// Between two files of an input.
pub const MARK: &[u8] = b"\n%%FILE%%\n";

thread_local! {
    static FOLDER: RefCell<Option<TempDir>> = const { RefCell::new(None) };
}

/// A folder in memory where there is one: a target writes thousands of files. `TMPDIR`, if it is set, comes first.
pub fn temporary() -> TempDir {
    let given = std::env::var_os("TMPDIR").map(PathBuf::from);
    let folder = given.unwrap_or_else(|| PathBuf::from("/dev/shm"));
    tempfile::tempdir_in(folder).or_else(|_| tempfile::tempdir()).expect("a temporary folder")
}

/// Returns the path of `name` in this thread's folder.
pub fn path(name: &str) -> PathBuf {
    FOLDER.with_borrow_mut(|folder| folder.get_or_insert_with(temporary).path().join(name))
}

/// Splits `data` at each [`MARK`] into files with these names, and writes them. The last file takes the rest. Removes
/// files of these names that `data` has not. Returns the path of the first file.
pub fn write(names: &[&str], data: &[u8]) -> PathBuf {
    let mut rest = Some(data);
    for (i, name) in names.iter().enumerate() {
        let Some(bytes) = rest else {
            let _ = std::fs::remove_file(path(name));
            continue;
        };
        let end = if i + 1 < names.len() { find(bytes) } else { None };
        std::fs::write(path(name), end.map_or(bytes, |end| &bytes[..end])).expect("an input file");
        rest = end.map(|end| &bytes[end + MARK.len()..]);
    }
    path(names[0])
}

/// Joins files to one input.
pub fn join(files: &[&[u8]]) -> Vec<u8> {
    files.join(MARK)
}

fn find(bytes: &[u8]) -> Option<usize> {
    bytes.windows(MARK.len()).position(|window| window == MARK)
}
