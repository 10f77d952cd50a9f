//! Every mesh of the shared models, read and compared with the figures of their README.

use crate::models::{MODELS, Row, Shape::*};
use glam::DVec3;
use outcrop::Result;
use outcrop::import::collect::Collector;
use outcrop::import::{PartKey, ReadOptions, read_file};
use std::collections::HashSet;
use std::path::Path;

fn read(path: &Path) -> Result<Collector> {
    let mut sink = Collector::new();
    read_file(path, &ReadOptions::default(), &mut sink)?;
    Ok(sink)
}

/// The README gives four significant digits.
fn agrees(found: DVec3, stated: [f64; 3]) -> bool {
    let digits = |x: f64, at: f64| (x - at).abs() <= 0.6 * 10f64.powf(at.abs().log10().floor() - 3.0);
    (0..3).all(|i| stated[i] == found[i] || digits(found[i], stated[i]) || (found[i] - stated[i]).abs() < 1e-9)
}

fn check(row: &Row, sink: &Collector) -> Vec<String> {
    let mut wrong = Vec::new();
    let placed = sink.placed().count();
    if placed != row.triangles {
        wrong.push(format!("{}: {placed} triangles, the README says {}", row.file, row.triangles));
    }
    if let Some([min, max]) = row.bounds {
        let b = sink.bounds();
        if !agrees(b.min, min) || !agrees(b.max, max) {
            wrong.push(format!("{}: bounds {b:?}, the README says {min:?} {max:?}", row.file));
        }
    }
    match row.shape {
        Whole if sink.parts.len() != 1 => wrong.push(format!("{}: {} parts", row.file, sink.parts.len())),
        Groups(_, n) if sink.parts.len() != n => {
            wrong.push(format!("{}: {} parts, not {n}", row.file, sink.parts.len()));
        }
        Meshes(meshes, places) => {
            let placed: HashSet<PartKey> = sink.placed().map(|t| t.part).collect();
            let stored = sink.direct().iter().map(|t| t.part).collect::<HashSet<_>>().len()
                + sink.meshes.iter().map(|m| m.local_parts as usize).sum::<usize>();
            if (stored, placed.len()) != (meshes, places) {
                let found = format!("{stored} meshes, placed {} times", placed.len());
                wrong.push(format!("{}: {found}; the README says {meshes}, {places}", row.file));
            }
        }
        _ => {}
    }
    wrong
}

#[test]
fn every_mesh_agrees_with_the_readme() {
    let mut wrong = Vec::new();
    for row in MODELS {
        let Some(path) = crate::common::models::find(row.file) else { continue };
        match read(&path) {
            Ok(sink) => {
                wrong.extend(check(row, &sink));
            }
            Err(error) => wrong.push(format!("{}: {error}", row.file)),
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}
/// What reading a file that is no mesh, or a damaged one, must say (all of these words).
const REFUSED: &[(&str, &[&str])] = &[
    ("hostile/malformed/malformed.obj", &["line 23", "vertex 12", "8"]),
    ("hostile/malformed/out_of_memory.off", &["OFF", "not supported"]),
    ("hostile/malformed/payload_JVN42386607.ply", &["line 12", "no x, y and z"]),
    ("hostile/malformed/all_indices_out_of_range.gltf", &["meshes[0].primitives[0]", "65535", "24"]),
    ("hostile/malformed/AllIndicesOutOfRange.bin", &["not a mesh file"]),
    ("hostile/malformed/recursive_nodes.gltf", &["cycle"]),
    ("architecture/lyon_tileset.json", &["tileset"]),
    ("cad/sportsCar.mtl", &["material library"]),
    ("architecture/conference.mtl", &["material library"]),
    ("nurbs/as1-oc-214.stp", &["STEP"]),
    ("nurbs/mech_part_a.3dm", &["3DM"]),
    ("subdivision/cube_depth.png", &["PNG"]),
    ("README.md", &["not a mesh file"]),
    ("scans", &["directory"]),
];

#[test]
fn what_is_no_mesh_is_refused_by_name() {
    let Some(folder) = crate::common::models::find("README.md").and_then(|p| p.parent().map(Path::to_path_buf)) else {
        return;
    };
    for (name, words) in REFUSED {
        let path = folder.join(name);
        let error = read(&path).expect_err(name).to_string();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
        for word in *words {
            assert!(error.contains(word), "{name}: \"{word}\" is not in: {error}");
        }
    }
}

#[test]
fn numbers_that_are_none_reach_the_sink_which_drops_them() {
    for (name, bad) in [("hostile/malformed/test-nan.obj", 2), ("hostile/malformed/infinites.glb", 12)] {
        let Some(path) = crate::common::models::find(name) else { return };
        let sink = read(&path).expect(name);
        let not_finite = sink.direct().iter().filter(|t| t.positions.iter().any(|p| !p.is_finite())).count();
        assert_eq!(not_finite, bad, "{name}");
    }
}

/// Bytes to parse for each file of which every beginning must be parsed as far as it goes.
const BUDGET: u64 = 24 << 20;

/// Lengths at which to cut a file: every kilobyte where a reader sees at once that something lacks or
/// the file is small enough, else evenly so that about [`BUDGET`] bytes are parsed.
fn cuts(path: &Path, bytes: u64) -> Vec<u64> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let at_once =
        ending == "glb" || path.ends_with("counter.unitsmm.stl") || path.ends_with("thingi_1514499_slivers.stl");
    let step = if at_once { 1024 } else { (bytes * bytes / 2 / BUDGET).max(1024) };
    let mut cuts: Vec<u64> = (1..bytes).step_by(step as usize).collect();
    cuts.reverse();
    cuts
}

#[test]
fn cut_files_are_refused_or_read_but_never_worse() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for row in MODELS.iter().filter(|row| !row.file.starts_with("subdivision/")) {
        let Some(path) = crate::common::models::find(row.file) else { continue };
        let copy = folder.path().join(path.file_name().expect("a name"));
        let bytes = std::fs::copy(&path, &copy).expect("a copy");
        let mut permissions = std::fs::metadata(&copy).expect("metadata").permissions();
        #[allow(clippy::permissions_set_readonly_false)] // a temporary copy of a read-only file
        permissions.set_readonly(false);
        std::fs::set_permissions(&copy, permissions).expect("a writable copy");
        let file = std::fs::File::options().write(true).open(&copy).expect("the copy");
        for len in cuts(&path, bytes) {
            file.set_len(len).expect("a shorter file");
            match read(&copy) {
                // Only OBJ has no end that could be missing. A text STL cut between facets is read with a note.
                Ok(sink) => {
                    let noted = row.file.ends_with(".stl") && sink.notes.iter().any(|n| n.contains("cut short"));
                    assert!(row.file.ends_with(".obj") || noted, "{} was read after {len} of {bytes} bytes", row.file);
                    assert!(sink.received as usize <= row.triangles, "{}, {len} bytes", row.file);
                }
                Err(error) => assert!(error.to_string().starts_with(&copy.display().to_string()), "{error}"),
            }
        }
        std::fs::remove_file(&copy).expect("removed");
    }
}
