mod content;
mod instancing;
mod lenient;
mod textures;

use crate::import::collect::Collector;
use crate::import::testing::{read_bytes, read_files, refused, refuses_every_truncation, survives_damage};
use crate::import::{MeshKey, UpAxis};
use base64::Engine as _;
use glam::DVec3;
use proptest::prelude::*;
use serde_json::{Value, json};
use textures::{png, textured};

/// A document under construction, with one buffer.
struct Document {
    json: Value,
    bin: Vec<u8>,
}

impl Document {
    /// Creates a document that only has a scene with the given roots.
    fn new(nodes: Value, roots: Value) -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "scenes": [{ "nodes": roots }], "nodes": nodes,
            "meshes": [], "accessors": [], "bufferViews": [], "buffers": [], "materials": []
        });
        Self { json, bin: Vec::new() }
    }

    /// Creates a node with a mesh of one triangle, (0,0,0) (1,0,0) (0,1,0).
    fn triangle() -> Self {
        let mut document = Self::new(json!([{ "mesh": 0 }]), json!([0]));
        let positions = document.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        document.mesh(json!([{ "attributes": { "POSITION": positions } }]));
        document
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    /// Sets a value by its path from the root, for example `nodes/0/name`. Lists become longer if necessary.
    fn set(&mut self, path: &str, value: Value) {
        let mut at = &mut self.json;
        for key in path.split('/') {
            at = match key.parse::<usize>() {
                Ok(index) => {
                    let list = at.as_array_mut().expect("a list");
                    list.resize(list.len().max(index + 1), Value::Null);
                    &mut list[index]
                }
                Err(_) => &mut at[key],
            };
        }
        *at = value;
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }))
    }

    fn accessor(&mut self, component: u32, ty: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({ "bufferView": view, "componentType": component, "type": ty, "count": count }))
    }

    fn floats(&mut self, ty: &str, numbers: &[f32]) -> usize {
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let width = if ty == "VEC2" { 2 } else { 3 };
        self.accessor(5126, ty, numbers.len() / width, &bytes)
    }

    fn mesh(&mut self, primitives: Value) -> usize {
        self.push("meshes", json!({ "primitives": primitives }))
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let length = 12 + 8 + text.len() + 8 + bin.len();
        let word = |n: usize| (n as u32).to_le_bytes();
        [b"glTF", &word(2)[..], &word(length), &word(text.len()), b"JSON", &text, &word(bin.len()), b"BIN\0", &bin]
            .concat()
    }

    fn gltf(&self, uri: &str) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bin.len(), "uri": uri }]);
        json.to_string().into_bytes()
    }

    fn read(&self) -> Collector {
        read_bytes("t.glb", self.glb()).unwrap()
    }
}

fn data_uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

fn positions(sink: &Collector) -> Vec<[DVec3; 3]> {
    sink.direct().iter().map(|t| t.positions).collect()
}
const TRIANGLE: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

#[test]
fn buffers_are_found_in_every_place() {
    let document = Document::triangle();
    assert_eq!(positions(&document.read()), [TRIANGLE]);
    let inside = document.gltf(&data_uri(&document.bin));
    assert_eq!(positions(&read_bytes("t.gltf", &inside).unwrap()), [TRIANGLE]);
    // The content is decisive, not the file extension, also after a byte order mark and white space.
    let marked = [b"\xef\xbb\xbf \n".as_slice(), &inside].concat();
    assert_eq!(positions(&read_bytes("t.txt", marked).unwrap()), [TRIANGLE]);
    let files = [("t.gltf", document.gltf("my%20data.bin")), ("my data.bin", document.bin.clone())];
    let beside = read_files(&files.each_ref().map(|(n, b)| (*n, &b[..]))).unwrap();
    assert_eq!(positions(&beside), [TRIANGLE]);
    assert_eq!((beside.up, beside.metres_per_unit), (UpAxis::Y, Some(1.0)));
}

#[test]
fn buffers_that_are_not_there_are_named() {
    let document = Document::triangle();
    for (uri, words) in [
        ("missing.bin", "missing.bin"),
        ("https://example.org/a.bin", "not a path relative to the document"),
        ("/etc/passwd", "not a path relative to the document"),
        ("C:\\a.bin", "not a path relative to the document"),
        ("data:;base64,AA!A", "invalid data URI"),
        ("data:;base64,AAAA", "only 3 of the 36 bytes"),
        ("data:nothing", "without a comma"),
        ("", "not a path relative to the document"),
        (".", "directory"),
    ] {
        let error = refused("t.gltf", document.gltf(uri));
        assert!(error.contains(words), "{uri}: {error}");
    }
    let mut without = document.gltf("x");
    without = String::from_utf8(without).unwrap().replace(",\"uri\":\"x\"", "").into_bytes();
    assert!(refused("t.gltf", without).contains("no binary chunk"));
}

#[test]
fn transforms_are_composed_in_double_precision() {
    let mut document = Document::triangle();
    document.json["nodes"] = json!([
        { "translation": [6378137.0625, 0, 0], "children": [1], "name": "earth" },
        { "rotation": [0, 0, 0.5, 0.5], "scale": [2, 2, 2], "children": [2, 3] },
        { "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.001, 0, 0, 1], "mesh": 0 },
        { "camera": 0 }
    ]);
    let sink = document.read();
    let [a, b, c] = sink.direct()[0].positions;
    let expected = [DVec3::new(0.0, 0.002, 0.0), DVec3::new(0.0, 2.002, 0.0), DVec3::new(-2.0, 0.002, 0.0)];
    for (found, expected) in [a, b, c].into_iter().zip(expected) {
        assert!(found.distance(expected + DVec3::X * 6_378_137.062_5) < 1e-9, "{found}");
    }
    let parts: Vec<_> = sink.parts.iter().map(|p| (p.name.as_str(), p.parent)).collect();
    assert_eq!(parts, [("earth", None), ("node 1", Some(0)), ("node 2", Some(1))]);
}

#[test]
fn repeated_meshes_are_stored_once() {
    let mut document = Document::triangle();
    document.json["nodes"] = json!([
        { "mesh": 0, "translation": [10, 0, 0] },
        { "mesh": 0, "scale": [1, 1, 0] },
        { "mesh": 0, "scale": [-1, 1, 1], "children": [3] },
        { "mesh": 1 }
    ]);
    document.json["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
    document.json["materials"] = json!([{ "name": "paint" }]);
    document.json["meshes"][0]["primitives"] =
        json!([{ "attributes": { "POSITION": 0 } }, { "attributes": { "POSITION": 0 }, "material": 0 }]);
    document.mesh(json!([{ "attributes": { "POSITION": 0 } }]));
    let sink = document.read();
    let parts: Vec<_> = sink.parts.iter().map(|p| (p.name.as_str(), p.parent)).collect();
    let pair = |n: u32| [("primitive 0", Some(n)), ("paint", Some(n))];
    let [a, b] = pair(0);
    let [c, d] = pair(3);
    let [e, f] = pair(6);
    let nodes = [("node 0", None), a, b, ("node 1", None), c, d, ("node 2", None), e, f, ("node 3", Some(6))];
    assert_eq!(parts, nodes);
    // Two nodes share a mesh. A third one flattens it and is placed directly, as is the mesh that is used once.
    assert_eq!(sink.meshes.len(), 2);
    assert_eq!(sink.meshes[1].local_parts, 2);
    assert_eq!(
        sink.instances.iter().map(|i| (i.mesh, i.first_part)).collect::<Vec<_>>(),
        [(MeshKey(1), 1), (MeshKey(1), 7)]
    );
    assert_eq!(sink.direct().iter().map(|t| t.part).collect::<Vec<_>>(), [4, 5, 9]);
    assert_eq!(sink.placed().count(), 7);
    assert_eq!(sink.bounds().min, DVec3::new(-1.0, 0.0, 0.0));
    assert_eq!(sink.bounds().max, DVec3::new(11.0, 1.0, 0.0));
    // A nearly flat transform is treated like a flat one.
    document.json["nodes"][1]["scale"] = json!([1, 1, 1e-7]);
    assert_eq!(document.read().instances.len(), 2);
    document.json["nodes"][1]["scale"] = json!([1, 1, 1e-5]);
    assert_eq!(document.read().instances.len(), 3);
    // Primitive ids count through the meshes in the order of arrival.
    let mut prims: Vec<u64> = sink.meshes.iter().flat_map(|m| m.triangles.iter().map(|t| t.prim)).collect();
    prims.sort_unstable();
    assert_eq!(prims, [0, 1, 2, 3, 4]);
}

#[test]
fn nodes_must_be_trees() {
    for (nodes, roots, words) in [
        (json!([{ "children": [0] }]), json!([0]), "own ancestor"),
        (
            json!([{ "children": [1] }, { "children": [2] }, { "children": [1] }]),
            json!([0]),
            "nodes[1] is its own ancestor",
        ),
        (json!([{ "children": [2] }, { "children": [2] }, {}]), json!([0, 1]), "nodes[2] has two parents"),
        (json!([{}]), json!([0, 0]), "two parents"),
        (json!([{ "children": [7] }]), json!([0]), "nodes[7] does not exist"),
        (json!([{}]), json!([7]), "nodes[7] does not exist"),
        (json!([{ "mesh": 7 }]), json!([0]), "meshes[7] does not exist"),
    ] {
        let error = refused("t.glb", Document::new(nodes, roots).glb());
        assert!(error.contains(words), "{error}");
    }
    let mut document = Document::new(json!([{ "children": [1] }, { "children": [0] }]), json!([0]));
    document.json.as_object_mut().unwrap().remove("scenes");
    assert!(refused("t.glb", document.glb()).contains("cycle"));
    // A chain of a hundred thousand nodes must not overflow the stack.
    let nodes: Vec<Value> = (1..100_000).map(|i| json!({ "children": [i] })).chain([json!({ "mesh": 0 })]).collect();
    let mut document = Document::triangle();
    document.json["nodes"] = json!(nodes);
    assert_eq!(document.read().parts.len(), 100_000);
}

#[test]
fn without_a_scene_all_roots_are_shown() {
    let mut document = Document::triangle();
    document.json["nodes"] = json!([{ "mesh": 0 }, { "children": [0] }, { "mesh": 0 }]);
    document.json.as_object_mut().expect("an object").remove("scenes");
    assert_eq!(document.read().placed().count(), 2);
    document.json["scene"] = json!(3);
    assert!(refused("t.glb", document.glb()).contains("scenes[3] does not exist"));
    let nothing = Document::new(json!([]), json!([])).read();
    assert!(nothing.notes[0].contains("no triangles"));
}

/// Returns a document with the square corners 0..4, drawn in `mode` with `indices`.
fn square(mode: u32, component: u32, indices: Option<&[u32]>) -> Document {
    let mut document = Document::new(json!([{ "mesh": 0 }]), json!([0]));
    let positions = document.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    let mut primitive = json!({ "attributes": { "POSITION": positions }, "mode": mode });
    if let Some(indices) = indices {
        let size = [1, 0, 2, 0, 4][component as usize - 5121];
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()[..size].to_vec()).collect();
        primitive["indices"] = json!(document.accessor(component, "SCALAR", indices.len(), &bytes));
    }
    document.mesh(json!([primitive]));
    document
}

#[test]
fn every_mode_and_index_type_gives_the_same_square() {
    let [a, b, c, d] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)];
    for component in [5121, 5123, 5125] {
        let list = square(4, component, Some(&[0, 1, 2, 2, 1, 3])).read();
        assert_eq!(positions(&list), [[a, b, c], [c, b, d]], "{component}");
        assert_eq!(positions(&square(5, component, Some(&[0, 1, 2, 3])).read()), [[a, b, c], [c, b, d]]);
        assert_eq!(positions(&square(6, component, Some(&[0, 1, 3, 2])).read()), [[a, b, d], [a, d, c]]);
    }
    assert_eq!(positions(&square(5, 0, None).read()), [[a, b, c], [c, b, d]]);
    assert_eq!(positions(&square(6, 0, None).read()), [[a, b, c], [a, c, d]]);
    let sink = square(4, 0, None).read();
    assert!(sink.received == 1 && sink.notes[0].contains("incomplete last triangle"), "{:?}", sink.notes);
    let sink = square(1, 0, None).read();
    assert!(sink.received == 0 && sink.notes[0].contains("points or lines"), "{:?}", sink.notes);
    for (ty, bad) in [(5121, 255), (5123, 65535), (5125, u32::MAX), (5125, 4)] {
        let error = refused("t.glb", square(4, ty, Some(&[0, 1, bad])).glb());
        assert!(
            error.contains("meshes[0].primitives[0]: index 2 refers to vertex") && error.contains("of 4"),
            "{error}"
        );
    }
}

#[test]
fn accessors_must_lie_in_their_buffers() {
    let changes: &[(&str, Value, &str)] = &[
        ("/accessors/0/count", json!(4), "end outside of bufferViews[0]"),
        ("/accessors/0/count", json!(u64::MAX), "end outside of bufferViews[0]"),
        ("/accessors/0/count", json!(4_294_967_299u64), "end outside of bufferViews[0]"),
        ("/accessors/0/byteOffset", json!(1), "end outside"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "end outside"),
        ("/accessors/0/bufferView", json!(9), "bufferViews[9] does not exist"),
        ("/accessors/0/componentType", json!(5124), "unknown type of components, 5124"),
        ("/accessors/0/type", json!("VEC2"), "2 components"),
        ("/bufferViews/0/byteLength", json!(37), "outside of buffers[0]"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "outside of buffers[0]"),
        ("/bufferViews/0/byteStride", json!(4), "stride of 4"),
        ("/bufferViews/0/byteStride", json!(0), "stride of 0"),
        ("/bufferViews/0/buffer", json!(3), "buffers[3] does not exist"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(5), "accessors[5] does not exist"),
        ("/meshes/0/primitives/0/indices", json!(5), "accessors[5] does not exist"),
        ("/meshes/0/primitives/0/indices", json!(0), "3 components"),
        ("/meshes/0/primitives/0/mode", json!(9), "unknown mode"),
    ];
    for (path, value, words) in changes {
        let mut document = Document::triangle();
        let (parent, key) = path.rsplit_once('/').unwrap();
        document.json.pointer_mut(parent).unwrap()[key] = value.clone();
        let error = refused("t.glb", document.glb());
        assert!(error.contains(words), "{path} {value}: {error}");
    }
    // Implicit zeros that occupy no bytes of the file.
    let mut document = Document::triangle();
    document.json["accessors"][0] = json!({ "componentType": 5126, "type": "VEC3", "count": 1u64 << 40 });
    assert!(refused("t.glb", document.glb()).contains("without bytes"));
}

#[test]
fn sparse_and_quantised_accessors_are_read() {
    let mut document = Document::triangle();
    let indices = document.view(&[2u8]);
    let values = document.view(&[0.0f32, 5.0, 0.5].map(f32::to_le_bytes).concat());
    document.json["accessors"][0]["sparse"] = json!({
        "count": 1, "indices": { "bufferView": indices, "componentType": 5121 }, "values": { "bufferView": values }
    });
    assert_eq!(document.read().direct()[0].positions[2], DVec3::new(0.0, 5.0, 0.5));
    document.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(document.read().direct()[0].positions[1], DVec3::ZERO);
    document.bin[36] = 3;
    assert!(refused("t.glb", document.glb()).contains("sparse index 3 is out of range"));

    let mut document = Document::triangle();
    let bytes: Vec<u8> =
        [0i16, 0, 0, 7, 32767, 0, 0, 7, 0, -32767, -32768, 7].iter().flat_map(|x| x.to_le_bytes()).collect();
    let at = document.accessor(5122, "VEC3", 3, &bytes);
    document.json["bufferViews"][1]["byteStride"] = json!(8);
    document.json["accessors"][at]["normalized"] = json!(true);
    document.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(at);
    assert_eq!(document.read().direct()[0].positions, [DVec3::ZERO, DVec3::X, DVec3::new(0.0, -1.0, -1.0)]);
}

#[test]
fn materials_keep_their_factors() {
    let mut document = Document::triangle();
    document.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let mut look = |material: Value| {
        document.json["materials"] = json!([material]);
        let sink = document.read();
        assert_eq!(sink.parts[0].material, Some(0));
        assert_eq!(sink.direct()[0].colour(), None);
        sink.materials[0]
    };
    let factors = json!({ "baseColorFactor": [0.5, 0.25, 1.0, 0.4], "metallicFactor": 0.0, "roughnessFactor": 0.75 });
    let plain = look(json!({ "pbrMetallicRoughness": factors }));
    assert_eq!((plain.colour, plain.opacity, plain.metalness, plain.roughness), ([0.5, 0.25, 1.0], 1.0, 0.0, 0.75));
    assert_eq!(look(json!({ "pbrMetallicRoughness": factors, "alphaMode": "BLEND" })).opacity, 0.4);
    assert_eq!(look(json!({ "pbrMetallicRoughness": factors, "alphaMode": "MASK" })).opacity, 0.0);
    assert_eq!(look(json!({ "pbrMetallicRoughness": factors, "alphaMode": "MASK", "alphaCutoff": 0.3 })).opacity, 1.0);
    let older = json!({ "diffuseFactor": [0.1, 0.2, 0.3, 1.0], "glossinessFactor": 0.25 });
    let older = look(json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": older } }));
    assert_eq!((older.colour, older.metalness, older.roughness), ([0.1, 0.2, 0.3], 0.0, 0.75));
    assert_eq!(look(json!({})).metalness, 1.0);
}

#[test]
fn other_json_is_distinguished_from_gltf() {
    for (text, words) in [
        (r#"{"asset":{"version":"1.0"}}"#, "glTF version \"1.0\""),
        (r#"{"asset":{}}"#, "not glTF"),
        (r#"{"a":1}"#, "not glTF"),
        (r#"{"asset":{"version":"1.0"},"root":{},"geometricError":1}"#, "tileset"),
        ("{\n\"asset\": {\n", "line 3: not valid JSON"),
        (r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":-2}]}"#, "nodes[0]: \"mesh\" is -2, not an index"),
        (r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#, "KHR_draco"),
    ] {
        let error = refused("t.gltf", text);
        assert!(error.contains(words), "{error}");
    }
    let nested = format!("{}{}", "{\"a\":".repeat(100_000), "}".repeat(100_000));
    assert!(refused("t.gltf", nested).contains("not glTF"));
}

#[test]
fn every_truncation_is_refused() {
    let document = textured(&png(2, 2, &[255; 16]));
    refuses_every_truncation("t.glb", &document.glb());
    refuses_every_truncation("t.gltf", &document.gltf(&data_uri(&document.bin)));
}

#[test]
fn false_headers_are_refused() {
    let glb = Document::triangle().glb();
    for (at, word, words) in [
        (4, 1u32, "GLB version 1"),
        (8, u32::MAX, "announces"),
        (12, u32::MAX, "ends outside of the file"),
        (16, 0, "not JSON"),
    ] {
        let mut damaged = glb.clone();
        damaged[at..at + 4].copy_from_slice(&word.to_le_bytes());
        let error = refused("t.glb", damaged);
        assert!(error.contains(words), "{error}");
    }
}

proptest! {
    #[test]
    fn damage_is_survived(changes in prop::collection::vec((any::<usize>(), any::<u8>()), 1..4)) {
        survives_damage("t.glb", &textured(&png(2, 2, &[255; 16])).glb(), &changes);
        survives_damage("t.glb", &square(5, 5123, Some(&[0, 1, 2, 3])).glb(), &changes);
    }
}
