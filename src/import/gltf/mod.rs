//! glTF 2.0: JSON with separate buffers, and GLB.
//!
//! The `gltf` crate parses the JSON. Its readers of nodes and accessors rely on its validation, which refuses files for
//! errors in data that this crate does not use, and accepts ranges that end outside of their buffer. This module
//! therefore checks indices and ranges at their use, and reads the data of a primitive piece by piece.
//!
//! - Each node that has a mesh in its subtree is a part, below the part of its parent node. A mesh with several
//!   primitives has a child part for each. Transforms are composed in double precision.
//! - A mesh that one node uses is placed directly. A mesh that several nodes use becomes a shared mesh with instances,
//!   except at nodes with a transform that has no accurate inverse: there it is placed directly too.
//! - Triangles, strips and fans are read, with any type of index or none, from plain, sparse and quantised accessors.
//! - Materials: base colour, metalness and roughness (the mean of their texture), opacity by alpha mode. A texture or
//!   vertex colours give each triangle its mean colour ([`texture`]).
//! - The scene is the file's default scene, else its first, else all root nodes. Skins stay in their bind pose; morph
//!   targets and animations are ignored.

mod accessor;
mod buffers;
mod container;
mod materials;
mod primitive;
mod scene;

#[cfg(test)]
mod tests;

use super::input::{Input, Parsed};
use super::texture;
use super::{PartDesc, PartKey, Sink, UpAxis};
use crate::base::error::{Place, Result};
use ::gltf::json::{Root, mesh::Primitive, validation::Checked};
use buffers::Buffers;
use glam::DAffine3;
use materials::Materials;
use primitive::{Emitter, Target};
use scene::Placed;

/// Reads a glTF or GLB file from its beginning.
pub(crate) fn read(input: &mut Input, sink: &mut dyn Sink) -> Result<()> {
    let document = container::read(input)?;
    let path = input.path().to_path_buf();
    let placed = scene::placed(&document.root, &document.local).map_err(|fault| fault.at(&path, Place::File))?;
    sink.units(Some(1.0), UpAxis::Y);
    let mut reader = Reader {
        root: &document.root,
        placed: &placed,
        materials: Materials::default(),
        emitter: Emitter::new(&document.root, Buffers::new(input, &document, sink.cancel().clone())),
    };
    reader.read(sink).map_err(|fault| fault.at(&path, Place::File))
}

struct Reader<'a> {
    root: &'a Root,
    placed: &'a [Placed],
    materials: Materials,
    emitter: Emitter<'a>,
}

impl Reader<'_> {
    fn read(&mut self, sink: &mut dyn Sink) -> Parsed<()> {
        let parts = self.declare(sink)?;
        let mut uses: Vec<Vec<usize>> = vec![Vec::new(); self.root.meshes.len()];
        for (i, placed) in self.placed.iter().enumerate() {
            if let Some(mesh) = placed.mesh {
                uses[mesh].push(i);
            }
        }
        for (i, placed) in self.placed.iter().enumerate() {
            let Some(mesh) = placed.mesh else { continue };
            let invertible = |&i: &usize| scene::inverts_well(&self.placed[i].world);
            let shared: Vec<usize> = uses[mesh].iter().copied().filter(invertible).collect();
            if shared.len() < 2 || !invertible(&i) || !self.has_area(mesh) {
                self.direct(mesh, placed.world, parts[i], sink)?;
            } else if shared[0] == i {
                self.shared(mesh, shared.iter().map(|&i| (self.placed[i].world, parts[i])), sink)?;
            }
        }
        self.emitter.finish(sink)?;
        self.report(sink);
        Ok(())
    }

    /// Declares a part for each placed node, and one for each primitive of a mesh with several. Returns the part of
    /// each node's first primitive; for a node with fewer than two primitives this is the node's own part.
    fn declare(&mut self, sink: &mut dyn Sink) -> Parsed<Vec<PartKey>> {
        let mut own: Vec<PartKey> = Vec::with_capacity(self.placed.len());
        let mut first = Vec::with_capacity(self.placed.len());
        for placed in self.placed {
            let primitives = placed.mesh.map_or(&[][..], |m| &self.root.meshes[m].primitives[..]);
            let parent = placed.parent.map(|p| own[p]);
            let material = match primitives {
                [one] => self.material(one, sink)?,
                _ => None,
            };
            let part = sink.part(PartDesc { name: self.name(placed), parent, material, id: None })?;
            own.push(part);
            let mut children = Vec::new();
            for (i, primitive) in primitives.iter().enumerate().filter(|_| primitives.len() > 1) {
                let material = self.material(primitive, sink)?;
                let named = primitive.material.and_then(|m| self.root.materials.get(m.value())?.name.clone());
                let name = named.unwrap_or_else(|| format!("primitive {i}"));
                children.push(sink.part(PartDesc { name, parent: Some(part), material, id: None })?);
            }
            first.push(children.first().copied().unwrap_or(part));
        }
        Ok(first)
    }

    fn material(&mut self, primitive: &Primitive, sink: &mut dyn Sink) -> Parsed<Option<u32>> {
        let Some(index) = primitive.material else { return Ok(None) };
        let looks = self.materials.get(index.value(), self.root, self.emitter.buffers(), sink)?;
        Ok(Some(looks.key))
    }

    fn name(&self, placed: &Placed) -> String {
        let node = &self.root.nodes[placed.node];
        let mesh = placed.mesh.and_then(|m| self.root.meshes[m].name.as_ref());
        node.name.as_ref().or(mesh).cloned().unwrap_or_else(|| format!("node {}", placed.node))
    }

    /// True if the mesh has primitives with triangles.
    fn has_area(&self, mesh: usize) -> bool {
        let draws = |p: &Primitive| matches!(p.mode, Checked::Valid(mode) if primitive::has_area(mode));
        self.root.meshes[mesh].primitives.iter().any(draws)
    }

    fn direct(&mut self, mesh: usize, world: DAffine3, first: PartKey, sink: &mut dyn Sink) -> Parsed<()> {
        let target = Target { mesh: super::MeshKey::DIRECT, first_part: first, world: Some(world) };
        self.mesh(mesh, target, sink)
    }

    fn shared(
        &mut self,
        mesh: usize,
        places: impl Iterator<Item = (DAffine3, PartKey)>,
        sink: &mut dyn Sink,
    ) -> Parsed<()> {
        let key = sink.shared_mesh(self.root.meshes[mesh].primitives.len() as u32)?;
        self.mesh(mesh, Target { mesh: key, first_part: 0, world: None }, sink)?;
        self.emitter.flush(sink)?;
        for (world, first) in places {
            sink.instance(key, world, first)?;
        }
        Ok(())
    }

    fn mesh(&mut self, mesh: usize, target: Target, sink: &mut dyn Sink) -> Parsed<()> {
        for (i, primitive) in self.root.meshes[mesh].primitives.iter().enumerate() {
            let material = match primitive.material {
                Some(m) => Some(self.materials.get(m.value(), self.root, self.emitter.buffers(), sink)?),
                None => None,
            };
            let part = Target { first_part: target.first_part + i as u32, ..target };
            let name = format!("meshes[{mesh}].primitives[{i}]");
            self.emitter.primitive(primitive, &name, part, material, &mut self.materials, sink)?;
        }
        Ok(())
    }

    fn report(&mut self, sink: &mut dyn Sink) {
        let file = self.emitter.buffers().path().display().to_string();
        for text in self.emitter.notes() {
            sink.note(format!("{file}: {text}"));
        }
    }
}
