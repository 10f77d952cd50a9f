//! Parallel helpers that can also run entirely in the calling thread.

use crate::base::error::Result;
use crate::base::memory;

/// Number of threads that a build may use. With one thread all work stays in the calling thread, and rayon, which would
/// start its own threads, is not entered. A host that provides its own threads relies on this.
#[derive(Debug, Clone, Copy)]
pub struct Par {
    /// At least 1.
    pub threads: usize,
}

impl Par {
    /// Runs both functions, in parallel where allowed.
    pub fn join<A: Send, B: Send>(&self, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        if self.threads > 1 { rayon::join(a, b) } else { (a(), b()) }
    }

    /// Returns the results of `f` for `0..n`, in order.
    pub fn map<T: Send>(&self, n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        use rayon::prelude::*;
        if self.threads > 1 { (0..n).into_par_iter().map(f).collect() } else { (0..n).map(f).collect() }
    }

    /// As [`Par::map`], but fails with `NoMemory` if the system has no memory for the results: for `what` they are.
    pub fn try_map<T: Send>(&self, n: usize, what: &str, f: impl Fn(usize) -> T + Sync + Send) -> Result<Vec<T>> {
        use rayon::prelude::*;
        let mut out = memory::room(n, what)?;
        if self.threads > 1 {
            (0..n).into_par_iter().map(f).collect_into_vec(&mut out)
        } else {
            out.extend((0..n).map(f))
        }
        Ok(out)
    }

    /// Returns the results of `f` for each item of `items`, in order.
    pub fn map_items<I: Send, T: Send>(&self, items: Vec<I>, f: impl Fn(I) -> T + Sync + Send) -> Vec<T> {
        use rayon::prelude::*;
        if self.threads > 1 { items.into_par_iter().map(f).collect() } else { items.into_iter().map(f).collect() }
    }
}
