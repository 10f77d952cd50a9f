//! The memory that a build takes: its budget, and not more the larger the model is.

#[path = "common/counting.rs"]
mod counting;

use glam::DVec3;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{Attributes, MeshKey, PartDesc, Sink};
use outcrop::{Error, Result};
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// Builds a generated model; the most bytes held meanwhile.
fn build(name: &str, triangles: u64, memory_budget: u64) -> (usize, BuildReport) {
    let folder = tempfile::tempdir().unwrap();
    let options =
        BuildOptions { memory_budget, threads: 2, temp_dir: Some(folder.path().into()), ..Default::default() };
    let (report, most) = counting::most(|| {
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
        generate(name, &GenerateOptions { triangles, seed: 0, ..Default::default() }, &Cancel::new(), &mut builder)
            .unwrap();
        builder.finish(&folder.path().join("model.oc")).unwrap()
    });
    let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
    println!(
        "{triangles} of {name}: {:.1} MiB of {:.1}, {} chunks",
        mib(most),
        mib(memory_budget as usize),
        report.chunks
    );
    (most, report)
}

/// Builds a mesh file; the most bytes held meanwhile.
fn build_file(input: &Path, memory_budget: u64) -> (u64, Result<BuildReport>) {
    let folder = tempfile::tempdir().unwrap();
    let options =
        BuildOptions { memory_budget, threads: 2, temp_dir: Some(folder.path().into()), ..Default::default() };
    let (outcome, most) = counting::most(|| {
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
        builder.add_file(input).and_then(|()| builder.finish(&folder.path().join("model.oc")))
    });
    let most = most as u64;
    println!("{}: {:.1} MiB of {:.1}", input.display(), most as f64 / f64::from(1 << 20), memory_budget >> 20);
    (most, outcome)
}

/// Bytes that names, parts and one texture may take besides the budget, as oc_build_desc says.
const BESIDE: u64 = 64 << 20;

const LEAST: u64 = 32 << 20;

/// Names and parts: an error that names the budget that suffices, in the memory that was allowed; with it a model.
fn many_parts(folder: &Path) {
    const PARTS: usize = 100_000;
    let mut obj = String::from("v 0 0 0\nv 1 0 0\n");
    (0..PARTS).for_each(|i| {
        obj += &format!("g part with a name of its own {i}\nv {} {} {}\nf -1 -2 -3\n", i / 400, i % 400, i % 3);
    });
    let nodes: Vec<String> = (0..PARTS / 2).map(|i| format!("{{\"mesh\":0,\"name\":\"node {i}\"}}")).collect();
    let gltf = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}],\"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}}}}]}}],\
         \"accessors\":[{{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}}]}}",
        nodes.join(",")
    );
    for (name, text) in [("a.obj", obj), ("a.gltf", gltf)] {
        let path = folder.join(name);
        fs::write(&path, text).unwrap();
        let (mut budget, mut tries) = (LEAST, 0);
        loop {
            let (most, outcome) = build_file(&path, budget);
            assert!(most <= budget + BESIDE, "{name}: {most} of {budget} bytes");
            match outcome {
                Ok(report) => {
                    assert!(report.parts as usize >= PARTS / 2);
                    break;
                }
                Err(Error::OverBudget { need, have, what }) => {
                    assert!(have == budget && need > budget && tries < 3, "{what}: {need} of {have}");
                    assert!(what.contains(name) || what.contains("parts"), "{what}");
                    (budget, tries) = (need, tries + 1);
                }
                Err(other) => panic!("{other}"),
            }
        }
        assert!(tries > 0);
    }
}

/// A PNG is decoded in rows; a JPEG that does not fit is left out with a note.
fn large_textures(folder: &Path) {
    let picture = image::RgbImage::from_fn(4000, 4000, |x, y| image::Rgb([x as u8, y as u8, (x / 100) as u8]));
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
    for (ending, notes) in [("png", 0), ("jpg", 1)] {
        let file = format!("a.{ending}");
        picture.save(folder.join(&file)).unwrap();
        fs::write(folder.join("a.mtl"), format!("newmtl m\nmap_Kd {file}\n")).unwrap();
        fs::write(folder.join("a.obj"), obj).unwrap();
        let (most, report) = build_file(&folder.join("a.obj"), LEAST);
        let report = report.unwrap();
        assert!(most <= LEAST + BESIDE, "{file}: {most} bytes");
        assert_eq!(report.notes.len(), notes, "{:?}", report.notes);
        assert!(report.notes.iter().all(|note| note.contains("takes 48000000 bytes to decode")), "{:?}", report.notes);
        let (_, report) = build_file(&folder.join("a.obj"), 0);
        assert!(report.unwrap().notes.is_empty());
    }
}

/// Many triangles at one vertex: no chunk takes those of all others for its normals.
fn fan(budget: u64) {
    const TRIANGLES: u32 = 120_000;
    let folder = tempfile::tempdir().unwrap();
    let options = BuildOptions {
        memory_budget: budget,
        threads: 2,
        temp_dir: Some(folder.path().into()),
        crease_angle: 40.0,
        ..Default::default()
    };
    let (report, most) = counting::most(|| {
        let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).unwrap();
        let part = builder.part(PartDesc::default()).unwrap();
        let rim = |i: u32| {
            let angle = f64::from(i) / f64::from(TRIANGLES) * std::f64::consts::TAU;
            DVec3::new(angle.cos(), angle.sin(), 0.1 * (7.0 * angle).sin())
        };
        let triangles: Vec<_> = (0..TRIANGLES).map(|i| [DVec3::Z, rim(i), rim(i + 1)]).collect();
        for some in triangles.chunks(4096) {
            builder.triangles(MeshKey::DIRECT, part, some, Attributes::NONE).unwrap();
        }
        drop(triangles);
        builder.finish(&folder.path().join("model.oc")).unwrap()
    });
    println!("a fan of {TRIANGLES}: {most} of {budget} bytes, {} chunks", report.chunks);
    assert!(report.chunks > 2 && most as u64 <= budget, "{most} of {budget} bytes");
}

/// One test: the count is the process's.
#[test]
fn a_build_keeps_to_its_budget() {
    let folder = tempfile::tempdir().unwrap();
    many_parts(folder.path());
    large_textures(folder.path());
    fan(LEAST);
    for (name, triangles) in [("mandelbulb", 1_000_000), ("airliner", 600_000)] {
        for budget in [32 << 20, 64 << 20] {
            let (most, report) = build(name, triangles, budget);
            assert!(report.chunks > 2, "{report:?}");
            assert!(most as u64 <= budget, "{name}: {most} of {budget} bytes");
        }
    }
}
