//! Writes GLB files of glTF 2.0: meshes of shared vertices in single precision, and a tree of nodes.

use super::shapes::Shape;
use crate::failure::Failure;
use glam::{DAffine3, DMat4};
use serde_json::{Value, json};

/// A node of the scene.
#[derive(Debug, Clone)]
pub struct Node {
    pub name: String,
    /// To the node above it.
    pub place: DAffine3,
    /// Index of its mesh.
    pub mesh: Option<usize>,
    pub below: Vec<Node>,
}

impl Node {
    pub fn mesh(name: &str, place: DAffine3, mesh: usize) -> Self {
        Self { name: name.into(), place, mesh: Some(mesh), below: Vec::new() }
    }
}

/// glTF's numbers for kinds of components and of buffers.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// The bytes of a file with these meshes, named, and these roots.
pub fn write(meshes: &[(&str, Shape)], roots: &[Node]) -> Result<Vec<u8>, Failure> {
    let (mut binary, mut views, mut accessors, mut described) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (name, shape) in meshes {
        let vertices: Vec<[f32; 3]> = shape.vertices.iter().map(|v| v.as_vec3().to_array()).collect();
        let end = |pick: fn(f32, f32) -> f32| {
            vertices.iter().copied().reduce(|a, b| std::array::from_fn(|k| pick(a[k], b[k])))
        };
        let first = accessors.len();
        let mut add = |bytes: Vec<u8>, target: u32, mut accessor: Value| {
            accessor["bufferView"] = views.len().into();
            views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "target": target }));
            accessors.push(accessor);
            binary.extend(bytes);
        };
        let (min, max) = (end(f32::min), end(f32::max));
        let positions =
            json!({ "componentType": FLOAT, "type": "VEC3", "count": vertices.len(), "min": min, "max": max });
        add(vertices.iter().flatten().flat_map(|x| x.to_le_bytes()).collect(), ARRAY_BUFFER, positions);
        let indices = json!({ "componentType": UNSIGNED_INT, "type": "SCALAR", "count": 3 * shape.triangles.len() });
        add(shape.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()).collect(), ELEMENT_ARRAY_BUFFER, indices);
        let primitive = json!({ "attributes": { "POSITION": first }, "indices": first + 1 });
        described.push(json!({ "name": name, "primitives": [primitive] }));
    }
    let mut nodes = Vec::new();
    let roots: Vec<usize> = roots.iter().map(|root| add_node(root, &mut nodes)).collect();
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": roots }],
        "nodes": nodes,
        "meshes": described,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    let mut text = serde_json::to_vec(&document).map_err(|e| e.to_string())?;
    text.resize(text.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + text.len() + 8 + binary.len();
    let words = |all: [usize; 2]| all.map(|n| (n as u32).to_le_bytes()).concat();
    Ok([b"glTF".to_vec(), words([2, length]), words([text.len(), JSON]), text, words([binary.len(), BINARY]), binary]
        .concat())
}

/// Kinds of chunks: "JSON" and "BIN" as words.
const JSON: usize = 0x4e4f_534a;
const BINARY: usize = 0x004e_4942;

/// Adds a node after all below it; its index.
fn add_node(node: &Node, to: &mut Vec<Value>) -> usize {
    let below: Vec<usize> = node.below.iter().map(|node| add_node(node, to)).collect();
    let mut value = json!({ "name": node.name, "matrix": DMat4::from(node.place).to_cols_array() });
    if !below.is_empty() {
        value["children"] = below.into();
    }
    if let Some(mesh) = node.mesh {
        value["mesh"] = mesh.into();
    }
    to.push(value);
    to.len() - 1
}
