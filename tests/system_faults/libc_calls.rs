//! Functions of the C library, replaced in this program: the n-th call of a kind fails, and writes are recorded.
//!
//! The dynamic linker prefers the program's own symbols, so that the standard library calls these. They make the
//! system calls themselves.

use libc::{c_char, c_int, c_void, off64_t, size_t, ssize_t};
use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering::SeqCst};

/// A kind of calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Call {
    Open = 1,
    Read = 2,
    Write = 3,
    Sync = 4,
    Rename = 5,
    Thread = 6,
}

/// The kind that fails; 0: none.
static KIND: AtomicU32 = AtomicU32::new(0);
/// Calls until the one that fails.
static LEFT: AtomicI64 = AtomicI64::new(0);
static ARMED: AtomicBool = AtomicBool::new(false);
/// Set while calls on files are recorded.
static RECORDING: AtomicBool = AtomicBool::new(false);
static RECORD: Mutex<Vec<Event>> = Mutex::new(Vec::new());

thread_local! {
    /// Set while the record itself allocates or writes.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// A recorded call.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// Bytes written to a file at an offset.
    Write(c_int, u64, Vec<u8>),
    Sync(c_int),
    Rename,
}

/// Runs `work`, in which call number `n` of a kind fails, counted from 0 in the sections that are [`armed`]. Also
/// returns whether there was such a call.
pub fn fail_at<T>(call: Call, n: u32, work: impl FnOnce() -> T) -> (T, bool) {
    LEFT.store(i64::from(n), SeqCst);
    KIND.store(call as u32, SeqCst);
    let done = work();
    KIND.store(0, SeqCst);
    (done, LEFT.load(SeqCst) < 0)
}

/// Runs a section in which calls are counted.
pub fn armed<T>(work: impl FnOnce() -> T) -> T {
    ARMED.store(true, SeqCst);
    let done = work();
    ARMED.store(false, SeqCst);
    done
}

/// Runs `work`; returns its calls on files too.
pub fn recorded<T>(work: impl FnOnce() -> T) -> (T, Vec<Event>) {
    RECORDING.store(true, SeqCst);
    let done = work();
    RECORDING.store(false, SeqCst);
    (done, std::mem::take(&mut *RECORD.lock().unwrap_or_else(|e| e.into_inner())))
}

fn record(event: impl FnOnce() -> Event) {
    if RECORDING.load(SeqCst) && !INSIDE.replace(true) {
        RECORD.lock().unwrap_or_else(|e| e.into_inner()).push(event());
        INSIDE.set(false);
    }
}

/// True if this call is the one that fails; sets its error number.
fn fails(call: Call, error: c_int) -> bool {
    let is_it = ARMED.load(SeqCst) && KIND.load(SeqCst) == call as u32 && LEFT.fetch_sub(1, SeqCst) == 0;
    if is_it {
        // SAFETY: the address of this thread's error number.
        unsafe { *libc::__errno_location() = error };
    }
    is_it
}

/// # Safety
/// As of the function of the C library; so for all below.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn open64(path: *const c_char, flags: c_int, mode: libc::mode_t) -> c_int {
    if fails(Call::Open, libc::EMFILE) {
        return -1;
    }
    // SAFETY: the caller's promise. (A mode that was not given is not used.)
    unsafe { libc::syscall(libc::SYS_openat, libc::AT_FDCWD, path, flags | libc::O_LARGEFILE, mode) as c_int }
}

/// # Safety
/// See `open64`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn read(fd: c_int, buffer: *mut c_void, len: size_t) -> ssize_t {
    if fails(Call::Read, libc::EIO) {
        return -1;
    }
    // SAFETY: the caller's promise.
    unsafe { libc::syscall(libc::SYS_read, fd, buffer, len) as ssize_t }
}

/// # Safety
/// See `open64`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pread64(fd: c_int, buffer: *mut c_void, len: size_t, at: off64_t) -> ssize_t {
    if fails(Call::Read, libc::EIO) {
        return -1;
    }
    // SAFETY: the caller's promise.
    unsafe { libc::syscall(libc::SYS_pread64, fd, buffer, len, at) as ssize_t }
}

/// # Safety
/// See `open64`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn write(fd: c_int, buffer: *const c_void, len: size_t) -> ssize_t {
    if fd > 2 && fails(Call::Write, libc::ENOSPC) {
        return -1;
    }
    // SAFETY: a number, and a plain system call.
    let at = unsafe { libc::syscall(libc::SYS_lseek, fd, 0, libc::SEEK_CUR) };
    // SAFETY: the caller's promise.
    let written = unsafe { libc::syscall(libc::SYS_write, fd, buffer, len) as ssize_t };
    if fd > 2 && written > 0 && at >= 0 {
        // SAFETY: the caller's promise: as many bytes were readable.
        let bytes: &[u8] = unsafe { std::slice::from_raw_parts(buffer.cast(), written as usize) };
        record(|| Event::Write(fd, at as u64, bytes.to_vec()));
    }
    written
}

/// # Safety
/// See `open64`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fsync(fd: c_int) -> c_int {
    if fails(Call::Sync, libc::EIO) {
        return -1;
    }
    record(|| Event::Sync(fd));
    // SAFETY: the caller's promise.
    unsafe { libc::syscall(libc::SYS_fsync, fd) as c_int }
}

/// # Safety
/// See `open64`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rename(from: *const c_char, to: *const c_char) -> c_int {
    if fails(Call::Rename, libc::EACCES) {
        return -1;
    }
    record(|| Event::Rename);
    // SAFETY: the caller's promise.
    unsafe { libc::syscall(libc::SYS_renameat2, libc::AT_FDCWD, from, libc::AT_FDCWD, to, 0) as c_int }
}

type Start = extern "C" fn(*mut c_void) -> *mut c_void;
type Create = unsafe extern "C" fn(*mut libc::pthread_t, *const libc::pthread_attr_t, Start, *mut c_void) -> c_int;

/// # Safety
/// See `open64`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pthread_create(
    thread: *mut libc::pthread_t,
    options: *const libc::pthread_attr_t,
    start: Start,
    argument: *mut c_void,
) -> c_int {
    if fails(Call::Thread, libc::EAGAIN) {
        return libc::EAGAIN;
    }
    // SAFETY: the next function of this name is the C library's.
    let next = unsafe { libc::dlsym(libc::RTLD_NEXT, c"pthread_create".as_ptr()) };
    assert!(!next.is_null(), "the C library has no pthread_create");
    // SAFETY: its type.
    let next = unsafe { std::mem::transmute::<*mut c_void, Create>(next) };
    // SAFETY: the caller's promise.
    unsafe { next(thread, options, start, argument) }
}
