//! The memory that a build takes: its budget, and not more the larger the model is.

use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Counts the bytes that all threads hold, and the most they ever held.
struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn took(bytes: usize) {
    MOST.fetch_max(NOW.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        took(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        took(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both for a moment, where it moves.
        took(size);
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Builds a generated model; the most bytes held meanwhile.
fn build(name: &str, triangles: u64, memory_budget: u64) -> (usize, BuildReport) {
    let folder = tempfile::tempdir().unwrap();
    let options =
        BuildOptions { memory_budget, threads: 2, temp_dir: Some(folder.path().into()), ..Default::default() };
    let before = NOW.load(Relaxed);
    MOST.store(before, Relaxed);
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
    generate(name, &GenerateOptions { triangles, seed: 0 }, &Cancel::new(), &mut builder).unwrap();
    let report = builder.finish(&folder.path().join("model.oc")).unwrap();
    let most = MOST.load(Relaxed) - before;
    let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
    println!(
        "{triangles} of {name}: {:.1} MiB of {:.1}, {} chunks",
        mib(most),
        mib(memory_budget as usize),
        report.chunks
    );
    (most, report)
}

/// One test: the count is the process's.
#[test]
fn a_build_keeps_to_its_budget() {
    for (name, triangles) in [("mandelbulb", 1_000_000), ("airliner", 600_000)] {
        for budget in [32 << 20, 64 << 20] {
            let (most, report) = build(name, triangles, budget);
            assert!(report.chunks > 2, "{report:?}");
            assert!(most as u64 <= budget, "{name}: {most} of {budget} bytes");
        }
    }
}
