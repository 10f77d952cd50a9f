//! The table says what is: tests that it names exist, parts that it waits for do not, measures that it says are missed
//! are measured, and its rows are those of the design.

use super::table::{DESIGN, Later, State, rows};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All Rust files below a folder.
fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// The names of a file's tests that run: functions right below `#[test]`, but for other attributes and comments; and
/// those that `on_each_structure!` makes tests of.
fn tests_of(file: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut is_test = false;
    let text = text(&root().join(file));
    for (_, list) in text.match_indices("on_each_structure!(").map(|(at, start)| text.split_at(at + start.len())) {
        let list = list.split(')').next().unwrap_or_default();
        names.extend(
            list.split(',').map(|name| name.trim().to_owned()).filter(|name| text.contains(&format!("fn {name}("))),
        );
    }
    for line in text.lines().map(str::trim) {
        if line == "#[test]" {
            is_test = true;
        } else if let Some(name) = line.strip_prefix("fn ").filter(|_| is_test) {
            names.extend(name.split('(').next().map(str::to_owned));
            is_test = false;
        } else if line.starts_with("#[ignore") || !line.starts_with("#[") && !line.starts_with("//") {
            is_test = false;
        }
    }
    names
}

/// The file that a name of the table means.
fn file_of(name: &str) -> String {
    let beside = format!("tests/{name}.rs");
    if root().join(&beside).is_file() { beside } else { format!("tests/stability/{name}.rs") }
}

#[test]
fn tests_that_are_named_exist() {
    for row in rows() {
        let waits = matches!(row.state, State::Pending(_));
        assert!(waits || !row.tests.is_empty(), "nothing shows: {}", row.fails);
        for test in row.tests {
            let (file, name) = test.split_once("::").expect("file::test");
            assert!(tests_of(&file_of(file)).contains(name), "{}: there is no {test}", row.fails);
        }
    }
}

/// No test of this folder is forgotten in the table.
#[test]
fn tests_that_exist_are_named() {
    let named: BTreeSet<&str> = rows().flat_map(|row| row.tests).copied().collect();
    let mut files = Vec::new();
    sources(&root().join("tests/stability"), &mut files);
    assert!(files.len() > 10);
    for file in files {
        let stem = file.file_stem().expect("a name").to_string_lossy().into_owned();
        if stem == "up_to_date" {
            continue;
        }
        for test in tests_of(&format!("tests/stability/{stem}.rs")) {
            assert!(named.contains(format!("{stem}::{test}").as_str()), "no row names {stem}::{test}");
        }
    }
}

/// Whether a part that rows wait for is there.
fn is_there(part: Later) -> bool {
    let code = |words: &[&str]| {
        let mut files = Vec::new();
        sources(&root().join("src"), &mut files);
        let is_code = |line: &&str| !line.trim_start().starts_with("//");
        let has = |path: &PathBuf| {
            let text = text(path).to_lowercase();
            text.lines().filter(is_code).any(|line| words.iter().any(|word| line.contains(word)))
        };
        files.iter().find(|path| has(path)).is_some_and(|path| {
            println!("{part:?}: {}", path.display());
            true
        })
    };
    match part {
        Later::Mirrors => code(&["differential", "fn reflect", "fn mirror", "mod mirror", "mod reflect"]),
    }
}

#[test]
fn parts_that_are_waited_for_are_not_there() {
    for row in rows() {
        if let State::Pending(part) = row.state {
            assert!(!is_there(part), "{part:?} are there, and nothing shows: {}", row.fails);
        }
    }
}

#[test]
fn what_is_said_to_be_missed_is_measured() {
    for row in rows() {
        let State::Misses { measures, why } = row.state else { continue };
        assert!(!measures.is_empty() && !why.is_empty(), "nothing is missed: {}", row.fails);
        for missed in measures {
            assert!(!missed.at.is_empty(), "{} is missed nowhere: {}", missed.measure, row.fails);
            // Tests put the name together of their scene and "what is measured".
            let (scene, what) = missed.measure.split_once(": ").unwrap_or((missed.measure, missed.measure));
            let of_row = row.tests.iter().filter_map(|test| test.split_once("::"));
            let is_measured = of_row.map(|(file, _)| text(&root().join(file_of(file)))).any(|file| {
                file.contains("judge") && file.contains(&format!("\"{scene}")) && file.contains(&format!("{what}\""))
            });
            assert!(is_measured, "no test of its row measures {}", missed.measure);
        }
    }
}

#[test]
fn the_rows_are_those_of_the_design() {
    let path = root().join("../shared/design.md");
    let Ok(design) = std::fs::read_to_string(&path) else {
        println!("skipped: no design beside the checkout");
        return;
    };
    let section = design.split("\n## ").find(|s| s.starts_with("10. ")).expect("section 10");
    let rows = section.lines().filter(|line| line.starts_with('|')).skip(2);
    let stated: Vec<(&str, &str)> = rows
        .map(|row| {
            let mut cells = row.trim_matches('|').split('|').map(str::trim);
            (cells.next().expect("where it fails"), cells.next().expect("what must hold"))
        })
        .collect();
    let ours: Vec<(&str, &str)> = DESIGN.iter().map(|row| (row.fails, row.must)).collect();
    assert_eq!(ours, stated);
}
