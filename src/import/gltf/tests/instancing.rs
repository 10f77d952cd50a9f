//! Instances of `EXT_mesh_gpu_instancing`: where they stand, what is refused, and the memory that they take.

use super::*;
use crate::base::account::Account;
use crate::base::error::Error;
use crate::import::testing::temporary;
use crate::import::{ReadOptions, read_file};

const FLOAT: u32 = 5126;

/// Returns the triangle at node 0, with these attributes of its instances.
fn instanced(attributes: Value) -> Document {
    let mut document = Document::triangle();
    document.instance(0, attributes);
    document
}

impl Document {
    /// Gives a node instances.
    fn instance(&mut self, node: usize, attributes: Value) {
        let extension = json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
        self.set(&format!("nodes/{node}/extensions"), extension);
    }

    /// Adds an accessor of floats with any number of components.
    fn list(&mut self, ty: &str, numbers: &[f32]) -> usize {
        let width = [("SCALAR", 1), ("VEC3", 3), ("VEC4", 4)].into_iter().find(|known| known.0 == ty).unwrap().1;
        self.accessor(
            FLOAT,
            ty,
            numbers.len() / width,
            &numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>(),
        )
    }
}

/// A transform as the format states it: numbers of single precision.
#[derive(Clone, Copy, Debug)]
struct Trs {
    translation: [f32; 3],
    rotation: [f32; 4],
    scale: [f32; 3],
}

impl Trs {
    fn json(&self) -> Value {
        json!({ "translation": self.translation, "rotation": self.rotation, "scale": self.scale })
    }

    /// Moves a point by the formula of quaternions, v + 2 u × (u × v + w v), without matrices.
    fn apply(&self, p: DVec3) -> DVec3 {
        let [x, y, z, w] = self.rotation.map(f64::from);
        let length = (x * x + y * y + z * z + w * w).sqrt();
        let (u, w) = (DVec3::new(x, y, z) / length, w / length);
        let v = p * DVec3::from(self.scale.map(f64::from));
        v + 2.0 * u.cross(u.cross(v) + w * v) + DVec3::from(self.translation.map(f64::from))
    }
}

/// Any transform that is not flat; also mirrored ones, and quaternions that are not of length 1. The numbers are
/// multiples of 1/64, which the text of a document states exactly.
fn trs(reach: i32) -> impl Strategy<Value = Trs> {
    let number = |n: i32| n as f32 / 64.0;
    let scale = prop_oneof![16..256, -256..-16].prop_map(number);
    let rotation = prop::array::uniform4((-64..64).prop_map(number));
    let rotation = rotation.prop_filter("no rotation", |q| q.iter().any(|x| *x != 0.0));
    let translation = prop::array::uniform3((-64 * reach..64 * reach).prop_map(number));
    (translation, rotation, prop::array::uniform3(scale)).prop_map(|(translation, rotation, scale)| Trs {
        translation,
        rotation,
        scale,
    })
}

/// Returns three triangles in two primitives, so that instances have parts of their own.
fn two_primitives() -> Document {
    let mut document = Document::triangle();
    let more = [0.5, 0.0, 2.0, 1.5, 0.25, 2.0, 0.0, 3.0, -1.0, 7.0, 0.0, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0, 9.0];
    let more = document.floats("VEC3", &more);
    let primitives = json!([{ "attributes": { "POSITION": 0 } }, { "attributes": { "POSITION": more } }]);
    document.set("meshes/0/primitives", primitives);
    document
}

/// Instances below a turned, scaled and moved parent, and the same as nodes.
fn both_ways(above: &[Trs], each: &[Trs]) -> (Document, Document) {
    let chain = |last: Value| {
        let mut nodes: Vec<Value> = above.iter().map(Trs::json).collect();
        let count = nodes.len();
        for (i, node) in nodes.iter_mut().enumerate().take(count - 1) {
            node["children"] = json!([i + 1]);
        }
        nodes[count - 1].as_object_mut().unwrap().extend(last.as_object().unwrap().clone());
        nodes
    };
    let mut document = two_primitives();
    let flat = |of: fn(&Trs) -> Vec<f32>| each.iter().flat_map(of).collect::<Vec<f32>>();
    let translation = document.list("VEC3", &flat(|t| t.translation.to_vec()));
    let rotation = document.list("VEC4", &flat(|t| t.rotation.to_vec()));
    let scale = document.list("VEC3", &flat(|t| t.scale.to_vec()));
    document.json["nodes"] = json!(chain(json!({ "mesh": 0 })));
    document.instance(above.len() - 1, json!({ "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale }));
    let mut single = two_primitives();
    let first = above.len();
    let mut nodes = chain(json!({ "children": (first..first + each.len()).collect::<Vec<_>>() }));
    nodes.extend(each.iter().map(|t| {
        let mut node = t.json();
        node["mesh"] = json!(0);
        node
    }));
    single.json["nodes"] = json!(nodes);
    (document, single)
}

proptest! {
    /// All triangles are those of single nodes with the same transforms, to the last bit, and those of the formula of
    /// quaternions, to rounding.
    #[test]
    fn instances_stand_where_single_nodes_stand(
        above in prop::collection::vec(trs(10_000_000), 1..4),
        each in prop::collection::vec(trs(100), 2..6),
    ) {
        let (instances, single) = both_ways(&above, &each);
        let (instances, single) = (instances.read(), single.read());
        let all = |sink: &Collector| sink.placed().map(|t| t.positions).collect::<Vec<_>>();
        prop_assert_eq!(all(&instances).len(), 3 * each.len());
        prop_assert_eq!(all(&instances), all(&single));
        let local = |sink: &Collector| sink.placed().take(3).map(|t| t.prim).collect::<Vec<_>>();
        prop_assert_eq!(local(&instances), local(&single));
        // The corners of the mesh, from a file in which it stands at zero.
        let mesh = two_primitives().read();
        let corners: Vec<[DVec3; 3]> = mesh.placed().map(|t| t.positions).collect();
        for (i, found) in all(&instances).iter().enumerate() {
            for (corner, found) in corners[i % 3].iter().zip(found) {
                let inside = each[i / 3].apply(*corner);
                let expected = above.iter().rev().fold(inside, |p, t| t.apply(p));
                let size = above.iter().rev().scan(inside, |p, t| {
                    *p = t.apply(*p);
                    Some(p.length())
                });
                let size = size.fold(inside.length(), f64::max);
                prop_assert!(found.distance(expected) <= 1e-12 * size, "{found} instead of {expected}");
            }
        }
    }
}

/// Two nodes name one accessor below parents of their own, and a third one shows the mesh once.
#[test]
fn nodes_with_one_list_of_instances_stand_at_their_own_places() {
    let mut document = two_primitives();
    let moves = document.floats("VEC3", &[10.0, 0.0, 0.0, 20.0, 0.0, 0.0]);
    let up = |z: i32| json!({ "translation": [0, 0, z], "children": [z / 100] });
    document.json["nodes"] = json!([
        { "mesh": 0, "name": "once" }, { "mesh": 0, "name": "a" }, { "mesh": 0, "name": "b" }, up(100), up(200)
    ]);
    document.json["scenes"] = json!([{ "nodes": [0, 3, 4] }]);
    document.instance(1, json!({ "TRANSLATION": moves }));
    document.instance(2, json!({ "TRANSLATION": moves }));
    let sink = document.read();
    let name = |part: u32| sink.parts[sink.parts[part as usize].parent.unwrap() as usize].name.as_str();
    let found: Vec<_> = sink.placed().map(|t| (name(t.part), t.positions[0])).step_by(3).collect();
    let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
    let expected = [
        ("once", at(0.0, 0.0)),
        ("a", at(10.0, 100.0)),
        ("a", at(20.0, 100.0)),
        ("b", at(10.0, 200.0)),
        ("b", at(20.0, 200.0)),
    ];
    assert_eq!(found, expected);
    assert_eq!((sink.meshes.len(), sink.instances.len(), sink.direct().len()), (2, 5, 0));
}

/// Children stand once, by the transform of the node itself: instances are places of its mesh alone.
#[test]
fn children_of_nodes_with_instances_are_placed_once() {
    let mut document = Document::triangle();
    let moves = document.floats("VEC3", &[10.0, 0.0, 0.0, 20.0, 0.0, 0.0, 30.0, 0.0, 0.0]);
    document.json["nodes"] = json!([
        { "mesh": 0, "translation": [0, 5, 0], "scale": [2, 2, 2], "children": [1, 3] },
        { "mesh": 1, "translation": [0, 0, 1], "children": [2] },
        { "mesh": 1, "translation": [0, 0, 1] },
        { "mesh": 0, "translation": [0, 0, 50] }
    ]);
    document.mesh(json!([{ "attributes": { "POSITION": 0 } }]));
    document.instance(0, json!({ "TRANSLATION": moves }));
    let sink = document.read();
    let mut found: Vec<_> = sink.placed().map(|t| (t.part, t.positions[0])).collect();
    found.sort_by(|a, b| (a.0, a.1.x).partial_cmp(&(b.0, b.1.x)).unwrap());
    let at = |part: u32, x: f64, z: f64| (part, DVec3::new(x, 5.0, z));
    let expected =
        [at(0, 20.0, 0.0), at(0, 40.0, 0.0), at(0, 60.0, 0.0), at(1, 0.0, 2.0), at(2, 0.0, 4.0), at(3, 0.0, 100.0)];
    assert_eq!(found, expected);
}

/// Nodes that show a mesh in another shape, and flat instances, are placed directly.
#[test]
fn instances_that_cannot_share_the_mesh_are_placed_directly() {
    let mut document = Document::triangle();
    let up = document.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let moves = document.floats("VEC3", &[10.0, 0.0, 0.0, 20.0, 0.0, 0.0, 30.0, 0.0, 0.0]);
    let scales = document.floats("VEC3", &[1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    document.set("meshes/0/primitives/0/targets", json!([{ "POSITION": up }]));
    document.json["nodes"] = json!([{ "mesh": 0, "weights": [1.0] }, { "mesh": 0 }]);
    document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    document.instance(0, json!({ "TRANSLATION": moves }));
    document.instance(1, json!({ "TRANSLATION": moves, "SCALE": scales }));
    let sink = document.read();
    let first = |list: Vec<[DVec3; 3]>| list.iter().map(|t| t[0].to_array()).collect::<Vec<_>>();
    let expected = [[10.0, 0.0, 1.0], [20.0, 0.0, 1.0], [30.0, 0.0, 1.0], [20.0, 0.0, 0.0]];
    assert_eq!(first(positions(&sink)), expected);
    let shared: Vec<_> = sink.instances.iter().map(|i| i.world_from_mesh.translation.x).collect();
    assert_eq!(shared, [10.0, 30.0]);
    assert!(sink.notes.iter().any(|n| n.contains("1 placements of meshes are flattened")), "{:?}", sink.notes);
    // A skinned node stands at its joints, whatever the values of its instances.
    let mut document = Document::triangle();
    let joints = document.accessor(5121, "VEC4", 3, &[0; 12]);
    let weights = document.list("VEC4", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    document.set("meshes/0/primitives/0/attributes/JOINTS_0", json!(joints));
    document.set("meshes/0/primitives/0/attributes/WEIGHTS_0", json!(weights));
    document.set("nodes", json!([{ "mesh": 0, "skin": 0 }]));
    document.set("skins", json!([{ "joints": [0] }]));
    document.instance(0, json!({ "TRANSLATION": "none" }));
    let sink = document.read();
    assert_eq!(positions(&sink), [TRIANGLE]);
    assert!(
        sink.notes[0].contains("1 skinned nodes have instances, which were ignored (nodes[0])"),
        "{:?}",
        sink.notes
    );
}

/// An index that is none was taken as a missing attribute, and the mesh stood at zero without a word.
#[test]
fn malformed_attributes_are_named() {
    for (attributes, words) in [
        (json!({ "TRANSLATION": -1 }), "\"TRANSLATION\" is -1, not an index"),
        (json!({ "TRANSLATION": 0, "ROTATION": "1" }), "\"ROTATION\" is \"1\", not an index"),
        (json!({ "TRANSLATION": 0, "SCALE": 0.5 }), "\"SCALE\" is 0.5, not an index"),
        (json!({ "_ID": [0] }), "\"_ID\" is [0], not an index"),
        (json!({ "TRANSLATION": 77 }), "TRANSLATION: accessors[77] does not exist"),
        (json!({ "_ID": 77 }), "_ID: accessors[77] does not exist"),
        (json!(["TRANSLATION", 0]), "\"attributes\" is [\"TRANSLATION\",0], not an object"),
    ] {
        let error = refused("t.glb", instanced(attributes).glb());
        assert!(error.contains(&format!("nodes[0]: EXT_mesh_gpu_instancing: {words}")), "{words}: {error}");
    }
    let mut document = Document::triangle();
    document.set("nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": 3 }));
    let error = refused("t.glb", document.glb());
    assert!(error.contains("nodes[0]: EXT_mesh_gpu_instancing is 3, not an object"), "{error}");
    // What is missing is no error, also where the node shows nothing.
    assert_eq!(positions(&instanced(json!({ "TRANSLATION": null })).read()), [TRIANGLE]);
    assert_eq!(positions(&instanced(json!(null)).read()), [TRIANGLE]);
    let mut document = Document::triangle();
    document.json["nodes"] = json!([{ "children": [1] }, { "mesh": 0 }]);
    document.instance(0, json!({ "TRANSLATION": -1 }));
    assert_eq!(positions(&document.read()), [TRIANGLE]);
}

/// The numbers of elements must agree, also that of an attribute that is not read.
#[test]
fn attributes_of_different_length_are_named() {
    let mut document = instanced(json!({}));
    let two = document.list("VEC3", &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let turns = document.list("VEC4", &[0.0, 0.0, 0.0, 1.0]);
    let five = document.list("SCALAR", &[0.0, 1.0, 2.0, 3.0, 4.0]);
    for (attributes, words) in [
        (json!({ "TRANSLATION": two, "SCALE": 0 }), "3 elements of SCALE, but 2 of TRANSLATION"),
        (json!({ "TRANSLATION": two, "ROTATION": turns }), "1 elements of ROTATION, but 2 of TRANSLATION"),
        (json!({ "TRANSLATION": two, "_ID": five }), "2 elements of TRANSLATION, but 5 of _ID"),
        (json!({ "_A": five, "_B": two }), "5 elements of _A, but 2 of _B"),
    ] {
        document.instance(0, attributes);
        let error = refused("t.glb", document.glb());
        let words =
            format!("nodes[0]: EXT_mesh_gpu_instancing: the attributes differ in their number of elements: {words}");
        assert!(error.contains(&words), "{error}");
    }
}

/// The extension allows vectors of floats, and normalised bytes and shorts for rotations.
#[test]
fn types_of_components_that_are_not_allowed_are_named() {
    let (byte, short) = (5120, 5122);
    for (name, ty, component, normalized, words) in [
        ("TRANSLATION", "VEC3", byte, true, "normalised signed bytes"),
        ("TRANSLATION", "VEC3", 5125, false, "unsigned 32-bit integers"),
        ("SCALE", "VEC3", short, false, "signed 16-bit integers"),
        ("SCALE", "VEC3", 5123, true, "normalised unsigned 16-bit integers"),
        ("ROTATION", "VEC4", short, false, "signed 16-bit integers"),
        ("ROTATION", "VEC4", 5121, false, "unsigned bytes"),
        ("ROTATION", "VEC4", 5125, true, "normalised unsigned 32-bit integers"),
    ] {
        let mut document = instanced(json!({}));
        let at = document.accessor(component, ty, 1, &[1; 16]);
        document.json["accessors"][at]["normalized"] = json!(normalized);
        document.instance(0, json!({ name: at }));
        let error = refused("t.glb", document.glb());
        let words = format!("nodes[0]: EXT_mesh_gpu_instancing: {name}: accessors[{at}] has {words}");
        assert!(error.contains(&words), "{name} {component} {normalized}: {error}");
    }
    for (name, ty, words) in [
        ("TRANSLATION", "VEC4", "has 4 components; expected one of [3]"),
        ("ROTATION", "VEC3", "has 3 components; expected one of [4]"),
        ("SCALE", "SCALAR", "has 1 components; expected one of [3]"),
    ] {
        let mut document = instanced(json!({}));
        let at = document.list(ty, &[1.0; 12]);
        document.instance(0, json!({ name: at }));
        let error = refused("t.glb", document.glb());
        let words = format!("nodes[0]: EXT_mesh_gpu_instancing: {name}: accessors[{at}] {words}");
        assert!(error.contains(&words), "{error}");
    }
}

/// A turn by 90° about z, as each type of components that is read.
#[test]
fn rotations_are_read_in_each_type() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let words = |most: f64| [0, 0, (half * most).round() as i16, (half * most).round() as i16].map(i16::to_le_bytes);
    let floats = [0.0, 0.0, half as f32, half as f32].map(f32::to_le_bytes).concat();
    for (component, bytes, is_noted) in [
        (FLOAT, floats, false),
        (5120, vec![0, 0, 90, 90], false),
        (5122, words(32767.0).concat(), false),
        // Some programs write unsigned ones.
        (5121, vec![0, 0, 180, 180], true),
        (5123, words(32767.0).concat(), true),
    ] {
        let mut document = instanced(json!({}));
        let at = document.accessor(component, "VEC4", 1, &bytes);
        document.json["accessors"][at]["normalized"] = json!(component != FLOAT);
        document.instance(0, json!({ "ROTATION": at }));
        let sink = document.read();
        let turned = [DVec3::ZERO, DVec3::Y, -DVec3::X];
        let is_close = |(a, b): (&DVec3, &DVec3)| a.distance(*b) < 1e-6;
        assert!(sink.direct()[0].positions.iter().zip(&turned).all(is_close), "{component}: {:?}", positions(&sink));
        let words =
            "1 nodes have unsigned rotations of instances, which EXT_mesh_gpu_instancing does not allow (nodes[0])";
        assert_eq!(sink.notes.iter().any(|n| n.contains(words)), is_noted, "{component}: {:?}", sink.notes);
    }
}

/// Values that have no meaning as a transform name the node and the element.
#[test]
fn values_that_place_nothing_are_named() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for (name, ty, width) in [("TRANSLATION", "VEC3", 3), ("ROTATION", "VEC4", 4), ("SCALE", "VEC3", 3)] {
            let mut document = instanced(json!({}));
            let mut numbers = vec![1.0; 3 * width];
            numbers[2 * width + 1] = bad;
            let at = document.list(ty, &numbers);
            document.instance(0, json!({ name: at }));
            let error = refused("t.glb", document.glb());
            let words =
                format!("nodes[0]: EXT_mesh_gpu_instancing: element 2 of {name} (accessors[{at}]) is not finite");
            assert!(error.contains(&words), "{bad}: {error}");
        }
    }
    // Floats, and bytes of which the second rotation is zero.
    let floats = [0.0f32, 0.0, 0.0, 1.0, 0.0, -0.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
    for (component, bytes) in [(FLOAT, floats), (5120, vec![0, 0, 0, 127, 0, 0, 0, 0])] {
        let mut document = instanced(json!({}));
        let at = document.accessor(component, "VEC4", 2, &bytes);
        document.json["accessors"][at]["normalized"] = json!(component != FLOAT);
        document.instance(0, json!({ "ROTATION": at }));
        let error = refused("t.glb", document.glb());
        let words = format!("nodes[0]: EXT_mesh_gpu_instancing: element 1 of ROTATION (accessors[{at}]) is zero");
        assert!(error.contains(&words), "{component}: {error}");
    }
    // The least numbers are a rotation.
    let mut document = instanced(json!({}));
    let least = f32::from_bits(1);
    let at = document.list("VEC4", &[0.0, 0.0, 0.0, least, 0.0, 0.0, least, 0.0]);
    document.instance(0, json!({ "ROTATION": at }));
    let found: Vec<_> = document.read().placed().map(|t| t.positions[1]).collect();
    assert_eq!(found, [DVec3::X, -DVec3::X]);
}

/// The elements of one node are counted before they are read, and the error names a budget that suffices.
#[test]
fn elements_are_paid_for_before_they_are_read() {
    let count = 20_000;
    let mut document = two_primitives();
    let moves = document.list("VEC3", &vec![1.0; 3 * count]);
    let turns = document.list("VEC4", &vec![1.0; 4 * count]);
    document.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0 }]);
    document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    document.instance(1, json!({ "TRANSLATION": moves, "ROTATION": turns }));
    let folder = temporary();
    let path = folder.path().join("t.glb");
    std::fs::write(&path, document.glb()).unwrap();
    // Another table leaves 100 KB.
    let budget = 64 << 20;
    let read = |budget: u64| {
        let options = ReadOptions { account: Account::new(budget), ..ReadOptions::default() };
        options.account.add((56 << 20) - 100_000);
        let mut sink = Collector::new();
        read_file(&path, &options, &mut sink).map(|()| sink.instances.len())
    };
    let Err(Error::OverBudget { what, need, have }) = read(budget) else { panic!("the elements fit") };
    assert_eq!((what.as_str(), have), ("reading the 20000 instances of nodes[1]", budget));
    let bytes = 28 * count as u64;
    assert!(need > budget + bytes - 100_000 && need < budget + bytes, "{need}");
    assert_eq!(read(need).unwrap(), count + 1);
    assert!(matches!(read(need - 1), Err(Error::OverBudget { .. })));
}
