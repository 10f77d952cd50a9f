//! Models of flights.

use crate::changed::{self, Change};
use crate::flight::Content;
use glam::DVec3;
use outcrop::Result;
use outcrop::build::{BuildOptions, Builder};
use outcrop::import::generate::GenerateOptions;
use outcrop::import::{Attributes, MeshKey, PartDesc, PartKey, Sink};
use std::path::{Path, PathBuf};

/// Triangles of a part that is divided.
const RUN: usize = 33;

/// Divides each part into `into` parts, which take its triangles in turns of [`RUN`].
struct Divided {
    into: u32,
    /// The part in the build of each part, its first one, and the next turn.
    parts: Vec<(PartKey, u32)>,
}

impl Change for Divided {
    fn part(&mut self, to: &mut Builder, part: PartDesc) -> Result<PartKey> {
        let parent = part.parent.map(|parent| self.parts[parent as usize].0);
        let (name, material) = (part.name.clone(), part.material);
        let own = to.part(PartDesc { parent, id: None, ..part })?;
        for i in 1..self.into {
            let name = format!("{name}, piece {i}");
            to.part(PartDesc { id: None, name, parent: Some(own), material })?;
        }
        self.parts.push((own, 0));
        Ok(self.parts.len() as u32 - 1)
    }
    fn triangles(
        &mut self,
        to: &mut Builder,
        (mesh, part): (MeshKey, u32),
        positions: &[[DVec3; 3]],
        attributes: Attributes<'_>,
    ) -> Result<()> {
        if self.into == 1 {
            return to.triangles(mesh, self.parts[part as usize].0, positions, attributes);
        }
        for piece in positions.chunks(RUN) {
            let (first, turn) = &mut self.parts[part as usize];
            to.triangles(mesh, *first + *turn % self.into, piece, Attributes::NONE)?;
            *turn += 1;
        }
        Ok(())
    }
}

/// Builds a generated model, unless an earlier run has.
fn built(path: PathBuf, name: &str, size: &GenerateOptions, into: u32) -> PathBuf {
    if !path.exists() {
        let options = BuildOptions { threads: 2, memory_budget: 1 << 30, ..BuildOptions::default() };
        let report = changed::build(&path, name, size, options, Divided { into, parts: Vec::new() });
        println!("{}: {} triangles, {} parts", path.display(), report.triangles_kept, report.parts);
    }
    path
}

/// An airliner of 4,928 parts (at 10 million triangles), each of which is divided into `into` parts.
pub fn airliner(folder: &Path, triangles: u64, into: u32) -> PathBuf {
    let path = folder.join(format!("airliner-{triangles}-{into}-{}.oc", env!("CARGO_PKG_VERSION")));
    built(path, "airliner", &GenerateOptions { triangles, seed: 0, ..Default::default() }, into)
}

/// Instances of ten models of 1,000 to 10,000 triangles.
pub fn instances(folder: &Path, count: u64) -> Content {
    let model = |i: u64| {
        let path = folder.join(format!("small-{i}-{}.oc", env!("CARGO_PKG_VERSION")));
        built(path, "mandelbulb", &GenerateOptions { triangles: 1000 * (i + 1), seed: i, ..Default::default() }, 1)
    };
    Content::Instances((0..10).map(model).collect(), count)
}
