//! glTF 2.0: JSON with separate buffers, and GLB.
//!
//! Only the objects that are used are read ([`model`]), so that an error in any other data, which this reader does not
//! understand or need, never refuses a file. Indices and ranges are checked at their use, and the data of a primitive
//! is read piece by piece. An error is refused if it makes the geometry wrong; otherwise it is noted.
//!
//! - Each node that has a mesh in its subtree is a part, below the part of its parent node. A mesh with several
//!   primitives has a child part for each. Transforms are composed in double precision.
//! - A mesh that one node uses is placed directly. A mesh that is placed several times, by nodes or by
//!   `EXT_mesh_gpu_instancing`, becomes a shared mesh with instances, except where the transform has no accurate
//!   inverse: there it is placed directly too. Meshes with a pose of their own, skinned or morphed, are also placed
//!   directly.
//! - Triangles, strips and fans are read, with any type of index or none, from plain, sparse and quantised accessors.
//! - The pose is the default one: morph targets at the weights of the node or mesh, skinned vertices at the joints'
//!   nodes ([`pose`]). Animations are ignored.
//! - Materials: base colour, metalness and roughness (the mean of their texture), opacity by alpha mode. A texture or
//!   vertex colours give each triangle its mean colour ([`texture`]).
//! - The scene is the file's default scene, else its first, else all root nodes.

mod accessor;
mod buffers;
mod container;
mod extensions;
mod instancing;
mod json;
mod materials;
mod model;
mod notes;
mod parse;
mod pose;
mod primitive;
mod repair;
mod scene;
mod uri;

#[cfg(test)]
mod tests;

use super::access::Files;
use super::input::{Fault, Input, Parsed};
use super::texture;
use super::{MeshKey, PartDesc, PartKey, Sink, UpAxis};
use crate::base::account::Claim;
use crate::base::error::{Place, Result};
use crate::base::progress::Cancel;
use buffers::Buffers;
use glam::{DAffine3, DVec3};
use instancing::Instances;
use materials::Materials;
use model::{Model, Primitive};
use notes::Notes;
use pose::{Pose, Skins};
use primitive::{Emitter, Target};
use scene::Placed;
use std::collections::{HashMap, HashSet};

/// Reads a glTF or GLB file from its beginning.
pub(crate) fn read(input: &mut Input, files: &Files<'_>, sink: &mut dyn Sink) -> Result<()> {
    let document = container::read(input, files.options.account.claim(), sink.cancel())?;
    let path = input.path().to_path_buf();
    let mut notes = Notes::default();
    if document.has_other_texts {
        notes.add("file has texts that are not UTF-8, which are shown with replacement characters", String::new);
    }
    if document.is_repaired {
        notes.add("file has values that are not JSON (NaN, numbers out of range, more than 100 levels)", String::new);
    }
    let model = &document.model;
    if let Some(center) = model.center.filter(|center| *center != DVec3::ZERO) {
        notes.add("file has positions relative to a centre (CESIUM_RTC), which was added", || center.to_string());
    }
    let placed = extensions::check(model).and_then(|()| scene::placed(model, &mut notes, sink.cancel()));
    let placed = placed.map_err(|fault| fault.at(&path, Place::File))?;
    sink.units(Some(1.0), UpAxis::Y);
    let mut reader = Reader {
        model,
        placed: &placed,
        materials: Materials::new(files.options),
        skins: Skins::default(),
        emitter: Emitter::new(model, Buffers::new(input, &document, files, sink.cancel().clone()), notes),
    };
    reader.read(files.options.account.claim(), sink).map_err(|fault| fault.at(&path, Place::File))
}

/// Adds the name of the object in which an error arose.
fn within(name: &str, fault: Fault) -> Fault {
    match fault {
        Fault::Why(why) => Fault::Why(format!("{name}: {why}")),
        failed => failed,
    }
}

/// Names the instances of a node.
fn instances_of(placed: &Placed) -> String {
    format!("nodes[{}]: EXT_mesh_gpu_instancing", placed.node)
}

struct Reader<'a> {
    model: &'a Model,
    placed: &'a [Placed],
    materials: Materials,
    skins: Skins<'a>,
    emitter: Emitter<'a>,
}

/// The meshes that several nodes or instances can show.
#[derive(Default)]
struct Sharing {
    meshes: HashMap<usize, Shared>,
    /// Nodes with an instance that cannot show the shared mesh, by index in `placed`.
    with_flat: HashSet<usize>,
}

/// A mesh at the nodes that can show it.
#[derive(Default)]
struct Shared {
    /// Number of places, over all nodes.
    places: u64,
    /// Indices in `placed`.
    nodes: Vec<usize>,
}

impl<'a> Reader<'a> {
    fn read(&mut self, claim: Claim, sink: &mut dyn Sink) -> Parsed<()> {
        let _claim = self.pay_for_instances(claim, sink.cancel())?;
        let parts = self.declare(sink)?;
        let Sharing { meshes, with_flat } = self.sharing(sink.cancel())?;
        let mut is_shown = HashSet::new();
        for (i, placed) in self.placed.iter().enumerate() {
            sink.cancel().check()?;
            let Some(mesh) = placed.mesh else { continue };
            let shared = meshes.get(&mesh).filter(|shared| shared.places > 1);
            let shared = if self.has_own_pose(placed)? { None } else { shared };
            if shared.is_none() || with_flat.contains(&i) {
                let worlds = self.instances(placed)?;
                let direct = |world: &DAffine3| shared.is_none() || !scene::inverts_well(world);
                for world in worlds.worlds(placed.world).filter(direct) {
                    sink.cancel().check()?;
                    self.direct(placed, mesh, world, parts[i], sink)?;
                }
            }
            if let Some(shared) = shared.filter(|_| is_shown.insert(mesh)) {
                self.shared(mesh, &shared.nodes, &parts, sink)?;
            }
        }
        self.emitter.flush(sink)?;
        self.report(sink);
        Ok(())
    }

    /// Declares a part for each placed node, and one for each primitive of a mesh with several. Returns the part of
    /// each node's first primitive; for a node with fewer than two primitives this is the node's own part.
    fn declare(&mut self, sink: &mut dyn Sink) -> Parsed<Vec<PartKey>> {
        let mut own: Vec<PartKey> = Vec::with_capacity(self.placed.len());
        let mut first = Vec::with_capacity(self.placed.len());
        for placed in self.placed {
            sink.cancel().check()?;
            let primitives = match placed.mesh {
                Some(mesh) => &self.model.meshes.get(mesh)?.primitives[..],
                None => &[],
            };
            let parent = placed.parent.map(|p| own[p]);
            let material = match primitives {
                [Ok(one)] => self.material(one, sink)?,
                _ => None,
            };
            let part = sink.part(PartDesc { name: self.name(placed)?, parent, material, id: None })?;
            own.push(part);
            let mut children = Vec::new();
            for (i, primitive) in primitives.iter().enumerate().filter(|_| primitives.len() > 1) {
                let primitive = primitive.as_ref().ok();
                let material = match primitive {
                    Some(primitive) => self.material(primitive, sink)?,
                    None => None,
                };
                let named = primitive.and_then(|p| self.model.materials.find(p.material?)?.name.as_deref());
                let name = named.map_or_else(|| format!("primitive {i}"), str::to_owned);
                children.push(sink.part(PartDesc { name, parent: Some(part), material, id: None })?);
            }
            first.push(children.first().copied().unwrap_or(part));
        }
        Ok(first)
    }

    fn material(&mut self, primitive: &Primitive, sink: &mut dyn Sink) -> Parsed<Option<u32>> {
        let Some(index) = primitive.material else { return Ok(None) };
        Ok(self.emitter.looks(index, &mut self.materials, sink)?.map(|looks| looks.key))
    }

    fn name(&self, placed: &Placed) -> Parsed<String> {
        let node = self.model.nodes.get(placed.node)?;
        let mesh = placed.mesh.and_then(|mesh| self.model.meshes.find(mesh)?.name.as_deref());
        Ok(node.name.as_deref().or(mesh).map_or_else(|| format!("node {}", placed.node), str::to_owned))
    }

    /// Counts the memory of the elements of instances: those of the node with the most. Fails if it does not fit, or if
    /// the accessors of a node are not as they must be.
    fn pay_for_instances(&mut self, mut claim: Claim, cancel: &Cancel) -> Parsed<Claim> {
        let (mut most, mut of) = (0, (0, 0));
        for placed in self.placed.iter().filter(|placed| placed.mesh.is_some()) {
            cancel.check()?;
            let example = || format!("nodes[{}]", placed.node);
            if self.is_skinned(placed)? && self.has_instances(placed)? {
                self.emitter.notes.add("skinned nodes have instances, which were ignored", example);
            }
            let Some(accessors) = self.accessors(placed)? else { continue };
            if accessors.has_unsigned_rotations {
                let text = "nodes have unsigned rotations of instances, which EXT_mesh_gpu_instancing does not allow";
                self.emitter.notes.add(text, example);
            }
            if accessors.bytes() > most {
                (most, of) = (accessors.bytes(), (accessors.count, placed.node));
            }
        }
        let (count, node) = of;
        match most == 0 || claim.grow(most) {
            true => Ok(claim),
            false => Err(claim.over(1.0, 0, format!("reading the {count} instances of nodes[{node}]")).into()),
        }
    }

    /// True if the node has attributes of instances, or something else in their place.
    fn has_instances(&self, placed: &Placed) -> Parsed<bool> {
        Ok(self.model.nodes.get(placed.node)?.instancing.as_ref().map_or(true, |attributes| !attributes.is_empty()))
    }

    /// Opens the accessors of the instances of a node. `None` if it places its mesh once.
    fn accessors(&mut self, placed: &Placed) -> Parsed<Option<instancing::Accessors>> {
        if !self.has_instances(placed)? || self.is_skinned(placed)? {
            return Ok(None);
        }
        let attributes = self.model.nodes.get(placed.node)?.instancing.as_ref();
        let attributes = attributes.map_err(|why| format!("nodes[{}]: {why}", placed.node))?;
        let accessors = instancing::Accessors::open(self.model, attributes, self.emitter.buffers());
        Ok(Some(accessors.map_err(|fault| within(&instances_of(placed), fault))?))
    }

    /// Reads the instances of a node.
    fn instances(&mut self, placed: &Placed) -> Parsed<Instances> {
        let Some(accessors) = self.accessors(placed)? else { return Ok(Instances::ONE) };
        accessors.read(self.emitter.buffers()).map_err(|fault| within(&instances_of(placed), fault))
    }

    /// Finds, for each mesh with triangles, the nodes with places where an instance can show it.
    fn sharing(&mut self, cancel: &Cancel) -> Parsed<Sharing> {
        let mut sharing = Sharing::default();
        for (i, placed) in self.placed.iter().enumerate() {
            cancel.check()?;
            let Some(index) = placed.mesh else { continue };
            let mesh = self.model.meshes.get(index)?;
            if self.has_own_pose(placed)? || !mesh.primitives.iter().flatten().any(Primitive::has_area) {
                continue;
            }
            let (mut places, mut flat) = (0, 0);
            for world in self.instances(placed)?.worlds(placed.world) {
                cancel.check()?;
                *(if scene::inverts_well(&world) { &mut places } else { &mut flat }) += 1;
            }
            let shared = sharing.meshes.entry(index).or_default();
            shared.places += places;
            shared.nodes.extend((places > 0).then_some(i));
            sharing.with_flat.extend((flat > 0).then_some(i));
        }
        Ok(sharing)
    }

    /// True if the node shows its mesh in another shape than other nodes.
    fn has_own_pose(&self, placed: &Placed) -> Parsed<bool> {
        let Some(mesh) = placed.mesh else { return Ok(false) };
        let (node, mesh) = (self.model.nodes.get(placed.node)?, self.model.meshes.get(mesh)?);
        let is_morphed = || mesh.primitives.iter().flatten().any(|primitive| !primitive.targets.is_empty());
        let has_weights = node.weights.as_ref().is_some_and(|weights| *weights != mesh.weights);
        Ok(has_weights && is_morphed() || self.is_skinned(placed)?)
    }

    fn is_skinned(&self, placed: &Placed) -> Parsed<bool> {
        let Some(mesh) = placed.mesh else { return Ok(false) };
        let mesh = self.model.meshes.get(mesh)?;
        let has_skin = self.model.nodes.get(placed.node)?.skin.is_some();
        Ok(has_skin && mesh.primitives.iter().flatten().any(pose::is_skinned))
    }

    /// Places the triangles of a mesh in the world, in the pose of a node.
    fn direct(
        &mut self,
        placed: &Placed,
        index: usize,
        world: DAffine3,
        first: PartKey,
        sink: &mut dyn Sink,
    ) -> Parsed<()> {
        let (node, mesh) = (self.model.nodes.get(placed.node)?, self.model.meshes.get(index)?);
        let name = || format!("nodes[{}]", placed.node);
        let joints = match node.skin {
            Some(skin) if self.is_skinned(placed)? => {
                self.emitter.notes.add("skinned meshes stand in the pose of their joints", name);
                Some(self.skins.joints(skin, self.model, self.emitter.buffers())?)
            }
            _ => None,
        };
        if joints.is_none() && !scene::inverts_well(&world) {
            self.emitter.notes.add("placements of meshes are flattened: their transform has no accurate inverse", name);
        }
        let weights = node.weights.as_ref().unwrap_or(&mesh.weights).as_ref().into();
        let target = Target { mesh: MeshKey::DIRECT, first_part: first, world: Some(world) };
        self.mesh(index, target, &Pose { weights, joints }, sink)
    }

    /// Shows a mesh at all places of `nodes` where an instance can show it.
    fn shared(&mut self, index: usize, nodes: &[usize], parts: &[PartKey], sink: &mut dyn Sink) -> Parsed<()> {
        let mesh = self.model.meshes.get(index)?;
        let key = sink.shared_mesh(mesh.primitives.len() as u32)?;
        let pose = Pose { weights: mesh.weights.as_ref().into(), joints: None };
        self.mesh(index, Target { mesh: key, first_part: 0, world: None }, &pose, sink)?;
        self.emitter.flush(sink)?;
        for &node in nodes {
            let instances = self.instances(&self.placed[node])?;
            for world in instances.worlds(self.placed[node].world).filter(scene::inverts_well) {
                sink.cancel().check()?;
                sink.instance(key, world, parts[node])?;
            }
        }
        Ok(())
    }

    fn mesh(&mut self, index: usize, target: Target, pose: &Pose, sink: &mut dyn Sink) -> Parsed<()> {
        for (i, primitive) in self.model.meshes.get(index)?.primitives.iter().enumerate() {
            let name = format!("meshes[{index}].primitives[{i}]");
            let primitive = primitive.as_ref().map_err(|why| format!("{name} {why}"))?;
            let part = Target { first_part: target.first_part + i as u32, ..target };
            self.emitter.primitive(primitive, &name, part, pose, &mut self.materials, sink)?;
        }
        Ok(())
    }

    fn report(&mut self, sink: &mut dyn Sink) {
        let file = self.emitter.buffers().path().display().to_string();
        for text in self.emitter.notes.texts() {
            sink.note(format!("{file}: {text}"));
        }
        if self.model.animations.len() > 0 {
            sink.note(format!("{file}: {} animations were ignored", self.model.animations.len()));
        }
        if self.emitter.is_empty() {
            sink.note(format!("{file}: no triangles; the model is empty"));
        }
    }
}
