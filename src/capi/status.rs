//! Status codes, and the reason of a failure in words.

use super::guard;
use std::ffi::{CStr, c_char};

/// Result of a call, or the reason why background work failed. Numbers are never reused. The hundreds name the cause:
/// - 1: the calling program
/// - 2: the file
/// - 3: the installation
/// - 4: the memory budget, or another limit
/// - 5: the machine
/// - 6: the library itself
pub type oc_status = u32;

/// Success.
pub const OC_STATUS_OK: oc_status = 0;
/// The calling program: an argument is NULL, is out of its range, or belongs to another context. Nothing changed.
pub const OC_STATUS_INVALID_ARGUMENT: oc_status = 100;
/// The calling program: the object's present state does not allow the call, or the object belongs to the parent
/// process: after `fork` a child can only release it. Nothing changed.
pub const OC_STATUS_INVALID_STATE: oc_status = 101;
/// The calling program: the array is too small. The required count was written, nothing else.
pub const OC_STATUS_BUFFER_TOO_SMALL: oc_status = 102;
/// The calling program: the work was cancelled on request.
pub const OC_STATUS_CANCELLED: oc_status = 103;
/// The calling program: the block of a node is not in memory, and a cursor with OC_CURSOR_NOW does not read it. Nothing
/// changed.
pub const OC_STATUS_MISSING: oc_status = 104;
/// The file: an input file of a build cannot be parsed.
pub const OC_STATUS_PARSE: oc_status = 200;
/// The file: the model file is damaged, is not a model, or has an older format.
pub const OC_STATUS_CORRUPT: oc_status = 201;
/// The installation: the program was compiled with the header of another version.
pub const OC_STATUS_VERSION_MISMATCH: oc_status = 300;
/// The installation: a newer version of the library wrote the model.
pub const OC_STATUS_NEWER_FORMAT: oc_status = 301;
/// The budget: the memory budget is too small. oc_last_error_need returns the least budget that suffices.
pub const OC_STATUS_OVER_BUDGET: oc_status = 400;
/// The limit: a build exceeds a limit of oc_build_desc. oc_last_error names the limit and what exceeds it.
pub const OC_STATUS_OVER_LIMIT: oc_status = 401;
/// The machine: reading or writing failed, or a thread could not be started.
pub const OC_STATUS_IO: oc_status = 500;
/// The machine: the system refused memory. oc_last_error names its purpose and size. Nothing changed, or the state is
/// that after any other error.
///
/// Allocations of up to 4 MiB that the system refuses come from a reserve of 32 MiB in the library. The reserve takes
/// memory only while it is used. While more than half of it is taken and the system still refuses memory, builds,
/// loads, queries and frames end with this status, and return what they took. Larger allocations fail by themselves.
/// Exceptions, in which the process ends: many threads take the rest of the reserve between two steps of their work;
/// the lists of parts, names and vertices of mesh files grow beyond 4 MiB.
pub const OC_STATUS_OUT_OF_MEMORY: oc_status = 501;
/// The library: a defect. The object is poisoned: further calls return OC_STATUS_POISONED. oc_last_error describes the
/// defect; for background work the log does too. Rust's standard library also writes the description to standard error,
/// because outcrop installs no panic hook (a hook would be global state).
pub const OC_STATUS_INTERNAL: oc_status = 600;
/// The library: a defect occurred in this object before. The only valid call is the release.
pub const OC_STATUS_POISONED: oc_status = 601;

/// Returns the name of a status, e.g. "OC_STATUS_IO", or "unknown status" for an unknown number.
///
/// The string is a constant. Never NULL.
/// Thread safety: any thread. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_status_name(status: oc_status) -> *const c_char {
    let name: &CStr = match status {
        OC_STATUS_OK => c"OC_STATUS_OK",
        OC_STATUS_INVALID_ARGUMENT => c"OC_STATUS_INVALID_ARGUMENT",
        OC_STATUS_INVALID_STATE => c"OC_STATUS_INVALID_STATE",
        OC_STATUS_BUFFER_TOO_SMALL => c"OC_STATUS_BUFFER_TOO_SMALL",
        OC_STATUS_CANCELLED => c"OC_STATUS_CANCELLED",
        OC_STATUS_MISSING => c"OC_STATUS_MISSING",
        OC_STATUS_PARSE => c"OC_STATUS_PARSE",
        OC_STATUS_CORRUPT => c"OC_STATUS_CORRUPT",
        OC_STATUS_VERSION_MISMATCH => c"OC_STATUS_VERSION_MISMATCH",
        OC_STATUS_NEWER_FORMAT => c"OC_STATUS_NEWER_FORMAT",
        OC_STATUS_OVER_BUDGET => c"OC_STATUS_OVER_BUDGET",
        OC_STATUS_OVER_LIMIT => c"OC_STATUS_OVER_LIMIT",
        OC_STATUS_IO => c"OC_STATUS_IO",
        OC_STATUS_OUT_OF_MEMORY => c"OC_STATUS_OUT_OF_MEMORY",
        OC_STATUS_INTERNAL => c"OC_STATUS_INTERNAL",
        OC_STATUS_POISONED => c"OC_STATUS_POISONED",
        _ => c"unknown status",
    };
    name.as_ptr()
}

/// Returns the reason of the calling thread's last failure, in words. A failure is:
/// - a call in this thread that did not return OC_STATUS_OK, or
/// - a poll or wait in this thread that reported work as failed or cancelled, or as OC_STATE_COMPLETE_WITHIN_BUDGET
///   with an error. The text is then the reason of that work.
///
/// Never NULL. Empty before the first failure.
/// Ownership: the library owns the string. It is valid until the next failure in this thread.
/// Thread safety: each thread has its own. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_last_error() -> *const c_char {
    guard::last_error()
}

/// Returns the least budget in bytes that suffices, if the failure that oc_last_error describes is
/// OC_STATUS_OVER_BUDGET. Otherwise returns 0.
///
/// Thread safety: each thread has its own. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_last_error_need() -> u64 {
    guard::last_error_need()
}

/// Zeroes a struct that begins with `struct_size`, and sets that member to `size`. The macro OC_INIT calls it.
///
/// - `object`: a struct of this header. NULL: the call does nothing.
/// - `size`: its size in bytes. Below 4: the call does nothing.
///
/// Thread safety: any thread. Cheap.
/// # Safety
/// `object` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn oc_init(object: *mut std::ffi::c_void, size: usize) {
    let Ok(size32) = u32::try_from(size) else { return };
    if object.is_null() || size < size_of::<u32>() {
        return;
    }
    // SAFETY: the pointer is not null and has `size` bytes by the function's contract. The write needs no alignment.
    unsafe {
        object.cast::<u8>().write_bytes(0, size);
        object.cast::<u32>().write_unaligned(size32);
    }
}
