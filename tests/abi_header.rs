//! `include/outcrop.h` is what cbindgen makes of `src/capi` today.

use std::path::{Path, PathBuf};

/// The files of `src/capi` in the order in which the header introduces them.
const SOURCES: &[&str] = &[
    "version.rs",
    "status.rs",
    "job.rs",
    "context.rs",
    "view.rs",
    "resolve.rs",
    "build.rs",
    "contents.rs",
    "triangles.rs",
    "cages.rs",
    "nurbs.rs",
    "report.rs",
    "model.rs",
    "scene.rs",
    "instances.rs",
    "nested.rs",
    "scene_files.rs",
    "looks.rs",
    "query.rs",
    "query_f32.rs",
    "geometry.rs",
    "evaluate.rs",
    "crossings.rs",
    "cursor.rs",
    "inside.rs",
    "overlap.rs",
    "clash.rs",
    "nearest.rs",
    "fit.rs",
    "frame.rs",
    "pixels.rs",
    "prefetch.rs",
];

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
    for_c(&String::from_utf8(bytes).expect("UTF-8"))
}

/// Leaves out what only Rust's reader needs: the `# Safety` sections, which the rules at the head of the
/// header replace (they are the last of their comments). Comments of one line take one line.
fn for_c(header: &str) -> String {
    let mut inside = false;
    let mut lines: Vec<String> = Vec::new();
    for line in header.lines() {
        inside = (inside || line.trim() == "* # Safety") && line.trim() != "*/";
        if inside {
            continue;
        }
        lines.push(line.to_string());
        let one_line = match &lines[..] {
            [.., open, text, close] if open.trim() == "/**" && close.trim() == "*/" => {
                text.trim_start().strip_prefix("* ").map(|t| open.replace("/**", &format!("/** {t} */")))
            }
            _ => None,
        };
        if let Some(line) = one_line {
            lines.truncate(lines.len() - 3);
            lines.push(line);
        }
    }
    lines.join("\n") + "\n"
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
