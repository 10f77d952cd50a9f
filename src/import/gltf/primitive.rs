//! Conversion of a primitive, from its accessors to triangles in the sink.

use super::accessor::Elements;
use super::buffers::Buffers;
use super::materials::{Looks, Materials};
use super::model::{Mode, Model, Primitive};
use super::notes::Notes;
use super::pose::{self, Pose, Positions};
use super::texture::{Mapping, Texture};
use crate::import::batch::{Batch, Corners};
use crate::import::input::{Fault, Parsed};
use crate::import::{MaterialDesc, MeshKey, Sink};
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use std::rc::Rc;

/// Destination of a mesh.
#[derive(Clone, Copy)]
pub(crate) struct Target {
    pub(crate) mesh: MeshKey,
    /// Part of the primitive: a part of the model, or a local part in a shared mesh.
    pub(crate) first_part: u32,
    /// Transform to the world; `None` keeps mesh coordinates.
    pub(crate) world: Option<DAffine3>,
}

/// Vertex data of a primitive.
struct Vertices {
    positions: Positions,
    /// Linear colours of `COLOR_0`.
    colours: Option<Vec<[f32; 3]>>,
    texture: Option<(Rc<Texture>, Mapping, Vec<[f32; 2]>)>,
    factor: [f32; 3],
    normals: Option<Vec<[f32; 3]>>,
    /// Transform of the positions to the world; `None` if they keep their coordinates.
    world: Option<DAffine3>,
    /// Transform of the normals to the world.
    across: Option<DMat3>,
}

/// Reads primitives and sends their triangles to the sink.
pub(crate) struct Emitter<'a> {
    model: &'a Model,
    buffers: Buffers<'a>,
    batch: Batch,
    triangles: u64,
    pub(crate) notes: Notes,
}

impl<'a> Emitter<'a> {
    pub(crate) fn new(model: &'a Model, buffers: Buffers<'a>, notes: Notes) -> Self {
        Self { model, buffers, batch: Batch::new(0), triangles: 0, notes }
    }

    pub(crate) fn buffers(&mut self) -> &mut Buffers<'a> {
        &mut self.buffers
    }

    /// Returns material `index`, and declares it at first use.
    pub(crate) fn looks(
        &mut self,
        index: usize,
        materials: &mut Materials,
        sink: &mut dyn Sink,
    ) -> Parsed<Option<Looks>> {
        materials.get(index, self.model, &mut self.buffers, &mut self.notes, sink)
    }

    pub(crate) fn flush(&mut self, sink: &mut dyn Sink) -> Parsed<()> {
        Ok(self.batch.flush(sink)?)
    }

    /// True if no triangle was read.
    pub(crate) fn is_empty(&self) -> bool {
        self.triangles == 0
    }

    /// Reads one primitive into part `target.first_part`. Errors refer to the primitive by `name`.
    pub(crate) fn primitive(
        &mut self,
        primitive: &Primitive,
        name: &str,
        target: Target,
        pose: &Pose,
        materials: &mut Materials,
        sink: &mut dyn Sink,
    ) -> Parsed<()> {
        if primitive.mode == Mode::WithoutArea {
            self.notes.add("primitives of points or lines make no triangles", || name.into());
            return Ok(());
        }
        let Some(positions) = primitive.attribute("POSITION") else {
            self.notes.add("primitives have no positions and were left out", || name.into());
            return Ok(());
        };
        let named = |fault| super::within(name, fault);
        self.has_plain_data(primitive).map_err(named)?;
        let looks = match primitive.material {
            Some(index) => self.looks(index, materials, sink)?,
            None => None,
        };
        let positions = pose::positions(self.model, primitive, positions, pose, &mut self.buffers).map_err(named)?;
        let world = target.world.filter(|_| !matches!(positions, Positions::Skinned(_)));
        let across = world.map(|world| {
            let [x, y, z] = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis];
            DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
        });
        let mut vertices =
            Vertices { positions, colours: None, texture: None, factor: [1.0; 3], normals: None, world, across };
        // Normals of a mesh in another pose are not those of its vertices.
        if let (Positions::AsStored(_), Some(index)) = (&vertices.positions, primitive.attribute("NORMAL")) {
            let list = self.attribute::<3>(index, &[3], vertices.positions.len());
            vertices.normals = self.noted(list, "primitives have invalid normals, which were left out", name)?;
        }
        self.colour(primitive, name, &looks, &mut vertices, materials, sink)?;
        let colour = looks.map_or(MaterialDesc::default().colour, |l| l.colour);
        self.batch.aim(target.mesh, target.first_part, colour, sink)?;
        self.batch.with_normals(vertices.normals.is_some(), sink)?;
        self.assemble(primitive, name, &vertices, sink).map_err(named)
    }

    /// Fails if the primitive has its data only in a compressed form.
    fn has_plain_data(&self, primitive: &Primitive) -> Parsed<()> {
        let accessors = primitive.attribute("POSITION").into_iter().chain(primitive.indices);
        let mut accessors = accessors.filter_map(|index| self.model.accessors.find(index));
        match primitive.is_draco && accessors.any(|a| a.view.is_none() && a.sparse.is_none()) {
            true => Err("has data only for KHR_draco_mesh_compression, which is not supported".into()),
            false => Ok(()),
        }
    }

    /// Reads vertex colours and texture coordinates. Invalid ones are noted and left out.
    fn colour(
        &mut self,
        primitive: &Primitive,
        name: &str,
        looks: &Option<Looks>,
        vertices: &mut Vertices,
        materials: &mut Materials,
        sink: &mut dyn Sink,
    ) -> Parsed<()> {
        let count = vertices.positions.len();
        if let Some(index) = primitive.attribute("COLOR_0") {
            let list = self.attribute::<3>(index, &[3, 4], count);
            vertices.colours = self.noted(list, "primitives have invalid colours, which were left out", name)?;
        }
        let Some(looks) = looks else { return Ok(()) };
        vertices.factor = looks.colour;
        if let Some(painted) = looks.texture
            && let Some(coordinates) = primitive.attribute(&format!("TEXCOORD_{}", painted.set))
            && let Some(decoded) =
                materials.texture(painted.texture, painted.alpha, self.model, &mut self.buffers, sink)?
        {
            let list = self.attribute::<2>(coordinates, &[2], count);
            let list = self.noted(list, "primitives have invalid texture coordinates, and no texture", name)?;
            vertices.texture = list.map(|list| (decoded, painted.mapping, list));
        }
        Ok(())
    }

    fn attribute<const N: usize>(&mut self, index: usize, widths: &[usize], count: usize) -> Parsed<Vec<[f32; N]>> {
        let list = Elements::open(self.model, index, widths, &mut self.buffers)?.floats::<N>(&mut self.buffers)?;
        match list.len() == count {
            true => Ok(list),
            false => Err(format!("accessors[{index}] has {} elements for {count} positions", list.len()).into()),
        }
    }

    /// Returns a value, or adds a note if it is invalid. Fails only if reading failed.
    fn noted<T>(&mut self, value: Parsed<T>, text: &'static str, name: &str) -> Parsed<Option<T>> {
        match value {
            Ok(value) => Ok(Some(value)),
            Err(Fault::Why(why)) => {
                self.notes.add(text, || format!("{name}: {why}"));
                Ok(None)
            }
            Err(failed) => Err(failed),
        }
    }

    /// Assembles triangles from the indices, or from the vertices in order.
    fn assemble(&mut self, primitive: &Primitive, name: &str, vertices: &Vertices, sink: &mut dyn Sink) -> Parsed<()> {
        let mut assembly = Assembly { mode: primitive.mode, corners: [0; 3], seen: 0 };
        let (batch, made) = (&mut self.batch, &mut self.triangles);
        let count = vertices.positions.len();
        let mut each = |index: u32, buffers: &Buffers<'_>| {
            if index as usize >= count {
                let at = assembly.seen;
                return Err(Fault::Why(format!("index {at} refers to vertex {index} of {count}")));
            }
            if let Some(corners) = assembly.next(index) {
                *made += 1;
                let [a, b, c] = corners.map(|i| i as usize);
                if batch.push(vertices.triangle([a, b, c]), vertices.values([a, b, c])) {
                    let (bytes, total) = buffers.progress();
                    sink.at(bytes, total);
                    batch.flush(sink)?;
                }
            }
            Ok(())
        };
        match primitive.indices {
            Some(index) => {
                let elements = Elements::open(self.model, index, &[1], &mut self.buffers)?;
                elements.indices(&mut self.buffers, each)?;
            }
            None => (0..count as u32).try_for_each(|i| each(i, &self.buffers))?,
        }
        if !assembly.is_complete() {
            self.notes.add("primitives have an incomplete last triangle", || name.into());
        }
        Ok(())
    }
}

impl Vertices {
    fn triangle(&self, corners: [usize; 3]) -> [DVec3; 3] {
        corners.map(|i| {
            let p = self.positions.get(i);
            self.world.map_or(p, |world| world.transform_point3(p))
        })
    }

    fn values(&self, corners: [usize; 3]) -> Corners {
        Corners { colours: self.colours(corners), normals: self.normals(corners) }
    }

    /// Returns the product of base colour factor, vertex colours and texture; `None` without vertex colours and
    /// texture.
    fn colours(&self, corners: [usize; 3]) -> Option<[[f32; 3]; 3]> {
        if self.colours.is_none() && self.texture.is_none() {
            return None;
        }
        let by = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|i| (a[i] * b[i]).clamp(0.0, 1.0));
        let mut factor = self.factor;
        if let Some((texture, mapping, uv)) = &self.texture {
            let corners: [Vec2; 3] = corners.map(|i| mapping.apply(uv[i]));
            factor = by(factor, texture.mean(corners, mapping).unwrap_or([1.0; 3]));
        }
        Some(self.colours.as_ref().map_or([factor; 3], |colours| corners.map(|i| by(factor, colours[i]))))
    }

    /// Returns the normals in the frame of the positions. Transforms take normals by the transpose of their inverse;
    /// the matrix of cofactors has the same directions and exists always.
    fn normals(&self, corners: [usize; 3]) -> Option<[Vec3; 3]> {
        let normals = self.normals.as_ref()?;
        Some(corners.map(|i| {
            let normal = Vec3::from(normals[i]);
            self.across.map_or(normal, |across| (across * normal.as_dvec3()).as_vec3())
        }))
    }
}

/// Assembles triangles from a sequence of indices.
struct Assembly {
    mode: Mode,
    corners: [u32; 3],
    seen: u64,
}

impl Assembly {
    /// Takes the next index. Returns a triangle if the index completes one.
    fn next(&mut self, index: u32) -> Option<[u32; 3]> {
        let n = self.seen;
        self.seen += 1;
        let [a, b, _] = self.corners;
        match self.mode {
            Mode::TriangleStrip => {
                self.corners = [b, index, 0];
                // Every other triangle has the opposite orientation.
                (n >= 2).then_some(if n.is_multiple_of(2) { [a, b, index] } else { [b, a, index] })
            }
            Mode::TriangleFan => {
                self.corners = if n == 0 { [index, index, 0] } else { [a, index, 0] };
                (n >= 2).then_some([a, b, index])
            }
            _ => {
                self.corners[(n % 3) as usize] = index;
                (n % 3 == 2).then_some(self.corners)
            }
        }
    }

    fn is_complete(&self) -> bool {
        match self.mode {
            Mode::TriangleStrip | Mode::TriangleFan => self.seen == 0 || self.seen >= 3,
            _ => self.seen.is_multiple_of(3),
        }
    }
}
