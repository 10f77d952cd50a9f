//! Models built from triangle lists and opened through the public API.

use super::brute::Tri;
use glam::DAffine3;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder};
use outcrop::import::{MaterialDesc, MeshKey, PartDesc, Sink};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use std::path::PathBuf;
use std::sync::Arc;

/// A part to build: its id, its material, its triangles.
pub struct Part {
    pub id: u64,
    pub material: MaterialDesc,
    pub tris: Vec<Tri>,
}

/// White and matt.
pub const WHITE: MaterialDesc =
    MaterialDesc { colour: [1.0; 3], opacity: 1.0, metalness: 0.0, roughness: 1.0 };

impl Part {
    pub fn white(id: u64, tris: Vec<Tri>) -> Self {
        Self { id, material: WHITE, tris }
    }
}

/// A built file in a folder of its own, gone with it.
pub struct Built {
    pub path: PathBuf,
    _folder: tempfile::TempDir,
}

/// Builds a file; `fill` pushes into the sink.
pub fn build(fill: impl FnOnce(&mut Builder)) -> Built {
    build_with(BuildOptions { threads: 1, ..Default::default() }, fill).0
}

/// The same with options; and what is said of the build.
pub fn build_with(options: BuildOptions, fill: impl FnOnce(&mut Builder)) -> (Built, BuildReport) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("model.oc");
    let mut builder = Builder::new(options, Arc::new(Progress::default()), Cancel::new()).expect("a builder");
    fill(&mut builder);
    let report = builder.finish(&path).expect("a build");
    (Built { path, _folder: folder }, report)
}

/// Pushes a part's triangles into `mesh`.
pub fn push(builder: &mut Builder, part: &Part) {
    let material = builder.material(part.material).expect("a material");
    let desc = PartDesc { id: Some(part.id), name: format!("part {}", part.id), parent: None, material: Some(material) };
    let key = builder.part(desc).expect("a part");
    builder.triangles(MeshKey::DIRECT, key, &part.tris, None).expect("triangles");
}

pub fn parts(parts: &[Part]) -> Built {
    build(|builder| parts.iter().for_each(|p| push(builder, p)))
}

pub fn context(threads: usize) -> Context {
    Context::new(ContextOptions { threads, ..Default::default() }).expect("a context")
}

/// A scene with one instance, id 7, of the built model.
pub fn scene(context: &Context, built: &Built) -> (Scene, Model) {
    let model = Model::open(context, &built.path).expect("a model");
    let scene = Scene::new(context);
    scene.add_instance(&model, 7, DAffine3::IDENTITY).expect("an instance");
    scene.commit().expect("a commit");
    (scene, model)
}
