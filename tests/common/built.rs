//! Models built from triangle lists and opened through the public API.

use super::brute::Tri;
use glam::DAffine3;
use outcrop::base::progress::{Cancel, Progress};
use outcrop::build::{BuildOptions, BuildReport, Builder, Structure};
use outcrop::import::{Attributes, MaterialDesc, MeshKey, PartDesc, Sink};
use outcrop::scene::{Context, ContextOptions, Model, Scene};
use std::cell::Cell;
use std::path::PathBuf;
use std::sync::Arc;

thread_local! {
    static STRUCTURE: Cell<Structure> = const { Cell::new(Structure::Bvh) };
}

/// The structure of all models that this thread builds: that of the running test.
pub fn structure() -> Structure {
    STRUCTURE.get()
}

/// Whether that is the one whose own numbers (bytes, blocks, cells) a test may state.
pub fn is_bvh() -> bool {
    structure() == Structure::Bvh
}

/// A size for a bvh, and one for a structure that takes time in proportion to the triangles.
pub fn sized<T>(of_bvh: T, of_others: T) -> T {
    if is_bvh() { of_bvh } else { of_others }
}

/// Runs `test` with models of a structure.
pub fn with<T>(structure: Structure, test: impl FnOnce() -> T) -> T {
    /// Sets back what was before, also where the test panics.
    struct Before(Structure);
    impl Drop for Before {
        fn drop(&mut self) {
            STRUCTURE.set(self.0);
        }
    }
    let _before = Before(STRUCTURE.replace(structure));
    test()
}

/// A value for each structure, made when first asked for.
pub struct OfEach<T>([std::sync::OnceLock<T>; Structure::ALL.len()]);

impl<T> OfEach<T> {
    pub const fn new() -> Self {
        Self([const { std::sync::OnceLock::new() }; Structure::ALL.len()])
    }

    /// That of the running test.
    pub fn get(&self, make: impl FnOnce() -> T) -> &T {
        let index = Structure::ALL.iter().position(|one| *one == structure()).expect("a structure");
        self.0[index].get_or_init(make)
    }
}

/// A test for each structure and function: `on_each_structure!(check)` makes `bvh::check` and `brute::check`, which
/// build with theirs.
#[allow(unused_macros)]
macro_rules! on_each_structure {
    ($($test:ident),+ $(,)?) => {
        mod bvh {
            $crate::common::built::on_each_structure!(@ Bvh: $($test),+);
        }
        mod brute {
            $crate::common::built::on_each_structure!(@ Brute: $($test),+);
        }
    };
    (@ $structure:ident: $($test:ident),+) => {
        $(
            #[test]
            fn $test() {
                $crate::common::built::with(outcrop::build::Structure::$structure, super::$test);
            }
        )+
    };
}
#[allow(unused_imports)]
pub(crate) use on_each_structure;

/// A part to build: its id, its material, its triangles.
pub struct Part {
    pub id: u64,
    pub material: MaterialDesc,
    pub tris: Vec<Tri>,
}

/// White and matt.
pub const WHITE: MaterialDesc = MaterialDesc { colour: [1.0; 3], opacity: 1.0, metalness: 0.0, roughness: 1.0 };

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

/// Usual options, for the structure of the running test.
pub fn options() -> BuildOptions {
    BuildOptions { structure: structure(), ..Default::default() }
}

/// Builds a file; `fill` pushes into the sink.
pub fn build(fill: impl FnOnce(&mut Builder)) -> Built {
    build_with(BuildOptions { threads: 1, ..options() }, fill).0
}

/// The same with other [`options`]; and what is said of the build.
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
    let desc =
        PartDesc { id: Some(part.id), name: format!("part {}", part.id), parent: None, material: Some(material) };
    let key = builder.part(desc).expect("a part");
    builder.triangles(MeshKey::DIRECT, key, &part.tris, Attributes::NONE).expect("triangles");
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
