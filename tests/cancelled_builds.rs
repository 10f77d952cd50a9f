//! A build returns soon after it is cancelled, at any moment of it: with many parts, many meshes, and large pictures.
//!
//! By hand, OUTCROP_CANCEL_SIZE multiplies the sizes of the models, and the output shows the worst time from the cancel
//! to the return of each build (`cargo test --test files cancelled_builds:: -- --nocapture`).

use outcrop::Error;
use outcrop::base::error::Result;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, Builder};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Number of moments at which each build is cancelled.
const MOMENTS: u32 = 6;

/// A build returns within this time and that of the whole build: a bound on hangs. (Unit tests count what is done after
/// a cancel. Optimised and alone, a build of a million parts returns within some 100 ms.)
const LONGEST: Duration = Duration::from_secs(2);

fn size(of: usize) -> usize {
    let factor = std::env::var("OUTCROP_CANCEL_SIZE").ok().and_then(|text| text.parse().ok());
    (of as f64 * factor.unwrap_or(1.0)) as usize
}

/// Each group has a name, and a triangle.
fn many_groups(folder: &Path) -> PathBuf {
    let mut text = String::from("v 0 0 0\nv 1 0 0\n");
    for i in 0..size(3_000) {
        let _ = writeln!(text, "g a part with the name {i}\nv {} {} {}\nf -1 1 2", i % 1000, i / 1000, i % 7);
    }
    file(folder, "groups.obj", &text)
}

/// A document with these nodes and `meshes` meshes of two triangles each.
fn document(nodes: &str, meshes: usize) -> String {
    let mesh = "{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}";
    let corners: Vec<u8> = (0..18u8).flat_map(|i| f32::from(i * 7 % 5).to_le_bytes()).collect();
    let uri: String = corners.iter().flat_map(|byte| format!("%{byte:02x}").into_bytes()).map(char::from).collect();
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{nodes}],\"meshes\":[{}],\"buffers\":[{{\"byteLength\":72,\"uri\":\
         \"data:,{uri}\"}}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":72}}],\"accessors\":[{{\"bufferView\":0,\
         \"componentType\":5126,\"count\":6,\"type\":\"VEC3\"}}]}}",
        vec![mesh; meshes].join(",")
    )
}

fn node(i: usize, mesh: usize) -> String {
    let (x, turn) = (i % 1000, 0.001 * (i % 700) as f64);
    let (sin, cos) = turn.sin_cos();
    format!(
        "{{\"mesh\":{mesh},\"name\":\"a node {i}\",\"translation\":[{x},{},0],\"rotation\":[0,0,{sin},{cos}]}}",
        i / 1000
    )
}

/// One mesh that many nodes show.
fn many_nodes(folder: &Path) -> PathBuf {
    let nodes: Vec<String> = (0..size(3_000)).map(|i| node(i, 0)).collect();
    file(folder, "nodes.gltf", &document(&nodes.join(","), 1))
}

/// Many meshes, each shown by two nodes.
fn many_meshes(folder: &Path) -> PathBuf {
    let meshes = size(300);
    let nodes: Vec<String> = (0..2 * meshes).map(|i| node(i, i % meshes)).collect();
    file(folder, "meshes.gltf", &document(&nodes.join(","), meshes))
}

/// Pictures of this size, each of a material of its own.
fn pictures(folder: &Path, count: usize, side: u32, ending: &str) -> PathBuf {
    let (mut library, mut text) = (String::new(), String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"));
    let _ = writeln!(text, "mtllib {ending}{count}.mtl");
    for i in 0..count {
        let name = format!("{ending}{count}-{i}.{ending}");
        let pixel = |x: u32, y: u32| image::Rgb([(x * y) as u8, (x ^ y) as u8, (x + i as u32) as u8]);
        image::RgbImage::from_fn(side, side, pixel).save(folder.join(&name)).expect("a picture");
        let _ = writeln!(library, "newmtl {i}\nmap_Kd {name}");
        let _ = writeln!(text, "usemtl {i}\nf 1/1 2/2 3/3");
    }
    file(folder, &format!("{ending}{count}.mtl"), &library);
    file(folder, &format!("{ending}{count}.obj"), &text)
}

/// A bumpy plane of one part.
fn plane(folder: &Path) -> PathBuf {
    let side = (size(8_000) as f64 / 2.0).sqrt() as usize;
    let mut text = String::new();
    for (y, x) in (0..=side).flat_map(|y| (0..=side).map(move |x| (y, x))) {
        let _ = writeln!(text, "v {x} {y} {}", (x as f64 * 12.9898 + y as f64 * 78.233).sin());
    }
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        let at = y * (side + 1) + x + 1;
        let _ = writeln!(text, "f {} {} {} {}", at, at + 1, at + side + 2, at + side + 1);
    }
    file(folder, "plane.obj", &text)
}

fn file(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a file");
    path
}

fn build(input: &Path, memory_budget: u64, cancel: Cancel) -> Result<()> {
    let out = input.with_extension("oc");
    let options = BuildOptions { memory_budget, threads: 2, ..BuildOptions::default() };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), cancel)?;
    builder.add_file(input)?;
    builder.finish(&out).map(drop)
}

/// Cancels a build at many moments.
fn cancel_at_many_moments(input: &Path, memory_budget: u64) {
    let begun = Instant::now();
    build(input, memory_budget, Cancel::new()).expect("a build");
    let (whole, mut worst, mut cancelled) = (begun.elapsed(), (Duration::ZERO, 0), 0);
    for moment in 0..MOMENTS {
        let cancel = Cancel::new();
        let (path, switch) = (input.to_path_buf(), cancel.clone());
        let build = std::thread::spawn(move || build(&path, memory_budget, switch));
        std::thread::sleep(whole * moment / MOMENTS);
        let begun = Instant::now();
        cancel.cancel();
        let outcome = build.join().expect("no panic");
        worst = worst.max((begun.elapsed(), moment));
        assert!(matches!(outcome, Ok(()) | Err(Error::Cancelled)), "{outcome:?}");
        cancelled += usize::from(outcome.is_err());
        if std::env::var("OUTCROP_CANCEL_SIZE").is_ok() {
            println!("    {moment:2}: {:?}", begun.elapsed());
        }
    }
    let name = input.file_name().unwrap_or_default().display();
    println!(
        "{name}, budget {memory_budget}: {whole:?}, at most {:?} after a cancel, at {}/{MOMENTS}",
        worst.0, worst.1
    );
    assert!(cancelled > 0 && worst.0 < LONGEST + whole, "{name}: {cancelled}, {worst:?} of {whole:?}");
}

#[test]
fn a_cancel_is_heard_soon() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let side = size(800).min(8000) as u32;
    let inputs = [
        many_groups(folder),
        many_nodes(folder),
        many_meshes(folder),
        pictures(folder, 1, side, "png"),
        pictures(folder, 1, side, "jpg"),
        pictures(folder, size(10).min(200), 256, "png"),
        plane(folder),
    ];
    let wanted = std::env::var("OUTCROP_CANCEL_ONLY").unwrap_or_default();
    for input in inputs.iter().filter(|input| input.to_string_lossy().contains(&wanted)) {
        cancel_at_many_moments(input, 0);
    }
    // In chunks.
    cancel_at_many_moments(&plane(folder), 32 << 20);
}
