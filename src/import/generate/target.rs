//! Targets of generated triangles, with shared vertices or as soup.

use super::Generated;
use crate::base::error::Result;
use crate::import::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, Sink, UpAxis};
use glam::DVec3;

/// Number of triangles per call of a sink.
const BATCH: usize = 1 << 14;

/// Receives a generated model.
pub trait Target {
    /// Sets length unit and up axis, before any other call.
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) -> Result<()>;
    /// Adds a material.
    fn material(&mut self, material: MaterialDesc, name: &str) -> Result<MaterialKey>;
    /// Adds a part.
    fn part(&mut self, part: PartDesc) -> Result<PartKey>;
    /// Adds new vertices, numbered after the earlier ones, and triangles that refer to any vertex so far. `at` returns
    /// the position of any vertex that these triangles use.
    fn indexed(
        &mut self,
        part: PartKey,
        vertices: &[[f32; 3]],
        faces: &[[u32; 3]],
        at: &dyn Fn(u32) -> [f32; 3],
    ) -> Result<()>;
    /// Adds triangles that share no vertices.
    fn soup(&mut self, part: PartKey, triangles: &[[[f32; 3]; 3]]) -> Result<()>;
}

/// A target that passes everything on to a [`Sink`].
pub struct SinkTarget<'a> {
    sink: &'a mut dyn Sink,
    batch: Vec<[DVec3; 3]>,
    /// Counts so far.
    pub generated: Generated,
}

impl<'a> SinkTarget<'a> {
    /// Creates a target that writes to `sink`.
    pub fn new(sink: &'a mut dyn Sink) -> Self {
        Self { sink, batch: Vec::with_capacity(BATCH), generated: Generated::default() }
    }

    fn send(&mut self, part: PartKey, triangles: impl Iterator<Item = [[f32; 3]; 3]>) -> Result<()> {
        let mut triangles = triangles.map(|t| t.map(|p| DVec3::from(p.map(f64::from))));
        loop {
            self.batch.clear();
            self.batch.extend(triangles.by_ref().take(BATCH));
            if self.batch.is_empty() {
                return Ok(());
            }
            self.sink.cancel().check()?;
            self.generated.triangles += self.batch.len() as u64;
            self.sink.triangles(MeshKey::DIRECT, part, &self.batch, Attributes::NONE)?;
        }
    }
}

impl Target for SinkTarget<'_> {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) -> Result<()> {
        self.sink.units(metres_per_unit, up);
        Ok(())
    }

    fn material(&mut self, material: MaterialDesc, _: &str) -> Result<MaterialKey> {
        self.sink.material(material)
    }

    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        self.generated.parts += 1;
        self.sink.part(part)
    }

    fn indexed(
        &mut self,
        part: PartKey,
        vertices: &[[f32; 3]],
        faces: &[[u32; 3]],
        at: &dyn Fn(u32) -> [f32; 3],
    ) -> Result<()> {
        self.generated.vertices += vertices.len() as u64;
        self.send(part, faces.iter().map(|f| f.map(at)))
    }

    fn soup(&mut self, part: PartKey, triangles: &[[[f32; 3]; 3]]) -> Result<()> {
        self.generated.vertices += 3 * triangles.len() as u64;
        self.send(part, triangles.iter().copied())
    }
}
