//! The version of header and library.

/// Major version. Programs compiled for another major version do not work.
pub const OC_VERSION_MAJOR: u32 = 0;
/// Minor version. While the major version is 0, programs compiled for another minor version do not work.
pub const OC_VERSION_MINOR: u32 = 1;
/// Patch version.
pub const OC_VERSION_PATCH: u32 = 0;
/// Version of this header: `major * 10000 + minor * 100 + patch`. Pass it to oc_context_create.
pub const OC_HEADER_VERSION: u32 = 100;

/// Returns the version of the library, in the format of OC_HEADER_VERSION.
///
/// Thread safety: any thread. Cheap.
#[unsafe(no_mangle)]
pub extern "C" fn oc_version() -> u32 {
    OC_HEADER_VERSION
}
