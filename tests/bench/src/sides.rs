//! What traces: outcrop and its peers, asked in the same way. Chunks of rays are dealt to threads, which flush
//! denormals.

use outcrop::simd::DenormalsOff;
use std::sync::Mutex;

/// Rays that a thread takes at a time.
pub const CHUNK: usize = 4096;

/// What was hit, as far as all sides tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Infinity for a miss. Of shadow rays: 0 for a hit.
    pub t: f64,
}

impl Answer {
    pub const MISS: Self = Self { t: f64::INFINITY };

    pub fn is_hit(&self) -> bool {
        self.t < f64::INFINITY
    }
}

/// Rays made ready for one way of asking one side; only `run` is timed.
pub trait Run {
    /// Puts back what the last run has overwritten.
    fn prepare(&mut self);
    /// Traces all rays in so many threads and sums how directly the hit surfaces face them, so that hits are looked at.
    fn run(&mut self, threads: usize) -> f64;
    /// After a run.
    fn answers(&self) -> Vec<Answer>;
}

/// Deals `items` to threads; sums what `work` returns of each. Every thread makes a `state` of its own.
pub fn deal<I: Send, S>(
    threads: usize,
    items: impl Iterator<Item = I> + Send,
    state: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, I) -> f64 + Sync,
) -> f64 {
    let items = Mutex::new(items);
    let one = || {
        let _denormals = DenormalsOff::set();
        let (mut sum, mut state) = (0.0, state());
        loop {
            let Some(item) = items.lock().expect("no thread panics while it takes an item").next() else { return sum };
            sum += work(&mut state, item);
        }
    };
    std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(one)).collect();
        let mine = one();
        others.into_iter().map(|thread| thread.join().expect("tracing does not panic")).sum::<f64>() + mine
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_dealt_once_and_denormals_are_flushed() {
        for threads in [1, 2, 5] {
            let mut done = vec![0u32; 100];
            let sum = deal(
                threads,
                done.iter_mut().enumerate(),
                || (),
                |(), (i, done)| {
                    *done += 1;
                    // With denormals this product is not zero.
                    let tiny = std::hint::black_box(f32::MIN_POSITIVE) * std::hint::black_box(0.5);
                    i as f64 + f64::from(tiny.to_bits())
                },
            );
            assert_eq!(sum, 4950.0);
            assert!(done.iter().all(|&n| n == 1));
        }
    }
}
