//! Sources that fail, stall and dawdle.

use outcrop::store::{CallbackSource, ModelFile, Source};
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// Serves the file as it is now; `on_read` is called after each read with where it was, may change what was read, and
/// may fail.
pub fn meddled(
    path: &Path,
    on_read: impl Fn(u64, &mut [u8]) -> io::Result<()> + Send + Sync + 'static,
) -> Arc<dyn Source> {
    let bytes = std::fs::read(path).expect("the file");
    let len = bytes.len() as u64;
    let read = move |at: u64, buf: &mut [u8]| {
        buf.copy_from_slice(&bytes[at as usize..at as usize + buf.len()]);
        on_read(at, buf)
    };
    Arc::new(CallbackSource::new(path, len, Box::new(read)))
}

/// Where each block is stored.
pub fn blocks(path: &Path) -> Vec<Range<u64>> {
    let file = ModelFile::open_path(path).expect("the file");
    file.directory().iter().map(|row| row.offset..row.end()).collect()
}

/// Whether a read at `at` of `len` bytes has some of `of`.
pub fn reaches(at: u64, len: usize, of: &Range<u64>) -> bool {
    at < of.end && of.start < at + len as u64
}

/// Counts reads once armed.
#[derive(Default)]
pub struct Calls {
    armed: AtomicBool,
    count: AtomicUsize,
}

impl Calls {
    pub fn arm(&self) {
        self.armed.store(true, SeqCst);
    }
    pub fn count(&self) -> usize {
        self.count.load(SeqCst)
    }
    /// The number of this read, from 0; `None` before counting begins.
    pub fn next(&self) -> Option<usize> {
        self.armed.load(SeqCst).then(|| self.count.fetch_add(1, SeqCst))
    }
}

/// Holds up whoever comes, until it is opened.
#[derive(Default)]
pub struct Gate {
    /// Whether it is open, and how many have come to it while it was not.
    state: Mutex<(bool, usize)>,
    changed: Condvar,
}

impl Gate {
    pub fn pass(&self) {
        let mut state = self.state.lock().expect("the gate");
        state.1 += usize::from(!state.0);
        self.changed.notify_all();
        drop(self.changed.wait_while(state, |state| !state.0).expect("the gate"));
    }
    pub fn open(&self) {
        self.state.lock().expect("the gate").0 = true;
        self.changed.notify_all();
    }
    /// Waits until somebody is held up; whether somebody was within `timeout`.
    pub fn is_reached(&self, timeout: Duration) -> bool {
        let state = self.state.lock().expect("the gate");
        !self.changed.wait_timeout_while(state, timeout, |state| state.1 == 0).expect("the gate").1.timed_out()
    }
}

/// Opens a gate when it goes, so that a test that fails ends.
pub struct OpensAtEnd(pub Arc<Gate>);

impl Drop for OpensAtEnd {
    fn drop(&mut self) {
        self.0.open();
    }
}

/// Empties the system's memory of files where it lets us, as root. Elsewhere what follows reads from it.
pub fn forget_files() {
    let _ = std::fs::write("/proc/sys/vm/drop_caches", "3");
}
