//! The nodes of the scene that have meshes, with their transforms and parents.

use crate::import::input::Parsed;
use ::gltf::json::Root;
use glam::{DAffine3, DVec3};

/// A node that has a mesh in its subtree.
pub(crate) struct Placed {
    pub(crate) node: usize,
    /// Index of the parent in the list; parents come before their children.
    pub(crate) parent: Option<usize>,
    pub(crate) world: DAffine3,
    pub(crate) mesh: Option<usize>,
    holds_mesh: bool,
}

/// Returns all placed nodes, parents first, in the order of the file. `local` holds the transform of each node.
///
/// A node that is reached twice is an error, also without a cycle: a graph with shared nodes can expand to an
/// exponentially large tree.
pub(crate) fn placed(root: &Root, local: &[DAffine3]) -> Parsed<Vec<Placed>> {
    let mut all: Vec<Placed> = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    let mut todo: Vec<(usize, Option<usize>)> = roots(root)?.into_iter().rev().map(|n| (n, None)).collect();
    while let Some((index, parent)) = todo.pop() {
        let Some(node) = root.nodes.get(index) else {
            return Err(format!("nodes[{index}] does not exist (there are {})", root.nodes.len()).into());
        };
        if std::mem::replace(&mut seen[index], true) {
            let ancestors = std::iter::successors(parent, |&p| all[p].parent);
            let why = match ancestors.into_iter().any(|p| all[p].node == index) {
                true => format!("nodes[{index}] is its own ancestor: the nodes form a cycle"),
                false => format!("nodes[{index}] has two parents"),
            };
            return Err(why.into());
        }
        let above = parent.map_or(DAffine3::IDENTITY, |p| all[p].world);
        let world = above * local.get(index).copied().unwrap_or(DAffine3::IDENTITY);
        let mesh = node.mesh.map(|m| m.value());
        if let Some(mesh) = mesh.filter(|&m| m >= root.meshes.len()) {
            return Err(
                format!("nodes[{index}]: meshes[{mesh}] does not exist (there are {})", root.meshes.len()).into()
            );
        }
        all.push(Placed { node: index, parent, world, mesh, holds_mesh: mesh.is_some() });
        let here = Some(all.len() - 1);
        let children = node.children.iter().flatten().rev();
        todo.extend(children.map(|child| (child.value(), here)));
    }
    Ok(with_meshes(all))
}

/// Returns the root nodes: of the default scene, else of the first scene, else the nodes without a parent.
fn roots(root: &Root) -> Parsed<Vec<usize>> {
    let index = root.scene.map(|s| s.value());
    if let Some(index) = index.filter(|&i| i >= root.scenes.len()) {
        return Err(format!("scenes[{index}] does not exist (there are {})", root.scenes.len()).into());
    }
    if let Some(scene) = root.scenes.get(index.unwrap_or(0)) {
        return Ok(scene.nodes.iter().map(|n| n.value()).collect());
    }
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|n| n.children.iter().flatten()) {
        if let Some(is_child) = is_child.get_mut(child.value()) {
            *is_child = true;
        }
    }
    let roots: Vec<usize> = (0..root.nodes.len()).filter(|&i| !is_child[i]).collect();
    match roots.is_empty() && !root.nodes.is_empty() {
        true => Err("every node is a child of another: the nodes form a cycle".into()),
        false => Ok(roots),
    }
}

/// Removes nodes without a mesh in their subtree, such as cameras, lights and bones.
fn with_meshes(mut all: Vec<Placed>) -> Vec<Placed> {
    for i in (0..all.len()).rev() {
        if let (true, Some(parent)) = (all[i].holds_mesh, all[i].parent) {
            all[parent].holds_mesh = true;
        }
    }
    let mut index = vec![0; all.len()];
    let mut kept: Vec<Placed> = Vec::new();
    for (i, mut placed) in all.into_iter().enumerate() {
        if placed.holds_mesh {
            placed.parent = placed.parent.map(|p| index[p]);
            index[i] = kept.len();
            kept.push(placed);
        }
    }
    kept
}

/// True if a transform has an inverse accurate enough for rays: it is finite, no axis is scaled to less than a
/// millionth of another, and the axes are not nearly coplanar.
pub(crate) fn inverts_well(m: &DAffine3) -> bool {
    let columns = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(DVec3::length);
    let (least, most) = columns.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &c| (a.min(c), b.max(c)));
    let volume = m.matrix3.determinant().abs();
    m.is_finite()
        && most > 0.0
        && least > 1e-6 * most
        && volume.is_finite()
        && volume > 1e-6 * columns.iter().product::<f64>()
}
