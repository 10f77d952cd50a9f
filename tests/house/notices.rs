//! `THIRD_PARTY.txt`, which the package carries: the licences of all crates that the libraries and the command line
//! link.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Set to write the file instead of comparing it.
const WRITE: &str = "OUTCROP_WRITE_NOTICES";
const FILE: &str = "THIRD_PARTY.txt";

const HEAD: &str = "\
outcrop contains the following software of others: in the libraries, and in the command line `outcrop`.
Each entry has a name, a version, the licence as its authors state it, and the place of its source. The texts follow.
`make notices` writes this file.

the Rust standard library: MIT OR Apache-2.0, https://github.com/rust-lang/rust
";

/// A crate that is linked.
struct Linked {
    entry: String,
    folder: String,
    licence: String,
}

/// All crates that are linked, in order of their names. Procedural macros and what only they need run in the compiler.
fn linked(root: &Path) -> Vec<Linked> {
    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    let args =
        ["metadata", "--format-version=1", "--locked", "--offline", "--filter-platform=x86_64-unknown-linux-gnu"];
    let out = Command::new(cargo).args(args).current_dir(root).output().expect("cargo metadata");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let all: Value = serde_json::from_slice(&out.stdout).expect("JSON");
    let list = |value: &Value| value.as_array().expect("an array").clone();
    let text = |value: &Value| value.as_str().unwrap_or("unknown").to_string();
    let packages: BTreeMap<String, Value> = list(&all["packages"]).into_iter().map(|p| (text(&p["id"]), p)).collect();
    let nodes: BTreeMap<String, Value> =
        list(&all["resolve"]["nodes"]).into_iter().map(|n| (text(&n["id"]), n)).collect();
    let own = packages.iter().find(|(_, p)| p["name"] == "outcrop").expect("the package").0.clone();
    let is_macro = |p: &Value| list(&p["targets"]).iter().any(|t| t["kind"][0] == "proc-macro");
    let (mut found, mut open) = (BTreeSet::new(), vec![own.clone()]);
    while let Some(id) = open.pop() {
        if is_macro(&packages[&id]) || !found.insert(id.clone()) {
            continue;
        }
        let deps = list(&nodes[&id]["deps"]);
        let normal = deps.iter().filter(|dep| list(&dep["dep_kinds"]).iter().any(|kind| kind["kind"].is_null()));
        open.extend(normal.map(|dep| text(&dep["pkg"])));
    }
    found.remove(&own);
    let mut linked: Vec<Linked> = found
        .iter()
        .map(|id| {
            let p = &packages[id];
            let [name, version, licence, source] =
                ["name", "version", "license", "repository"].map(|member| text(&p[member]));
            let manifest = text(&p["manifest_path"]);
            let folder = manifest.trim_end_matches("Cargo.toml").to_string();
            Linked { entry: format!("{name} {version}: {licence}, {source}"), folder, licence }
        })
        .collect();
    linked.sort_by(|a, b| a.entry.cmp(&b.entry));
    linked
}

/// Returns the texts of a crate's licence: that of MIT if it may be chosen, else all.
fn texts(of: &Linked) -> Vec<String> {
    let starts = ["LICEN", "COPYING", "NOTICE", "UNLICENSE"];
    let mut names: Vec<String> = fs::read_dir(&of.folder)
        .expect("the folder of a crate")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| starts.iter().any(|start| name.to_uppercase().starts_with(start)))
        .collect();
    names.sort();
    let is_mit = |name: &String| name.to_uppercase().contains("MIT");
    if of.licence.contains("MIT") && names.iter().any(is_mit) {
        names.retain(is_mit);
    }
    let read = |name: &String| fs::read_to_string(Path::new(&of.folder).join(name)).ok();
    names.iter().filter_map(read).map(|text| text.replace('\r', "").trim().to_string()).collect()
}

/// Returns the list of all crates, then each text below the crates that have it.
fn write(linked: &[Linked]) -> String {
    let mut out = HEAD.to_string();
    linked.iter().for_each(|of| writeln!(out, "{}", of.entry).expect("a string"));
    let mut by_text: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for of in linked {
        let name = of.entry.split(':').next().unwrap_or_default();
        texts(of).into_iter().for_each(|text| by_text.entry(text).or_default().push(name));
    }
    let mut all: Vec<_> = by_text.into_iter().map(|(text, names)| (names, text)).collect();
    all.sort();
    for (names, text) in all {
        write!(out, "\n{}\n{}\n\n{text}\n", "-".repeat(80), names.join(", ")).expect("a string");
    }
    out
}

#[test]
fn notices_list_each_crate_that_is_linked() {
    let root = super::root();
    let linked = linked(&root);
    assert!(linked.len() > 20, "{} crates", linked.len());
    if std::env::var_os(WRITE).is_some() {
        fs::write(root.join(FILE), write(&linked)).expect(FILE);
    }
    let text = fs::read_to_string(root.join(FILE)).expect(FILE);
    let list: Vec<&str> = text.strip_prefix(HEAD).expect("the head").lines().take_while(|l| !l.is_empty()).collect();
    let wanted: Vec<&str> = linked.iter().map(|of| of.entry.as_str()).collect();
    assert_eq!(list, wanted, "{FILE} is out of date; `make notices` writes it");
    for part in ["Permission is hereby granted, free of charge", "Apache License"] {
        assert!(text.contains(part), "no text of a licence: {part}");
    }
}
