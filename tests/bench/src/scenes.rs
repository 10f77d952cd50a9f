//! Scenes: their triangles for peers and the oracle, and the models built of them, kept in `target/bench`.

use crate::assemblies;
use crate::common::{models, scenes};
use crate::data::{SceneRow, StructureRow};
use crate::everyday;
use crate::failure::{Failure, Outcome};
use crate::ours::ModelAt;
use crate::placed::{self, Placed};
use glam::{DAffine3, DVec3, Vec3};
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::collect::Collector;
use outcrop::import::generate::{GenerateOptions, generate};
use outcrop::import::{Attributes, MeshKey, PartDesc, ReadOptions, Sink, read_file};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Triangles in single precision, corners shared: what peers take.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    pub vertices: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// Of each triangle; peers know none.
    pub parts: Vec<u32>,
}

impl Mesh {
    /// Shares equal corners. A primitive is an index into the input, also here.
    pub fn of(triangles: impl Iterator<Item = (u32, [DVec3; 3])>) -> Self {
        let mut mesh = Self::default();
        let mut known = HashMap::new();
        for (part, corners) in triangles {
            let triangle = corners.map(|corner| {
                let corner = corner.as_vec3().to_array();
                *known.entry(corner.map(f32::to_bits)).or_insert_with(|| {
                    mesh.vertices.push(corner);
                    mesh.vertices.len() as u32 - 1
                })
            });
            mesh.triangles.push(triangle);
            mesh.parts.push(part);
        }
        mesh
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|i| Vec3::from(self.vertices[i as usize]).as_dvec3())
    }

    /// Bytes of vertices and indices.
    pub fn bytes(&self) -> u64 {
        (12 * self.vertices.len() + 12 * self.triangles.len()) as u64
    }
}

/// A scene that is here.
pub struct Scene {
    pub row: SceneRow,
    source: Source,
}

enum Source {
    Generator(String),
    /// Of each part.
    Triangles(Vec<Vec<[DVec3; 3]>>),
    File(PathBuf),
    Assembly(assemblies::Kind),
    Everyday(everyday::Kind),
}

impl Scene {
    /// `None` after a message if it is of a file that is not here.
    pub fn find(row: &SceneRow) -> Result<Option<Self>, Failure> {
        let source = match (&row.generator, &row.formula, &row.file, &row.assembly, &row.everyday) {
            (Some(name), ..) => Source::Generator(name.clone()),
            (_, Some(name), ..) => Source::Triangles(formula(name, row)?),
            (.., Some(name), _) => Source::Assembly(assemblies::Kind::of(name)?),
            (.., Some(name)) => Source::Everyday(everyday::Kind::of(name)?),
            (_, _, Some(file), ..) => match models::find(file) {
                Some(path) => Source::File(path),
                None => return Ok(None),
            },
            _ => return Err(Failure::new(format!("scene {:?} comes from nowhere", row.name))),
        };
        Ok(Some(Self { row: row.clone(), source }))
    }

    /// The file that it comes from, if it does.
    pub fn file(&self) -> Option<&Path> {
        if let Source::File(path) = &self.source { Some(path) } else { None }
    }

    /// Sends its triangles to a sink.
    pub fn fill(&self, sink: &mut dyn Sink) -> Outcome {
        match &self.source {
            Source::Generator(name) => {
                let options =
                    GenerateOptions { triangles: self.row.triangles, seed: self.row.seed, ..Default::default() };
                generate(name, &options, &Cancel::new(), sink)?;
            }
            Source::Triangles(parts) => {
                for (id, triangles) in (1..).zip(parts) {
                    let name = self.row.name.clone();
                    let part = sink.part(PartDesc { id: Some(id), name, ..PartDesc::default() })?;
                    sink.triangles(MeshKey::DIRECT, part, triangles, Attributes::NONE)?;
                }
            }
            Source::File(path) => read_file(path, &ReadOptions::default(), sink)?,
            Source::Assembly(kind) => kind.fill(&self.row, sink)?,
            Source::Everyday(kind) => kind.fill(&self.row, sink)?,
        }
        Ok(())
    }

    fn collected(&self) -> Result<Collector, Failure> {
        let mut collector = Collector::new();
        self.fill(&mut collector)?;
        Ok(collector)
    }

    /// The places of its model: the origin, and those that the row adds.
    fn places(&self) -> Vec<DAffine3> {
        let others = self.row.also_at.iter().map(|at| DAffine3::from_translation((*at).into()));
        std::iter::once(DAffine3::IDENTITY).chain(others).collect()
    }

    /// Its triangles where they are seen, of a model that is placed once.
    pub fn mesh(&self) -> Result<Mesh, Failure> {
        Ok(Mesh::of(self.collected()?.placed().map(|t| (t.part, t.positions))))
    }

    /// Its meshes with all their placements.
    pub fn placed(&self) -> Result<Placed, Failure> {
        Ok(Placed::of(&self.collected()?, &self.places()))
    }

    /// Builds it as it would be built from files: the clock of the caller also counts making the triangles.
    pub fn build(&self, structure: &StructureRow, threads: usize, to: &Path) -> Result<BuildReport, Failure> {
        let mut builder = builder(structure, threads)?;
        self.fill(&mut builder)?;
        Ok(builder.finish(to)?)
    }

    /// Its model, at all its places.
    pub fn model(&self, structure: &StructureRow) -> Result<ModelAt, Failure> {
        let path = self.kept(structure, &structure.name, &|to| self.build(structure, 0, to).map(|_| ()))?;
        Ok(ModelAt { path, places: self.places() })
    }

    /// All its triangles, each where it is seen, as one model of one tree.
    pub fn flattened(&self, structure: &StructureRow, name: &str) -> Result<ModelAt, Failure> {
        let build = |to: &Path| {
            let mut builder = builder(structure, 0)?;
            placed::flatten(&self.collected()?, &self.places(), &mut builder)?;
            builder.finish(to)?;
            Ok(())
        };
        Ok(ModelAt::once(self.kept(structure, name, &build)?))
    }

    /// The model that `build` makes, made by this very program: a model of an older version is replaced.
    pub fn kept(
        &self,
        structure: &StructureRow,
        called: &str,
        build: &dyn Fn(&Path) -> Outcome,
    ) -> Result<PathBuf, Failure> {
        let folder = folder().join("models");
        std::fs::create_dir_all(&folder)?;
        let mut made_by = std::fs::read(std::env::current_exe()?)?;
        made_by.extend(format!("{structure:?}{:?}", self.row).bytes());
        let stem = format!("{}-{called}-", self.row.name);
        let name = format!("{stem}{:016x}.oc", xxhash_rust::xxh3::xxh3_64(&made_by));
        let path = folder.join(&name);
        if !path.is_file() {
            for old in std::fs::read_dir(&folder)?.flatten() {
                // What is left of the name is the hash: another structure's name may begin like this one's.
                let is_of_this =
                    old.file_name().to_string_lossy().strip_prefix(&stem).is_some_and(|hash| !hash.contains('-'));
                if is_of_this {
                    std::fs::remove_file(old.path())?;
                }
            }
            eprintln!("building {}, {called}", self.row.name);
            build(&path)?;
        }
        Ok(path)
    }
}

/// A builder with so many threads; 0 for all.
pub fn builder(structure: &StructureRow, threads: usize) -> Result<Builder, Failure> {
    builder_with(BuildOptions { threads, ..structure.options()? })
}

pub fn builder_with(options: BuildOptions) -> Result<Builder, Failure> {
    Ok(Builder::new(options, Arc::new(Progress::default()), Cancel::new())?)
}

/// A scene of `tests/common/scenes.rs`, part by part.
fn formula(name: &str, row: &SceneRow) -> Result<Vec<Vec<[DVec3; 3]>>, Failure> {
    match name {
        "wire_forest" => Ok(vec![scenes::wire_forest(row.count, 24, row.seed)]),
        "wires" => Ok(scenes::wires(row.count, 24, row.seed).collect()),
        _ => Err(Failure::new(format!("scene {:?}: no formula {name:?}", row.name))),
    }
}

/// Where results and models are kept.
pub fn folder() -> PathBuf {
    models::checkout().join("target/bench")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_are_shared_and_primitives_keep_their_numbers() {
        let [a, b, c, d] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let mesh = Mesh::of([[a, b, c], [c, b, d], [a, b, c]].into_iter().zip([0, 0, 1]).map(|(t, part)| (part, t)));
        assert_eq!(mesh.vertices.len(), 4);
        assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [0, 1, 2]]);
        assert_eq!(mesh.bytes(), 84);
    }

    #[test]
    fn a_wire_forest_is_closed_and_thin() {
        let tris = scenes::wire_forest(7, 24, 1);
        // Every edge has a neighbour that runs the other way.
        let mut edges = HashMap::new();
        for tri in &tris {
            for i in 0..3 {
                let [from, to] = [tri[i], tri[(i + 1) % 3]].map(|v| v.to_array().map(f64::to_bits));
                *edges.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
        assert!(!edges.is_empty() && edges.values().all(|&n| n == 0), "an open edge");
        let area: f64 = tris.iter().map(|t| (t[1] - t[0]).cross(t[2] - t[0]).length() / 2.0).sum();
        assert!(area < 7.0 * 7.0 * std::f64::consts::TAU * 0.006, "{area}");
    }
}
