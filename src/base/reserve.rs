//! A reserve for small allocations that the system refuses. Rust code cannot return an error there: the process would
//! end.
//!
//! The reserve lies in the program's zero-initialised data: it costs no memory before it is used. While more than half
//! of it is taken and the system still refuses memory, [`check`] fails, and long work, which calls it before each step,
//! ends with [`super::error::Error::NoMemory`]. The work then frees its memory, and with it the reserve. Nothing else
//! changes: no allocation has failed. Larger allocations, whose size grows with the input, are not served: code that
//! makes them uses [`super::memory`].

use super::error::Result;
use super::memory;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::UnsafeCell;
use std::hint::{black_box, spin_loop};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Size of the reserve in bytes.
pub const BYTES: usize = 32 << 20;
/// Largest allocation that the reserve serves, in bytes. Pieces of data, as blocks and batches of triangles, are
/// smaller.
pub const LARGEST: usize = 4 << 20;
/// Work ends if more of the reserve is taken than this. What it allocates until it notices takes the rest.
const LOW: usize = BYTES / 2;
/// Number of bytes that the system must provide before work continues with a low reserve.
const PROBE: usize = 2 * LARGEST;
/// Smallest block, and the alignment of all that are larger: that of a page at most.
const LEAST: usize = 16;
const PAGE: usize = 4096;
/// Number of block sizes: powers of two from `LEAST` to `LARGEST`.
const CLASSES: usize = (LARGEST / LEAST).ilog2() as usize + 1;

/// A global allocator: that of the system, and the reserve for what it refuses.
#[derive(Debug, Default)]
pub struct Reserve<A = System>(pub A);

// SAFETY: memory comes from the allocator `A`, or from `RESERVE`, whose blocks are disjoint while they are taken, as
// large as their class, and aligned. It goes back to where its address says that it is from. Nothing unwinds.
unsafe impl<A: GlobalAlloc> GlobalAlloc for Reserve<A> {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        let memory = unsafe { self.0.alloc(layout) };
        if memory.is_null() { RESERVE.take(layout) } else { memory }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        let memory = unsafe { self.0.alloc_zeroed(layout) };
        if !memory.is_null() {
            return memory;
        }
        let memory = RESERVE.take(layout);
        if !memory.is_null() {
            // SAFETY: a block of at least this size, which is the caller's.
            unsafe { memory.write_bytes(0, layout.size()) };
        }
        memory
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        if RESERVE.holds(memory) {
            RESERVE.give(memory, layout);
        } else {
            // SAFETY: the caller's promise; the memory is of the allocator.
            unsafe { self.0.dealloc(memory, layout) };
        }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let is_reserve = RESERVE.holds(memory);
        if !is_reserve {
            // SAFETY: the caller's promise; the memory is of the allocator.
            let moved = unsafe { self.0.realloc(memory, layout, size) };
            if !moved.is_null() {
                return moved;
            }
        }
        // SAFETY: the caller promises that the size, rounded up to the alignment, does not overflow.
        let new = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        // SAFETY: the caller's promise: the size is not 0. The allocator has just refused to move its own memory.
        let moved = if is_reserve { unsafe { self.alloc(new) } } else { RESERVE.take(new) };
        if !moved.is_null() {
            // SAFETY: two blocks of at least these sizes, which do not overlap; the old one is freed once.
            unsafe {
                moved.copy_from_nonoverlapping(memory, layout.size().min(size));
                self.dealloc(memory, layout);
            }
        }
        moved
    }
}

/// Fails with [`super::error::Error::NoMemory`] while the reserve is low and the system refuses memory. Long work calls
/// it before each step; usually it reads one number.
#[inline]
pub fn check() -> Result<()> {
    if RESERVE.used.load(Ordering::Relaxed) <= LOW { Ok(()) } else { probe() }
}

#[cold]
fn probe() -> Result<()> {
    let provided = memory::room::<u8>(PROBE, "the work")?;
    black_box(provided.as_ptr());
    Ok(())
}

/// The memory of the reserve. It is part of the program, as the allocator is.
static RESERVE: Store = Store {
    locked: AtomicBool::new(false),
    used: AtomicUsize::new(0),
    state: UnsafeCell::new(State { live: 0, free: [0; CLASSES] }),
    memory: UnsafeCell::new(Memory([0; BYTES])),
};

/// Used through pointers only.
#[repr(align(4096))]
struct Memory(#[allow(dead_code)] [u8; BYTES]);

struct Store {
    locked: AtomicBool,
    /// Number of bytes before the first one that was never taken.
    used: AtomicUsize,
    /// Used under the lock only.
    state: UnsafeCell<State>,
    memory: UnsafeCell<Memory>,
}

struct State {
    /// Number of blocks that are taken.
    live: usize,
    /// For each size the first free block, as its offset plus 1; the block begins with the next one. 0: none.
    free: [usize; CLASSES],
}

// SAFETY: the state is used under the lock. A block is used by its taker only.
unsafe impl Sync for Store {}

impl Store {
    fn begin(&self) -> *mut u8 {
        self.memory.get().cast()
    }

    fn holds(&self, memory: *mut u8) -> bool {
        memory.addr().wrapping_sub(self.begin().addr()) < BYTES
    }

    /// The index of the block size for a layout; `None` if there is none.
    fn class(layout: Layout) -> Option<usize> {
        let size = layout.size().max(layout.align()).max(LEAST);
        let fits = size <= LARGEST && layout.align() <= PAGE;
        fits.then(|| (size.next_power_of_two() / LEAST).ilog2() as usize)
    }

    /// Calls `work` under the lock. No other lock is taken meanwhile, and nothing is allocated.
    fn locked<T>(&self, work: impl FnOnce(&mut State) -> T) -> T {
        while self.locked.compare_exchange_weak(false, true, Ordering::Acquire, Ordering::Relaxed).is_err() {
            spin_loop();
        }
        // SAFETY: the lock is held, so there is no other reference.
        let done = work(unsafe { &mut *self.state.get() });
        self.locked.store(false, Ordering::Release);
        done
    }

    /// Takes a block, or returns null if there is none.
    fn take(&self, layout: Layout) -> *mut u8 {
        let Some(class) = Self::class(layout) else { return null_mut() };
        let size = LEAST << class;
        self.locked(|state| {
            let offset = if let Some(offset) = state.free[class].checked_sub(1) {
                // SAFETY: a free block within the memory; `give` has written the number at its begin.
                state.free[class] = unsafe { self.begin().add(offset).cast::<usize>().read() };
                offset
            } else {
                // Larger blocks are aligned to a page, as the memory is.
                let offset = self.used.load(Ordering::Relaxed).next_multiple_of(size.min(PAGE));
                if offset + size > BYTES {
                    return null_mut();
                }
                self.used.store(offset + size, Ordering::Relaxed);
                offset
            };
            state.live += 1;
            // SAFETY: within the memory.
            unsafe { self.begin().add(offset) }
        })
    }

    /// Returns a block of this layout. If it is the last one, all memory is unused again.
    fn give(&self, memory: *mut u8, layout: Layout) {
        let Some(class) = Self::class(layout) else { return };
        let offset = memory.addr() - self.begin().addr();
        self.locked(|state| {
            state.live -= 1;
            if state.live == 0 {
                state.free = [0; CLASSES];
                self.used.store(0, Ordering::Relaxed);
                return;
            }
            // SAFETY: the block, of at least 16 bytes and aligned to 16, belongs to no caller any more.
            unsafe { memory.cast::<usize>().write(state.free[class]) };
            state.free[class] = offset + 1;
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An allocator that has nothing.
    struct Nothing;

    // SAFETY: it provides no memory.
    unsafe impl GlobalAlloc for Nothing {
        unsafe fn alloc(&self, _: Layout) -> *mut u8 {
            null_mut()
        }
        unsafe fn dealloc(&self, _: *mut u8, _: Layout) {
            unreachable!("it has provided none");
        }
        // SAFETY: it provides no memory.
        unsafe fn realloc(&self, _: *mut u8, _: Layout, _: usize) -> *mut u8 {
            null_mut()
        }
    }

    /// Blocks of many sizes: each keeps its bytes until it is returned, through growth and reuse.
    #[test]
    fn the_reserve_serves_what_the_system_refuses() {
        let allocator = Reserve(Nothing);
        let layout = |size: usize, align: usize| Layout::from_size_align(size, align).expect("a layout");
        let mut taken: Vec<(*mut u8, Layout, u8)> = Vec::new();
        let mut state = 1u64;
        let mut random = |n: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize % n
        };
        let mut refused = 0;
        for round in 0..10_000 {
            let bits = random(20);
            let size = 1 + random(1 << bits);
            if random(5) < 3 {
                let layout = layout(size, 1 << random(8));
                // SAFETY: a size above 0.
                let memory =
                    unsafe { if round % 2 == 0 { allocator.alloc(layout) } else { allocator.alloc_zeroed(layout) } };
                if memory.is_null() {
                    refused += 1;
                    continue;
                }
                assert!(memory.addr().is_multiple_of(layout.align()) && RESERVE.holds(memory));
                // SAFETY: a block of this size.
                unsafe {
                    assert!(round % 2 == 0 || (0..layout.size()).all(|i| memory.add(i).read() == 0));
                    memory.write_bytes(round as u8, layout.size());
                }
                taken.push((memory, layout, round as u8));
            } else if !taken.is_empty() {
                let (memory, old, byte) = taken.swap_remove(random(taken.len()));
                // SAFETY: a block of this layout, which is returned once.
                unsafe {
                    assert!((0..old.size()).all(|i| memory.add(i).read() == byte));
                    let kept = old.size().min(size);
                    let new = allocator.realloc(memory, old, size);
                    let (memory, old) = if new.is_null() { (memory, old) } else { (new, layout(size, old.align())) };
                    assert!((0..kept).all(|i| memory.add(i).read() == byte));
                    allocator.dealloc(memory, old);
                }
            }
        }
        assert!(refused > 100, "the reserve has an end");
        // SAFETY: a size above 0.
        assert!(unsafe { allocator.alloc(layout(LARGEST + 1, 1)) }.is_null());
        // The system has memory, so that a low reserve stops nothing.
        assert!(RESERVE.used.load(Ordering::Relaxed) > LOW && check().is_ok());
        for (memory, layout, _) in taken {
            // SAFETY: as above.
            unsafe { allocator.dealloc(memory, layout) };
        }
        assert_eq!(RESERVE.used.load(Ordering::Relaxed), 0);
    }
}
