//! Limits and safety of builds: files that a mesh file refers to, outputs onto inputs, numbers of triangles and bytes.

use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::Access;
use outcrop::{Error, Result};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;

fn build(input: &Path, out: &Path, options: BuildOptions) -> Result<BuildReport> {
    let options = BuildOptions { threads: 1, temp_dir: out.parent().map(Into::into), ..options };
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new())?;
    builder.add_file(input)?;
    builder.finish(out)
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder");
    let mut names: Vec<_> = entries.map(|e| e.expect("an entry").file_name().into_string().expect("a name")).collect();
    names.sort();
    names
}

fn png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(2, 2).write_to(&mut bytes, image::ImageFormat::Png).expect("a picture");
    bytes.into_inner()
}

/// An OBJ with library and texture, and a glTF with buffer and texture.
fn models() -> TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    let corners: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|x| x.to_le_bytes()).collect();
    let gltf = json!({
        "asset": { "version": "2.0" }, "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 0 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicRoughnessTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }], "images": [{ "uri": "b.png" }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }], "buffers": [{ "byteLength": 36, "uri": "b.bin" }],
    });
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
    for (name, bytes) in [
        ("a.obj", obj.as_bytes()),
        ("a.mtl", b"newmtl m\nmap_Kd a.png\n"),
        ("a.png", &png()),
        ("b.gltf", gltf.to_string().as_bytes()),
        ("b.bin", &corners),
        ("b.png", &png()),
    ] {
        fs::write(dir.path().join(name), bytes).expect("a file");
    }
    dir
}

#[test]
fn no_file_that_a_build_reads_is_replaced_by_its_output() {
    let dir = models();
    let at = |name: &str| dir.path().join(name);
    #[cfg(unix)]
    std::os::unix::fs::symlink("a.png", at("soft.oc")).expect("a link");
    fs::hard_link(at("b.bin"), at("hard.oc")).expect("a link");
    let before = names(dir.path());
    for (input, outputs) in
        [("a.obj", ["a.obj", "a.mtl", "a.png", "soft.oc"]), ("b.gltf", ["b.gltf", "b.bin", "b.png", "hard.oc"])]
    {
        for output in outputs.into_iter().filter(|name| at(name).exists()) {
            let content = fs::read(at(output)).expect("the file");
            let error = build(&at(input), &at(output), BuildOptions::default()).expect_err(output);
            assert!(matches!(&error, Error::BadArgument(why) if why.contains(output)), "{output}: {error}");
            assert_eq!(
                (fs::read(at(output)).expect("the file"), names(dir.path())),
                (content, before.clone()),
                "{output}"
            );
        }
        // A file of the other input is none of this one.
        let other = if input == "a.obj" { "b.png" } else { "a.png" };
        build(&at(input), &at(other), BuildOptions::default()).expect(other);
        fs::write(at(other), png()).expect("a file");
    }
}

fn grid(dir: &Path, side: u32) -> std::path::PathBuf {
    let mut obj = String::new();
    for i in 0..side * side {
        obj += &format!("v {} {} {}\n", i % side, i / side, (i * 7919) % 13);
    }
    for i in (0..side * (side - 1)).filter(|i| (i + 1) % side > 0) {
        let i = i + 1;
        obj += &format!("f {i} {} {} {}\n", i + 1, i + side + 1, i + side);
    }
    fs::write(dir.join("grid.obj"), obj).expect("a file");
    dir.join("grid.obj")
}

#[test]
fn limits_of_triangles_and_bytes_name_themselves() {
    let dir = tempfile::tempdir().expect("a folder");
    let (input, out) = (grid(dir.path(), 220), dir.path().join("m.oc"));
    let with = |max_triangles: u64, max_bytes: u64, memory_budget: u64| {
        let options = BuildOptions { max_triangles, max_bytes, memory_budget, ..Default::default() };
        build(&input, &out, options)
    };
    let triangles = 2 * 219 * 219;
    let report = with(0, 0, 0).expect("no limits");
    assert_eq!(report.triangles_in, triangles);
    fs::remove_file(&out).expect("removed");
    let over = |outcome: Result<BuildReport>, words: &str| {
        let error = outcome.expect_err(words);
        assert!(matches!(error, Error::OverLimit { .. }) && error.to_string().contains(words), "{error}");
        assert_eq!(names(dir.path()), ["grid.obj"]);
    };
    over(
        with(triangles - 1, 0, 0),
        &format!("triangles of the input: more than {}, the limit max_triangles", triangles - 1),
    );
    over(with(1, 0, 0), "max_triangles");
    over(with(0, report.bytes - 1, 0), &format!("more than {}, the limit max_bytes", report.bytes - 1));
    over(with(0, 1, 0), "bytes of the model and its temporary files");
    // In a small budget temporary files count too.
    let tight = with(0, 0, 32 << 20).expect("no limits");
    assert!(tight.bytes_temporary > 10_000, "{tight:?}");
    fs::remove_file(&out).expect("removed");
    over(with(0, tight.bytes_temporary / 2, 32 << 20), "max_bytes");
    let exact = with(triangles, report.bytes, 0).expect("the limits suffice");
    assert_eq!((exact.triangles_in, exact.bytes), (triangles, report.bytes));
}

/// Twelve kilobytes that declare 300,000 triangles: all primitives use the same indices.
#[test]
fn triangles_that_a_small_file_repeats_count() {
    let dir = tempfile::tempdir().expect("a folder");
    let (path, out) = (dir.path().join("a.gltf"), dir.path().join("m.oc"));
    let primitive = json!({ "attributes": { "POSITION": 0 }, "indices": 1 });
    let gltf = json!({
        "asset": { "version": "2.0" }, "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": vec![primitive; 300] }],
        "accessors": [
            { "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 0, "componentType": 5121, "count": 3000, "type": "SCALAR" },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 3000 }],
        "buffers": [{ "byteLength": 3000, "uri": format!("data:;base64,{}", "AAEC".repeat(1000)) }],
    });
    fs::write(&path, gltf.to_string()).expect("a file");
    let error =
        build(&path, &out, BuildOptions { max_triangles: 299_999, ..Default::default() }).expect_err("too many");
    assert!(matches!(error, Error::OverLimit { most: 299_999, limit: "max_triangles", .. }), "{error}");
    let report = build(&path, &out, BuildOptions { max_triangles: 300_000, ..Default::default() }).expect("enough");
    assert_eq!((report.triangles_in, report.degenerate), (300_000, 300_000));
}

/// Many nodes of a small file name one list of instances.
#[test]
fn instances_that_a_small_file_repeats_count() {
    let dir = tempfile::tempdir().expect("a folder");
    let (path, out) = (dir.path().join("a.gltf"), dir.path().join("m.oc"));
    let instanced = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 1 } } });
    let corners: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|x| x.to_le_bytes()).collect();
    let gltf = json!({
        "asset": { "version": "2.0" }, "nodes": vec![json!({ "mesh": 0, "extensions": instanced }); 60],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "componentType": 5126, "count": 2500, "type": "VEC3" },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }], "buffers": [{ "byteLength": 36, "uri": "b.bin" }],
    });
    fs::write(&path, gltf.to_string()).expect("a file");
    fs::write(dir.path().join("b.bin"), corners).expect("a file");
    let options = |memory_budget| BuildOptions { memory_budget, ..Default::default() };
    let error = build(&path, &out, options(32 << 20)).expect_err("too many");
    let Error::OverBudget { what, need, have } = &error else { panic!("{error}") };
    assert!(what.contains("60 parts") && what.contains("150000 instances"), "{what}");
    assert_eq!(*have, 32 << 20);
    let report = build(&path, &out, options(*need)).expect("the budget that the error names");
    assert_eq!((report.instances, report.triangles_in), (150_000, 1));
}

#[test]
fn paths_are_trusted_by_an_option_alone() {
    let dir = models();
    let sub = dir.path().join("sub");
    fs::create_dir(&sub).expect("a folder");
    let text = fs::read_to_string(dir.path().join("b.gltf")).expect("the file");
    fs::write(sub.join("c.gltf"), text.replace("b.bin", "../b.bin")).expect("a file");
    let out = dir.path().join("m.oc");
    let error = build(&sub.join("c.gltf"), &out, BuildOptions::default()).expect_err("outside");
    assert!(matches!(&error, Error::Parse { .. }) && error.to_string().contains("\"../b.bin\" is outside"), "{error}");
    for access in
        [Access { any: true, ..Default::default() }, Access { folders: vec![dir.path().into()], ..Default::default() }]
    {
        let report = build(&sub.join("c.gltf"), &out, BuildOptions { access, ..Default::default() }).expect("trusted");
        assert_eq!(report.triangles_kept, 1);
        // The texture is not in the folder of the file: it is left out.
        assert!(report.notes.iter().any(|note| note.contains("b.png")), "{:?}", report.notes);
    }
}
