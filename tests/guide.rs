//! The snippets of `README.md` and of the guide (`src/guide`): each one compiles without warnings and runs.
//!
//! A block that contains `main` (in Python: `import outcrop`) is a whole program. Any other block is the body of a
//! function of `tests/guide/prelude.c`, `prelude.cpp` or `prelude.py`, with the variables that `src/guide/index.md`
//! lists. Leading paragraphs of a C or C++ block that begin with `static`, `typedef` or `#` go before that function.

use crate::abi::{SONAME, built, compiler, root, run, temp};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

/// Languages that are tested, and those that are not.
const TESTED: [&str; 3] = ["c", "cpp", "python"];
const UNTESTED: [&str; 3] = ["sh", "cmake", "text"];

/// The number of snippets: a page that loses a snippet by accident fails the test.
const SNIPPETS: usize = 51;

const README_LINES: usize = 150;
const README_C_LINES: usize = 30;
const README_PYTHON_LINES: usize = 10;

/// A fenced block.
struct Snippet {
    /// Name of the page and line of the block's first line, for example `budgets-45`.
    name: String,
    language: String,
    code: String,
}

impl Snippet {
    /// Returns the ending of a file in the snippet's language.
    fn ending(&self) -> &str {
        if self.language == "python" { "py" } else { &self.language }
    }
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Returns all fenced blocks of a page. Fails on unknown languages and on fences without an end.
fn blocks(path: &Path) -> Vec<Snippet> {
    let (mut found, mut open) = (Vec::new(), None);
    let stem = path.file_stem().expect("a name").to_string_lossy().into_owned();
    for (number, line) in (1..).zip(read(path).lines()) {
        match (line.strip_prefix("```"), &mut open) {
            (Some(language), None) => {
                let is_known = TESTED.contains(&language) || UNTESTED.contains(&language);
                assert!(is_known, "{}:{number}: unknown language {language:?}", path.display());
                let name = format!("{stem}-{}", number + 1);
                open = Some(Snippet { name, language: language.into(), code: String::new() });
            }
            (Some(_), Some(_)) => found.extend(open.take()),
            (None, Some(snippet)) => snippet.code += &format!("{line}\n"),
            (None, None) => assert!(!line.trim_start().starts_with("```"), "{}:{number}: indented", path.display()),
        }
    }
    assert!(open.is_none(), "{}: a block without an end", path.display());
    found
}

/// Returns the tested snippets of all pages.
fn snippets() -> Vec<Snippet> {
    let pages = std::fs::read_dir(root().join("src/guide")).expect("src/guide").map(|e| e.expect("a page").path());
    let mut pages: Vec<_> = pages.chain([root().join("README.md")]).collect();
    pages.sort();
    pages.iter().flat_map(|page| blocks(page)).filter(|s| TESTED.contains(&s.language.as_str())).collect()
}

/// Splits leading definitions from statements.
fn definitions(code: &str) -> (String, String) {
    let is_definition = |paragraph: &&str| {
        let is_comment = |line: &&str| line.starts_with("/*") || line.starts_with("//");
        let first = paragraph.lines().find(|line| !is_comment(line)).unwrap_or("");
        ["static ", "typedef ", "#"].iter().any(|begin| first.starts_with(begin))
    };
    let paragraphs: Vec<_> = code.split("\n\n").collect();
    let count = paragraphs.iter().take_while(|p| is_definition(p)).count();
    (paragraphs[..count].join("\n\n"), paragraphs[count..].join("\n\n"))
}

/// Returns the program that a snippet becomes.
fn program(snippet: &Snippet) -> String {
    let prelude = || read(&root().join("tests/guide").join(format!("prelude.{}", snippet.ending())));
    match snippet.ending() {
        "py" if snippet.code.contains("import outcrop") => snippet.code.clone(),
        "py" => prelude() + &snippet.code,
        _ if snippet.code.contains("int main(") => snippet.code.clone(),
        _ => {
            let (definitions, statements) = definitions(&snippet.code);
            let prelude = prelude();
            assert!(prelude.contains("/* DEFINITIONS */") && prelude.contains("/* STATEMENTS */"));
            prelude.replace("/* DEFINITIONS */", &definitions).replace("/* STATEMENTS */", &statements)
        }
    }
}

/// Returns a GLB file of four boxes: a housing, and a shaft and two bolts that share a mesh.
fn pump() -> Vec<u8> {
    let corners = (0..8).flat_map(|i| [i >> 2, i >> 1 & 1, i & 1].map(|bit| if bit == 1 { 1f32 } else { -1f32 }));
    let mut binary: Vec<u8> = corners.flat_map(f32::to_le_bytes).collect();
    for [a, b, c, d] in [[0u16, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        binary.extend([a, b, c, a, c, d].iter().flat_map(|i| i.to_le_bytes()));
    }
    let mut json = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3]}],
"nodes": [{"name": "housing", "mesh": 0, "scale": [2, 1, 1]}, {"name": "shaft", "mesh": 1, "scale": [3, 0.2, 0.2]},
{"name": "bolt 1", "mesh": 1, "scale": [0.2, 0.3, 0.2], "translation": [-1.5, 1.2, 0]},
{"name": "bolt 2", "mesh": 1, "scale": [0.2, 0.3, 0.2], "translation": [1.5, 1.2, 0]}],
"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]},
{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 1}]}],
"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.7, 1]}},
{"pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.6, 0.6, 1]}}],
"accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [-1, -1, -1],
"max": [1, 1, 1]}, {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}],
"bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
"buffers": [{"byteLength": 168}]}"#
        .to_string();
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let chunk = |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), &kind[..], bytes].concat();
    let chunks = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", &binary)].concat();
    [&b"glTF"[..], &2u32.to_le_bytes(), &(12 + chunks.len() as u32).to_le_bytes(), &chunks].concat()
}

/// Makes a folder with `pump.glb`, `pump.oc` built from it, and `libs` with the library under its installed name.
fn workshop() -> tempfile::TempDir {
    let folder = temp();
    let (mesh, model) = (folder.path().join("pump.glb"), folder.path().join("pump.oc"));
    std::fs::write(&mesh, pump()).expect("pump.glb");
    let (progress, cancel) = (Arc::new(Progress::default()), Cancel::new());
    let mut builder = Builder::new(BuildOptions::default(), progress, cancel).expect("a builder");
    builder.add_file(&mesh).expect("the mesh is read");
    assert_eq!(builder.finish(&model).expect("the model is built").triangles_kept, 24);
    let libs = folder.path().join("libs");
    std::fs::create_dir(&libs).expect("libs");
    std::os::unix::fs::symlink(built().join("liboutcrop.so"), libs.join(SONAME)).expect("a link");
    folder
}

/// Returns a command that ends after two minutes: a snippet that waits for ever fails.
fn limited(program: impl AsRef<std::ffi::OsStr>) -> Command {
    let mut command = Command::new("timeout");
    command.arg("120").arg(program);
    command
}

/// Returns the Python that has numpy: that of the environment which cmake/setup.sh makes, else the system's.
fn python() -> PathBuf {
    Some(root().join("build/python/venv/bin/python")).filter(|p| p.exists()).unwrap_or("python3".into())
}

/// Compiles and runs a snippet in a folder of its own below the workshop.
fn try_out(snippet: &Snippet, workshop: &Path) {
    let folder = workshop.join(&snippet.name);
    std::fs::create_dir(&folder).expect("a folder");
    for file in ["pump.glb", "pump.oc"] {
        std::fs::copy(workshop.join(file), folder.join(file)).expect("a copy");
    }
    let library = workshop.join("libs").join(SONAME);
    let source = folder.join(format!("{}.{}", snippet.name, snippet.ending()));
    std::fs::write(&source, program(snippet)).expect("the source");
    let mut command = if snippet.language == "python" {
        let mut python = limited(python());
        python.arg("-B").arg(&source);
        python.env("PYTHONPATH", root().join("bindings/python")).env("OUTCROP_LIBRARY", &library);
        python
    } else {
        let (name, standard) = if snippet.language == "c" { ("cc", "c99") } else { ("c++", "c++11") };
        let exe = folder.join("snippet");
        run(compiler(name, standard).arg(&source).arg(&library).args(["-pthread", "-lm", "-o"]).arg(&exe));
        let mut program = limited(exe);
        program.env("LD_LIBRARY_PATH", workshop.join("libs"));
        program
    };
    run(command.current_dir(&folder));
}

fn try_all(language: &str) {
    let workshop = workshop();
    let all: Vec<_> = snippets().into_iter().filter(|s| s.language == language).collect();
    assert!(!all.is_empty());
    all.iter().for_each(|snippet| try_out(snippet, workshop.path()));
}

#[test]
fn c_snippets_run() {
    try_all("c");
}

#[test]
fn cpp_snippets_run() {
    try_all("cpp");
}

#[test]
fn python_snippets_run() {
    let has_numpy = Command::new(python()).args(["-c", "import numpy"]).status().is_ok_and(|s| s.success());
    assert!(has_numpy, "python3 or its numpy is missing: cmake/setup.sh installs them");
    try_all("python");
}

#[test]
fn pages_have_their_snippets_and_the_readme_is_short() {
    let snippets = snippets();
    assert_eq!(snippets.len(), SNIPPETS, "snippets of the tested languages");
    let lines = read(&root().join("README.md")).lines().count();
    assert!(lines <= README_LINES, "README.md has {lines} lines");
    for (language, most) in [("c", README_C_LINES), ("python", README_PYTHON_LINES)] {
        let programs: Vec<_> =
            snippets.iter().filter(|s| s.name.starts_with("README-") && s.language == language).collect();
        assert_eq!(programs.len(), 1, "README.md has one program in {language}");
        let lines = programs[0].code.lines().count();
        assert!(lines <= most, "README.md: the program in {language} has {lines} lines");
        let is_whole = programs[0].code.contains(if language == "c" { "int main(" } else { "import outcrop" });
        assert!(is_whole, "README.md: the program in {language} is not whole");
    }
}

/// A new buffer or object gets its line in the table of the guide.
#[test]
fn tables_name_every_buffer_and_object_of_the_header() {
    let header = read(&root().join("include/outcrop.h"));
    let page = |name: &str| read(&root().join("src/guide").join(name));
    let names = |before: &str, after: &str| -> BTreeSet<String> {
        let lines = header.lines().filter_map(|line| line.strip_prefix(before));
        lines.filter_map(|line| line.split_once(after)).map(|(name, _)| name.to_string()).collect()
    };
    let (buffers, handles) = (names("#define OC_BUFFER_", " "), names("OC_API void oc_", "_retain("));
    assert!(buffers.len() >= 12 && handles.len() >= 8, "the header's names were not found");
    for buffer in buffers {
        assert!(page("promise.md").contains(&format!("`OC_BUFFER_{buffer}`")), "promise.md lacks OC_BUFFER_{buffer}");
    }
    for object in handles {
        assert!(page("concepts.md").contains(&format!("| `oc_{object}` |")), "concepts.md lacks oc_{object}");
    }
}

#[test]
fn leading_definitions_are_split_off() {
    assert_eq!(definitions("a();\n"), (String::new(), "a();\n".into()));
    assert_eq!(
        definitions("static int x;\n\n/* f */\nstatic void f(void) {\n}\n\nf();\n\nstatic int y;\n"),
        ("static int x;\n\n/* f */\nstatic void f(void) {\n}".into(), "f();\n\nstatic int y;\n".into())
    );
}
