//! Statuses, and the reason in words.

use super::guard;
use std::ffi::{CStr, c_char};

/// What a call says, or why background work failed. The hundreds say who can act: 1 the caller, 2
/// the file, 3 the installation, 4 the budget, 5 the machine, 6 us. Numbers are never reused.
pub type oc_status = u32;

/// All is well.
pub const OC_STATUS_OK: oc_status = 0;
/// The caller: an argument is NULL, out of its range, or of another context; nothing changed.
pub const OC_STATUS_INVALID_ARGUMENT: oc_status = 100;
/// The caller: not possible in the object's present state; nothing changed.
pub const OC_STATUS_INVALID_STATE: oc_status = 101;
/// The caller: the array given is too small; the count it should have was written, nothing else.
pub const OC_STATUS_BUFFER_TOO_SMALL: oc_status = 102;
/// The caller: cancelled on request.
pub const OC_STATUS_CANCELLED: oc_status = 103;
/// The file: an input of a build cannot be understood.
pub const OC_STATUS_PARSE: oc_status = 200;
/// The file: a built model is damaged, or is not one.
pub const OC_STATUS_CORRUPT: oc_status = 201;
/// The installation: header and library do not belong together.
pub const OC_STATUS_VERSION_MISMATCH: oc_status = 300;
/// The installation: the model was written by a newer library.
pub const OC_STATUS_NEWER_FORMAT: oc_status = 301;
/// The budget: too small; `oc_last_error_need` says what would do.
pub const OC_STATUS_OVER_BUDGET: oc_status = 400;
/// The machine: reading or writing failed, or a thread could not be started.
pub const OC_STATUS_IO: oc_status = 500;
/// The machine: it gave no memory for something large (a picture, the tree of a build); `oc_last_error` says how many
/// bytes for what. Nothing changed, or it is as after any other error. (Where it gives none for something small, or for
/// triangles that are pushed or read without a budget, the process ends, as Rust programs do.)
pub const OC_STATUS_OUT_OF_MEMORY: oc_status = 501;
/// Us: a defect in the library. The object is poisoned. What it was is in oc_last_error, and for background work in
/// the log; the library has no hook on panics (that would be global state), so Rust's standard library also writes
/// it to standard error.
pub const OC_STATUS_INTERNAL: oc_status = 600;
/// Us: the object met a defect before; it can only be released.
pub const OC_STATUS_POISONED: oc_status = 601;

/// The name of a status, for instance "OC_STATUS_IO"; "unknown status" for other numbers.
///
/// Returns a constant. Thread safety: any thread. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_status_name(status: oc_status) -> *const c_char {
    let name: &CStr = match status {
        OC_STATUS_OK => c"OC_STATUS_OK",
        OC_STATUS_INVALID_ARGUMENT => c"OC_STATUS_INVALID_ARGUMENT",
        OC_STATUS_INVALID_STATE => c"OC_STATUS_INVALID_STATE",
        OC_STATUS_BUFFER_TOO_SMALL => c"OC_STATUS_BUFFER_TOO_SMALL",
        OC_STATUS_CANCELLED => c"OC_STATUS_CANCELLED",
        OC_STATUS_PARSE => c"OC_STATUS_PARSE",
        OC_STATUS_CORRUPT => c"OC_STATUS_CORRUPT",
        OC_STATUS_VERSION_MISMATCH => c"OC_STATUS_VERSION_MISMATCH",
        OC_STATUS_NEWER_FORMAT => c"OC_STATUS_NEWER_FORMAT",
        OC_STATUS_OVER_BUDGET => c"OC_STATUS_OVER_BUDGET",
        OC_STATUS_IO => c"OC_STATUS_IO",
        OC_STATUS_OUT_OF_MEMORY => c"OC_STATUS_OUT_OF_MEMORY",
        OC_STATUS_INTERNAL => c"OC_STATUS_INTERNAL",
        OC_STATUS_POISONED => c"OC_STATUS_POISONED",
        _ => c"unknown status",
    };
    name.as_ptr()
}

/// Why the last call of this thread that did not return `OC_STATUS_OK` failed; or, after a poll or
/// wait that reported `OC_STATE_FAILED`, why the work failed. Never NULL; empty before any failure.
///
/// Returns a string of the library's, valid until the next failure in this thread.
/// Thread safety: each thread has its own. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_last_error() -> *const c_char {
    guard::last_error()
}

/// The least budget in bytes that would have done, if the failure that `oc_last_error` tells of was
/// `OC_STATUS_OVER_BUDGET`; else 0.
///
/// Thread safety: each thread has its own. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_last_error_need() -> u64 {
    guard::last_error_need()
}

/// Zeroes `size` bytes at `object`, any struct of this header that begins with `struct_size`, and sets
/// that member: what the macro OC_INIT calls. NULL, or a size below 4, does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `object` is NULL or has `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_init(object: *mut std::ffi::c_void, size: usize) {
    let Ok(size32) = u32::try_from(size) else { return };
    if object.is_null() || size < size_of::<u32>() {
        return;
    }
    // SAFETY: not null, and `size` bytes by the function's contract; the write asks no alignment.
    unsafe {
        object.cast::<u8>().write_bytes(0, size);
        object.cast::<u32>().write_unaligned(size32);
    }
}
