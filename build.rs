//! cargo sets no soname; without one a program linked to the library records its file name. Tests that measure the stack
//! need to know if code is optimised (`cfg(optimised)`).

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-check-cfg=cfg(optimised)");
    if std::env::var("OPT_LEVEL").is_ok_and(|level| level != "0" && level != "1") {
        println!("cargo:rustc-cfg=optimised");
    }
    let os = std::env::var("CARGO_CFG_TARGET_OS").unwrap_or_default();
    if os == "linux" || os.ends_with("bsd") {
        // While the major version is 0, each minor version is a new interface.
        let (major, minor) = (env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"));
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,liboutcrop.so.{major}.{minor}");
    }
}
