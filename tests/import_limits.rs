//! Limits of the readers: memory by the size of the file, whatever it claims; cancel; failing sinks.

mod common;
mod models;
#[path = "common/thread_memory.rs"]
mod thread_memory;

use glam::{DAffine3, DVec3};
use models::MODELS;
use outcrop::base::progress::Cancel;
use outcrop::import::{
    Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, ReadOptions, Sink, UpAxis, read_file,
};
use outcrop::{Error, Result};
use std::path::Path;

/// Counts triangles; may cancel or fail when the first ones come.
#[derive(Default)]
struct Counter {
    triangles: u64,
    parts: u32,
    materials: u32,
    meshes: u32,
    instances: u64,
    cancel: Cancel,
    cancel_at_once: bool,
    cancel_at_part: bool,
    fail_at_once: bool,
}

impl Sink for Counter {
    fn units(&mut self, _: Option<f64>, _: UpAxis) {}
    fn material(&mut self, _: MaterialDesc) -> Result<MaterialKey> {
        self.materials += 1;
        Ok(self.materials - 1)
    }
    fn part(&mut self, _: PartDesc) -> Result<PartKey> {
        self.parts += 1;
        if self.cancel_at_part {
            self.cancel.cancel();
        }
        Ok(self.parts - 1)
    }
    fn shared_mesh(&mut self, _: u32) -> Result<MeshKey> {
        self.meshes += 1;
        Ok(MeshKey(self.meshes))
    }
    fn triangles(&mut self, _: MeshKey, _: u32, positions: &[[DVec3; 3]], _: Attributes<'_>) -> Result<()> {
        self.triangles += positions.len() as u64;
        if self.cancel_at_once {
            self.cancel.cancel();
        }
        if self.fail_at_once { Err(Error::BadState("the sink is full".into())) } else { Ok(()) }
    }
    fn instance(&mut self, _: MeshKey, _: DAffine3, _: PartKey) -> Result<()> {
        self.instances += 1;
        if self.cancel_at_once {
            self.cancel.cancel();
        }
        Ok(())
    }
    fn at(&mut self, bytes: u64, total: u64) {
        assert!(bytes <= total, "{bytes} of {total} bytes");
    }
    fn note(&mut self, _: String) {}
    fn cancel(&self) -> &Cancel {
        &self.cancel
    }
}

fn read(path: &Path, sink: &mut Counter) -> Result<()> {
    read_file(path, &ReadOptions::default(), sink)
}

/// Window, batch and tables of a reader, whatever the file.
const FIXED: u64 = 1 << 20;

#[test]
fn memory_is_a_small_multiple_of_the_file() {
    for row in MODELS {
        // A decoded picture is bounded by its own limit.
        if row.file.ends_with("fern_02.glb") {
            continue;
        }
        let Some(path) = common::models::find(row.file) else { continue };
        let bytes = std::fs::metadata(&path).expect("metadata").len();
        let (outcome, most) = thread_memory::peak(|| read(&path, &mut Counter::default()));
        outcome.expect(row.file);
        println!("{}: {bytes} bytes, {most} held", row.file);
        assert!(most < FIXED + bytes, "{}: {most} bytes for a file of {bytes}", row.file);
    }
}

#[test]
fn claims_take_no_memory() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let ply = |coding: &str, list: &str, body: &[u8]| {
        let header = format!(
            "ply\nformat {coding} 1.0\nelement vertex 1000000000000\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1000000000000\nproperty list {list} vertex_indices\nend_header\n"
        );
        [header.as_bytes(), body].concat()
    };
    let faces = |coding: &str, body: &[u8]| {
        let header = format!(
            "ply\nformat {coding} 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uint int vertex_indices\nend_header\n"
        );
        [header.as_bytes(), body].concat()
    };
    let stl = [&[b' '; 80][..], &u32::MAX.to_le_bytes(), &[0; 50]].concat();
    let soup = [b"OCSOUP\r\n\x01\0\0\0\0\0\0\0".as_slice(), &(1u64 << 58).to_le_bytes(), &[0; 8 + 36]].concat();
    let gltf = |accessor: &str, view: &str, buffer: &str| {
        format!(
            "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{{\"mesh\":0}}],\"meshes\":[{{\"primitives\":[{{\"attributes\":\
             {{\"POSITION\":0}}}}]}}],\"accessors\":[{{\"componentType\":5126,\"type\":\"VEC3\",{accessor}}}],\
             \"bufferViews\":[{{\"buffer\":0,{view}}}],\"buffers\":[{{{buffer},\"uri\":\"data:;base64,AAAA\"}}]}}"
        )
        .into_bytes()
    };
    let huge = "\"byteLength\":1000000000000";
    let glb =
        [b"glTF\x02\0\0\0".as_slice(), &u32::MAX.to_le_bytes(), &(u32::MAX - 64).to_le_bytes(), b"JSON{}"].concat();
    let files = [
        ("a.ply", ply("ascii", "uchar int", b"0 0 0\n")),
        ("b.ply", ply("binary_little_endian", "uchar int", &[0; 24])),
        ("c.ply", ply("binary_big_endian", "uint int", &[0; 24])),
        ("d.ply", faces("ascii", b"0 0 0\n4000000000 0 0\n")),
        ("e.ply", faces("binary_little_endian", &[[0; 12].as_slice(), &u32::MAX.to_le_bytes(), &[0; 8]].concat())),
        ("a.stl", stl),
        ("a.soup", soup),
        ("a.glb", glb),
        ("a.gltf", gltf("\"bufferView\":0,\"count\":1000000000000", huge, huge)),
        ("b.gltf", gltf("\"bufferView\":0,\"count\":1000000000000", huge, "\"byteLength\":3")),
        ("c.gltf", gltf("\"count\":1000000000000", huge, "\"byteLength\":3")),
        ("a.obj", b"v 0 0 0\nf 1 -1 4000000000\n".to_vec()),
    ];
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).expect("a file");
        let (outcome, most) = thread_memory::peak(|| read(&path, &mut Counter::default()));
        let error = outcome.expect_err(name);
        assert!(matches!(error, Error::Parse { .. }), "{name}: {error}");
        assert!(most < FIXED, "{name}: {most} bytes held for: {error}");
    }
}

/// Returns a file with `nodes` nodes that name one accessor of `count` translations of instances.
fn instances(nodes: usize, count: usize) -> Vec<u8> {
    let node = "{\"mesh\":0,\"extensions\":{\"EXT_mesh_gpu_instancing\":{\"attributes\":{\"TRANSLATION\":1}}}}";
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat();
    let bytes = [corners, vec![0; 12 * count]].concat();
    let accessor =
        |view, n| format!("{{\"bufferView\":{view},\"componentType\":5126,\"type\":\"VEC3\",\"count\":{n}}}");
    let view = |at, len| format!("{{\"buffer\":0,\"byteOffset\":{at},\"byteLength\":{len}}}");
    let mut json = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}],\"meshes\":[{{\"primitives\":[{{\"attributes\":\
         {{\"POSITION\":0}}}}]}}],\"accessors\":[{},{}],\"bufferViews\":[{},{}],\"buffers\":[{{\"byteLength\":{}}}]}}",
        vec![node; nodes].join(","),
        accessor(0, 3),
        accessor(1, count),
        view(0, 36),
        view(36, 12 * count),
        bytes.len()
    );
    json += &" ".repeat(json.len().next_multiple_of(4) - json.len());
    let word = |n: usize| (n as u32).to_le_bytes();
    let head = [b"glTF", &word(2)[..], &word(28 + json.len() + bytes.len())].concat();
    [&head[..], &word(json.len()), b"JSON", json.as_bytes(), &word(bytes.len()), b"BIN\0", &bytes].concat()
}

/// A file of 250 KB can have more instances than memory has bytes, because its nodes may name one list of them. Its
/// reader kept a transform for each.
#[test]
fn instances_that_nodes_repeat_take_no_memory() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.glb");
    let file = instances(50, 20_000);
    std::fs::write(&path, &file).expect("a file");
    let mut sink = Counter::default();
    let (outcome, most) = thread_memory::peak(|| read(&path, &mut sink));
    outcome.expect("it is valid");
    assert_eq!((sink.instances, sink.meshes, sink.triangles), (1_000_000, 1, 1));
    println!("{} bytes, {most} held", file.len());
    assert!(most < FIXED + 2 * file.len() as u64, "{most} bytes for a file of {}", file.len());
    // A cancel is heard at the next instance.
    let mut sink = Counter { cancel_at_once: true, ..Counter::default() };
    assert!(matches!(read(&path, &mut sink), Err(Error::Cancelled)));
    assert!(sink.instances <= 1, "{} instances after the cancel", sink.instances);
}

/// One file of each format with more triangles than a batch.
const LARGE: [&str; 8] = [
    "scans/bun_zipper.ply",
    "scans/asian_dragon_100k.ply",
    "scans/armadillo.ply",
    "scans/happy_buddha_100k.obj",
    "cad/tray_bottom.stl",
    "cad/counter.unitsmm.stl",
    "cad/2CylinderEngine.glb",
    "cad/nist_ctc_02.glb",
];

#[test]
fn cancel_is_heard_within_a_batch() {
    for name in LARGE {
        let Some(path) = common::models::find(name) else { continue };
        let mut sink = Counter { cancel_at_once: true, ..Counter::default() };
        let outcome = read(&path, &mut sink);
        assert!(matches!(outcome, Err(Error::Cancelled)), "{name}");
        assert!(sink.triangles <= 4096, "{name}: {} triangles after the cancel", sink.triangles);
        // Before anything was read.
        let mut sink = Counter::default();
        sink.cancel.cancel();
        assert!(matches!(read(&path, &mut sink), Err(Error::Cancelled)), "{name}");
        assert_eq!(sink.triangles, 0, "{name}");
    }
}

/// Files of many parts: no more than one, and those that hang below it, come after a cancel.
#[test]
fn cancel_is_heard_between_parts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let groups: String = (0..5000).map(|i| format!("g {i}\nf 1 2 3\n")).collect();
    let nodes: Vec<String> = (0..5000).map(|_| "{\"mesh\":0}".into()).collect();
    let gltf = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}],\"meshes\":[{{\"primitives\":[]}}]}}",
        nodes.join(",")
    );
    for (name, text) in [("a.obj", format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{groups}")), ("a.gltf", gltf)] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        let mut all = Counter::default();
        read(&path, &mut all).expect(name);
        assert_eq!(all.parts, 5000, "{name}");
        let mut sink = Counter { cancel_at_part: true, ..Counter::default() };
        assert!(matches!(read(&path, &mut sink), Err(Error::Cancelled)), "{name}");
        assert!(sink.parts <= 2, "{name}: {} parts after the cancel", sink.parts);
    }
}

#[test]
fn an_error_of_the_sink_ends_the_reading() {
    for name in LARGE {
        let Some(path) = common::models::find(name) else { continue };
        let mut sink = Counter { fail_at_once: true, ..Counter::default() };
        let outcome = read(&path, &mut sink);
        assert!(matches!(outcome, Err(Error::BadState(_))), "{name}");
        assert!(sink.triangles <= 4096, "{name}");
    }
}
