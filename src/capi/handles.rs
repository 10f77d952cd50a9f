//! Counted objects behind incomplete C types.
//!
//! A `*mut oc_scene` points to a [`Shell`] in an `Arc`; the C type itself has no members in Rust
//! either, so that nobody can look through it by mistake.

use super::guard::{Checked, Failure, bad, panicked};
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// A C type and what is behind it.
pub(crate) trait Handle {
    /// What is behind it.
    type Object: Send + Sync;
    /// Its name in the header.
    const NAME: &'static str;
    /// Tells it from other objects (and, by luck, from what is no object).
    const TAG: u64;
}

/// What a handle points to.
#[repr(C)]
pub(crate) struct Shell<T> {
    tag: u64,
    poisoned: AtomicBool,
    object: T,
}

impl<T> Shell<T> {
    /// From now on calls answer `OC_STATUS_POISONED`.
    pub(crate) fn poison(&self) {
        self.poisoned.store(true, Relaxed);
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
        // A handle used after its last release is a bug of the caller's; this makes it likelier to
        // be noticed. SAFETY: our own field; volatile, or it would be optimised away.
        unsafe { (&raw mut self.tag).write_volatile(0) };
    }
}

/// Makes an object with one count, owned by the caller.
pub(crate) fn give<H: Handle>(object: H::Object) -> *mut H {
    let shell = Shell { tag: H::TAG, poisoned: AtomicBool::new(false), object };
    Arc::into_raw(Arc::new(shell)).cast_mut().cast()
}

/// Borrows the object behind a handle, poisoned or not.
///
/// # Safety
/// `handle` is null or a live handle (of any kind of ours).
pub(crate) unsafe fn borrow_any<'a, H: Handle>(handle: *const H) -> Checked<&'a Shell<H::Object>> {
    if handle.is_null() {
        return bad(format!("{} is NULL", H::NAME));
    }
    let shell: *const Shell<H::Object> = handle.cast();
    if !shell.is_aligned() {
        return bad(format!("this is no {}", H::NAME));
    }
    // SAFETY: a live handle points to a `Shell`, whose first member is the tag whatever its kind.
    if unsafe { shell.cast::<u64>().read() } != H::TAG {
        return bad(format!("this is no {}", H::NAME));
    }
    // SAFETY: the tag says that it is this kind; alive as long as the caller holds its count.
    Ok(unsafe { &*shell })
}

/// Borrows the object behind a handle; a poisoned one is refused.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn borrow<'a, H: Handle>(handle: *const H) -> Checked<&'a Shell<H::Object>> {
    // SAFETY: the caller's contract.
    let shell = unsafe { borrow_any(handle)? };
    if shell.poisoned.load(Relaxed) { Err(Failure::Poisoned(H::NAME)) } else { Ok(shell) }
}

/// A count of the object behind a handle, for an object that needs it.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn share<H: Handle>(handle: *const H) -> Checked<Arc<Shell<H::Object>>> {
    // SAFETY: the caller's contract; `borrow` made sure of the kind, and that it is alive.
    unsafe {
        borrow(handle)?;
        let shell = handle.cast::<Shell<H::Object>>();
        Arc::increment_strong_count(shell);
        Ok(Arc::from_raw(shell))
    }
}

/// Runs `f` on the object behind a handle; a panic poisons it.
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
    /// Handles that calls of this thread which may call back are given, and counts that were taken back meanwhile.
    static IN_CALLS: RefCell<Vec<(*const (), usize)>> = const { RefCell::new(Vec::new()) };
}

/// [`with`], for calls that may call back: what the host releases of this handle in that call back, in the same thread,
/// goes when the call ends. (Without a count of its own: by that another thread's release would not be the last, and
/// not wait.)
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn with_callbacks<H: Handle>(
    handle: *const H,
    f: impl FnOnce(&Shell<H::Object>) -> Checked<()>,
) -> Checked<()> {
    // A thread that is ending may have no list any more; then its releases are at once.
    let is_listed = IN_CALLS.try_with(|calls| calls.borrow_mut().push((handle.cast(), 0))).is_ok();
    // SAFETY: the caller's contract; what this thread releases meanwhile is kept until below.
    let result = unsafe { with(handle, f) };
    let last = || IN_CALLS.try_with(|calls| calls.borrow_mut().pop()).ok().flatten();
    let released = if is_listed { last().map_or(0, |(_, released)| released) } else { 0 };
    for _ in 0..released {
        // SAFETY: a count of the host's, which gave it back in `f`. Calls of this thread on the same handle around this
        // one keep it in turn.
        unsafe { release(handle) };
    }
    result
}

/// Whether a call of this thread around this one is given the handle: then it takes back the count.
fn is_for_later(handle: *const ()) -> bool {
    let later = |calls: &RefCell<Vec<(*const (), usize)>>| {
        let mut calls = calls.borrow_mut();
        let Some(call) = calls.iter_mut().find(|(of, _)| *of == handle) else { return false };
        call.1 += 1;
        true
    };
    IN_CALLS.try_with(later).unwrap_or(false)
}

/// Adds a count; NULL and what is no handle of this kind are left alone.
///
/// # Safety
/// As for [`borrow_any`].
pub(crate) unsafe fn retain<H: Handle>(handle: *const H) {
    // SAFETY: the caller's contract; `borrow_any` made sure of the kind.
    unsafe {
        if borrow_any(handle).is_ok() {
            Arc::increment_strong_count(handle.cast::<Shell<H::Object>>());
        }
    }
}

/// Takes a count back; NULL and what is no handle of this kind are left alone. A panic while an
/// object goes stays here.
///
/// # Safety
/// As for [`borrow_any`]; the caller owns a count.
pub(crate) unsafe fn release<H: Handle>(handle: *const H) {
    let _ = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: the caller's contract; `borrow_any` made sure of the kind.
        unsafe {
            if borrow_any(handle).is_ok() && !is_for_later(handle.cast()) {
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
            // "outcrop" and the number.
            const TAG: u64 = 0x6f75_7463_726f_7000 + $number;
        }
    };
}
pub(crate) use handle;
