//! glTF files from their bytes to the built model: what is in it, where it stands, and what the build notes.

use crate::common::built;
use glam::DVec3;
use outcrop::build::{BuildOptions, BuildReport};
use outcrop::import::{ReadOptions, read_file};
use outcrop::math::DBounds;
use outcrop::scene::Model;
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// A glTF document and its binary chunk.
struct Document {
    json: Value,
    bin: Vec<u8>,
}

impl Document {
    /// Creates a document in which node 0 shows mesh 0, with the positions of accessor 0.
    fn of(positions: &[[f32; 3]]) -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "nodes": [{ "mesh": 0 }], "scenes": [{ "nodes": [0] }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }], "accessors": [], "bufferViews": []
        });
        let mut document = Self { json, bin: Vec::new() };
        document.accessor(5126, "VEC3", positions.len(), bytemuck::cast_slice(positions));
        document
    }

    fn accessor(&mut self, component: u32, ty: &str, count: usize, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let list = |json: &mut Value, name: &str, value: Value| {
            let list = json[name].as_array_mut().unwrap();
            list.push(value);
            list.len() - 1
        };
        let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        let view = list(&mut self.json, "bufferViews", view);
        self.bin.extend(bytes);
        let accessor = json!({ "bufferView": view, "componentType": component, "type": ty, "count": count });
        list(&mut self.json, "accessors", accessor)
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let (mut text, mut bin) = (json.to_string().into_bytes(), self.bin.clone());
        text.resize(text.len().next_multiple_of(4), b' ');
        bin.resize(bin.len().next_multiple_of(4), 0);
        let word = |n: usize| (n as u32).to_le_bytes();
        let head = [b"glTF", &word(2)[..], &word(28 + text.len() + bin.len())].concat();
        [&head[..], &word(text.len()), b"JSON", &text, &word(bin.len()), b"BIN\0", &bin].concat()
    }

    fn build(&self, memory_budget: u64) -> (Model, BuildReport) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.glb");
        std::fs::write(&path, self.glb()).unwrap();
        let options = BuildOptions { threads: 2, memory_budget, ..built::options() };
        let read = ReadOptions::default();
        let (built, report) = built::build_with(options, |builder| read_file(&path, &read, builder).unwrap());
        (Model::open(&built::context(1), &built.path).unwrap(), report)
    }
}

/// Returns the triangles along the border of a disc of radius 1 around zero, in the plane z = 0.
fn disc(count: u32) -> Vec<[f32; 3]> {
    let at = |i: u32| {
        let (y, x) = (TAU * f64::from(i) / f64::from(count)).sin_cos();
        [x as f32, y as f32, 0.0]
    };
    (0..count).flat_map(|i| [at(i).map(|x| 0.9 * x), at(i), at((i + 1) % count)]).collect()
}

fn close(found: DBounds, min: [f64; 3], max: [f64; 3]) {
    let is_close = |a: DVec3, b: [f64; 3]| (a - DVec3::from(b)).abs().max_element() < 1e-5;
    assert!(is_close(found.min, min) && is_close(found.max, max), "{found:?} instead of {min:?}, {max:?}");
}

/// A disc has the same extents however it is turned in its plane, in a mesh that is built at once or in chunks.
#[test]
fn turned_meshes_have_tight_bounds() {
    let turn = |degrees: f64| {
        let (sin, cos) = (degrees.to_radians() * 0.5).sin_cos();
        json!([0, 0, sin, cos])
    };
    for (count, budget) in [(720, 0), (70_000, 32 << 20)] {
        let mut document = Document::of(&disc(count));
        document.json["nodes"] = json!([
            { "mesh": 0, "rotation": turn(45.0) },
            { "mesh": 0, "rotation": turn(45.0), "translation": [5, 0, 0] },
            { "rotation": turn(45.0), "children": [3] },
            { "mesh": 0, "rotation": turn(-15.0), "translation": [0, 0, 9], "scale": [2, 2, 2] },
        ]);
        document.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
        let (model, report) = document.build(budget);
        assert_eq!((report.instances, report.chunks > 1), (3, budget > 0));
        let parts: Vec<_> = model.parts().iter().filter(|part| part.triangles > 0).map(|part| part.bounds).collect();
        close(parts[0], [-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]);
        close(parts[1], [4.0, -1.0, 0.0], [6.0, 1.0, 0.0]);
        close(parts[2], [-2.0, -2.0, 9.0], [2.0, 2.0, 9.0]);
        close(model.info().bounds, [-2.0, -2.0, 0.0], [6.0, 2.0, 9.0]);
    }
}

/// Beyond the limit of the work, bounds are those of turned boxes: larger, never smaller.
#[test]
fn many_turned_meshes_have_bounds_that_contain_them() {
    let mut document = Document::of(&disc(72));
    let node = |i: i32| {
        let (sin, cos) = (0.01 * f64::from(i)).sin_cos();
        json!({ "mesh": 0, "rotation": [0, 0, sin, cos] })
    };
    document.json["scenes"][0]["nodes"] = json!((0..50).collect::<Vec<_>>());
    document.json["nodes"] = json!((0..50).map(node).collect::<Vec<_>>());
    let bounds = document.build(0).0.info().bounds;
    assert!(bounds.min.x <= -1.0 && bounds.max.y >= 1.0 && bounds.extent().max_element() < 2.83, "{bounds:?}");
}

/// One file with much that is unusual, and valid: each mesh stands where the format says.
#[test]
fn a_valid_file_is_built_as_the_format_says() {
    let mut document = Document::of(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let raised = document.accessor(5126, "VEC3", 3, bytemuck::cast_slice(&[[0.0f32, 0.0, 4.0]; 3]));
    let joints = document.accessor(5121, "VEC4", 3, &[0; 12]);
    let weights = document.accessor(5126, "VEC4", 3, bytemuck::cast_slice(&[[1.0f32, 0.0, 0.0, 0.0]; 3]));
    let moves = document.accessor(5126, "VEC3", 2, bytemuck::cast_slice(&[[20.0f32, 0.0, 0.0], [30.0, 0.0, 0.0]]));
    document.json["accessors"][0]["count"] = json!(3.0);
    document.json["meshes"] = json!([
        { "primitives": [{ "attributes": { "POSITION": 0 } }, { "attributes": {} }] },
        { "primitives": [{ "attributes": { "POSITION": 0 }, "targets": [{ "POSITION": raised }] }], "weights": [0.5] },
        { "primitives": [{ "attributes": { "POSITION": 0, "JOINTS_0": joints, "WEIGHTS_0": weights } }] },
    ]);
    document.json["nodes"] = json!([
        { "mesh": 0, "name": "instances",
            "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": moves } } } },
        { "mesh": 1, "name": "morphed" },
        { "mesh": 2, "name": "skinned", "skin": 0, "translation": [999, 999, 999] },
        { "translation": [0, 10, 0], "name": "joint" },
        { "mesh": 0, "name": "flat", "matrix": [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1] },
    ]);
    document.json["skins"] = json!([{ "joints": [3] }, { "joints": [99] }]);
    document.json["scenes"] = json!([{ "nodes": [0, 1, 2, 3, 4] }, {}]);
    document.json["animations"] =
        json!([{ "channels": [{ "sampler": 0, "target": { "path": "pointer" } }], "samplers": [] }]);
    document.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing", "KHR_animation_pointer"]);
    let (model, report) = document.build(0);
    let bounds = |name: &str| {
        let of = |index: usize| model.parts().get(index).unwrap().bounds;
        let index = model.parts().iter().position(|part| part.name == name).unwrap();
        let below =
            (0..model.parts().len()).filter(|&i| model.parts().get(i).unwrap().parent == Some(index as u32)).map(of);
        below.fold(of(index), DBounds::union)
    };
    close(bounds("instances"), [20.0, 0.0, 0.0], [31.0, 1.0, 0.0]);
    close(bounds("morphed"), [0.0, 0.0, 2.0], [1.0, 1.0, 2.0]);
    close(bounds("skinned"), [0.0, 10.0, 0.0], [1.0, 11.0, 0.0]);
    assert!(bounds("flat").is_empty());
    assert_eq!((report.instances, report.triangles_in, report.degenerate), (2, 4, 1));
    for words in ["no positions", "skinned meshes stand", "flattened", "1 animations were ignored"] {
        assert!(report.notes.iter().any(|note| note.contains(words)), "{words}: {:?}", report.notes);
    }
}
