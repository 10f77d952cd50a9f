//! The nodes of the scene that have meshes, with their transforms and parents.

use super::model::{Model, Node};
use super::notes::Notes;
use crate::base::progress::Cancel;
use crate::import::input::Parsed;
use glam::{DAffine3, DVec3};
use std::collections::HashMap;

/// A node that has a mesh in its subtree.
pub(crate) struct Placed {
    pub(crate) node: usize,
    /// Index of the parent in the list; parents come before their children.
    pub(crate) parent: Option<usize>,
    pub(crate) world: DAffine3,
    pub(crate) mesh: Option<usize>,
    holds_mesh: bool,
    is_hidden: bool,
}

/// Returns all placed nodes, parents first, in the order of the file.
///
/// A node that is reached twice is an error, also without a cycle: a graph with shared nodes can expand to an
/// exponentially large tree.
pub(crate) fn placed(model: &Model, notes: &mut Notes, cancel: &Cancel) -> Parsed<Vec<Placed>> {
    let mut all: Vec<Placed> = Vec::new();
    let mut seen = vec![false; model.nodes.len()];
    let mut todo: Vec<(usize, Option<usize>)> = roots(model)?.into_iter().rev().map(|n| (n, None)).collect();
    while let Some((index, parent)) = todo.pop() {
        cancel.check()?;
        let node = model.nodes.get(index)?;
        if std::mem::replace(&mut seen[index], true) {
            let ancestors = std::iter::successors(parent, |&p| all[p].parent);
            let why = match ancestors.into_iter().any(|p| all[p].node == index) {
                true => format!("nodes[{index}] is its own ancestor: the nodes form a cycle"),
                false => format!("nodes[{index}] has two parents"),
            };
            return Err(why.into());
        }
        let above = parent.map(|p| &all[p]);
        let world = above.map_or(model.world(), |p| p.world) * local(node);
        if node.has_negative {
            notes.add("nodes refer to mesh or skin -1, which was taken as none", || format!("nodes[{index}]"));
        }
        let is_hidden = !node.is_visible || above.is_some_and(|p| p.is_hidden);
        let mesh = node.mesh.filter(|_| !is_hidden);
        if let Some(mesh) = mesh {
            model.meshes.get(mesh).map_err(|fault| super::within(&format!("nodes[{index}]"), fault))?;
        }
        if is_hidden && node.mesh.is_some() {
            notes.add("nodes with meshes are invisible and were left out", || format!("nodes[{index}]"));
        }
        all.push(Placed { node: index, parent, world, mesh, holds_mesh: mesh.is_some(), is_hidden });
        let here = Some(all.len() - 1);
        todo.extend(node.children.iter().rev().map(|&child| (child, here)));
    }
    for (index, _) in model.nodes.iter().filter(|(index, node)| !seen[*index] && node.mesh.is_some()) {
        notes.add("nodes with meshes are not in the scene and were left out", || format!("nodes[{index}]"));
    }
    let all = with_meshes(all, cancel)?;
    for placed in &all {
        cancel.check()?;
        if let Err(why) = &model.nodes.get(placed.node)?.local {
            return Err(format!("nodes[{}]: {why}", placed.node).into());
        }
    }
    Ok(all)
}

/// Returns the transform of a node to its parent. A malformed one, which matters only above meshes, is the identity.
fn local(node: &Node) -> DAffine3 {
    node.local.as_ref().map_or(DAffine3::IDENTITY, |local| *local)
}

/// Returns the root nodes: of the default scene, else of the first scene, else the nodes without a parent.
fn roots(model: &Model) -> Parsed<Vec<usize>> {
    match model.scene {
        Some(index) => return Ok(model.scenes.get(index)?.clone()),
        None if model.scenes.len() > 0 => return Ok(model.scenes.get(0)?.clone()),
        None => {}
    }
    let parents = parents(model);
    let roots: Vec<usize> = (0..parents.len()).filter(|&i| parents[i].is_none()).collect();
    match roots.is_empty() && !parents.is_empty() {
        true => Err("every node is a child of another: the nodes form a cycle".into()),
        false => Ok(roots),
    }
}

/// Returns the parent of each node of the document, also of those outside of the scene.
fn parents(model: &Model) -> Vec<Option<usize>> {
    let mut parents = vec![None; model.nodes.len()];
    for (index, child) in model.nodes.iter().flat_map(|(i, node)| node.children.iter().map(move |&child| (i, child))) {
        if let Some(parent) = parents.get_mut(child) {
            *parent = Some(index);
        }
    }
    parents
}

/// Transforms of any nodes to the world, also of nodes outside of the scene.
pub(crate) struct Worlds<'m> {
    model: &'m Model,
    parents: Vec<Option<usize>>,
    known: HashMap<usize, DAffine3>,
}

impl<'m> Worlds<'m> {
    pub(crate) fn new(model: &'m Model) -> Self {
        Self { model, parents: parents(model), known: HashMap::new() }
    }

    /// Returns the transform of a node to the world.
    pub(crate) fn of(&mut self, index: usize) -> Parsed<DAffine3> {
        self.model.nodes.get(index)?;
        let mut chain = Vec::new();
        let mut at = Some(index);
        while let Some(node) = at.filter(|node| !self.known.contains_key(node)) {
            if chain.len() > self.parents.len() {
                return Err(format!("nodes[{index}] is its own ancestor: the nodes form a cycle").into());
            }
            chain.push(node);
            at = self.parents[node];
        }
        let mut world = at.and_then(|known| self.known.get(&known)).copied().unwrap_or(self.model.world());
        for node in chain.into_iter().rev() {
            let local = self.model.nodes.get(node)?.local.as_ref().map_err(|why| format!("nodes[{node}]: {why}"))?;
            world *= *local;
            self.known.insert(node, world);
        }
        Ok(world)
    }
}

/// Removes nodes without a mesh in their subtree, such as cameras, lights and bones.
fn with_meshes(mut all: Vec<Placed>, cancel: &Cancel) -> Parsed<Vec<Placed>> {
    for i in (0..all.len()).rev() {
        cancel.check()?;
        if let (true, Some(parent)) = (all[i].holds_mesh, all[i].parent) {
            all[parent].holds_mesh = true;
        }
    }
    let mut index = vec![0; all.len()];
    let mut kept: Vec<Placed> = Vec::new();
    for (i, mut placed) in all.into_iter().enumerate() {
        cancel.check()?;
        if placed.holds_mesh {
            placed.parent = placed.parent.map(|p| index[p]);
            index[i] = kept.len();
            kept.push(placed);
        }
    }
    Ok(kept)
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
        && volume.is_normal()
        && volume.recip().is_normal()
        && volume > 1e-6 * columns.iter().product::<f64>()
}
