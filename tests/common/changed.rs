//! Generated models with changes on their way to the build.

use glam::{DAffine3, DVec3};
use outcrop::base::error::Result;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::base::units::UpAxis;
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{Attributes, MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, Sink};
use std::path::Path;
use std::sync::Arc;

/// What becomes of a model's materials, parts and triangles. By default they are passed on.
pub trait Change {
    fn material(&mut self, to: &mut Builder, material: MaterialDesc) -> Result<MaterialKey> {
        to.material(material)
    }
    fn part(&mut self, to: &mut Builder, part: PartDesc) -> Result<PartKey> {
        to.part(part)
    }
    fn triangles(
        &mut self,
        to: &mut Builder,
        (mesh, part): (MeshKey, u32),
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        to.triangles(mesh, part, positions, attributes)
    }
}

struct Changed<'a, C> {
    to: &'a mut Builder,
    by: C,
}

impl<C: Change> Sink for Changed<'_, C> {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) {
        self.to.units(metres_per_unit, up);
    }
    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        self.by.material(self.to, material)
    }
    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        self.by.part(self.to, part)
    }
    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        self.to.shared_mesh(local_parts)
    }
    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        self.by.triangles(self.to, (mesh, part), positions, attributes)
    }
    fn instance(&mut self, mesh: MeshKey, world_from_mesh: DAffine3, first_part: PartKey) -> Result<()> {
        self.to.instance(mesh, world_from_mesh, first_part)
    }
    fn at(&mut self, bytes: u64, total: u64) {
        self.to.at(bytes, total);
    }
    fn note(&mut self, text: String) {
        self.to.note(text);
    }
    fn cancel(&self) -> &Cancel {
        self.to.cancel()
    }
}

/// Builds generated model `name` with a change.
pub fn build(path: &Path, name: &str, size: &GenerateOptions, options: BuildOptions, by: impl Change) -> BuildReport {
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    generate(name, size, &Cancel::new(), &mut Changed { to: &mut builder, by }).expect("a generated model");
    builder.finish(path).expect("a model")
}
