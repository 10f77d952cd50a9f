//! Helpers of the readers' tests: reading bytes as a file, truncating and damaging them.

use super::collect::Collector;
use super::{ReadOptions, read_file};
use crate::base::error::Result;
use tempfile::TempDir;

pub(crate) fn temporary() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Reads `bytes` as a file with the given name.
pub(crate) fn read_bytes(name: &str, bytes: impl AsRef<[u8]>) -> Result<Collector> {
    read_files(&[(name, bytes.as_ref())])
}

/// Writes the files into one folder and reads the first of them.
pub(crate) fn read_files(files: &[(&str, &[u8])]) -> Result<Collector> {
    let folder = temporary();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("a file written");
    }
    let mut sink = Collector::new();
    read_file(&folder.path().join(files[0].0), &ReadOptions::default(), &mut sink)?;
    Ok(sink)
}

/// Returns the error message of a file that must be refused.
pub(crate) fn refused(name: &str, bytes: impl AsRef<[u8]>) -> String {
    match read_bytes(name, bytes) {
        Ok(sink) => panic!("{name} was read: {} triangles, notes {:?}", sink.received, sink.notes),
        Err(error) => error.to_string(),
    }
}

/// Asserts that every proper prefix of `bytes` is refused.
pub(crate) fn refuses_every_truncation(name: &str, bytes: &[u8]) {
    for len in 0..bytes.len() {
        if let Ok(sink) = read_bytes(name, &bytes[..len]) {
            panic!("{name} was read after {len} of {} bytes: {} triangles", bytes.len(), sink.received);
        }
    }
}

/// Asserts that reading any prefix of `bytes` terminates, with or without an error, and yields at most as many
/// triangles as the whole.
pub(crate) fn survives_every_truncation(name: &str, bytes: &[u8]) {
    let all = read_bytes(name, bytes).expect("the whole file").received;
    for len in 0..bytes.len() {
        if let Ok(sink) = read_bytes(name, &bytes[..len]) {
            assert!(sink.received <= all, "{name} after {len} bytes: {} triangles of {all}", sink.received);
        }
    }
}

/// Reads `bytes` with some bytes changed; the test passes if reading terminates, with or without an error.
pub(crate) fn survives_damage(name: &str, bytes: &[u8], changes: &[(usize, u8)]) {
    let mut damaged = bytes.to_vec();
    for &(at, value) in changes {
        let at = at % damaged.len();
        damaged[at] = value;
    }
    let _ = read_bytes(name, &damaged);
}
