//! Working memory that is used again. It lies in places that threads look at from different ones on: mostly none waits
//! for another, nor writes where another reads.

use std::any::Any;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, TryLockError};

/// What lies in a place. In cache lines of its own.
#[derive(Default)]
#[repr(align(128))]
struct Place(Mutex<Option<Box<dyn Any + Send>>>);

/// As many places as are kept at most.
pub struct WorkingMemory(Box<[Place]>);

static NEXT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Where a thread looks first.
    static HOME: usize = NEXT.fetch_add(1, Relaxed);
}

impl WorkingMemory {
    /// `count`: at least 1.
    pub fn new(count: usize) -> Self {
        Self((0..count.max(1)).map(|_| Place::default()).collect())
    }

    /// Memory that was given back, or new.
    pub fn take<T: Any + Send + Default>(&self) -> Box<T> {
        let there = self.first(|place| place.take_if(|it| it.is::<T>()));
        there.and_then(|it| it.downcast().ok()).unwrap_or_default()
    }

    /// Gives it back; it goes where there is no place left.
    pub fn give(&self, it: Box<dyn Any + Send>) {
        let mut it = Some(it);
        self.first(|place| {
            if place.is_none() {
                *place = it.take();
            }
            it.is_none().then_some(())
        });
    }

    /// What `look` first finds, from the thread's own place on. Places that others look at are left out.
    fn first<R>(&self, mut look: impl FnMut(&mut Option<Box<dyn Any + Send>>) -> Option<R>) -> Option<R> {
        // It may be the last that a thread does.
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
    fn what_is_given_back_is_taken_again_as_far_as_there_are_places() {
        let memory = WorkingMemory::new(2);
        let mut three: Vec<Box<Vec<u32>>> = (0..3).map(|_| memory.take()).collect();
        assert!(three.iter().all(|it| it.is_empty()));
        three.iter_mut().enumerate().for_each(|(i, it)| it.push(i as u32));
        three.into_iter().for_each(|it| memory.give(it));
        // Of another kind there is none.
        assert_eq!(*memory.take::<u64>(), 0);
        let again: Vec<Box<Vec<u32>>> = (0..3).map(|_| memory.take()).collect();
        let mut found: Vec<u32> = again.iter().flat_map(|it| it.iter().copied()).collect();
        found.sort_unstable();
        assert_eq!(found, [0, 1]);
    }

    /// Each piece has a number, and nobody takes one that is taken.
    #[test]
    fn what_a_thread_has_taken_no_other_gets() {
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
