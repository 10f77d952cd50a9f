//! The callback that resolves the names of files that mesh files refer to.

use super::guard::{self, Failure};
use super::status::{OC_STATUS_CANCELLED, OC_STATUS_OK, oc_status, oc_status_name};
use crate::base::error::{Error, Result};
use crate::import::{Resolved, Resolver};
use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;

/// Answer of oc_resolve_fn.
pub type oc_resolution = u32;
/// The library looks for the file, by the rule of `trusted_folder` in oc_build_desc.
pub const OC_RESOLUTION_DEFAULT: oc_resolution = 0;
/// The content of the file is at `bytes`.
pub const OC_RESOLUTION_BYTES: oc_resolution = 1;
/// The file at `path` is read, wherever it is.
pub const OC_RESOLUTION_PATH: oc_resolution = 2;
/// The file must not be read.
pub const OC_RESOLUTION_REFUSED: oc_resolution = 3;

/// Frees the memory that an answer of oc_resolve_fn refers to.
// SAFETY of a call: the host vouches for the pointer. The library calls it once for each answer.
pub type oc_release_fn = Option<unsafe extern "C" fn(release_user: *mut c_void)>;

/// Receives the answer of oc_resolve_fn. All members but `struct_size` are 0 or NULL before the call.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct oc_resolved {
    /// Size of this struct in bytes, set by the library.
    pub struct_size: u32,
    /// One of the OC_RESOLUTION_ constants.
    pub kind: oc_resolution,
    /// OC_RESOLUTION_BYTES: the content of the file. It must stay as it is until `release` is called.
    pub bytes: *const c_void,
    /// Size of `bytes`. 0: `bytes` is ignored.
    pub size: u64,
    /// OC_RESOLUTION_PATH: path of the file.
    pub path: *const c_char,
    /// Called once, by the thread of the job, when `bytes` and `path` are needed no more: at the latest when the job
    /// ends. Also called if the answer is invalid. Not called if the callback fails. NULL: nothing is to be freed.
    pub release: oc_release_fn,
    /// Passed to `release`.
    pub release_user: *mut c_void,
}

/// Callback: resolves the name of a file that a mesh file or a material library refers to.
///
/// - `user`: `resolve_user` of oc_build_desc.
/// - `uri`: the URI of a glTF file as it is written, or the name in an OBJ file or material library without quotes and
///   comment. Valid during the call. URIs with data (`data:`) are not passed. A line of several words in an OBJ file is
///   passed as one name first; if that is refused or not found, each word is.
/// - `file`: path of the file that names it, or the name of a library that came as OC_RESOLUTION_BYTES. Valid during
///   the call.
/// - `out`: receives the answer.
///
/// Returns OC_STATUS_OK, or a status that says why there is no answer. OC_STATUS_CANCELLED ends the job. Any other
/// status counts as a file that cannot be read. If the geometry needs the file, the job fails with OC_STATUS_IO, and
/// oc_last_error names the URI and the status; otherwise a note does. An invalid answer counts likewise, with
/// OC_STATUS_INVALID_ARGUMENT, and a refusal with OC_STATUS_PARSE.
///
/// The thread of the build job calls it, never while the library holds a lock. It must not unwind. It may be called
/// several times for the same name.
// SAFETY of a call: the host vouches for the pointer. The library keeps the promises of the comment above.
pub type oc_resolve_fn = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        uri: *const c_char,
        file: *const c_char,
        out: *mut oc_resolved,
    ) -> oc_status,
>;

// SAFETY of a call: as for [`oc_resolve_fn`].
type Resolve = unsafe extern "C" fn(*mut c_void, *const c_char, *const c_char, *mut oc_resolved) -> oc_status;

/// The host's callback, as a resolver of the crate.
pub(super) struct HostResolver {
    resolve: Resolve,
    user: *mut c_void,
}

// SAFETY: the job's thread uses it, and only one thread at a time. The header says which thread calls.
unsafe impl Send for HostResolver {}
// SAFETY: as above.
unsafe impl Sync for HostResolver {}

impl HostResolver {
    pub(super) fn new(resolve: Resolve, user: *mut c_void) -> Self {
        Self { resolve, user }
    }
}

/// An answer of the host, whose memory is freed when it is dropped.
struct Answer(oc_resolved);

impl Drop for Answer {
    fn drop(&mut self) {
        if let Some(release) = self.0.release {
            // SAFETY: the host set the function and its argument for one call.
            unsafe { release(self.0.release_user) };
        }
    }
}

impl AsRef<[u8]> for Answer {
    fn as_ref(&self) -> &[u8] {
        if self.0.size == 0 {
            return &[];
        }
        // SAFETY: the pointer and the size were checked when the answer came. The host keeps the bytes until `release`.
        unsafe { std::slice::from_raw_parts(self.0.bytes.cast(), self.0.size as usize) }
    }
}

impl Resolver for HostResolver {
    fn resolve(&self, name: &[u8], file: &Path) -> Result<Resolved> {
        let shown: String = String::from_utf8_lossy(name).chars().take(80).collect();
        let text = |bytes: &[u8]| {
            CString::new(bytes).map_err(|_| Error::bad_argument(format!("the name {shown:?} contains a zero byte")))
        };
        let (uri, file) = (text(name)?, text(file.as_os_str().as_encoded_bytes())?);
        let mut out = oc_resolved {
            struct_size: size_of::<oc_resolved>() as u32,
            kind: OC_RESOLUTION_DEFAULT,
            bytes: std::ptr::null(),
            size: 0,
            path: std::ptr::null(),
            release: None,
            release_user: std::ptr::null_mut(),
        };
        // SAFETY: the host registered the function for this call. All pointers are valid during it.
        let status = unsafe { (self.resolve)(self.user, uri.as_ptr(), file.as_ptr(), &mut out) };
        match status {
            OC_STATUS_OK => answer(Answer(out), &shown),
            OC_STATUS_CANCELLED => Err(Error::Cancelled),
            other => {
                // SAFETY: the name of a status is a constant.
                let name = unsafe { CStr::from_ptr(oc_status_name(other)) }.to_string_lossy();
                let why = format!("the resolve callback returned {name} ({other})");
                Err(Error::io(shown, "resolving", std::io::Error::other(why)))
            }
        }
    }
}

fn answer(answer: Answer, shown: &str) -> Result<Resolved> {
    let invalid = |why: String| Err(Error::bad_argument(format!("the resolve callback's answer to {shown:?}: {why}")));
    let oc_resolved { kind, bytes, size, path, .. } = answer.0;
    match kind {
        OC_RESOLUTION_DEFAULT => Ok(Resolved::Default),
        OC_RESOLUTION_REFUSED => Ok(Resolved::Refused),
        OC_RESOLUTION_BYTES if size > 0 && bytes.is_null() => invalid(format!("bytes is NULL, but size is {size}")),
        OC_RESOLUTION_BYTES if size > isize::MAX as u64 || (bytes.addr() as u64).checked_add(size).is_none() => {
            invalid(format!("{size} bytes do not fit into memory"))
        }
        OC_RESOLUTION_BYTES => Ok(Resolved::Bytes(Box::new(answer))),
        // SAFETY: the host's path is NULL or ends with 0, and is valid until `release`.
        OC_RESOLUTION_PATH => match unsafe { guard::path(path, "path") } {
            Ok(path) => Ok(Resolved::Path(path)),
            Err(Failure::Error(Error::BadArgument(why))) => invalid(why),
            Err(_) => invalid("path is invalid".into()),
        },
        other => invalid(format!("kind {other} is unknown")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        static FREED: Cell<usize> = const { Cell::new(0) };
    }

    // SAFETY: it reads no pointer.
    unsafe extern "C" fn free(_: *mut c_void) {
        FREED.set(FREED.get() + 1);
    }

    /// Answers as `user`, an answer and a status, says.
    // SAFETY: callers pass an answer and a status, texts, and room for the answer.
    unsafe extern "C" fn resolve(
        user: *mut c_void,
        uri: *const c_char,
        file: *const c_char,
        out: *mut oc_resolved,
    ) -> oc_status {
        // SAFETY: as the test passes them.
        unsafe {
            assert_eq!((CStr::from_ptr(uri), CStr::from_ptr(file)), (c"a b.bin", c"x/a.gltf"));
            assert_eq!(((*out).struct_size as usize, (*out).kind), (size_of::<oc_resolved>(), 0));
            let (answer, status) = *user.cast::<(oc_resolved, oc_status)>();
            out.write(answer);
            status
        }
    }

    /// Returns the error of an answer, or the bytes, and the number of calls that free.
    fn ask(kind: oc_resolution, bytes: *const c_void, size: u64, status: oc_status) -> (Result<Vec<u8>>, usize) {
        let before = FREED.get();
        let (path, release_user) = (std::ptr::null(), std::ptr::null_mut());
        let struct_size = size_of::<oc_resolved>() as u32;
        let answer = oc_resolved { struct_size, kind, bytes, size, path, release: Some(free), release_user };
        let mut user = (answer, status);
        let host = HostResolver::new(resolve, (&raw mut user).cast());
        let found = host.resolve(b"a b.bin", Path::new("x/a.gltf")).map(|resolved| match resolved {
            Resolved::Bytes(bytes) => {
                assert_eq!(FREED.get(), before, "still in use");
                (*bytes).as_ref().to_vec()
            }
            _ => Vec::new(),
        });
        (found, FREED.get() - before)
    }

    #[test]
    fn answers_are_checked_and_freed_once() {
        let (bytes, null) = ([1u8, 2, 3], std::ptr::null());
        let at = bytes.as_ptr().cast();
        for (kind, pointer, size, found) in [
            (OC_RESOLUTION_BYTES, at, 3, &bytes[..]),
            (OC_RESOLUTION_BYTES, null, 0, &[]),
            (0, at, 3, &[]),
            (3, null, 0, &[]),
        ] {
            let (answer, freed) = ask(kind, pointer, size, OC_STATUS_OK);
            assert_eq!((answer.expect("an answer"), freed), (found.to_vec(), 1), "{kind}");
        }
        for (kind, pointer, size, words) in [
            (OC_RESOLUTION_BYTES, null, 3, "bytes is NULL, but size is 3"),
            (OC_RESOLUTION_BYTES, at, u64::MAX, "do not fit into memory"),
            (OC_RESOLUTION_BYTES, at, 1 << 63, "do not fit into memory"),
            (OC_RESOLUTION_PATH, at, 3, "path is NULL"),
            (77, at, 3, "kind 77 is unknown"),
        ] {
            let (answer, freed) = ask(kind, pointer, size, OC_STATUS_OK);
            let error = answer.expect_err(words);
            assert!(
                matches!(&error, Error::BadArgument(why) if why.contains("\"a b.bin\"") && why.contains(words)),
                "{error}"
            );
            assert_eq!(freed, 1, "{words}");
        }
    }

    #[test]
    fn a_callback_that_fails_names_its_status_and_frees_nothing() {
        for (status, words) in [(201, "OC_STATUS_CORRUPT (201)"), (12345, "unknown status (12345)")] {
            let (answer, freed) = ask(OC_RESOLUTION_BYTES, std::ptr::null(), 3, status);
            let error = answer.expect_err(words).to_string();
            assert!(error.starts_with("a b.bin: resolving failed") && error.contains(words) && freed == 0, "{error}");
        }
        assert!(matches!(ask(0, std::ptr::null(), 0, OC_STATUS_CANCELLED).0, Err(Error::Cancelled)));
        let host = HostResolver::new(resolve, std::ptr::null_mut());
        assert!(
            matches!(host.resolve(b"a\0b", Path::new("x")), Err(Error::BadArgument(why)) if why.contains("zero byte"))
        );
    }
}
