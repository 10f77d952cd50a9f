//! The house: every room of `src/` uses only the rooms it may, in one direction, and what is special
//! (unsafe, vector instructions, C) is where it belongs.

#[path = "house/notices.rs"]
mod notices;
#[path = "house/source.rs"]
mod source;

use source::{Module, Reexports, Token, modules, names_at_root, names_below, reexports, tokens};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The rooms in the order of `lib.rs`, each with those it may use: only earlier ones, hence no cycles.
const ROOMS: [(&str, &[&str]); 14] = [
    ("base", &[]),
    ("math", &[]),
    ("simd", &["math"]),
    ("geom", &["base", "math", "simd"]),
    ("lod", &["base", "math", "simd"]),
    ("store", &["base"]),
    ("import", &["base", "math", "geom"]),
    ("residency", &["base", "store"]),
    ("structure", &["base", "math", "simd", "geom", "lod", "store", "residency"]),
    ("build", &["base", "math", "simd", "geom", "lod", "store", "import", "residency", "structure"]),
    ("scene", &["base", "math", "simd", "geom", "lod", "store", "residency", "structure"]),
    ("query", &["base", "math", "simd", "geom", "lod", "store", "residency", "structure", "scene"]),
    ("render", &["base", "math", "simd", "geom", "lod", "store", "residency", "structure", "scene", "query"]),
    ("capi", PUBLIC),
];

/// The rooms whose items are the crate's public face; the C ABI and the command line use no others.
const PUBLIC: &[&str] = &["base", "math", "simd", "store", "import", "build", "scene", "query", "render"];

/// The module that is documentation alone: pages of Markdown that rustdoc shows. It uses no room, and no room uses it.
const GUIDE: &str = "guide";

/// Folders at the top, beside plain files; the last three are never committed.
const TOP_FOLDERS: [&str; 10] =
    ["src", "include", "cmake", "examples_c", "tests", "bindings", ".ci", ".git", "target", "build"];

/// Where `unsafe` may be, and why.
const UNSAFE: [(&str, &str); 8] = [
    ("src/simd/", "vector instructions"),
    ("src/capi/", "pointers from C"),
    ("src/residency/slots.rs", "decoded blocks read while others are written"),
    ("src/residency/huge_pages.rs", "advice to the system on memory"),
    ("src/residency/pages.rs", "the same"),
    ("src/base/reserve.rs", "an allocator"),
    ("src/base/tasks.rs", "work that borrows from its caller's stack, who waits for it"),
    ("src/base/round_tests.rs", "cells of the model checker"),
];

/// Where rayon may be: the bake wing.
const RAYON: [&str; 3] = ["src/build/", "src/import/", "src/structure/"];

const LONGEST_FILE: usize = 600;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// As in the tables above.
fn short(file: &Path) -> String {
    file.strip_prefix(root()).unwrap_or(file).to_string_lossy().replace('\\', "/")
}

fn library() -> Vec<Module> {
    modules(&root().join("src/lib.rs"))
}

fn files_below(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().map(|e| e.unwrap()) {
        let path = entry.path();
        if path.is_dir() {
            out.extend(files_below(&path, ending));
        } else if path.to_string_lossy().ends_with(ending) {
            out.push(path);
        }
    }
    out.sort();
    out
}

fn none(faults: Vec<String>) {
    assert!(faults.is_empty(), "\n{}\n", faults.join("\n"));
}

/// Each use of another room that the table does not allow.
fn forbidden_uses(module: &Module, reexports: &Reexports) -> Vec<String> {
    let Some(room) = module.path.first() else { return Vec::new() };
    let allowed = ROOMS.iter().find(|(name, _)| name == room).map_or(&[][..], |r| r.1);
    let fault = |(name, line): (String, usize)| {
        let used = reexports.get(&name).unwrap_or(&name).as_str();
        let fine = used == room || allowed.contains(&used);
        (!fine).then(|| format!("{}:{line}: {room} may not use {name}", short(&module.file)))
    };
    names_at_root(module).into_iter().filter_map(fault).collect()
}

#[test]
fn every_room_uses_only_the_rooms_it_may() {
    let modules = library();
    assert!(modules.len() > 100, "only {} modules were found", modules.len());
    let reexports = reexports(modules.iter().find(|m| m.path.is_empty()).unwrap());
    assert_eq!(reexports["Error"], "base");
    none(modules.iter().flat_map(|m| forbidden_uses(m, &reexports)).collect());
}

#[test]
fn rooms_use_only_earlier_ones() {
    for (i, (room, uses)) in ROOMS.iter().enumerate() {
        for used in *uses {
            assert!(ROOMS[..i].iter().any(|(earlier, _)| earlier == used), "{room} uses {used}");
        }
    }
}

#[test]
fn the_library_is_its_rooms_in_order_and_no_logic() {
    let text = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let tokens = tokens(&text);
    let declared: Vec<_> = tokens.windows(2).filter(|w| w[0].0.is_word("mod")).filter_map(|w| w[1].0.word()).collect();
    assert_eq!(declared, [&ROOMS.map(|(room, _)| room)[..], &[GUIDE]].concat());
    none(tokens.iter().filter(|t| t.0.is_word("fn")).map(|t| format!("src/lib.rs:{}: a function", t.1)).collect());
    let mut folders = folders_in(&root().join("src"));
    assert!(folders.remove("bin") && folders.remove(GUIDE));
    assert_eq!(folders, ROOMS.map(|(room, _)| room.to_owned()).into());
}

#[test]
fn the_guide_is_documentation_alone() {
    let file = root().join("src").join(GUIDE).with_extension("rs");
    let tokens = tokens(&std::fs::read_to_string(&file).unwrap());
    let pages: BTreeSet<_> =
        tokens.windows(2).filter(|w| w[0].0.is_word("mod")).filter_map(|w| w[1].0.word()).collect();
    let is_allowed = |token: &Token| match token.word() {
        Some(word) => {
            ["pub", "mod", "doc", "include_str", "allow", "rustdoc", "broken_intra_doc_links"].contains(&word)
                || pages.contains(word)
        }
        None => true,
    };
    none(tokens.iter().filter(|t| !is_allowed(&t.0)).map(|t| format!("{}:{}: code", short(&file), t.1)).collect());
    // Every page is shown.
    let texts: Vec<_> =
        tokens.iter().filter_map(|t| if let Token::Text(text) = &t.0 { Some(text.as_str()) } else { None }).collect();
    let faults = files_below(&root().join("src").join(GUIDE), "").into_iter().filter(|page| {
        let name = page.strip_prefix(root().join("src")).unwrap().to_string_lossy().replace('\\', "/");
        !name.ends_with(".md") || !texts.contains(&name.as_str())
    });
    none(faults.map(|page| format!("{}: not in src/guide.rs", short(&page))).collect());
}

fn folders_in(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    entries.filter(|e| e.path().is_dir()).map(|e| e.file_name().into_string().unwrap()).collect()
}

#[test]
fn the_top_level_is_fixed() {
    let faults = folders_in(&root()).into_iter().filter(|name| !TOP_FOLDERS.contains(&name.as_str()));
    none(faults.map(|name| format!("{name}/: no further folder at the top")).collect());
}

#[test]
fn every_file_belongs_to_a_module() {
    let mut modules = library();
    modules.extend(modules_of_bin());
    let used: BTreeSet<_> = modules.into_iter().map(|m| m.file).collect();
    let all = files_below(&root().join("src"), ".rs").into_iter();
    none(all.filter(|f| !used.contains(f)).map(|f| format!("{}: no module", short(&f))).collect());
}

#[test]
fn every_test_file_belongs_to_a_binary() {
    let cargo = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let roots: Vec<_> = cargo.lines().filter_map(|l| l.strip_prefix("path = \"tests/")?.strip_suffix('"')).collect();
    assert!(roots.len() > 5, "{roots:?}");
    let texts: Vec<_> =
        roots.iter().map(|name| std::fs::read_to_string(root().join("tests").join(name)).unwrap()).collect();
    let is_used = |name: &str| {
        let module = format!("mod {};", name.trim_end_matches(".rs"));
        roots.contains(&name) || texts.iter().any(|text| text.lines().any(|line| line == module))
    };
    let files = std::fs::read_dir(root().join("tests")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    none(files.filter(|f| f.ends_with(".rs") && !is_used(f)).map(|f| format!("tests/{f}: in no binary")).collect());
}

fn modules_of_bin() -> Vec<Module> {
    modules(&root().join("src/bin/outcrop/main.rs"))
}

#[test]
fn the_command_line_uses_the_public_face() {
    let mut reexports = reexports(library().iter().find(|m| m.path.is_empty()).unwrap());
    reexports.retain(|_, room| PUBLIC.contains(&room.as_str()));
    let mut faults = Vec::new();
    for module in modules_of_bin() {
        for window in module.tokens.windows(4) {
            let [(crate_name, line), (a, _), (b, _), (item, _)] = window else { continue };
            let path = crate_name.is_word("outcrop") && a.is_sign(':') && b.is_sign(':');
            let named = item.word().is_some_and(|w| PUBLIC.contains(&w) || reexports.contains_key(w));
            if path && !named && !item.is_sign('{') {
                faults.push(format!("{}:{line}: outcrop::{item:?} is not public", short(&module.file)));
            }
        }
    }
    none(faults);
}

/// Faults of all library files in which `is_special` is found outside of `allowed` places.
fn only_in(allowed: &[&str], what: &str, is_special: impl Fn(&[Token]) -> bool) -> Vec<String> {
    let mut faults = Vec::new();
    for file in files_below(&root().join("src"), ".rs") {
        let name = short(&file);
        if allowed.iter().any(|place| name.starts_with(place)) {
            continue;
        }
        let (tokens, lines): (Vec<_>, Vec<_>) = tokens(&std::fs::read_to_string(&file).unwrap()).into_iter().unzip();
        let found = (0..tokens.len()).find(|&at| is_special(&tokens[at..]));
        faults.extend(found.map(|at| format!("{name}:{}: {what} does not belong here", lines[at])));
    }
    faults
}

fn begins_with_word(tokens: &[Token], words: &[&str]) -> bool {
    tokens.first().and_then(Token::word).is_some_and(|w| words.contains(&w))
}

#[test]
fn unsafe_is_where_it_must_be() {
    none(UNSAFE.iter().filter(|u| !root().join(u.0).exists()).map(|u| format!("{} does not exist", u.0)).collect());
    none(only_in(&UNSAFE.map(|u| u.0), "unsafe", |t| begins_with_word(t, &["unsafe"])));
}

#[test]
fn rooms_without_unsafe_forbid_it() {
    let holds_unsafe = |room: &str| UNSAFE.iter().any(|u| u.0.starts_with(&format!("src/{room}/")));
    let forbids = |room: &str| {
        let text = std::fs::read_to_string(root().join("src").join(room).join("mod.rs")).unwrap();
        text.contains("#![forbid(unsafe_code)]")
    };
    let faults = ROOMS.iter().filter(|(room, _)| !holds_unsafe(room) && !forbids(room));
    none(faults.map(|(room, _)| format!("src/{room}/mod.rs: #![forbid(unsafe_code)] is missing")).collect());
}

#[test]
fn vector_instructions_are_in_simd() {
    none(only_in(&["src/simd/"], "std::arch", |t| {
        let arch = t.len() > 3 && begins_with_word(t, &["std", "core"]) && t[1].is_sign(':') && t[3].is_word("arch");
        arch || begins_with_word(t, &["is_x86_feature_detected", "target_feature"])
    }));
}

#[test]
fn only_capi_knows_c() {
    none(only_in(&["src/capi/"], "C", |t| {
        let abi = t.len() > 1 && t[0].is_word("extern") && matches!(t[1], Token::Text(_));
        abi || begins_with_word(t, &["no_mangle", "export_name", "c_char", "c_void", "CStr", "CString"])
    }));
}

#[test]
fn rayon_serves_the_bake_wing() {
    none(only_in(&RAYON, "rayon", |t| t.len() > 1 && t[0].is_word("rayon") && t[1].is_sign(':')));
    let structures = root().join("src/structure");
    // The contract's own files trace too, but for those that build.
    let is_of_contract =
        |f: &PathBuf| f.parent() == Some(&structures) && !f.ends_with("par.rs") && !f.ends_with("bake.rs");
    let is_trace = |f: &PathBuf| {
        is_of_contract(f) || f.components().any(|c| c.as_os_str() == "trace" || c.as_os_str() == "trace.rs")
    };
    let traces: Vec<_> = files_below(&root().join("src/structure"), ".rs").into_iter().filter(is_trace).collect();
    assert!(!traces.is_empty());
    let faults = traces.iter().filter(|f| std::fs::read_to_string(f).unwrap().contains("rayon::"));
    none(faults.map(|f| format!("{}: rayon while tracing", short(f))).collect());
}

#[test]
fn every_structure_has_the_same_three_faces() {
    let structures = root().join("src/structure");
    for structure in folders_in(&structures) {
        for face in ["build", "layout", "trace"] {
            let at = structures.join(&structure).join(face);
            assert!(at.is_dir() || at.with_extension("rs").is_file(), "{structure} has no {face}");
        }
    }
}

/// The names of structures that a module of a room above them mentions, as folders of `structure`. `*` could be any.
fn named_structures(module: &Module, structures: &BTreeSet<String>) -> Vec<String> {
    let room = |name: &str| ROOMS.iter().position(|(room, _)| *room == name);
    let is_above = module.path.first().and_then(|own| room(own)) > room("structure");
    let named = names_below(module, "structure")
        .into_iter()
        .filter(|(name, _)| is_above && (name == "*" || structures.contains(name)));
    named
        .map(|(name, line)| format!("{}:{line}: structure::{name} is named above `structure`", short(&module.file)))
        .collect()
}

/// The contract's files that may name a structure: an arm for each in the first four; in the others state of the bvh's
/// own walks.
const NAMING: [&str; 6] = ["mod.rs", "tree.rs", "open.rs", "bake.rs", "packet.rs", "stream.rs"];

#[test]
fn few_files_of_the_contract_name_a_structure() {
    let at = root().join("src/structure");
    let structures = folders_in(&at);
    let contract = files_below(&at, ".rs")
        .into_iter()
        .filter(|f| f.parent() == Some(&at) && !NAMING.iter().any(|name| f.ends_with(name)));
    none(
        contract
            .flat_map(|file| {
                let tokens = tokens(&std::fs::read_to_string(&file).unwrap());
                let named = tokens.iter().filter_map(|(token, line)| {
                    token.word().filter(|w| structures.contains(*w)).map(|w| format!("{}:{line}: {w}", short(&file)))
                });
                named.collect::<Vec<_>>()
            })
            .collect(),
    );
}

#[test]
fn no_room_above_names_a_structure() {
    let structures = folders_in(&root().join("src/structure"));
    assert!(structures.contains("bvh") && structures.contains("brute"));
    none(library().iter().flat_map(|module| named_structures(module, &structures)).collect());
    // The root gives none of them a name of its own.
    let lib = tokens(&std::fs::read_to_string(root().join("src/lib.rs")).unwrap());
    none(
        lib.iter()
            .filter_map(|(token, line)| {
                token.word().filter(|w| structures.contains(*w)).map(|w| format!("src/lib.rs:{line}: {w}"))
            })
            .collect(),
    );
}

/// The files of the library and of its tests.
fn sources() -> Vec<PathBuf> {
    ["src", "tests"].iter().flat_map(|folder| files_below(&root().join(folder), ".rs")).collect()
}

#[test]
fn files_are_short_and_finished() {
    let mut faults = Vec::new();
    for file in sources() {
        let text = std::fs::read_to_string(&file).unwrap();
        let lines = text.lines().count();
        if lines > LONGEST_FILE {
            faults.push(format!("{}: {lines} lines", short(&file)));
        }
        let tokens = tokens(&text);
        let mut macros = tokens.windows(2).filter(|w| w[1].0.is_sign('!'));
        let unfinished = macros.find(|w| w[0].0.word().is_some_and(|w| ["todo", "unimplemented", "dbg"].contains(&w)));
        faults.extend(unfinished.map(|w| format!("{}:{}: unfinished", short(&file), w[0].1)));
        let note = ["TO", "FIX", "X"].iter().zip(["DO", "ME", "XX"]).map(|(a, b)| format!("{a}{b}"));
        faults.extend(note.filter(|n| text.contains(n.as_str())).map(|n| format!("{}: {n}", short(&file))));
    }
    none(faults);
}

/// Columns of a comment at most, as of code (`rustfmt.toml`). Rows of tables have none: they cannot be broken.
const WIDEST_COMMENT: usize = 120;

#[test]
fn comments_are_as_narrow_as_code() {
    let mut faults = Vec::new();
    for file in sources() {
        let text = std::fs::read_to_string(&file).unwrap();
        for (line, comment) in text.lines().enumerate().filter(|(_, line)| line.trim_start().starts_with("//")) {
            let width = comment.chars().count();
            let is_row = comment.trim_start().trim_start_matches(['/', '!', ' ']).starts_with('|');
            if width > WIDEST_COMMENT && !is_row {
                faults.push(format!("{}:{}: {width} columns", short(&file), line + 1));
            }
        }
    }
    none(faults);
}

// The test of the test: it must see what it is there for.

fn uses(path: &[&str], text: &str) -> Vec<String> {
    let path = path.iter().map(|&s| s.to_owned()).collect();
    let module = Module { file: PathBuf::new(), path, tokens: tokens(text) };
    names_at_root(&module).into_iter().map(|n| n.0).collect()
}

#[test]
fn escapes_are_seen() {
    assert_eq!(uses(&["a", "b"], "use crate::build::Builder;"), ["build"]);
    assert_eq!(uses(&["a", "b"], "use crate::{base::{x, y}, scene::*, Error};"), ["base", "scene", "Error"]);
    assert_eq!(uses(&["a", "b"], "fn f() { super::super::scene::f(); super::own(); }"), ["scene"]);
    assert_eq!(uses(&["a"], "use super::{query, render::*};"), ["query", "render"]);
    assert_eq!(uses(&["a", "b"], "use super::super::*; use crate::*;"), ["*", "*"]);
    assert_eq!(uses(&["a"], "macro_rules! m { () => { $crate::scene::f() } }"), ["scene"]);
    assert!(
        uses(&["a", "b"], "// crate::build\n/* /* */ crate::build */ \"crate::build\" r#\"\" crate::x\"# 'a' '\\''")
            .is_empty()
    );
    assert!(uses(&["a", "b"], "pub(crate) fn f<'a>(x: &'a str) { super::g() }").is_empty());
}

#[test]
fn forbidden_uses_are_faults() {
    let module = |text: &str| Module { path: vec!["store".into()], tokens: tokens(text), ..Module::default() };
    let reexports = Reexports::from([("Error".to_owned(), "base".to_owned()), ("Hit".to_owned(), "query".to_owned())]);
    assert!(
        forbidden_uses(&module("use crate::base::ids; use crate::Error; use crate::store::x;"), &reexports).is_empty()
    );
    for fault in ["use crate::math::Ray;", "use crate::Hit;", "use crate::unheard_of;", "use crate::*;"] {
        assert_eq!(forbidden_uses(&module(fault), &reexports).len(), 1, "{fault}");
    }
}

#[test]
fn named_structures_are_faults() {
    let structures = ["bvh".to_owned(), "brute".to_owned()].into();
    let faults = |room: &str, text: &str| {
        let path = vec![room.to_owned(), "walk".to_owned()];
        named_structures(&Module { file: PathBuf::new(), path, tokens: tokens(text) }, &structures).len()
    };
    for fault in [
        "use crate::structure::bvh::trace::TreeView;",
        "use crate::structure::{Tree, bvh::{layout, leaf}};",
        "use crate::structure::{self, brute};",
        "use crate::{math::Ray, structure::{Walk, bvh}};",
        "use crate::{structure::brute::build};",
        "use super::super::structure::bvh;",
        "fn f() { crate::structure::brute::layout::check() }",
        "use crate::structure::*;",
        "use crate::structure::{tree::Tree, *};",
        "use crate::{structure as shape}; fn f() { shape::bvh::open() }",
    ] {
        assert_eq!(faults("scene", fault), 1, "{fault}");
    }
    for fine in [
        "use crate::structure::{Tree, Walk, tree::{Visit, bvh}, open::*};",
        "use crate::structure; // crate::structure::bvh",
        "use super::bvh; use crate::scene::brute; use crate::structure::Structure;",
        "fn f() { let bvh = Structure::Bvh; }",
    ] {
        assert_eq!(faults("scene", fine), 0, "{fine}");
    }
    assert_eq!(faults("structure", "use crate::structure::bvh;"), 0);
    assert_eq!(faults("store", "use crate::structure::bvh;"), 0, "another rule forbids that");
}

#[test]
fn modules_inside_of_files_are_one_deeper() {
    let dir = tempfile::tempdir().unwrap();
    let lib = dir.path().join("lib.rs");
    std::fs::create_dir(dir.path().join("a")).unwrap();
    std::fs::write(&lib, "pub mod a; mod c { use super::q; }").unwrap();
    std::fs::write(
        dir.path().join("a/mod.rs"),
        "mod b { use super::super::x; fn f() { if true {} } } use super::y;
        #[path = \"t_tests.rs\"] mod tests;",
    )
    .unwrap();
    std::fs::write(dir.path().join("a/t_tests.rs"), "use super::inside; use super::super::z;").unwrap();
    let mut found: Vec<_> = modules(&lib).iter().flat_map(names_at_root).map(|n| n.0).collect();
    found.sort();
    assert_eq!(found, ["q", "x", "y", "z"]);
}
