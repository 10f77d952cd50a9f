//! `include/outcrop.h` is what cbindgen makes of `src/capi` today.

use std::path::{Path, PathBuf};

/// The files of `src/capi` in the order in which the header introduces them.
const SOURCES: &[&str] = &["version.rs"];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn generate() -> String {
    let config = cbindgen::Config::from_file(root().join("cbindgen.toml")).expect("cbindgen.toml");
    let mut builder = cbindgen::Builder::new().with_config(config);
    for name in SOURCES {
        builder = builder.with_src(root().join("src/capi").join(name));
    }
    let mut bytes = Vec::new();
    builder.generate().expect("cbindgen").write(&mut bytes);
    String::from_utf8(bytes).expect("UTF-8")
}

/// Run with `OUTCROP_WRITE_HEADER=1` (`make header`) to write it.
#[test]
fn header_is_up_to_date() {
    let path = root().join("include/outcrop.h");
    let fresh = generate();
    if std::env::var_os("OUTCROP_WRITE_HEADER").is_some() {
        std::fs::write(&path, &fresh).expect("writing the header");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == fresh, "src/capi has changed: run `make header` and commit the result");
}

/// A file of the room that the list above forgets would be missing from the header.
#[test]
fn every_file_with_an_entry_point_is_listed() {
    for entry in std::fs::read_dir(root().join("src/capi")).expect("src/capi") {
        let path = entry.expect("entry").path();
        let name = Path::new(path.file_name().expect("name")).display().to_string();
        let text = std::fs::read_to_string(&path).expect("source");
        let exports = text.contains("no_mangle") && name != "testing.rs";
        assert_eq!(exports, exports && SOURCES.contains(&name.as_str()), "{name}");
    }
}
