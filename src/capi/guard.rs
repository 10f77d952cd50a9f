//! The border between C and Rust: catches panics, checks pointers, sizes and strings, and stores errors for
//! `oc_last_error`.

use super::status::*;
use crate::base::error::Error;
use crate::simd::prefetch_l2;
use std::any::Any;
use std::cell::{Cell, RefCell};
use std::ffi::{CStr, CString, c_char};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Reason why an entry point fails: an error of the crate, or one that only the C side has.
#[derive(Debug)]
pub(crate) enum Failure {
    Error(Error),
    /// Kind of an object in which a panic occurred before.
    Poisoned(&'static str),
    VersionMismatch(String),
    /// Number of elements, and number of elements that fit.
    TooSmall {
        need: u64,
        have: u64,
    },
    /// Number of a block that is not in memory and may not be read.
    Missing(u32),
}

pub(crate) type Checked<T> = Result<T, Failure>;

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Failure::Error(error)
    }
}

/// Returns an [`Error::BadArgument`].
pub(crate) fn bad<T>(what: impl Into<String>) -> Checked<T> {
    Err(Failure::Error(Error::bad_argument(what)))
}

/// Returns the status of an error, and the least budget that suffices (0 if the budget is not the cause).
pub(crate) fn status_of(error: &Error) -> (oc_status, u64) {
    let status = match error {
        Error::BadArgument(_) => OC_STATUS_INVALID_ARGUMENT,
        Error::BadState(_) => OC_STATUS_INVALID_STATE,
        Error::Parse { .. } => OC_STATUS_PARSE,
        Error::Corrupt { .. } => OC_STATUS_CORRUPT,
        Error::NewerFormat { .. } => OC_STATUS_NEWER_FORMAT,
        Error::OverBudget { need, .. } => return (OC_STATUS_OVER_BUDGET, *need),
        Error::OverLimit { .. } => OC_STATUS_OVER_LIMIT,
        Error::Cancelled => OC_STATUS_CANCELLED,
        Error::Io { source, .. } if source.kind() == std::io::ErrorKind::OutOfMemory => OC_STATUS_OUT_OF_MEMORY,
        Error::Io { .. } => OC_STATUS_IO,
        Error::NoMemory { .. } => OC_STATUS_OUT_OF_MEMORY,
        Error::Internal(_) => OC_STATUS_INTERNAL,
    };
    (status, 0)
}

thread_local! {
    static MESSAGE: RefCell<CString> = RefCell::default();
    static NEED: Cell<u64> = const { Cell::new(0) };
}

/// Stores a message for `oc_last_error` of this thread.
fn keep(message: String, need: u64) {
    let mut bytes = message.into_bytes();
    bytes.retain(|&b| b != 0);
    // Cannot fail: the zeros are removed. A thread that is ending has no storage any more.
    let text = CString::new(bytes).unwrap_or_default();
    let _ = MESSAGE.try_with(|m| *m.borrow_mut() = text);
    NEED.set(need);
}

/// Stores the reason why background work failed, as if the present call had failed.
pub(crate) fn keep_error(error: &Error) {
    keep(error.to_string(), status_of(error).1);
}

pub(crate) fn last_error() -> *const c_char {
    MESSAGE.try_with(|m| m.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

pub(crate) fn last_error_need() -> u64 {
    NEED.get()
}

fn report(failure: Failure) -> oc_status {
    match failure {
        Failure::Error(error) => {
            keep_error(&error);
            status_of(&error).0
        }
        Failure::Poisoned(kind) => {
            keep(format!("an internal error occurred in this {kind} before; it can only be released"), 0);
            OC_STATUS_POISONED
        }
        Failure::VersionMismatch(why) => {
            keep(why, 0);
            OC_STATUS_VERSION_MISMATCH
        }
        Failure::TooSmall { need, have } => {
            keep(format!("{need} elements do not fit into an array of {have}"), 0);
            OC_STATUS_BUFFER_TOO_SMALL
        }
        Failure::Missing(block) => {
            keep(format!("block {block} is not in memory"), 0);
            OC_STATUS_MISSING
        }
    }
}

/// Runs an entry point. Turns a panic or a failure into a status and stores its reason.
pub(crate) fn boundary(f: impl FnOnce() -> Checked<()>) -> oc_status {
    let caught = catch_unwind(AssertUnwindSafe(|| {
        #[cfg(debug_assertions)]
        super::testing::trip(super::testing::AT_ENTRY);
        f()
    }));
    match caught {
        Ok(Ok(())) => OC_STATUS_OK,
        Ok(Err(failure)) => report(failure),
        Err(panic) => report(Failure::Error(panicked(&*panic))),
    }
}

/// Returns the error for a caught panic.
pub(crate) fn panicked(panic: &(dyn Any + Send)) -> Error {
    let text = panic.downcast_ref::<&str>().copied();
    let text = text.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    Error::Internal(format!("a panic occurred: {}", text.unwrap_or("no message")))
}

/// Runs `f` on a worker of the library. Turns a panic into an [`Error::Internal`].
pub(crate) fn caught<T>(f: impl FnOnce() -> crate::Result<T>) -> crate::Result<T> {
    catch_unwind(AssertUnwindSafe(f)).unwrap_or_else(|panic| Err(panicked(&*panic)))
}

/// Refuses a reserved member that is not 0: a later version may give it a meaning.
pub(crate) fn reserved(value: u32, name: &str) -> Checked<()> {
    if value == 0 { Ok(()) } else { bad(format!("{name} must be 0")) }
}

/// Refuses a null pointer for an output, before any work is done.
pub(crate) fn out<T>(pointer: *mut T, name: &str) -> Checked<*mut T> {
    if pointer.is_null() { bad(format!("{name} is NULL")) } else { Ok(pointer) }
}

/// A struct of the header that begins with `uint32_t struct_size`.
///
/// # Safety
/// The type is `#[repr(C)]` without padding, its first member is that `u32`, and all zeros is a valid value.
pub(crate) unsafe trait Sized32: Copy {
    /// Its name in the header.
    const NAME: &'static str;
    /// Its size when it was first published: where the first member begins that a later version added. The caller's
    /// struct must have at least this size.
    const FIRST_SIZE: usize = size_of::<Self>();
}

/// Checks the `struct_size` that the caller set, and returns it.
///
/// # Safety
/// `pointer` is null, or points to memory of which four bytes, and the size that they contain, are readable.
unsafe fn size_at<T: Sized32>(pointer: *const T) -> Checked<usize> {
    if pointer.is_null() {
        return bad(format!("{} is NULL", T::NAME));
    }
    // SAFETY: the pointer is not null and has four readable bytes by the contract.
    let size = unsafe { pointer.cast::<u32>().read_unaligned() } as usize;
    if size < T::FIRST_SIZE || size > size_of::<T>() {
        return bad(format!(
            "{}.struct_size is {size}, but this library supports {} to {}; was it set with OC_INIT?",
            T::NAME,
            T::FIRST_SIZE,
            size_of::<T>()
        ));
    }
    Ok(size)
}

/// Reads a struct that the caller filled. Members that an older struct lacks become zero.
///
/// # Safety
/// As for [`size_at`].
pub(crate) unsafe fn read<T: Sized32>(pointer: *const T) -> Checked<T> {
    // SAFETY: the caller's contract. `size` is at most the size of `T`, for which all zeros is a valid value.
    unsafe {
        let size = size_at(pointer)?;
        let mut value: T = std::mem::zeroed();
        let target = (&raw mut value).cast::<u8>();
        target.copy_from_nonoverlapping(pointer.cast::<u8>(), size);
        Ok(value)
    }
}

/// As [`read`]. NULL stands for all zeros, the defaults.
///
/// # Safety
/// As for [`size_at`].
pub(crate) unsafe fn read_or_default<T: Sized32>(pointer: *const T) -> Checked<T> {
    if pointer.is_null() {
        // SAFETY: all zeros is a valid value by the contract of the trait.
        return Ok(unsafe { std::mem::zeroed() });
    }
    // SAFETY: the caller's contract.
    unsafe { read(pointer) }
}

/// A struct of the caller that a call fills: checked first, written at the end.
pub(crate) struct Fill<T> {
    pointer: *mut T,
    size: usize,
}

impl<T: Sized32> Fill<T> {
    /// Checks the caller's struct.
    ///
    /// # Safety
    /// `pointer` is null, or points to memory of the size that it contains, writable until [`Fill::with`].
    pub(crate) unsafe fn new(pointer: *mut T) -> Checked<Self> {
        // SAFETY: the caller's contract.
        let size = unsafe { size_at(pointer)? };
        Ok(Self { pointer, size })
    }

    /// Writes all members except `struct_size`, as far as the caller's struct has them.
    pub(crate) fn with(self, value: T) {
        // SAFETY: the value is of the struct's own type.
        unsafe { self.with_same(&value) }
    }

    /// [`Fill::with`], from another type that has the same members in the same places.
    ///
    /// # Safety
    /// The bytes of any `U` are a valid `T`.
    pub(crate) unsafe fn with_same<U>(self, value: &U) {
        const { assert!(size_of::<T>() == size_of::<U>()) };
        let skip = size_of::<u32>();
        // SAFETY: both structs have `size` bytes (`size_at`), which is more than `skip`.
        unsafe {
            let from = (&raw const *value).cast::<u8>().add(skip);
            self.pointer.cast::<u8>().add(skip).copy_from_nonoverlapping(from, self.size - skip);
        }
    }
}

/// Array in the caller's memory, of any alignment and stride.
#[derive(Clone, Copy)]
pub(crate) struct Strided<T> {
    base: *mut T,
    pub(crate) count: usize,
    stride: usize,
}

// SAFETY: a pointer and two sizes. Each read or write through it relies on the caller's promise.
unsafe impl<T: Send> Send for Strided<T> {}
// SAFETY: as above.
unsafe impl<T: Sync> Sync for Strided<T> {}

impl<T: Copy> Strided<T> {
    /// Checks the pointer, the stride (0: tightly packed), and that the array fits the address space.
    pub(crate) fn new(base: *const T, count: u64, stride: u64, name: &str) -> Checked<Self> {
        let stride = if stride == 0 { size_of::<T>() as u64 } else { stride };
        if count == 0 {
            return Ok(Self { base: std::ptr::null_mut(), count: 0, stride: 0 });
        }
        if base.is_null() {
            return bad(format!("{name} is NULL"));
        }
        if stride < size_of::<T>() as u64 {
            return bad(format!(
                "{name}: a stride of {stride} bytes is less than the element size of {} bytes",
                size_of::<T>()
            ));
        }
        let bytes = count.checked_mul(stride).filter(|&b| b <= isize::MAX as u64);
        if bytes.is_none_or(|b| (base.addr() as u64).checked_add(b).is_none()) {
            return bad(format!("{name}: {count} elements of {stride} bytes do not fit into memory"));
        }
        // Both fit: as factors of `bytes` they are at most `isize::MAX`.
        Ok(Self { base: base.cast_mut(), count: count as usize, stride: stride as usize })
    }

    /// Copies a tightly packed array.
    ///
    /// # Safety
    /// The array is readable, and no thread writes it.
    pub(crate) unsafe fn copied(base: *const T, count: u64, name: &str) -> Checked<Vec<T>> {
        let array = Self::new(base, count, 0, name)?;
        // SAFETY: the caller's contract.
        Ok((0..array.count).map(|i| unsafe { array.get(i) }).collect())
    }

    fn at(&self, index: usize) -> *mut T {
        debug_assert!(index < self.count);
        self.base.cast::<u8>().wrapping_add(index * self.stride).cast()
    }

    /// Reads an element.
    ///
    /// # Safety
    /// `index < count`, the caller's array is readable, and no thread writes it.
    #[inline]
    pub(crate) unsafe fn get(&self, index: usize) -> T {
        // SAFETY: the element is within the array, which fits the address space (`new`).
        unsafe { self.at(index).read_unaligned() }
    }

    /// Returns `N` elements from `first` on without a copy, as another type. Returns `None` if there are fewer, or if
    /// they are not tightly packed or not aligned for `U`.
    ///
    /// # Safety
    /// As for `get`, for all of them, while they are borrowed. The bytes of any `T` are a valid `U`.
    #[inline]
    pub(crate) unsafe fn array<U: Copy, const N: usize>(&self, first: usize) -> Option<&[U; N]> {
        const { assert!(size_of::<T>() == size_of::<U>() && N > 0) };
        let is_there = self.count.checked_sub(first).is_some_and(|rest| rest >= N);
        if !is_there || self.stride != size_of::<T>() || !self.at(first).cast::<U>().is_aligned() {
            return None;
        }
        // SAFETY: within the array, which is tightly packed and aligned. The caller vouches for the rest.
        Some(unsafe { &*self.at(first).cast::<[U; N]>() })
    }

    /// Copies elements from `first` on to `out`. The elements of `out` have the same bytes as another type.
    ///
    /// # Safety
    /// As for `get`, for all of them. The bytes of any `T` are a valid `U`.
    #[inline]
    pub(crate) unsafe fn copy_to<U: Copy>(&self, first: usize, out: &mut [U]) {
        const { assert!(size_of::<T>() == size_of::<U>()) };
        if self.stride == size_of::<T>() {
            // SAFETY: within the array, which is tightly packed. `out` is an exclusive reference.
            unsafe { self.at(first).cast::<u8>().copy_to_nonoverlapping(out.as_mut_ptr().cast(), size_of_val(out)) };
            return;
        }
        for (i, out) in out.iter_mut().enumerate() {
            // SAFETY: within the array. Any `T` is a valid `U`.
            *out = unsafe { self.at(first + i).cast::<U>().read_unaligned() };
        }
    }

    /// Copies `from` to the elements from `first` on. The elements of `from` have the same bytes as another type.
    ///
    /// # Safety
    /// As for `set`, for all of them. The bytes of any `U` are a valid `T`, without padding.
    #[inline]
    pub(crate) unsafe fn copy_from<U: Copy>(&self, first: usize, from: &[U]) {
        const { assert!(size_of::<T>() == size_of::<U>()) };
        if self.stride == size_of::<T>() {
            // SAFETY: within the array, which is tightly packed. No other thread uses these elements.
            unsafe { self.at(first).cast::<u8>().copy_from_nonoverlapping(from.as_ptr().cast(), size_of_val(from)) };
            return;
        }
        for (i, from) in from.iter().enumerate() {
            // SAFETY: within the array. Any `U` is a valid `T`.
            unsafe { self.at(first + i).cast::<U>().write_unaligned(*from) };
        }
    }

    /// True if the memory from the first to the last element of both arrays may overlap.
    pub(crate) fn meets<U: Copy>(&self, other: &Strided<U>) -> bool {
        let (mine, theirs) = (self.extent(), other.extent());
        mine.start < theirs.end && theirs.start < mine.end
    }

    fn extent(&self) -> Range<usize> {
        // Fits the address space (`new`). For an empty array the pointer is NULL.
        self.base.addr()..self.base.addr() + self.count * self.stride
    }

    /// Prefetches elements into the L2 cache. Indices beyond the last element are ignored.
    #[inline]
    pub(crate) fn ask_for(&self, elements: Range<usize>) {
        for i in elements.start..elements.end.min(self.count) {
            prefetch_l2(self.at(i));
        }
    }

    /// Writes an element.
    ///
    /// # Safety
    /// `index < count`, the caller's array is writable, and no other thread uses this element.
    #[inline]
    pub(crate) unsafe fn set(&self, index: usize, value: T) {
        // SAFETY: as for `get`.
        unsafe { self.at(index).write_unaligned(value) }
    }
}

/// Reads a string of the caller, which must be UTF-8.
///
/// # Safety
/// `pointer` is null, or its string ends with 0.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Checked<&'a str> {
    if pointer.is_null() {
        return bad(format!("{name} is NULL"));
    }
    // SAFETY: the pointer is not null and its string ends with 0 by the contract.
    match unsafe { CStr::from_ptr(pointer) }.to_str() {
        Ok(text) => Ok(text),
        Err(_) => bad(format!("{name} is not UTF-8")),
    }
}

/// As [`text`]. NULL: `None`.
///
/// # Safety
/// `pointer` is null, or its string ends with 0.
pub(crate) unsafe fn optional_text<'a>(pointer: *const c_char, name: &str) -> Checked<Option<&'a str>> {
    // SAFETY: the caller's contract.
    if pointer.is_null() { Ok(None) } else { unsafe { text(pointer, name) }.map(Some) }
}

/// Reads a path of the caller: on Unix any bytes, elsewhere UTF-8. Refuses an empty path.
///
/// # Safety
/// `pointer` is null, or its string ends with 0.
pub(crate) unsafe fn path(pointer: *const c_char, name: &str) -> Checked<std::path::PathBuf> {
    if pointer.is_null() {
        return bad(format!("{name} is NULL"));
    }
    // SAFETY: the pointer is not null and its string ends with 0 by the contract.
    let bytes = unsafe { CStr::from_ptr(pointer) };
    if bytes.is_empty() {
        return bad(format!("{name} is empty"));
    }
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStrExt;
        Ok(std::ffi::OsStr::from_bytes(bytes.to_bytes()).into())
    }
    #[cfg(not(unix))]
    match bytes.to_str() {
        Ok(text) => Ok(text.into()),
        Err(_) => bad(format!("{name} is not UTF-8")),
    }
}

#[cfg(test)]
mod tests {
    use super::Sized32;
    use crate::capi::build::oc_build_desc;
    use crate::capi::frame::{oc_frame_accuracy, oc_frame_settings};
    use crate::capi::report::oc_build_report;

    /// Programs that were compiled with an older header pass smaller structs.
    #[test]
    fn structs_that_grew_are_accepted_in_their_first_size() {
        assert_eq!(oc_frame_settings::FIRST_SIZE, 16);
        assert_eq!(oc_frame_accuracy::FIRST_SIZE, 88);
        assert_eq!(oc_build_desc::FIRST_SIZE, 48);
        assert_eq!(oc_build_report::FIRST_SIZE, 104);
    }
}
