//! Reference-counted objects behind incomplete C types.
//!
//! A `*mut oc_scene` points to a [`Shell`] in an `Arc`. The Rust type `oc_scene` has no members either, so that no code
//! can use its content by mistake.

use super::fork;
use super::guard::{Checked, Failure, bad, panicked};
use crate::base::error::Error;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// A C type and the Rust object behind it.
pub(crate) trait Handle {
    /// The Rust object behind it.
    type Object: Send + Sync;
    /// Its name in the header.
    const NAME: &'static str;
    /// Distinguishes the kinds of objects, and with high probability other memory from an object.
    const TAG: u64;
}

/// The memory that a handle points to.
#[repr(C)]
pub(crate) struct Shell<T> {
    tag: u64,
    poisoned: AtomicBool,
    /// The process that created the object.
    process: u32,
    object: T,
}

impl<T> Shell<T> {
    /// Poisons the object: later calls return `OC_STATUS_POISONED`.
    pub(crate) fn poison(&self) {
        self.poisoned.store(true, Relaxed);
    }

    /// True if a process from which this one was forked created the object.
    fn is_of_parent(&self) -> bool {
        self.process != fork::process()
    }
}

impl<T> std::ops::Deref for Shell<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.object
    }
}

impl<T> Drop for Shell<T> {
    fn drop(&mut self) {
        // A use after the last release is a bug of the caller. Clearing the tag makes it likelier that `borrow_any`
        // notices it. SAFETY: a field of this object. The write is volatile, otherwise the compiler would remove it.
        unsafe { (&raw mut self.tag).write_volatile(0) };
    }
}

/// Creates an object with one reference, which the caller owns.
pub(crate) fn give<H: Handle>(object: H::Object) -> *mut H {
    fork::watch();
    let shell = Shell { tag: H::TAG, poisoned: AtomicBool::new(false), process: fork::process(), object };
    Arc::into_raw(Arc::new(shell)).cast_mut().cast()
}

/// Borrows the object behind a handle, poisoned or not.
///
/// # Safety
/// `handle` is null or a live handle of any kind of this library.
pub(crate) unsafe fn borrow_any<'a, H: Handle>(handle: *const H) -> Checked<&'a Shell<H::Object>> {
    if handle.is_null() {
        return bad(format!("{} is NULL", H::NAME));
    }
    let shell: *const Shell<H::Object> = handle.cast();
    if !shell.is_aligned() {
        return bad(format!("the handle is not a live {}", H::NAME));
    }
    // SAFETY: a live handle points to a `Shell`. The first member of every kind of shell is the tag.
    if unsafe { shell.cast::<u64>().read() } != H::TAG {
        return bad(format!("the handle is not a live {}", H::NAME));
    }
    // SAFETY: the tag shows that the object is of this kind. It lives as long as the caller holds its reference.
    Ok(unsafe { &*shell })
}

/// Borrows the object behind a handle. Refuses a poisoned one, and one of a parent process.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn borrow<'a, H: Handle>(handle: *const H) -> Checked<&'a Shell<H::Object>> {
    // SAFETY: the caller's contract.
    let shell = unsafe { borrow_any(handle)? };
    if shell.is_of_parent() {
        let why = format!("the {} belongs to the parent process; a child of fork can only release it", H::NAME);
        return Err(Error::BadState(why).into());
    }
    if shell.poisoned.load(Relaxed) { Err(Failure::Poisoned(H::NAME)) } else { Ok(shell) }
}

/// Returns another reference to the object behind a handle, for an object that depends on it.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn share<H: Handle>(handle: *const H) -> Checked<Arc<Shell<H::Object>>> {
    // SAFETY: the caller's contract. `borrow` has checked the kind, and the object is alive.
    unsafe {
        borrow(handle)?;
        let shell = handle.cast::<Shell<H::Object>>();
        Arc::increment_strong_count(shell);
        Ok(Arc::from_raw(shell))
    }
}

/// Runs `f` on the object behind a handle. A panic poisons the object.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn with<H: Handle>(
    handle: *const H,
    f: impl FnOnce(&Shell<H::Object>) -> Checked<()>,
) -> Checked<()> {
    // SAFETY: the caller's contract.
    let shell = unsafe { borrow(handle)? };
    let caught = catch_unwind(AssertUnwindSafe(|| {
        #[cfg(debug_assertions)]
        super::testing::trip(super::testing::IN_OBJECT);
        f(shell)
    }));
    caught.unwrap_or_else(|panic| {
        shell.poison();
        Err(Failure::Error(panicked(&*panic)))
    })
}

thread_local! {
    /// The handles of this thread's running calls that may call back, each with the number of references released
    /// meanwhile.
    static IN_CALLS: RefCell<Vec<(*const (), usize)>> = const { RefCell::new(Vec::new()) };
}

/// As [`with`], for calls that may call back into the host. If the callback releases this handle in the same thread,
/// the release takes effect at the end of the call. (The call holds no reference of its own: the release of another
/// thread would then not be the last, and would not wait.)
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn with_callbacks<H: Handle>(
    handle: *const H,
    f: impl FnOnce(&Shell<H::Object>) -> Checked<()>,
) -> Checked<()> {
    // A thread that is ending may have no list any more. Its releases then take effect at once.
    let is_listed = IN_CALLS.try_with(|calls| calls.borrow_mut().push((handle.cast(), 0))).is_ok();
    // SAFETY: the caller's contract. References that this thread releases meanwhile are kept until below.
    let result = unsafe { with(handle, f) };
    let last = || IN_CALLS.try_with(|calls| calls.borrow_mut().pop()).ok().flatten();
    let released = if is_listed { last().map_or(0, |(_, released)| released) } else { 0 };
    for _ in 0..released {
        // SAFETY: a reference of the host, released during `f`. An outer call of this thread on the same handle defers
        // it again.
        unsafe { release(handle) };
    }
    result
}

/// True if an outer call of this thread uses the handle. That call then releases the reference.
fn is_for_later(handle: *const ()) -> bool {
    let later = |calls: &RefCell<Vec<(*const (), usize)>>| {
        let mut calls = calls.borrow_mut();
        let Some(call) = calls.iter_mut().find(|(of, _)| *of == handle) else { return false };
        call.1 += 1;
        true
    };
    IN_CALLS.try_with(later).unwrap_or(false)
}

/// Adds a reference. Does nothing for NULL or a handle of another kind.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn retain<H: Handle>(handle: *const H) {
    // SAFETY: the caller's contract. `borrow_any` has checked the kind.
    unsafe {
        if borrow_any(handle).is_ok_and(|shell| !shell.is_of_parent()) {
            Arc::increment_strong_count(handle.cast::<Shell<H::Object>>());
        }
    }
}

/// Releases a reference. Does nothing for NULL, a handle of another kind, or a handle of a parent process: its
/// destructor would wait for threads that do not exist here. Catches a panic in the object's destructor.
///
/// # Safety
/// As for [`borrow_any`]; the caller owns a reference.
pub(crate) unsafe fn release<H: Handle>(handle: *const H) {
    let _ = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: the caller's contract. `borrow_any` has checked the kind.
        unsafe {
            let is_ours = borrow_any(handle).is_ok_and(|shell| !shell.is_of_parent());
            if is_ours && !is_for_later(handle.cast()) {
                Arc::decrement_strong_count(handle.cast::<Shell<H::Object>>());
            }
        }
    }));
}

/// Implements [`Handle`]: `handle!(oc_scene, SceneObject, 3)`.
macro_rules! handle {
    ($c:ident, $object:ty, $number:literal) => {
        impl crate::capi::handles::Handle for $c {
            type Object = $object;
            const NAME: &'static str = stringify!($c);
            // The ASCII bytes of "outcrop" and the number.
            const TAG: u64 = 0x6f75_7463_726f_7000 + $number;
        }
    };
}
pub(crate) use handle;
