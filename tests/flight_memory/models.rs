//! Models of flights.

use crate::flight::Content;
use glam::{DAffine3, DVec3};
use outcrop::Result;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::base::units::UpAxis;
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{MaterialDesc, MaterialKey, MeshKey, PartDesc, PartKey, Sink};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Triangles of a part that is divided.
const RUN: usize = 33;

/// Divides each part into `into` parts, which take its triangles in turns of [`RUN`].
struct Divided<'a> {
    to: &'a mut Builder,
    into: u32,
    /// The part in `to` of each part, its first one, and the next turn.
    parts: Vec<(PartKey, u32)>,
}

impl Sink for Divided<'_> {
    fn units(&mut self, metres_per_unit: Option<f64>, up: UpAxis) {
        self.to.units(metres_per_unit, up);
    }
    fn material(&mut self, material: MaterialDesc) -> Result<MaterialKey> {
        self.to.material(material)
    }
    fn part(&mut self, part: PartDesc) -> Result<PartKey> {
        let parent = part.parent.map(|parent| self.parts[parent as usize].0);
        let (name, material) = (part.name.clone(), part.material);
        let own = self.to.part(PartDesc { parent, id: None, ..part })?;
        for i in 1..self.into {
            let name = format!("{name}, piece {i}");
            self.to.part(PartDesc { id: None, name, parent: Some(own), material })?;
        }
        self.parts.push((own, 0));
        Ok(self.parts.len() as u32 - 1)
    }
    fn shared_mesh(&mut self, local_parts: u32) -> Result<MeshKey> {
        self.to.shared_mesh(local_parts)
    }
    fn triangles(
        &mut self,
        mesh: MeshKey,
        part: u32,
        positions: &[[DVec3; 3]],
        colours: Option<&[[f32; 3]]>,
    ) -> Result<()> {
        if self.into == 1 {
            return self.to.triangles(mesh, self.parts[part as usize].0, positions, colours);
        }
        for piece in positions.chunks(RUN) {
            let (first, turn) = &mut self.parts[part as usize];
            self.to.triangles(mesh, *first + *turn % self.into, piece, None)?;
            *turn += 1;
        }
        Ok(())
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

/// Builds a generated model, unless an earlier run has.
fn built(path: PathBuf, name: &str, options: &GenerateOptions, into: u32) -> PathBuf {
    if !path.exists() {
        let options_of_build = BuildOptions { threads: 2, memory_budget: 1 << 30, ..BuildOptions::default() };
        let mut builder =
            Builder::new(options_of_build, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
        let mut divided = Divided { to: &mut builder, into, parts: Vec::new() };
        generate(name, options, &Cancel::new(), &mut divided).expect("a model");
        let report = builder.finish(&path).expect("a model");
        println!("{}: {} triangles, {} parts", path.display(), report.triangles_kept, report.parts);
    }
    path
}

/// An airliner of 4,928 parts (at 10 million triangles), each of which is divided into `into` parts.
pub fn airliner(folder: &Path, triangles: u64, into: u32) -> PathBuf {
    let path = folder.join(format!("airliner-{triangles}-{into}-{}.oc", env!("CARGO_PKG_VERSION")));
    built(path, "airliner", &GenerateOptions { triangles, seed: 0 }, into)
}

/// Instances of ten models of 1,000 to 10,000 triangles.
pub fn instances(folder: &Path, count: u64) -> Content {
    let model = |i: u64| {
        let path = folder.join(format!("small-{i}-{}.oc", env!("CARGO_PKG_VERSION")));
        built(path, "mandelbulb", &GenerateOptions { triangles: 1000 * (i + 1), seed: i }, 1)
    };
    Content::Instances((0..10).map(model).collect(), count)
}
