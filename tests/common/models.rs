//! The models folder, and readers just good enough for the four files that the oracle uses.
//!
//! `OUTCROP_MODELS` names the folder, else it is `../shared/models` beside the checkout. Without it tests fall
//! back or skip, loudly; under CI (`CI` is set) that is a failure unless `OUTCROP_ALLOW_MISSING_MODELS` is set.

use super::brute::Tri;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// The folder of the workspace: `tests/bench` is a package below it.
pub fn checkout() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().find(|folder| folder.join("Cargo.lock").is_file()).unwrap_or(package)
}

/// The models folder, if it is there.
pub fn folder() -> Option<PathBuf> {
    let path = match std::env::var_os("OUTCROP_MODELS") {
        Some(p) => PathBuf::from(p),
        None => checkout().join("../shared/models"),
    };
    path.is_dir().then_some(path)
}

/// The path of a model, or `None` after saying `skipped:` (a failure under CI).
pub fn find(name: &str) -> Option<PathBuf> {
    let path = folder().map(|f| f.join(name)).filter(|p| p.is_file());
    if path.is_none() {
        println!("skipped: {name} (no models folder; set OUTCROP_MODELS)");
        eprintln!("skipped: {name} (no models folder; set OUTCROP_MODELS)");
        let allowed = std::env::var_os("CI").is_none() || std::env::var_os("OUTCROP_ALLOW_MISSING_MODELS").is_some();
        assert!(allowed, "{name} is missing; set OUTCROP_ALLOW_MISSING_MODELS to allow that");
    }
    path
}

/// The triangles of an ASCII PLY of triangles, a binary STL or an OBJ; panics on anything else.
pub fn read(path: &Path) -> Vec<Tri> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => ply(&String::from_utf8_lossy(&bytes)),
        Some("stl") => stl(&bytes),
        Some("obj") => obj(&String::from_utf8_lossy(&bytes)),
        _ => panic!("{}: no reader", path.display()),
    }
}

fn numbers(line: &str) -> Vec<f64> {
    // Through f32, as the scanners wrote them.
    line.split_whitespace().filter_map(|w| w.parse::<f32>().ok()).map(f64::from).collect()
}

fn ply(text: &str) -> Vec<Tri> {
    let mut lines = text.lines().map(str::trim);
    let count = |line: &str| line.rsplit(' ').next().and_then(|n| n.parse::<usize>().ok());
    let (mut vertices, mut faces) = (0, 0);
    for line in lines.by_ref().take_while(|l| *l != "end_header") {
        if line.starts_with("element vertex") {
            vertices = count(line).expect("vertex count");
        } else if line.starts_with("element face") {
            faces = count(line).expect("face count");
        }
    }
    let points: Vec<DVec3> = lines.by_ref().take(vertices).map(numbers).map(|n| DVec3::new(n[0], n[1], n[2])).collect();
    lines
        .take(faces)
        .map(|l| {
            let n: Vec<usize> = l.split_whitespace().filter_map(|w| w.parse().ok()).collect();
            assert_eq!(n[0], 3, "triangles only");
            [points[n[1]], points[n[2]], points[n[3]]]
        })
        .collect()
}

fn stl(bytes: &[u8]) -> Vec<Tri> {
    let number = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().expect("4 bytes")));
    let corner = |at: usize| DVec3::new(number(at), number(at + 4), number(at + 8));
    let count = u32::from_le_bytes(bytes[80..84].try_into().expect("4 bytes")) as usize;
    assert_eq!(bytes.len(), 84 + 50 * count, "a binary STL");
    (0..count).map(|i| 84 + 50 * i + 12).map(|at| [corner(at), corner(at + 12), corner(at + 24)]).collect()
}

fn obj(text: &str) -> Vec<Tri> {
    let (mut points, mut tris) = (Vec::new(), Vec::new());
    for line in text.lines().map(str::trim) {
        if let Some(rest) = line.strip_prefix("v ") {
            let n = numbers(rest);
            points.push(DVec3::new(n[0], n[1], n[2]));
        } else if let Some(rest) = line.strip_prefix("f ") {
            let index = |w: &str| -> usize {
                let i: i64 = w.split('/').next().and_then(|n| n.parse().ok()).expect("an index");
                if i < 0 { (points.len() as i64 + i) as usize } else { i as usize - 1 }
            };
            let face: Vec<usize> = rest.split_whitespace().map(index).collect();
            tris.extend((2..face.len()).map(|k| [points[face[0]], points[face[k - 1]], points[face[k]]]));
        }
    }
    tris
}
