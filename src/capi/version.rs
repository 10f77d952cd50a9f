//! The version of header and library.

/// Major version: programs built for another one do not work.
pub const OC_VERSION_MAJOR: u32 = 0;
/// Minor version: while the major version is 0, programs built for another one do not work.
pub const OC_VERSION_MINOR: u32 = 1;
/// Patch version.
pub const OC_VERSION_PATCH: u32 = 0;
/// The version of this header, `major * 10000 + minor * 100 + patch`: pass it to
/// `oc_context_create`.
pub const OC_HEADER_VERSION: u32 = 100;

/// The version of the library, to be compared with `OC_HEADER_VERSION`.
///
/// Thread safety: any thread. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_version() -> u32 {
    OC_HEADER_VERSION
}
