//! Parallel helpers that can also run wholly in the calling thread.

/// How many threads a build may use. With one, nothing leaves the calling thread (and rayon, which
/// would start threads of its own, is not entered): a host that lends us its threads relies on it.
#[derive(Debug, Clone, Copy)]
pub struct Par {
    /// At least 1.
    pub threads: usize,
}

impl Par {
    /// Runs both, in parallel where allowed.
    pub fn join<A: Send, B: Send>(&self, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        if self.threads > 1 { rayon::join(a, b) } else { (a(), b()) }
    }

    /// `f` of each of `0..n`, in order.
    pub fn map<T: Send>(&self, n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        use rayon::prelude::*;
        if self.threads > 1 { (0..n).into_par_iter().map(f).collect() } else { (0..n).map(f).collect() }
    }

    /// `f` of each item of `items`, in order.
    pub fn map_items<I: Send, T: Send>(&self, items: Vec<I>, f: impl Fn(I) -> T + Sync + Send) -> Vec<T> {
        use rayon::prelude::*;
        if self.threads > 1 { items.into_par_iter().map(f).collect() } else { items.into_iter().map(f).collect() }
    }
}
