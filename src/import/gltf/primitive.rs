//! Conversion of a primitive, from its accessors to triangles in the sink.

use super::accessor::Elements;
use super::buffers::Buffers;
use super::materials::{Looks, Materials};
use super::texture::{Mapping, Texture};
use crate::import::batch::Batch;
use crate::import::colour::mean3;
use crate::import::input::{Fault, Parsed};
use crate::import::{MaterialDesc, MeshKey, Sink};
use ::gltf::json::Root;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DAffine3, DVec3, Vec2};
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
    positions: Vec<[f32; 3]>,
    /// Linear colours of `COLOR_0`.
    colours: Option<Vec<[f32; 3]>>,
    texture: Option<(Rc<Texture>, Mapping, Vec<[f32; 2]>)>,
    factor: [f32; 3],
    world: Option<DAffine3>,
}

/// Reads primitives and sends their triangles to the sink.
pub(crate) struct Emitter<'a> {
    root: &'a Root,
    buffers: Buffers<'a>,
    batch: Batch,
    triangles: u64,
    /// Number of primitives of points or lines, and of primitives with an incomplete last triangle.
    without_area: u64,
    incomplete: u64,
}

impl<'a> Emitter<'a> {
    pub(crate) fn new(root: &'a Root, buffers: Buffers<'a>) -> Self {
        Self { root, buffers, batch: Batch::new(0), triangles: 0, without_area: 0, incomplete: 0 }
    }

    pub(crate) fn buffers(&mut self) -> &mut Buffers<'a> {
        &mut self.buffers
    }

    pub(crate) fn flush(&mut self, sink: &mut dyn Sink) -> Parsed<()> {
        Ok(self.batch.flush(sink)?)
    }

    pub(crate) fn finish(&mut self, sink: &mut dyn Sink) -> Parsed<()> {
        self.flush(sink)
    }

    /// Reads one primitive into part `target.first_part`. Errors refer to the primitive by `name`.
    pub(crate) fn primitive(
        &mut self,
        primitive: &Primitive,
        name: &str,
        target: Target,
        looks: Option<Looks>,
        materials: &mut Materials,
        sink: &mut dyn Sink,
    ) -> Parsed<()> {
        let mode = match primitive.mode {
            Checked::Valid(mode) => mode,
            Checked::Invalid => return Err(format!("{name} has an unknown mode").into()),
        };
        if !has_area(mode) {
            self.without_area += 1;
            return Ok(());
        }
        let named = |fault| match fault {
            Fault::Why(why) => Fault::Why(format!("{name}: {why}")),
            failed => failed,
        };
        let vertices = self.vertices(primitive, target, &looks, materials, sink).map_err(named)?;
        let colour = looks.map_or(MaterialDesc::default().colour, |l| l.colour);
        self.batch.aim(target.mesh, target.first_part, colour, sink)?;
        self.assemble(primitive, mode, &vertices, sink).map_err(named)
    }

    fn vertices(
        &mut self,
        primitive: &Primitive,
        target: Target,
        looks: &Option<Looks>,
        materials: &mut Materials,
        sink: &mut dyn Sink,
    ) -> Parsed<Vertices> {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value());
        let Some(positions) = attribute(Semantic::Positions) else {
            return Err("has no positions".into());
        };
        let positions =
            Elements::open(self.root, positions, &[3], &mut self.buffers)?.floats::<3>(&mut self.buffers)?;
        let same_count = |what: &str, n: usize| match n == positions.len() {
            true => Ok(()),
            false => Err(Fault::Why(format!("{n} {what} for {} positions", positions.len()))),
        };
        let mut colours = None;
        if let Some(index) = attribute(Semantic::Colors(0)) {
            let list = Elements::open(self.root, index, &[3, 4], &mut self.buffers)?.floats::<3>(&mut self.buffers)?;
            same_count("colours", list.len())?;
            colours = Some(list);
        }
        let mut texture = None;
        if let Some((index, mapping)) = looks.as_ref().and_then(|l| l.texture)
            && let Some(coordinates) = attribute(Semantic::TexCoords(mapping.set))
            && let Some(decoded) = materials.texture(index, self.root, &mut self.buffers, sink)?
        {
            let list =
                Elements::open(self.root, coordinates, &[2], &mut self.buffers)?.floats::<2>(&mut self.buffers)?;
            same_count("texture coordinates", list.len())?;
            texture = Some((decoded, mapping, list));
        }
        let factor = looks.as_ref().map_or([1.0; 3], |l| l.colour);
        Ok(Vertices { positions, colours, texture, factor, world: target.world })
    }

    /// Assembles triangles from the indices, or from the vertices in order.
    fn assemble(&mut self, primitive: &Primitive, mode: Mode, vertices: &Vertices, sink: &mut dyn Sink) -> Parsed<()> {
        let mut assembly = Assembly { mode, corners: [0; 3], seen: 0 };
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
                if batch.push(vertices.triangle([a, b, c]), vertices.colour([a, b, c])) {
                    let (bytes, total) = buffers.progress();
                    sink.at(bytes, total);
                    batch.flush(sink)?;
                }
            }
            Ok(())
        };
        match primitive.indices {
            Some(index) => {
                let elements = Elements::open(self.root, index.value(), &[1], &mut self.buffers)?;
                elements.indices(&mut self.buffers, each)?;
            }
            None => (0..count as u32).try_for_each(|i| each(i, &self.buffers))?,
        }
        self.incomplete += u64::from(!assembly.is_complete());
        Ok(())
    }

    /// Returns the notes for the user after everything was read.
    pub(crate) fn notes(&self) -> Vec<String> {
        let (root, mut notes) = (self.root, Vec::new());
        let mut note = |n: u64, text: &str| {
            if n > 0 {
                notes.push(format!("{n} {text}"));
            }
        };
        note(self.without_area, "primitives of points or lines make no triangles");
        note(self.incomplete, "primitives have an incomplete last triangle");
        note(root.skins.len() as u64, "skins stay in their bind pose");
        note(root.animations.len() as u64, "animations were ignored");
        let masked = |m: &&::gltf::json::Material| {
            !matches!(m.alpha_mode, Checked::Valid(::gltf::json::material::AlphaMode::Opaque))
        };
        let cut =
            root.materials.iter().filter(masked).filter(|m| m.pbr_metallic_roughness.base_color_texture.is_some());
        note(cut.count() as u64, "materials with transparent textures are shown without the transparency");
        let unknown = |e: &&String| {
            matches!(e.as_str(), "EXT_mesh_gpu_instancing" | "KHR_draco_mesh_compression" | "EXT_meshopt_compression")
        };
        for extension in root.extensions_used.iter().filter(unknown) {
            notes.push(format!("the extension {extension} was ignored"));
        }
        if self.triangles == 0 {
            notes.push("no triangles; the model is empty".into());
        }
        notes
    }
}

impl Vertices {
    fn triangle(&self, corners: [usize; 3]) -> [DVec3; 3] {
        corners.map(|i| {
            let p = DVec3::from(self.positions[i].map(f64::from));
            self.world.map_or(p, |world| world.transform_point3(p))
        })
    }

    /// Returns the product of base colour factor, vertex colours and texture; `None` without vertex colours and
    /// texture.
    fn colour(&self, corners: [usize; 3]) -> Option<[f32; 3]> {
        if self.colours.is_none() && self.texture.is_none() {
            return None;
        }
        let mut colour = self.factor;
        let mut by = |other: [f32; 3]| (0..3).for_each(|i| colour[i] = (colour[i] * other[i]).clamp(0.0, 1.0));
        if let Some(colours) = &self.colours {
            by(mean3(colours[corners[0]], colours[corners[1]], colours[corners[2]]));
        }
        if let Some((texture, mapping, uv)) = &self.texture {
            let corners: [Vec2; 3] = corners.map(|i| mapping.apply(uv[i]));
            by(texture.mean(corners, mapping).unwrap_or([1.0; 3]));
        }
        Some(colour)
    }
}

/// True for modes that draw triangles.
pub(crate) fn has_area(mode: Mode) -> bool {
    matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
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
