//! The C ABI as C sees it: compilers, linkers and programs, over `include/` and the library just built.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Where cargo put the libraries that belong to this test.
pub(crate) fn built() -> PathBuf {
    let exe = std::env::current_exe().expect("the path of this test");
    exe.parent().expect("its folder").to_path_buf()
}

/// The name that programs record. While the major version is 0, it has the minor version too.
pub(crate) const SONAME: &str =
    concat!("liboutcrop.so.", env!("CARGO_PKG_VERSION_MAJOR"), ".", env!("CARGO_PKG_VERSION_MINOR"));

fn header() -> String {
    std::fs::read_to_string(root().join("include/outcrop.h")).expect("include/outcrop.h")
}

/// Runs a command; a failure shows all that it said.
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(
        output.status.success(),
        "{command:?}: {}\n{}{}",
        output.status,
        text(&output.stdout),
        text(&output.stderr)
    );
    text(&output.stdout)
}

/// A compiler with the warnings that must not come.
pub(crate) fn compiler(name: &str, standard: &str) -> Command {
    let mut command = Command::new(name);
    command.arg(format!("-std={standard}")).args(["-Wall", "-Wextra", "-pedantic", "-Werror", "-g"]);
    command.arg("-I").arg(root().join("include")).arg("-I").arg(root().join("tests/abi"));
    command
}

fn source(name: &str) -> PathBuf {
    root().join("tests/abi").join(name)
}

/// Compiles a C program of `tests/abi` against the shared library.
fn program(dir: &Path, name: &str, extra: &[&str]) -> PathBuf {
    let exe = dir.join(name.trim_end_matches(".c"));
    let mut cc = compiler("cc", "c11");
    cc.arg(source(name)).args(extra).arg("-o").arg(&exe);
    cc.arg(built().join("liboutcrop.so")).arg("-pthread").arg("-lm");
    run(&mut cc);
    exe
}

/// Runs a program with the folder where the library lies in the loader's path.
fn run_program(exe: &Path, argument: &Path) {
    // The soname is that of the installed library.
    let libs = exe.parent().expect("folder").join("libs");
    std::fs::create_dir_all(&libs).expect("libs");
    let link = libs.join(SONAME);
    if !link.exists() {
        std::os::unix::fs::symlink(built().join("liboutcrop.so"), &link).expect("link");
    }
    run(Command::new(exe).arg(argument).env("LD_LIBRARY_PATH", libs));
}

pub(crate) fn temp() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

pub(crate) fn is_there(tool: &str) -> bool {
    Command::new(tool).arg("--version").output().is_ok()
}

/// The functions that the header declares.
fn declared() -> BTreeSet<String> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let header = header();
    let names = header.split("OC_API").skip(1).filter_map(|declaration| {
        let head = declaration.split('(').next()?;
        head.rsplit(|c| !is_name(c)).next()
    });
    names.filter(|n| n.starts_with("oc_")).map(str::to_string).collect()
}

#[test]
fn header_is_clean_in_every_language() {
    let dir = temp();
    let compilers = [("gcc", "g++"), ("clang", "clang++")];
    for (c, cxx) in compilers.into_iter().filter(|(c, _)| is_there(c)) {
        for (name, standard, padded) in
            [(c, "c99", true), (c, "c11", true), (cxx, "c++11", false), (cxx, "c++20", false)]
        {
            let objects = ["include_a", "include_b"].map(|unit| {
                let object = dir.path().join(format!("{unit}.o"));
                let mut cc = compiler(name, standard);
                if padded {
                    // Structs have their padding written down, not left to the compiler.
                    cc.arg("-Wpadded");
                } else {
                    cc.args(["-x", "c++"]);
                }
                run(cc.arg("-c").arg(source(&format!("{unit}.c"))).arg("-o").arg(&object));
                object
            });
            // Twice in one program.
            let exe = dir.path().join("twice");
            let library = built().join("liboutcrop.so");
            run(Command::new(name).args(&objects).arg(library).arg("-o").arg(&exe));
            run_program(&exe, Path::new(""));
        }
        for standard in ["c++11", "c++20"] {
            for exceptions in ["-fexceptions", "-fno-exceptions"] {
                let mut cc = compiler(cxx, standard);
                let object = dir.path().join("handles.o");
                run(cc.arg(exceptions).arg("-c").arg(source("handles.cpp")).arg("-o").arg(object));
            }
        }
    }
}

#[test]
fn shared_library_shows_only_what_the_header_declares() {
    let symbols = run(Command::new("nm").args(["-D", "--defined-only"]).arg(built().join("liboutcrop.so")));
    let symbols: BTreeSet<String> =
        symbols.lines().filter_map(|l| l.split_whitespace().last()).map(str::to_string).collect();
    let mut wanted = declared();
    assert!(wanted.len() > 40, "the header's functions were not found");
    if cfg!(debug_assertions) {
        wanted.insert("oc_test_panic_at".into());
    }
    assert_eq!(symbols, wanted);
}

#[test]
fn soname_tells_which_versions_are_compatible() {
    let dynamic = run(Command::new("readelf").arg("-d").arg(built().join("liboutcrop.so")));
    assert!(dynamic.contains(&format!("soname: [{SONAME}]")), "{dynamic}");
    for file in ["src/guide/questions.md", "bindings/python/README.md", "bindings/python/outcrop/_library.py"] {
        let text = std::fs::read_to_string(root().join(file)).expect(file);
        let names: Vec<_> = text.match_indices("liboutcrop.so.").map(|(at, _)| &text[at..]).collect();
        assert!(!names.is_empty() && names.iter().all(|name| name.starts_with(SONAME)), "{file}");
    }
}

/// Makes the isolated static archive as the package does.
fn isolated(dir: &Path) -> PathBuf {
    let archive = dir.join("liboutcrop.a");
    run(Command::new("sh").arg(root().join("cmake/isolate.sh")).arg(built().join("liboutcrop.a")).arg(&archive));
    archive
}

#[test]
fn static_library_shows_only_oc_symbols() {
    let dir = temp();
    let symbols = run(Command::new("nm").args(["-g", "--defined-only"]).arg(isolated(dir.path())));
    let names: Vec<&str> =
        symbols.lines().filter(|l| l.contains(' ')).filter_map(|l| l.split_whitespace().last()).collect();
    assert!(names.len() > 40, "{symbols}");
    let strangers: Vec<_> = names.iter().filter(|n| !n.starts_with("oc_")).collect();
    assert!(strangers.is_empty(), "{strangers:?}");
}

/// Two Rust libraries with their own standard libraries in one program: cargo's own archives would clash.
#[test]
fn static_library_links_beside_another_rust_library() {
    let dir = temp();
    let second = dir.path().join("libsecond.a");
    run(Command::new("rustc")
        .args(["--edition=2024", "--crate-type=staticlib", "-O", "-o"])
        .arg(&second)
        .arg(source("second.rs")));
    let exe = dir.path().join("beside");
    let mut cc = compiler("cc", "c11");
    cc.arg("-DOC_STATIC").arg(source("beside.c")).arg(isolated(dir.path())).arg(&second);
    cc.arg("-Wl,--gc-sections");
    run(cc.args(["-lgcc_s", "-lutil", "-lrt", "-lpthread", "-lm", "-ldl", "-lc", "-o"]).arg(&exe));
    run_program(&exe, &dir.path().join("tetra.oc"));
}

#[test]
fn host_executor_and_zero_threads_start_no_thread_of_ours() {
    let dir = temp();
    run_program(&program(dir.path(), "threads.c", &[]), &dir.path().join("tetra.oc"));
}

#[test]
fn handles_of_a_parent_process_return_a_status() {
    let dir = temp();
    run_program(&program(dir.path(), "fork.c", &[]), &dir.path().join("tetra.oc"));
}

#[test]
fn panics_come_back_as_statuses() {
    let dir = temp();
    run_program(&program(dir.path(), "panics.c", &[]), &dir.path().join("tetra.oc"));
}

#[test]
fn a_host_resolves_names_and_limits_builds() {
    let dir = temp();
    run_program(&program(dir.path(), "resolve.c", &[]), dir.path());
}

#[test]
fn normals_and_colours_of_vertices_are_interpolated() {
    let dir = temp();
    let sanitized = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    run_program(&program(dir.path(), "normals.c", &sanitized), dir.path());
}

#[test]
fn surfaces_are_hit_in_both_structures() {
    let dir = temp();
    let sanitized = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    run_program(&program(dir.path(), "surfaces.c", &sanitized), dir.path());
}

#[test]
fn rays_and_hits_in_single_precision() {
    let dir = temp();
    let sanitized = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    run_program(&program(dir.path(), "single_precision.c", &sanitized), dir.path());
}

#[test]
fn misuse_comes_back_as_statuses() {
    let dir = temp();
    let sanitized = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"];
    run_program(&program(dir.path(), "misuse.c", &sanitized), dir.path());
}

#[test]
fn misuse_leaves_no_entry_point_out() {
    let text = std::fs::read_to_string(source("misuse.c")).expect("misuse.c");
    let missing: Vec<_> = declared().into_iter().filter(|f| !text.contains(&format!("{f}("))).collect();
    assert!(missing.is_empty(), "not in tests/abi/misuse.c: {missing:?}");
}
