//! Working memory that is reused. Pieces lie in places, and each thread begins its search at another place: mostly no
//! thread waits for another, nor writes to a cache line that another reads.

use std::any::Any;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, TryLockError};

/// A place for one piece of memory, in cache lines of its own.
#[derive(Default)]
#[repr(align(128))]
struct Place(Mutex<Option<Box<dyn Any + Send>>>);

/// A fixed number of places for pieces that are not in use.
pub struct WorkingMemory(Box<[Place]>);

static NEXT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// The place where a thread begins its search.
    static HOME: usize = NEXT.fetch_add(1, Relaxed);
}

impl WorkingMemory {
    /// `count`: the number of places, at least 1.
    pub fn new(count: usize) -> Self {
        Self((0..count.max(1)).map(|_| Place::default()).collect())
    }

    /// Returns a piece of this type that was given back, or a new one.
    pub fn take<T: Any + Send + Default>(&self) -> Box<T> {
        let there = self.first(|place| place.take_if(|it| it.is::<T>()));
        there.and_then(|it| it.downcast().ok()).unwrap_or_default()
    }

    /// Gives a piece back. It is dropped if no place is free.
    pub fn give(&self, it: Box<dyn Any + Send>) {
        let mut it = Some(it);
        self.first(|place| {
            if place.is_none() {
                *place = it.take();
            }
            it.is_none().then_some(())
        });
    }

    /// Calls `look` for the places, from the thread's own one on, until it returns a value. Places that other threads
    /// hold locked are skipped.
    fn first<R>(&self, mut look: impl FnMut(&mut Option<Box<dyn Any + Send>>) -> Option<R>) -> Option<R> {
        // The thread may be ending, and its thread-local values gone.
        let home = HOME.try_with(|home| *home).unwrap_or(0) % self.0.len();
        let (before, from) = self.0.split_at(home);
        from.iter().chain(before).find_map(|place| match place.0.try_lock() {
            Ok(mut place) => look(&mut place),
            Err(TryLockError::Poisoned(place)) => look(&mut place.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_given_back_are_reused_up_to_the_number_of_places() {
        let memory = WorkingMemory::new(2);
        let mut three: Vec<Box<Vec<u32>>> = (0..3).map(|_| memory.take()).collect();
        assert!(three.iter().all(|it| it.is_empty()));
        three.iter_mut().enumerate().for_each(|(i, it)| it.push(i as u32));
        three.into_iter().for_each(|it| memory.give(it));
        // There is no piece of another type.
        assert_eq!(*memory.take::<u64>(), 0);
        let again: Vec<Box<Vec<u32>>> = (0..3).map(|_| memory.take()).collect();
        let mut found: Vec<u32> = again.iter().flat_map(|it| it.iter().copied()).collect();
        found.sort_unstable();
        assert_eq!(found, [0, 1]);
    }

    /// Each piece has a number, and no thread gets a piece that another has taken.
    #[test]
    fn no_two_threads_get_the_same_piece() {
        #[derive(Default)]
        struct Piece(usize);
        let memory = WorkingMemory::new(3);
        let taken: Vec<AtomicUsize> = (0..=20_000).map(|_| AtomicUsize::new(0)).collect();
        let made = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..5000 {
                        let mut piece = memory.take::<Piece>();
                        if piece.0 == 0 {
                            piece.0 = made.fetch_add(1, Relaxed) + 1;
                        }
                        assert_eq!(taken[piece.0].fetch_add(1, Relaxed), 0);
                        taken[piece.0].fetch_sub(1, Relaxed);
                        memory.give(piece);
                    }
                });
            }
        });
        let made = made.into_inner();
        assert!((1..20_000).contains(&made), "{made} of 20000 were new");
    }
}
