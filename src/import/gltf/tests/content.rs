//! The content of meshes in their default pose, of instances, and of materials with alpha.

use super::*;

fn close(found: DVec3, expected: DVec3) {
    assert!(found.distance(expected) < 1e-6, "{found} instead of {expected}");
}

#[test]
fn morph_targets_have_their_default_weights() {
    let mut document = Document::triangle();
    let up = document.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    // The second target moves only the last corner, by normalised bytes in a sparse accessor.
    let index = document.view(&[2]);
    let value = document.view(&[0, 127, 0]);
    document.push(
        "accessors",
        json!({ "componentType": 5120, "normalized": true, "type": "VEC3", "count": 3, "sparse": {
            "count": 1, "indices": { "bufferView": index, "componentType": 5121 }, "values": { "bufferView": value } } }),
    );
    let (primitive, mesh, node) = ("meshes/0/primitives/0/targets", "meshes/0/weights", "nodes/0/weights");
    document.set(primitive, json!([{ "POSITION": up }, { "POSITION": up + 1 }, { "NORMAL": 0 }]));
    assert_eq!(positions(&document.read()), [TRIANGLE]);
    document.set(mesh, json!([0.5, 2.0, 1.0]));
    let half = DVec3::Z * 0.5;
    let morphed = [half, DVec3::X + half, DVec3::Y * 3.0 + half];
    assert_eq!(positions(&document.read()), [morphed]);
    // The weights of a node take precedence, and such a node does not share the mesh.
    document.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0 }, { "mesh": 0, "weights": [1.0, 0.0, 0.0] }]);
    document.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let sink = document.read();
    assert_eq!((sink.instances.len(), positions(&sink)), (2, vec![TRIANGLE.map(|p| p + DVec3::Z)]));
    assert_eq!(sink.meshes[1].triangles[0].positions, morphed);
    document.set(node, json!([0.5, 2.0, 1.0]));
    assert_eq!(document.read().instances.len(), 2);
    document.json["accessors"][up]["count"] = json!(2);
    let error = refused("t.glb", document.glb());
    assert!(error.contains("meshes[0].primitives[0]: 2 displacements of a morph target for 3 positions"), "{error}");
}

/// Returns the triangle with a skin of two joints: its corners belong to the first joint, to the second, and to both.
fn skinned() -> Document {
    let mut document = Document::triangle();
    let joints = document.accessor(5121, "VEC4", 3, &[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0]);
    let weights = [255u8, 0, 0, 0, 255, 0, 0, 0, 51, 204, 0, 0];
    let weights = document.accessor(5121, "VEC4", 3, &weights);
    document.json["accessors"][weights]["normalized"] = json!(true);
    document.set("meshes/0/primitives/0/attributes/JOINTS_0", json!(joints));
    document.set("meshes/0/primitives/0/attributes/WEIGHTS_0", json!(weights));
    // The inverse of the first joint's place in the bind pose moves by -10 along x, that of the second does nothing.
    let mut matrices = [0.0f32; 32];
    for i in 0..4 {
        (matrices[5 * i], matrices[16 + 5 * i]) = (1.0, 1.0);
    }
    matrices[12] = -10.0;
    let bytes: Vec<u8> = matrices.iter().flat_map(|x| x.to_le_bytes()).collect();
    let matrices = document.accessor(5126, "MAT4", 2, &bytes);
    document.json["nodes"] = json!([
        { "mesh": 0, "skin": 0, "translation": [1000, 1000, 1000], "scale": [9, 9, 9] },
        { "translation": [10, 0, 5], "children": [2] },
        { "translation": [-10, 0, 0], "scale": [2, 2, 2] }
    ]);
    document.json["skins"] = json!([{ "joints": [1, 2], "inverseBindMatrices": matrices }]);
    document
}

#[test]
fn skinned_meshes_stand_at_their_joints() {
    let mut document = skinned();
    // The joints are not in the scene. The first one moves by 5 along z, the second doubles and moves by 5 along z.
    let expected = [DVec3::Z * 5.0, DVec3::new(2.0, 0.0, 5.0), DVec3::new(0.0, 1.8, 5.0)];
    let check = |document: &Document| {
        let sink = document.read();
        assert_eq!((sink.direct().len(), sink.instances.len()), (1, 0));
        sink.direct()[0].positions.into_iter().zip(expected).for_each(|(found, expected)| close(found, expected));
        sink
    };
    assert!(check(&document).notes[0].contains("1 skinned meshes stand in the pose of their joints (nodes[0])"));
    document.json["scenes"][0]["nodes"] = json!([0, 1]);
    check(&document);
    // Weights whose sum is not 1, and a joint without weight that does not exist.
    let weights = [0.5f32, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.1, 0.4, 0.0, 0.0];
    let at = document.accessor(5126, "VEC4", 3, &weights.map(f32::to_le_bytes).concat());
    document.set("meshes/0/primitives/0/attributes/WEIGHTS_0", json!(at));
    document.bin[36 + 3] = 99;
    check(&document);
    document.bin[36] = 99;
    assert!(refused("t.glb", document.glb()).contains("meshes[0].primitives[0]: a vertex refers to joint 99 of 2"));
    // A second set of joints and weights counts too.
    let mut document = skinned();
    let joints = document.accessor(5123, "VEC4", 3, &[0; 24]);
    let weights = document.accessor(5126, "VEC4", 3, &[0.0f32; 12].map(f32::to_le_bytes).concat());
    document.set("meshes/0/primitives/0/attributes/JOINTS_1", json!(joints));
    document.set("meshes/0/primitives/0/attributes/WEIGHTS_1", json!(weights));
    check(&document);
    // Without inverse bind matrices they are the identity.
    document.json["skins"][0].as_object_mut().unwrap().remove("inverseBindMatrices");
    close(document.read().direct()[0].positions[0], DVec3::new(10.0, 0.0, 5.0));
}

#[test]
fn false_skins_are_named() {
    for (path, value, words) in [
        ("nodes/0/skin", json!(5), "skins[5] does not exist"),
        ("skins/0/joints", json!([1, 9]), "skins[0]: nodes[9] does not exist"),
        ("skins/0/joints", json!([1, 2, 1]), "skins[0]: 2 inverse bind matrices for 3 joints"),
        ("skins/0/inverseBindMatrices", json!(0), "skins[0]: accessors[0] has 3 components"),
        ("nodes/2/children", json!([1]), "skins[0]: nodes[1] is its own ancestor"),
        ("nodes/1/scale", json!(2), "skins[0]: nodes[1]: \"scale\""),
    ] {
        let mut document = skinned();
        document.set(path, value);
        let error = refused("t.glb", document.glb());
        assert!(error.contains(words), "{path}: {error}");
    }
    // A mesh without joints stands at its node, whatever its skin.
    let mut document = skinned();
    document.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("JOINTS_0");
    document.json["skins"] = json!([]);
    assert_eq!(document.read().direct()[0].positions[0], DVec3::splat(1000.0));
}

#[test]
fn gpu_instances_are_placed() {
    let mut document = Document::triangle();
    let translations = document.floats("VEC3", &[0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 10.0, 0.0]);
    let turns: Vec<u8> =
        [0i16, 0, 0, 32767, 0, 0, 32767, 0, 0, 0, 0, 32767].iter().flat_map(|x| x.to_le_bytes()).collect();
    let turns = document.accessor(5122, "VEC4", 3, &turns);
    document.json["accessors"][turns]["normalized"] = json!(true);
    let scales = document.floats("VEC3", &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 0.0]);
    let attributes = json!({ "TRANSLATION": translations, "ROTATION": turns, "SCALE": scales, "_ID": 0 });
    document.set("nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } }));
    document.set("nodes/0/translation", json!([0, 0, 7]));
    let sink = document.read();
    // Two places share the mesh. The third one is flat, and a turn by 180° about z changes the second.
    assert_eq!((sink.instances.len(), sink.direct().len(), sink.parts.len()), (2, 1, 1));
    let mut placed: Vec<_> = sink.placed().map(|t| t.positions).collect();
    placed.sort_by(|a, b| (a[0].x + 2.0 * a[0].y).total_cmp(&(b[0].x + 2.0 * b[0].y)));
    let expected = [
        TRIANGLE.map(|p| p + DVec3::Z * 7.0),
        TRIANGLE.map(|p| p * -2.0 + DVec3::new(10.0, 0.0, 7.0)),
        TRIANGLE.map(|p| p * 3.0 + DVec3::new(0.0, 10.0, 7.0)),
    ];
    for (found, expected) in placed.iter().flatten().zip(expected.iter().flatten()) {
        close(*found, *expected);
    }
    assert!(sink.notes[0].contains("flattened"), "{:?}", sink.notes);
    // One instance, and instances whose only attribute is an id.
    let mut document = Document::triangle();
    let one = document.floats("VEC3", &[1.0, 2.0, 3.0]);
    document.set("nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": one } } }));
    assert_eq!(positions(&document.read()), [TRIANGLE.map(|p| p + DVec3::new(1.0, 2.0, 3.0))]);
    document.set("nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": { "attributes": { "_ID": 0 } } }));
    assert_eq!(document.read().placed().count(), 3);
    document.set("nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": {} }));
    assert_eq!(positions(&document.read()), [TRIANGLE]);
    let attributes = json!({ "TRANSLATION": one, "SCALE": 0 });
    document.set("nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } }));
    let error = refused("t.glb", document.glb());
    assert!(error.contains("nodes[0]: EXT_mesh_gpu_instancing: the attributes differ"), "{error}");
}

#[test]
fn transforms_without_an_inverse_are_noted() {
    for transform in
        [json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]), json!(vec![0; 16]), json!(vec![1e308; 16])]
    {
        let mut document = Document::triangle();
        document.json["nodes"] = json!([{ "mesh": 0, "matrix": transform }, { "mesh": 1 }]);
        document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
        document.mesh(json!([{ "attributes": { "POSITION": 0 } }]));
        let sink = document.read();
        assert_eq!((sink.received, sink.direct()[1].positions), (2, TRIANGLE), "{transform}");
        assert!(sink.notes[0].contains("1 placements of meshes are flattened"), "{transform}: {:?}", sink.notes);
        assert!(sink.notes[0].contains("nodes[0]"), "{transform}: {:?}", sink.notes);
    }
}

#[test]
fn extreme_scales_refuse_no_file() {
    for scale in [1e-105, 1e-110, 1e-160, 1e105, 1e110, 1e160] {
        let mut document = Document::triangle();
        let node = json!({ "mesh": 0, "scale": [scale, scale, scale] });
        document.json["nodes"] = json!([node, node, { "mesh": 0 }]);
        document.json["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
        let sink = document.read();
        assert_eq!((sink.instances.len(), sink.direct().len()), (0, 3), "{scale}");
    }
}

#[test]
fn hidden_nodes_are_left_out() {
    let mut document = Document::triangle();
    document.json["nodes"] = json!([
        { "mesh": 0 },
        { "extensions": { "KHR_node_visibility": { "visible": false } }, "children": [2] },
        { "mesh": 0, "extensions": { "KHR_node_visibility": { "visible": true } } }
    ]);
    document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    let sink = document.read();
    assert_eq!((positions(&sink), sink.parts.len()), (vec![TRIANGLE], 1));
    assert!(sink.notes[0].contains("1 nodes with meshes are invisible and were left out (nodes[2])"));
}

#[test]
fn alpha_counts_by_the_mode() {
    // The left texel is green and transparent, the right one is red and half transparent.
    let mut document = textured(&png(2, 1, &[0, 255, 0, 0, 255, 0, 0, 128]));
    let mut read = |mode: &str, cutoff: f64, alpha: f64| {
        document.json["materials"] = json!([{ "alphaMode": mode, "alphaCutoff": cutoff, "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 }, "baseColorFactor": [1, 1, 1, alpha] } }]);
        let sink = document.read();
        let colours: Vec<_> = sink.direct().iter().map(|t| t.colour().unwrap()).collect();
        (colours, sink.materials[0].opacity, sink.notes)
    };
    let (green, red, white) = ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0; 3]);
    // OPAQUE ignores the alpha of the texture and of the factor.
    for alpha in [1.0, 0.25, 0.0] {
        assert_eq!(read("OPAQUE", 0.5, alpha), (vec![green, red], 1.0, vec![]));
    }
    // MASK: a texel is opaque or invisible. The left triangle has no visible texel.
    let (colours, opacity, notes) = read("MASK", 0.5, 1.0);
    assert_eq!((colours, opacity), (vec![white, red], 1.0));
    assert!(notes.len() == 1 && notes[0].contains("transparent textures"), "{notes:?}");
    assert_eq!(read("MASK", 0.5, 0.5).1, 0.0);
    assert_eq!(read("MASK", 0.0, 0.0).0, [green, red]);
    // BLEND: the mean opacity of the visible texels.
    let half = 128.0 / 255.0;
    assert!((read("BLEND", 0.5, 1.0).1 - half).abs() < 1e-6);
    assert!((read("BLEND", 0.5, 0.5).1 - half * 0.5).abs() < 1e-6);
}
