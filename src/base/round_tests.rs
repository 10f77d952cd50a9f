//! Model test of [`super::round`]: loom runs every interleaving that the memory model allows.

/// The atomics of `round.rs`, replaced by loom's.
mod sync {
    pub use loom::sync::atomic::{AtomicUsize, Ordering};
}
#[allow(clippy::duplicate_mod)] // compiled twice on purpose: with other atomics
#[allow(dead_code)] // the model needs no `has_items`
#[path = "round.rs"]
mod round;

use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use loom::thread;
use round::Round;

/// A round of two items whose bodies write without synchronisation of their own.
struct Game {
    round: Round,
    /// Loom reports a race if the last participant could read an item while it is still being written.
    items: [UnsafeCell<u32>; 2],
    ended: AtomicUsize,
}

impl Game {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            round: Round::new(2),
            items: [UnsafeCell::new(0), UnsafeCell::new(0)],
            ended: AtomicUsize::new(0),
        })
    }
    fn work(&self) {
        while let Some(item) = self.round.claim() {
            self.items[item].with_mut(unsafe_add);
            if self.round.complete() {
                self.end();
            }
        }
    }
    fn cancel(&self) {
        if self.round.drain() {
            self.end();
        }
    }
    fn end(&self) {
        self.ended.fetch_add(1, Relaxed);
        for item in &self.items {
            item.with(|x| assert!(unsafe_get(x) <= 1, "an item was run twice"));
        }
    }
    fn sum(&self) -> u32 {
        self.items.iter().map(|i| i.with(unsafe_get)).sum()
    }
}

fn unsafe_add(x: *mut u32) {
    // SAFETY: loom provides the pointer only while it tracks the access, and fails on a race.
    unsafe { *x += 1 }
}
fn unsafe_get(x: *const u32) -> u32 {
    // SAFETY: as above.
    unsafe { *x }
}

#[test]
fn each_item_once_and_one_end_after_all() {
    loom::model(|| {
        let game = Game::new();
        let other = Arc::clone(&game);
        let thread = thread::spawn(move || other.work());
        game.work();
        thread.join().unwrap();
        assert_eq!((game.ended.load(Relaxed), game.sum()), (1, 2));
    });
}

#[test]
fn a_cancel_at_any_moment_leaves_exactly_one_end() {
    loom::model(|| {
        let game = Game::new();
        let (a, b) = (Arc::clone(&game), Arc::clone(&game));
        let one = thread::spawn(move || a.work());
        let two = thread::spawn(move || b.cancel());
        game.cancel();
        one.join().unwrap();
        two.join().unwrap();
        assert_eq!(game.ended.load(Relaxed), 1);
        assert!(game.sum() <= 2);
    });
}
