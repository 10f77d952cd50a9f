//! Files with objects that this reader does not use, or that other programs write in an unusual form.

use super::*;

#[test]
fn unused_objects_do_not_matter() {
    let changes: &[(&str, Value)] = &[
        // An animation of a property of a material, whose target has no node.
        (
            "animations",
            json!([{
                "channels": [{ "sampler": 0, "target": { "path": "pointer",
                    "extensions": { "KHR_animation_pointer": { "pointer": "/materials/0/alphaCutoff" } } } }],
                "samplers": [{ "input": 0, "output": 0 }]
            }, { "channels": "none" }]),
        ),
        ("extensionsUsed", json!(["KHR_animation_pointer", 7])),
        ("scenes", json!([{ "nodes": [0], "extras": null, "name": 3 }, {}, { "nodes": "all" }, 5])),
        ("extras", json!({ "a": [1, { "b": null }] })),
        ("VENDOR_custom", json!("a custom property")),
        ("asset", json!({ "version": "2.0", "generator": 7, "copyright": {}, "minVersion": "2.0" })),
        ("asset", json!({ "version": 2.0 })),
        ("cameras", json!([{ "type": "wide" }])),
        ("skins", json!([{}, { "joints": [77] }, { "joints": "all" }])),
        ("samplers", json!([{ "magFilter": 1 }])),
        ("images", json!([{ "uri": 3 }, "a"])),
        ("textures", json!([{ "source": 99 }])),
        ("accessors/1", json!({ "type": "VEC9" })),
        ("accessors/1", json!({ "bufferView": 99, "componentType": 5126, "type": "VEC3", "count": -1 })),
        ("bufferViews/1", json!({ "buffer": 99, "byteLength": 1e300 })),
        ("nodes/1", json!({ "mesh": -1, "children": [[]], "matrix": "none" })),
        ("meshes/1", json!({ "primitives": [{ "attributes": { "POSITION": 77 }, "mode": 99 }] })),
        ("meshes/0/extras", json!({ "targetNames": 3 })),
        ("meshes/0/primitives/0/attributes/_CUSTOM", json!(99)),
        ("meshes/0/primitives/0/attributes/NORMAL", json!("none")),
        ("meshes/0/primitives/0/attributes/TEXCOORD_7", json!(99)),
        ("meshes/0/name", json!(["a", "list"])),
        ("nodes/0/camera", json!(99)),
        ("nodes/0/extensions", json!({ "VENDOR_custom": { "a": 1 } })),
        ("materials", json!([{ "pbrMetallicRoughness": 3, "alphaMode": "GLASS", "emissiveFactor": "red" }])),
    ];
    for (path, value) in changes {
        let mut document = Document::triangle();
        document.set(path, value.clone());
        let sink = read_bytes("t.glb", document.glb()).unwrap_or_else(|e| panic!("{path}: {e}"));
        assert_eq!(positions(&sink), [TRIANGLE], "{path}");
    }
}

#[test]
fn integers_may_be_written_as_real_numbers() {
    let mut document = square(4, 5123, Some(&[0, 1, 2, 2, 1, 3]));
    document.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]);
    document.json["meshes"][0]["weights"] = json!([0]);
    let expected = positions(&document.read());
    // Every integer of the document becomes a real number.
    fn real(value: &mut Value) {
        match value {
            Value::Number(n) => *value = json!(n.as_f64().unwrap()),
            Value::Array(list) => list.iter_mut().for_each(real),
            Value::Object(map) => map.values_mut().for_each(real),
            _ => {}
        }
    }
    let bin = data_uri(&document.bin);
    document.json["scene"] = json!(0);
    document.json["buffers"] = json!([{ "byteLength": document.bin.len(), "uri": bin }]);
    real(&mut document.json);
    let text = document.json.to_string();
    assert!(text.contains("\"count\":6.0") && text.contains("\"byteLength\":48.0"), "{text}");
    assert_eq!(positions(&read_bytes("t.gltf", &text).unwrap()), expected);
    let exponents = text.replace("\"count\":6.0", "\"count\":0.6e1");
    assert_eq!(positions(&read_bytes("t.gltf", &exponents).unwrap()), expected);
    let error = refused("t.gltf", text.replace("\"count\":6.0", "\"count\":6.5"));
    assert!(error.contains("accessors[1]: \"count\" is 6.5, not a whole number"), "{error}");
}

#[test]
fn an_empty_scene_is_an_empty_model() {
    let mut document = Document::triangle();
    document.json["scenes"] = json!([{}]);
    let sink = document.read();
    assert_eq!((sink.received, sink.parts.len()), (0, 0));
    assert!(sink.notes[0].contains("1 nodes with meshes are not in the scene"), "{:?}", sink.notes);
    assert!(sink.notes[1].contains("the model is empty"), "{:?}", sink.notes);
    // The default scene decides.
    document.json["scenes"] = json!([{}, { "nodes": [0] }]);
    document.json["scene"] = json!(1);
    assert_eq!(positions(&document.read()), [TRIANGLE]);
}

#[test]
fn primitives_without_positions_are_left_out() {
    let mut document = Document::triangle();
    document.json["meshes"][0]["primitives"] = json!([
        { "attributes": {} }, { "attributes": { "POSITION": 0 } }, { "attributes": { "NORMAL": 0 } }, {}
    ]);
    let sink = document.read();
    assert_eq!(positions(&sink), [TRIANGLE]);
    assert_eq!((sink.parts.len(), sink.direct()[0].part), (5, 2));
    let note = "t.glb: 3 primitives have no positions and were left out (the first: meshes[0].primitives[0])";
    assert!(sink.notes.len() == 1 && sink.notes[0].ends_with(note), "{:?}", sink.notes);
    // In a shared mesh too.
    document.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0 }]);
    document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    let sink = document.read();
    assert_eq!((sink.instances.len(), sink.placed().count()), (2, 2));
}

#[test]
fn errors_in_colours_are_noted() {
    let changes: &[(&str, Value, &str)] = &[
        ("meshes/0/primitives/0/material", json!(9), "materials[9]"),
        ("meshes/0/primitives/0/material", json!("red"), ""),
        ("meshes/0/primitives/0/attributes/COLOR_0", json!(9), "accessors[9] does not exist"),
        ("meshes/0/primitives/0/attributes/COLOR_0", json!(2), "accessors[2] has 1 elements for 3 positions"),
        ("meshes/0/primitives/0/attributes/TEXCOORD_0", json!(0), "3 components"),
        ("textures/0/source", json!(9), "images[9] does not exist"),
        ("textures/0/source", json!(null), "no picture of a supported type"),
        ("materials/0/pbrMetallicRoughness/baseColorTexture/index", json!(9), "textures[9] does not exist"),
        ("materials/0/pbrMetallicRoughness/baseColorFactor", json!([1]), ""),
    ];
    for (path, value, words) in changes {
        let mut document = Document::triangle();
        let uv = document.floats("VEC2", &[0.0; 6]);
        document.floats("VEC3", &[0.0; 3]);
        let picture = document.view(&png(1, 1, &[255; 4]));
        document.json["images"] = json!([{ "bufferView": picture }]);
        document.json["textures"] = json!([{ "source": 0 }]);
        document.json["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
        document.json["meshes"][0]["primitives"][0]["material"] = json!(0);
        document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uv);
        document.set(path, value.clone());
        let sink = read_bytes("t.glb", document.glb()).unwrap_or_else(|e| panic!("{path}: {e}"));
        assert_eq!(positions(&sink), [TRIANGLE], "{path}");
        assert_eq!(sink.notes.len(), usize::from(!words.is_empty()), "{path}: {:?}", sink.notes);
        assert!(sink.notes.iter().all(|note| note.contains(words)), "{path}: {:?}", sink.notes);
    }
}

#[test]
fn used_objects_that_are_malformed_are_named() {
    for (path, value, words) in [
        ("nodes/0/matrix", json!([1, 2, 3]), "nodes[0]: \"matrix\" is not a list of 16 numbers"),
        ("nodes/0/rotation", json!("none"), "nodes[0]: \"rotation\" is not a list of 4 numbers"),
        ("nodes/0/children", json!(1), "nodes[0]: \"children\" is not a list of indices"),
        ("scenes/0/nodes", json!([0.5]), "scenes[0]: \"nodes\" is not a list of indices"),
        ("meshes/0/primitives/0/indices", json!([]), "meshes[0].primitives[0] \"indices\" is [], not an index"),
        ("accessors/0/count", json!(null), "accessors[0]: has no \"count\""),
        ("accessors/0/type", json!("VEC5"), "accessors[0]: has an unknown type"),
        ("accessors/0/sparse", json!({ "count": 1 }), "accessors[0]: sparse: has no \"componentType\""),
        ("bufferViews/0/buffer", json!(null), "bufferViews[0]: has no \"buffer\""),
    ] {
        let mut document = Document::triangle();
        document.set(path, value);
        let error = refused("t.glb", document.glb());
        assert!(error.contains(words), "{path}: {error}");
    }
    // A malformed transform matters only above a mesh.
    let mut document = Document::triangle();
    document.json["nodes"] = json!([{ "mesh": 0, "children": [1] }, { "camera": 0, "scale": [1, "a", 1] }]);
    assert_eq!(positions(&document.read()), [TRIANGLE]);
}

#[test]
fn unknown_required_extensions_are_named() {
    let read = |names: &[&str]| {
        let mut document = Document::triangle();
        document.json["extensionsRequired"] = json!(names);
        document.json["extensionsUsed"] = json!(names);
        read_bytes("t.glb", document.glb()).map(|sink| positions(&sink)).map_err(|e| e.to_string())
    };
    let accepted = [
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_texture_basisu",
        "EXT_texture_webp",
        "KHR_lights_punctual",
        "KHR_animation_pointer",
        "EXT_mesh_gpu_instancing",
    ];
    assert_eq!(read(&accepted), Ok(vec![TRIANGLE]));
    for name in ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "VENDOR_unknown"] {
        let error = read(&["KHR_materials_unlit", name]).unwrap_err();
        assert!(error.contains(&format!("needs the extension {name}, which is not supported")), "{error}");
    }
}

#[test]
fn compressed_data_is_named_unless_there_is_plain_data() {
    // Draco: the accessors have a buffer view only if the data is also stored as it is.
    let mut document = Document::triangle();
    document.set("meshes/0/primitives/0/extensions", json!({ "KHR_draco_mesh_compression": { "bufferView": 0 } }));
    assert_eq!(positions(&document.read()), [TRIANGLE]);
    document.set("accessors/0", json!({ "componentType": 5126, "type": "VEC3", "count": 3 }));
    let error = refused("t.glb", document.glb());
    assert!(error.contains("meshes[0].primitives[0]: has data only for KHR_draco_mesh_compression"), "{error}");
    // Meshopt: the view's own buffer is missing, or holds plain data.
    let mut document = Document::triangle();
    document.set("bufferViews/0/extensions", json!({ "EXT_meshopt_compression": { "buffer": 0 } }));
    assert_eq!(positions(&document.read()), [TRIANGLE]);
    let mut json: Value = serde_json::from_slice(&document.gltf("x")).unwrap();
    json["buffers"] = json!([{ "byteLength": 36, "extensions": { "EXT_meshopt_compression": { "fallback": true } } }]);
    let error = refused("t.gltf", json.to_string());
    assert!(error.contains("has data only for EXT_meshopt_compression"), "{error}");
}

#[test]
fn buffers_may_be_shorter_than_they_say_if_their_views_are_inside() {
    let document = Document::triangle();
    let text = String::from_utf8(document.gltf(&data_uri(&document.bin))).unwrap();
    for len in ["1000", "36.0", "null", "\"36\""] {
        let text = text.replace("\"byteLength\":36,\"uri\"", &format!("\"byteLength\":{len},\"uri\""));
        assert_eq!(positions(&read_bytes("t.gltf", text).unwrap()), [TRIANGLE], "{len}");
    }
}

#[test]
fn uris_are_read_in_every_form() {
    let document = Document::triangle();
    let files = |uri: &str, name: &str| {
        read_files(&[("t.gltf", &document.gltf(uri)), (name, &document.bin)]).map(|sink| positions(&sink))
    };
    for (uri, name) in [("plan%3A3.bin", "plan:3.bin"), ("plan:3.bin", "plan:3.bin"), ("a%20b.bin", "a%20b.bin")] {
        assert_eq!(files(uri, name).unwrap_or_else(|e| panic!("{uri}: {e}")), [TRIANGLE], "{uri}");
    }
    let coded = base64::engine::general_purpose::STANDARD.encode(&document.bin);
    let broken: Vec<&str> = coded.as_bytes().chunks(7).map(|c| str::from_utf8(c).unwrap()).collect();
    for uri in [
        format!("DATA:application/octet-stream;base64,{coded}"),
        format!("Data:;Base64,{}", broken.join("\n")),
        format!("data:;base64,\r\n{}\r\n", broken.join("\r\n  ")),
        format!("data:;base64,{}", coded.trim_end_matches('=')),
    ] {
        assert_eq!(positions(&read_bytes("t.gltf", document.gltf(&uri)).unwrap()), [TRIANGLE], "{uri}");
    }
}

#[test]
fn texts_in_other_codings_are_noted() {
    let mut document = Document::triangle();
    document.json["nodes"][0]["name"] = json!("Geh?use");
    let text = document.gltf(&data_uri(&document.bin));
    let latin: Vec<u8> = text.iter().map(|&b| if b == b'?' { 0xe4 } else { b }).collect();
    let sink = read_bytes("t.gltf", latin).unwrap();
    assert_eq!((positions(&sink), sink.parts[0].name.as_str()), (vec![TRIANGLE], "Geh\u{fffd}use"));
    assert!(sink.notes[0].contains("not UTF-8"), "{:?}", sink.notes);
    // Zeros in place of the spaces that fill a chunk.
    let zeros = [text.as_slice(), &[0; 3]].concat();
    assert_eq!(positions(&read_bytes("t.gltf", zeros).unwrap()), [TRIANGLE]);
}

/// The notes of a file with a triangle whose text is changed by `change`.
fn notes_of(change: impl Fn(String) -> String) -> Vec<String> {
    let mut document = Document::triangle();
    let bin = data_uri(&document.bin);
    document.json["buffers"] = json!([{ "byteLength": document.bin.len(), "uri": bin }]);
    document.set("nodes/0/extras", json!("here"));
    let sink = read_bytes("t.gltf", change(document.json.to_string())).expect("is read");
    assert_eq!(positions(&sink), [TRIANGLE]);
    sink.notes
}

#[test]
fn unused_values_that_json_does_not_know_do_not_matter() {
    let deep = format!("{}{}", "[".repeat(200), "]".repeat(200));
    for value in ["NaN", "-Infinity", "[1, 1e400]", "{\"x\": -1e999}", &deep] {
        let notes = notes_of(|text| text.replace("\"here\"", value));
        assert!(notes.len() == 1 && notes[0].contains("values that are not JSON"), "{value}: {notes:?}");
    }
    // Where the geometry uses it, it is refused.
    let mut document = Document::triangle();
    document.set("nodes/0/translation", json!(["here", 0, 0]));
    let error = refused("t.gltf", document.json.to_string().replace("\"here\"", "NaN"));
    assert!(error.contains("\"translation\" is not a list of 3 numbers"), "{error}");
    // Errors have the place in the file.
    let error = refused("t.gltf", document.json.to_string().replace("\"here\"", "NaN,,"));
    assert!(error.contains("not valid JSON") && error.contains("line 1"), "{error}");
}

#[test]
fn minus_one_is_no_mesh_and_no_skin() {
    let mut document = Document::triangle();
    document.set("nodes/0/skin", json!(-1));
    document.set("nodes/0/children", json!([1]));
    document.set("nodes/1", json!({ "mesh": -1 }));
    let sink = document.read();
    assert_eq!(positions(&sink), [TRIANGLE]);
    assert!(sink.notes[0].contains("2 nodes refer to mesh or skin -1"), "{:?}", sink.notes);
    document.set("nodes/1", json!({ "mesh": -2 }));
    assert!(refused("t.glb", document.glb()).contains("\"mesh\" is -2, not an index"));
}

#[test]
fn positions_relative_to_a_centre_are_moved_there() {
    let mut document = Document::triangle();
    document.set("extensionsUsed", json!(["CESIUM_RTC"]));
    document.set("extensionsRequired", json!(["CESIUM_RTC"]));
    document.set("extensions", json!({ "CESIUM_RTC": { "center": [4000000.125, -5.5, 3000000.0] } }));
    document.set("nodes/0/translation", json!([0.0, 0.5, 0.0]));
    let sink = document.read();
    let center = DVec3::new(4000000.125, -5.0, 3000000.0);
    assert_eq!(positions(&sink), [TRIANGLE.map(|p| p + center)]);
    assert!(sink.notes[0].contains("CESIUM_RTC"), "{:?}", sink.notes);
}
